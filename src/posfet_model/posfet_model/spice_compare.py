# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Command that compares follower models with a simulated follower: ``python -m posfet_model.spice_compare --help``."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from posfet_model.amplifier.closed_loop import ClosedLoop, close_loop
from posfet_model.amplifier.follower import SquareLawFollower
from posfet_model.amplifier.follower_base import Follower
from posfet_model.amplifier.slew_identification import OVERDRIVE, SlewModel, slew_model
from posfet_model.command_line import ignoring_broken_pipe
from posfet_model.device.paper import AMPLIFIER_GAIN, GAIN_BANDWIDTH
from posfet_model.spice import circuit_command
from posfet_model.spice.model_comparison import (
    SECOND_POLE_QUALITY,
    blind_models,
    calibrated_models,
    deviations,
    fit_overdrive,
    slews,
)
from posfet_model.spice.model_validity import reasons
from posfet_model.spice.run_file import FollowerRun, RunFileError, read_run

CLOSED_LOOP_GAIN: Final = (0.5, 1.5)
OPEN_LOOP_GAIN: Final = (10.0, 1e9)
BANDWIDTH: Final = (1e-9, 1e12)
OVERDRIVE_RANGE: Final = (1e-3, 100.0)
LIKE_DECIBELS: Final = (10.0, 60.0)
"""Values of --gain that may be decibels by mistake: they are also possible as an open-loop gain in V/V."""
_DIGITS: Final = 6

_DESCRIPTION: Final = f"""\
Run each follower model on the input of a follower run and print the deviation of its output, as JSON:
{{"ideal"|"static"|"one_pole"|"two_pole"|"square_law_slew": {{"blind"|"calibrated": {{"max_pct", "rms_pct"}}}}}}

FILE.csv has the header time,v_in,v_out in s and V; lines starting with # are skipped, time steps may be uneven, and two
lines with the same time are a step of the input. Between lines the input is linear (first-order hold).
Deviations are in percent of full scale, the peak-to-peak value of v_out. The first value is subtracted from both
curves, so that offset does not count. The RMS is weighted by time: a long step weighs more than a short one.
Every model starts in the steady state of the first v_in.

"blind" uses an open-loop gain of 42.3 dB and a gain-bandwidth product of 1.5 MHz, and assumes a second pole at
{1 / SECOND_POLE_QUALITY**2:g} times that and a differential pair of {OVERDRIVE} V overdrive.
"calibrated" appears when --gain and --bandwidth are given. Nothing is fitted to FILE.csv. Gain and bandwidth do not
determine slewing: with the circuit of the op-amp (--stages 2: Miller; 1: one stage and an output follower) the
overdrive of the square-law model follows from hand formulas with the sizes of Table II, unless it is given
(--overdrive) or measured on another run of the same circuit (--overdrive-from). Without --stages it is assumed.
--validity adds "valid" and "reasons" to each result: whether what the model leaves out matters on this run, by gain and
bandwidth. They do not tell whether the follower rings.
In place of FILE.csv, "circuits" compares the models of the set of circuits with ngspice and says which are valid on
which run, "random" compares verdicts about stability, "netlist NAME" prints a circuit for SPICE (each with --help).
Standard output has the JSON only; standard error reports how --gain was interpreted where it may be in dB, the assumed
op-amp, and the overdrive used."""


class UsageError(ValueError):
    """Raised for options that cannot be combined or are out of range; the message is one line."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Compare and print; return the exit code: 0, or 1 with one line on stderr for a bad file or options."""
    arguments = sys.argv[1:] if arguments is None else arguments
    if arguments and arguments[0] in circuit_command.COMMANDS:
        return circuit_command.run(arguments)
    options = _parser().parse_args(arguments)
    try:
        result = compare(
            options.file,
            options.gain,
            options.bandwidth,
            gain_bandwidth=options.gain_bandwidth,
            stages=options.stages,
            overdrive=options.overdrive,
            overdrive_from=options.overdrive_from,
            validity=options.validity,
            report=_note,
        )
        text = json.dumps(result, indent=2, allow_nan=False)
    except (RunFileError, UsageError) as error:
        _note(str(error))
        return 1
    except ValueError:  # from json: infinity and NaN are no JSON
        _note(f"{options.file}: deviations must be finite, got infinity or NaN")
        return 1
    print(text)
    return 0


