# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""`posfet design`: the report of a design file, its netlist, a simulation, a sweep, and a tolerance analysis."""

from __future__ import annotations

import argparse
import importlib
import json
import os
import sys
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from posfet_model.command_line import BAD_INPUT, ignoring_broken_pipe, progress_bar
from posfet_model.config import ConfigError, write_text
from posfet_model.design import report, sweep_report, tolerance_report
from posfet_model.design.design_file import DesignFile, load_design, shipped
from posfet_model.design.options import check_options, make_parser
from posfet_model.design.posfet_design import PosfetDesign
from posfet_model.design.signal_file import read_signal, signal_csv
from posfet_model.design.simulation import simulate
from posfet_model.design.sweep import joblib_is_there, run_sweep
from posfet_model.design.tolerance import Tolerance, run_tolerance
from posfet_model.device.taxel_fields import plausible_fields

LONG_OSCILLATION: Final = 2000.0
"""Periods of the unity crossing for which an unstable follower is simulated without a remark: some seconds."""


def main(words: Sequence[str] | None = None) -> int:
    """Print the report and write what is asked for; return 0, or 1 with one line on stderr for bad input."""
    options = make_parser().parse_args(words)
    if options.list:
        print("\n".join(shipped()))
        return 0
    try:
        _run(options)
    except (ConfigError, ValueError) as error:
        print(f"posfet design: {' '.join(str(error).split())}", file=sys.stderr)
        return BAD_INPUT
    return 0


def _run(options: argparse.Namespace) -> None:
    check_options(options)
    if options.plot is not None:
        _plots().check_format(options.plot)
    loaded = load_design(options.file)
    if options.netlist is not None:
        write_text(options.netlist, f"{loaded.design.netlist(_circuit_name(loaded.name))}\n")
    parts: dict[str, tuple[Any, str]] = {}
    if loaded.adjusted:
        parts["adjusted"] = loaded.adjusted, _adjusted_text(loaded.adjusted)
    if options.simulate is not None:
        parts["simulation"] = _simulate(loaded.design, options)
    if options.sweep is not None:
        parts["sweep"] = _sweep(loaded, options)
    if options.tolerance is not None:
        parts["tolerance"] = _tolerance(loaded, options)
    if options.json:
        document = report.as_json(loaded.design) | {key: part for key, (part, _) in parts.items()}
        print(json.dumps(document, indent=2, allow_nan=False))
    else:
        print("\n".join([report.as_text(loaded.design), *(text for _, text in parts.values())]))


def _adjusted_text(adjusted: dict[str, float]) -> str:
    units = plausible_fields(PosfetDesign)
    shown = (f"{key} {report.readable(value, units[key].unit)}" for key, value in adjusted.items())
    return f"adjusted to the measured figures: {', '.join(shown)}"


def _simulate(design: PosfetDesign, options: argparse.Namespace) -> tuple[dict[str, Any], str]:
    signal = read_signal(options.simulate)
    wanted = np.ones(signal.time.size, np.bool_)
    if options.dt is not None:
        signal, wanted = signal.with_even_times(options.dt)
    follower = design.linear_follower() if options.linear else design.follower(float(np.ptp(signal.v_in)))
    periods = float(design.amplifier.gain_bandwidth) * float(np.ptp(signal.time))
    if not (options.linear or design.amplifier.stable) and periods > LONG_OSCILLATION:
        print(
            f"posfet design: unstable: some {periods:.0e} periods of oscillation are integrated, which may take long; "
            "--linear does not",
            file=sys.stderr,
        )
    run = simulate(follower, signal, progress_bar(signal.time.size, "samples"))
    write_text(options.out, signal_csv(signal, run.v_out, wanted))
    valid, total = int(np.count_nonzero(run.valid[wanted])), int(np.count_nonzero(wanted))
    lines = [f"{options.out}: {total} samples, the model is valid for {valid} of them"]
    found = [(one, signal.written(one.first_time)) for one in run.findings(signal.time, wanted)]
    lines += [f"  not valid for {one.samples}, first at {first} s: {one.reason}" for one, first in found]
    reasons = [{"reason": one.reason, "samples": one.samples, "first_time_s": float(first)} for one, first in found]
    return {"samples": total, "valid_samples": valid, "reasons": reasons}, "\n".join(lines)


def _sweep(loaded: DesignFile, options: argparse.Namespace) -> tuple[dict[str, Any], str]:
    if loaded.sweep is None:
        raise ConfigError(f"{options.file}: sweep: missing, must be a range or a list of ranges for --sweep")
    jobs = options.jobs or os.cpu_count() or 1
    if options.jobs and jobs > 1 and not joblib_is_there():
        print("posfet design: joblib is not installed, one process is used", file=sys.stderr)
    try:
        result = run_sweep(loaded.design, loaded.sweep, jobs, progress_bar(loaded.sweep.designs, "designs"))
    except ValueError as error:
        raise ConfigError(f"{options.file}: sweep: {error}") from None
    write_text(options.sweep, result.csv())
    if options.plot is not None:
        try:
            _plots().save_front(result, options.plot)
        except OSError as error:
            raise ConfigError(f"{options.plot}: cannot be written: {error.strerror}") from error
    summary = sweep_report.as_json(result)
    return summary, f"\n{sweep_report.as_text(summary, options.sweep)}"


def _tolerance(loaded: DesignFile, options: argparse.Namespace) -> tuple[dict[str, Any], str]:
    try:
        result = run_tolerance(loaded.design, loaded.tolerance or Tolerance())
    except ValueError as error:
        raise ConfigError(f"{options.file}: tolerance: of a random sample, {error}; give a smaller spread") from None
    write_text(options.tolerance, result.csv())
    return tolerance_report.as_json(result), f"\n{tolerance_report.as_text(result)}"


def _plots() -> Any:
    try:
        return importlib.import_module("posfet_model.figures.design_sweep")
    except ModuleNotFoundError as error:
        raise ConfigError(f"--plot: needs {error.name} (pip install matplotlib)") from None


def _circuit_name(name: str) -> str:
    """Return the name with only the characters that a netlist allows."""
    return "".join(c if c.isascii() and c.isalnum() else "_" for c in name).strip("_") or "design"


if __name__ == "__main__":
    sys.exit(ignoring_broken_pipe(main))
