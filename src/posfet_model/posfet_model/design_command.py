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
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from posfet_model._lib.shown import one_line
from posfet_model.command_line import ignoring_broken_pipe, positive
from posfet_model.config import ConfigError, write_text
from posfet_model.design import report
from posfet_model.design.design_file import DesignFile, load_design, shipped
from posfet_model.design.posfet_design import PosfetDesign
from posfet_model.design.signal_file import read_signal, signal_csv
from posfet_model.design.simulation import simulate
from posfet_model.design.sweep import OBJECTIVES, SweepResult, joblib_is_there, run_sweep
from posfet_model.design.tolerance import QUANTILES, Tolerance, ToleranceResult, run_tolerance
from posfet_model.device.taxel_fields import plausible_fields

BAD_INPUT: Final = 1
"""Exit code for bad input."""

FRONT_ROWS: Final = 20
"""Most designs of a Pareto front that are printed; all are in the CSV file."""

_BAR: Final = 30
_REDRAW: Final = 0.1

_DESCRIPTION: Final = """\
Print the figures of merit of a POSFET sensor element, from film to ADC: sensitivity, leakage, noise by source, smallest
force, gain, bandwidth, phase margin, ringing, slew rate, power, and whether and why the design is not valid.

FILE.yaml has one key for each number, in SI units or as text with a unit (film_thickness: 2.5 um); docs/design.md lists
the keys. In place of a file, the name of a shipped design (--list). What is not in the file has the paper's value.

Measured figures of the op-amp go into the key 'measured' (gain_db, gbw_hz, phase_margin_deg). With sizes and bias in
the same file, load and compensation are calibrated to them, and the follower is within 0.5 % of the measured one; with
the figures alone, it is right for small signals, and samples that may slew are not valid."""


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
    if not options.file:
        raise ConfigError("give the path of a design file, or the name of a shipped one (--list)")
    if (options.out is None) != (options.simulate is None):
        raise ConfigError("--simulate and --out must be given together")
    if (options.dt is not None or options.linear) and options.simulate is None:
        raise ConfigError(f"{'--linear' if options.linear else '--dt'} needs --simulate")
    if options.plot is not None and options.sweep is None:
        raise ConfigError("--plot needs --sweep")
    _check_outputs(options)
    loaded = load_design(options.file)
    if options.netlist is not None:
        write_text(options.netlist, f"{loaded.design.netlist(_circuit_name(loaded.name))}\n")
    document = report.as_json(loaded.design)
    text = report.as_text(loaded.design)
    if loaded.adjusted:
        document["adjusted"] = loaded.adjusted
        text += f"\n{_adjusted_text(loaded.adjusted)}"
    if options.simulate is not None:
        document["simulation"], remark = _simulate(loaded.design, options)
        text += f"\n{remark}"
    if options.sweep is not None:
        document["sweep"], table = _sweep(loaded, options)
        text += f"\n\n{table}"
    if options.tolerance is not None:
        document["tolerance"], table = _tolerance(loaded, options)
        text += f"\n\n{table}"
    print(json.dumps(document, indent=2, allow_nan=False) if options.json else text)


def _check_outputs(options: argparse.Namespace) -> None:
    """Raise ConfigError for files that replace each other or cannot be written, before anything is computed."""
    taken = {os.path.realpath(options.file): "design file"}
    if options.simulate is not None:
        taken[os.path.realpath(options.simulate)] = "input of --simulate"
    for name in ("netlist", "out", "sweep", "plot", "tolerance"):
        path = getattr(options, name)
        if path is None:
            continue
        where = os.path.realpath(path)
        if where in taken:
            raise ConfigError(f"--{name}: {one_line(str(path))} is the {taken[where]}, too; give another name")
        taken[where] = f"file of --{name}"
        if os.path.isdir(where):
            raise ConfigError(f"--{name}: {one_line(str(path))} is a folder; give the name of a file")
        if not os.path.isdir(path.parent):
            raise ConfigError(f"--{name}: {one_line(str(path))}: there is no such folder; make it first")
    if options.plot is not None:
        _plots().check_format(options.plot)