def compare(
    file: Path,
    gain: float | None = None,
    bandwidth: float | None = None,
    *,
    gain_bandwidth: float | None = None,
    stages: int | None = None,
    overdrive: float | None = None,
    overdrive_from: Path | None = None,
    validity: bool = False,
    report: Callable[[str], None] = lambda text: None,
) -> dict[str, dict[str, dict[str, Any]]]:
    """Return the deviations in percent, by model and by "blind" or "calibrated".

    Parameters
    ----------
    file : Path
        CSV file of the run.
    gain : float, optional
        Gain of the follower at low frequency, or open-loop gain from 10 on [V/V].
    bandwidth : float, optional
        -3 dB bandwidth of the follower [Hz].
    gain_bandwidth : float, optional
        Gain-bandwidth product of the op-amp [Hz].
    stages : int, optional
        2: Miller op-amp; 1: one stage and an output follower.
    overdrive : float, optional
        Overdrive of the differential pair [V].
    overdrive_from : Path, optional
        Another run of the same circuit, to measure the overdrive on.
    validity : bool, default False
        Whether to say which models are valid on the run.
    report : callable
        Called with each remark on the interpretation of the options, one line of text.

    Returns
    -------
    dict
        ``{model: {"blind" | "calibrated": {"max_pct", "rms_pct"}}}``; with `validity` also "valid" and "reasons".

    Raises
    ------
    RunFileError
        If a file cannot be used.
    UsageError
        If the options cannot be combined or are out of range.
    """
    loop = closed_loop(gain, bandwidth)
    if loop is None and any(option is not None for option in (gain_bandwidth, stages, overdrive, overdrive_from)):
        raise UsageError("--gain-bandwidth, --stages, --overdrive and --overdrive-from need --gain and --bandwidth")
    run = read_run(file)
    blind = close_loop(AMPLIFIER_GAIN.value, GAIN_BANDWIDTH.value)
    results = {"blind": _judged(run, blind_models(), blind, validity)}
    if loop is not None:
        if gain is not None and LIKE_DECIBELS[0] <= gain <= LIKE_DECIBELS[1]:
            report(f"--gain {gain:g} is read as an open-loop gain in V/V, not dB: a follower of {loop.gain:.6g} V/V")
        if gain_bandwidth is not None:
            _require("--gain-bandwidth", gain_bandwidth, BANDWIDTH)
        model = slew_model(loop, gain_bandwidth, stages)
        slewing = _slewing(loop, model, _Overdrive(overdrive, overdrive_from), run, report)
        results["calibrated"] = _judged(run, calibrated_models(loop, slewing), loop, validity)
    return {name: {knowledge: by_model[name] for knowledge, by_model in results.items()} for name in results["blind"]}


def _judged(
    run: FollowerRun, models: Mapping[str, Follower], loop: ClosedLoop, validity: bool
) -> dict[str, dict[str, Any]]:
    """Return the deviations of models and, if wanted, whether and why not they are valid on the run."""
    judged: dict[str, dict[str, Any]] = {}
    for name, found in deviations(run, models).items():
        judged[name] = {key: _rounded(value) for key, value in asdict(found).items()}
        if validity:
            why = reasons(run, models[name], loop)
            judged[name] |= {"valid": not why, "reasons": why}
    return judged


@dataclass(frozen=True)
class _Overdrive:
    """The overdrive on the command line: a number [V], another run to measure it on, or neither."""

    given: float | None
    other: Path | None


def _slewing(
    loop: ClosedLoop,
    model: SlewModel,
    overdrive: _Overdrive,
    run: FollowerRun,
    report: Callable[[str], None],
) -> SquareLawFollower:
    """Return the calibrated slewing model; `run` is only used to reject it as its own reference."""
    value, how = model.overdrive, "by hand formulas" if model.amplifier != "one pole" else "assumed"
    if overdrive.given is not None and overdrive.other is not None:
        raise UsageError("--overdrive and --overdrive-from cannot be combined")
    if overdrive.given is not None:
        _require("--overdrive", overdrive.given, OVERDRIVE_RANGE)
        value, how = overdrive.given, "as given"
    elif overdrive.other is not None:
        other = read_run(overdrive.other)
        if np.array_equal(other.time, run.time) and np.array_equal(other.v_out, run.v_out):
            raise UsageError("--overdrive-from must be another run than the one that is compared")
        if not slews(other, loop):
            raise UsageError(f"--overdrive-from must be a run that slews, {overdrive.other} does not")
        value, how = fit_overdrive(other, model), f"measured on {overdrive.other.name}"
    report(f"square_law_slew, calibrated: {model.amplifier}; overdrive {value:.4g} V, {how}")
    return model.follower(value)