def _plots() -> Any:
    try:
        return importlib.import_module("posfet_model.figures.design_sweep")
    except ModuleNotFoundError as error:
        raise ConfigError(f"--plot: needs {error.name} (pip install matplotlib)") from None


def _adjusted_text(adjusted: dict[str, float]) -> str:
    units = plausible_fields(PosfetDesign)
    shown = (f"{key} {report.readable(value, units[key].unit)}" for key, value in adjusted.items())
    return f"adjusted to the measured figures: {', '.join(shown)}"


def _simulate(design: PosfetDesign, options: argparse.Namespace) -> tuple[dict[str, Any], str]:
    signal = read_signal(options.simulate)
    wanted = np.ones(signal.time.size, np.bool_)
    if options.dt is not None:
        signal, wanted = signal.with_even_times(options.dt)
    follower = design.linear_follower() if options.linear else design.follower()
    run = simulate(follower, signal, _progress(signal.time.size, "samples"))
    write_text(options.out, signal_csv(signal, run.v_out, wanted))
    valid, total = int(np.count_nonzero(run.valid[wanted])), int(np.count_nonzero(wanted))
    lines = [f"{options.out}: {total} samples, the model is valid for {valid} of them"]
    found = run.findings(signal.time, wanted)
    lines += [f"  not valid for {one.samples}, first at {one.first_time:.9g} s: {one.reason}" for one in found]
    reasons = [{"reason": one.reason, "samples": one.samples, "first_time_s": one.first_time} for one in found]
    return {"samples": total, "valid_samples": valid, "reasons": reasons}, "\n".join(lines)


def _sweep(loaded: DesignFile, options: argparse.Namespace) -> tuple[dict[str, Any], str]:
    if loaded.sweep is None:
        raise ConfigError(f"{options.file}: sweep: missing, must be a range or a list of ranges for --sweep")
    jobs = options.jobs or os.cpu_count() or 1
    if options.jobs and jobs > 1 and not joblib_is_there():
        print("posfet design: joblib is not installed, one process is used", file=sys.stderr)
    try:
        result = run_sweep(loaded.design, loaded.sweep, jobs, _progress(loaded.sweep.designs))
    except ValueError as error:
        raise ConfigError(f"{options.file}: sweep: {error}") from None
    write_text(options.sweep, result.csv())
    if options.plot is not None:
        _plot(result, options.plot)
    front = np.flatnonzero(result.pareto)
    keys = [*result.fields, *OBJECTIVES]
    columns = {**result.fields, **result.figures}
    front = front[np.argsort(-result.figures["snr_db"][front], kind="stable")]
    best = [{key: float(columns[key][i]) for key in keys} for i in front]
    document = {
        "designs": loaded.sweep.designs,
        "valid": int(result.valid.sum()),
        "reasons": result.reasons,
        "pareto_front": best,
    }
    lines = [
        f"{loaded.sweep.designs} designs, {document['valid']} valid, {len(best)} on the Pareto front of "
        f"{', '.join(OBJECTIVES)} (the most of the first two, the least of the others)"
    ]
    lines += [f"  {count} not valid: {reason}" for reason, count in result.reasons.items()]
    if not best:
        return document, "\n".join(lines)
    width = [max(12, len(key)) for key in keys]
    lines.append("  ".join(f"{key:>{w}}" for key, w in zip(keys, width, strict=True)))
    for row in best[:FRONT_ROWS]:
        lines.append("  ".join(f"{row[key]:>{w}.5g}" for key, w in zip(keys, width, strict=True)))
    if len(best) > FRONT_ROWS:
        lines.append(f"... and {len(best) - FRONT_ROWS} more, marked in the column pareto of {options.sweep}")
    return document, "\n".join(lines)


def _plot(result: SweepResult, path: Path) -> None:
    try:
        _plots().save_front(result, path)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written: {error.strerror}") from error


def _tolerance(loaded: DesignFile, options: argparse.Namespace) -> tuple[dict[str, Any], str]:
    try:
        result = run_tolerance(loaded.design, loaded.tolerance or Tolerance())
    except ValueError as error:
        raise ConfigError(f"{options.file}: tolerance: of a random sample, {error}; give a smaller spread") from None
    write_text(options.tolerance, result.csv())
    return _tolerance_document(result), _tolerance_text(result)