def closed_loop(gain: float | None, bandwidth: float | None) -> ClosedLoop | None:
    """Return the closed loop that --gain and --bandwidth describe, None without both.

    Raises UsageError if only one is given, or if one is out of range.

    Parameters
    ----------
    gain : float
        Gain of the follower at low frequency [1], if given.
    bandwidth : float
        Its -3 dB frequency [Hz], if given.
    """
    if gain is None and bandwidth is None:
        return None
    if gain is None or bandwidth is None:
        raise UsageError("--gain and --bandwidth must be given together, got only one of them")
    _require("--bandwidth", bandwidth, BANDWIDTH)
    if OPEN_LOOP_GAIN[0] <= gain <= OPEN_LOOP_GAIN[1]:
        return ClosedLoop(gain=gain / (1 + gain), bandwidth=bandwidth)
    if not CLOSED_LOOP_GAIN[0] <= gain <= CLOSED_LOOP_GAIN[1]:
        raise UsageError(
            f"--gain must be in [{CLOSED_LOOP_GAIN[0]:g}, {CLOSED_LOOP_GAIN[1]:g}] (follower) or in "
            f"[{OPEN_LOOP_GAIN[0]:g}, {OPEN_LOOP_GAIN[1]:g}] (open loop, V/V), got {gain:g}"
        )
    return ClosedLoop(gain=gain, bandwidth=bandwidth)


def _note(text: str) -> None:
    print(f"spice_compare: {text}", file=sys.stderr)


def _require(name: str, value: float, allowed: tuple[float, float]) -> None:
    if not allowed[0] <= value <= allowed[1]:
        raise UsageError(f"{name} must be in [{allowed[0]:g}, {allowed[1]:g}], got {value:g}")


def _rounded(value: float) -> float:
    """Return the value with six significant digits."""
    return float(f"{value:.{_DIGITS}g}")


class _OneLineParser(argparse.ArgumentParser):
    """ArgumentParser that reports an error in one line, without the usage."""

    def error(self, message: str) -> None:  # type: ignore[override]
        self.exit(2, f"{self.prog}: {message}\n")


def _parser() -> argparse.ArgumentParser:
    parser = _OneLineParser(
        prog="spice_compare", description=_DESCRIPTION, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("file", type=Path, metavar="FILE.csv", help="run to compare the models with")
    parser.add_argument(
        "--gain",
        type=float,
        metavar="G",
        help="gain of the follower at low frequency, from an AC run of the same circuit, 0.5 to 1.5 V/V; "
        "from 10 on it is the open-loop gain A0 in V/V (not dB), which means A0/(1 + A0)",
    )
    parser.add_argument(
        "--bandwidth",
        type=float,
        metavar="HZ",
        help="-3 dB bandwidth of the follower, 1e-9 to 1e12 Hz",
    )
    parser.add_argument(
        "--gain-bandwidth",
        type=float,
        metavar="HZ",
        help=f"gain-bandwidth product of the op-amp, default {GAIN_BANDWIDTH.value:g} with --stages",
    )
    parser.add_argument(
        "--stages", type=int, choices=(1, 2), help="circuit of the op-amp, 2: Miller; 1: one stage, output follower"
    )
    parser.add_argument("--overdrive", type=float, metavar="V", help="overdrive of the differential pair")
    parser.add_argument(
        "--overdrive-from",
        type=Path,
        metavar="OTHER.csv",
        help="measure the overdrive on this run of the same circuit, which must differ from FILE.csv and must slew",
    )
    parser.add_argument("--validity", action="store_true", help="say which models are valid on this run, and why not")
    return parser


if __name__ == "__main__":
    sys.exit(ignoring_broken_pipe(main))