def _tolerance_document(result: ToleranceResult) -> dict[str, Any]:
    def number(value: float) -> float | None:
        return float(value) if np.isfinite(value) else None

    return {
        "samples": int(result.valid.size),
        "valid": int(result.valid.sum()),
        "yield": result.yielded,
        "limits": {key: float(mask.mean()) for key, mask in result.passed.items()},
        "quantiles": {
            key: {f"{q:g}": number(v) for q, v in zip(QUANTILES, result.quantiles(key), strict=True)}
            for key in result.figures
        },
    }


def _tolerance_text(result: ToleranceResult) -> str:
    lines = [f"{result.valid.size} samples, {int(result.valid.sum())} valid, yield {100 * result.yielded:.1f} %"]
    lines += [f"  {key}: {100 * mask.mean():.1f} % within the limit" for key, mask in result.passed.items()]
    lines.append(f"{'quantiles':27}" + "".join(f"{100 * q:>11g} %" for q in QUANTILES))
    for key in result.figures:
        lines.append(f"{key:27}" + "".join(f"{value:>13.5g}" for value in result.quantiles(key)))
    return "\n".join(lines)


def _progress(total: int, what: str = "designs") -> Callable[[int], None]:
    """Return a callback that draws a progress bar, on a terminal only."""
    if not sys.stderr.isatty():
        return lambda done: None
    drawn = 0.0

    def draw(done: int) -> None:
        nonlocal drawn
        if done < total and time.monotonic() - drawn < _REDRAW:
            return
        drawn = time.monotonic()
        bar = "#" * (_BAR * done // total)
        end = "\r\033[K" if done == total else ""
        sys.stderr.write(f"\r[{bar:{_BAR}}] {done}/{total} {what}{end}")
        sys.stderr.flush()

    return draw


def _circuit_name(name: str) -> str:
    """Return the name with only the characters that a netlist allows."""
    return "".join(c if c.isascii() and c.isalnum() else "_" for c in name).strip("_") or "design"


def _jobs(text: str) -> int:
    if not text.isascii() or not text.isdigit() or not 1 <= int(text) <= 1024:
        raise argparse.ArgumentTypeError(f"must be a whole number in [1, 1024], got '{text}'")
    return int(text)


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the command."""
    parser = argparse.ArgumentParser(
        prog="posfet design", description=_DESCRIPTION, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("file", nargs="?", metavar="FILE.yaml", help="design file, or name of a shipped design")
    parser.add_argument("--list", action="store_true", help="print the names of the shipped designs")
    parser.add_argument("--json", action="store_true", help="print JSON; what is unknown or infinite is null")
    parser.add_argument("--netlist", type=Path, metavar="OUT.cir", help="write the op-amp as a SPICE subcircuit")
    parser.add_argument("--simulate", type=Path, metavar="INPUT.csv", help="run the follower on a signal, t,vin [s, V]")
    parser.add_argument("--out", type=Path, metavar="OUTPUT.csv", help="where to write its output, t,vin,vout")
    parser.add_argument("--dt", type=positive, metavar="S", help="even steps [s] instead of the input's own times")
    parser.add_argument(
        "--linear", action="store_true", help="simulate small signals only: two poles and a zero, much faster"
    )
    parser.add_argument("--sweep", type=Path, metavar="OUT.csv", help="compute the ranges of the file's key 'sweep'")
    parser.add_argument("--plot", type=Path, metavar="OUT.svg", help="draw the Pareto front of the sweep (matplotlib)")
    parser.add_argument("--tolerance", type=Path, metavar="OUT.csv", help="Monte Carlo by the file's key 'tolerance'")
    parser.add_argument(
        "--jobs",
        type=_jobs,
        metavar="N",
        help="processes of a sweep, where joblib is installed (default: processors)",
    )
    return parser


if __name__ == "__main__":
    sys.exit(ignoring_broken_pipe(main))
