"""Command: how far each follower model is off a run of a follower. `python -m posfet_model.spice_compare --help`."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

import numpy as np

from posfet_model.amplifier.closed_loop import ClosedLoop
from posfet_model.amplifier.follower import SquareLawFollower
from posfet_model.amplifier.slew_identification import OVERDRIVE, slew_model
from posfet_model.command_line import until_reader_goes
from posfet_model.device.paper import GAIN_BANDWIDTH
from posfet_model.spice.model_comparison import (
    SECOND_POLE_QUALITY,
    blind_models,
    calibrated_models,
    deviations,
    fit_overdrive,
    slews,
)
from posfet_model.spice.run_file import FollowerRun, RunFileError, read_run

CLOSED_LOOP_GAIN: Final = (0.5, 1.5)
OPEN_LOOP_GAIN: Final = (10.0, 1e9)
BANDWIDTH: Final = (1e-9, 1e12)
OVERDRIVE_RANGE: Final = (1e-3, 100.0)
LIKE_DECIBELS: Final = (10.0, 60.0)
"""Values of --gain that may be decibels given by mistake; as an open-loop gain in V/V they cannot be told from it."""
_DIGITS: Final = 6

_DESCRIPTION: Final = f"""\
Run each follower model on the input of a follower run and print how far its output is off, as JSON:
{{"ideal"|"static"|"one_pole"|"two_pole"|"square_law_slew": {{"blind"|"calibrated": {{"max_pct", "rms_pct"}}}}}}

FILE.csv has the header time,v_in,v_out in s and V; lines starting with # are skipped, steps may be uneven, two lines
of the same time are a jump of the input. Between lines the input is taken as a straight line.
Percent are of full scale, the peak-to-peak of v_out. The first value is removed from both curves, so offset does not
count. rms is over time: a long step weighs more than a short one.
Every model starts at rest: as if the first v_in had been there for ever.

"blind" knows an open-loop gain of 42.3 dB and a gain-bandwidth product of 1.5 MHz, and assumes a second pole at
{1 / SECOND_POLE_QUALITY**2:g} times that and a differential pair of {OVERDRIVE} V overdrive.
"calibrated" appears when --gain and --bandwidth are given. Nothing is ever fitted to FILE.csv. Gain and bandwidth say
nothing about slewing, so the square-law model takes the op-amp from the ratio of the bandwidth to that of one pole with
the gain-bandwidth product (--gain-bandwidth): lower, two stages with a zero; higher, one stage and an output follower.
Its overdrive is then that of the hand formulas with the sizes of Table II, unless it is given (--overdrive) or measured
on another run of the same circuit (--overdrive-from).
Standard output is the JSON and nothing else; standard error says what --gain was taken for where it looks like dB, what
the op-amp was taken for, and which overdrive was taken."""


class UsageError(ValueError):
    """The options make no sense; the message is one line."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Compare and print; return the exit code: 0, or 1 with one line on stderr when file or options are bad."""
    options = _parser().parse_args(arguments)
    try:
        result = compare(
            options.file,
            options.gain,
            options.bandwidth,
            gain_bandwidth=options.gain_bandwidth,
            overdrive=options.overdrive,
            overdrive_from=options.overdrive_from,
            tell=_note,
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
    overdrive: float | None = None,
    overdrive_from: Path | None = None,
    tell: Callable[[str], None] = lambda text: None,
) -> dict[str, dict[str, dict[str, float]]]:
    """Return the deviations in percent, by model and by "blind" or "calibrated"; arguments as on the command line.

    `tell` gets a line for each thing that a reader of the numbers should know. Raises RunFileError or UsageError.
    """
    loop = closed_loop(gain, bandwidth)
    if loop is None and not (gain_bandwidth is None and overdrive is None and overdrive_from is None):
        raise UsageError("--gain-bandwidth, --overdrive and --overdrive-from need --gain and --bandwidth")
    run = read_run(file)
    results = {"blind": deviations(run, blind_models())}
    if loop is not None:
        if gain is not None and LIKE_DECIBELS[0] <= gain <= LIKE_DECIBELS[1]:
            tell(f"--gain {gain:g} is taken for an open-loop gain in V/V, not dB: a follower of {loop.gain:.6g} V/V")
        slewing = _slewing(loop, gain_bandwidth, _Overdrive(overdrive, overdrive_from), run, tell)
        results["calibrated"] = deviations(run, calibrated_models(loop, slewing))
    return {
        name: {
            knowledge: {key: _rounded(value) for key, value in asdict(by_model[name]).items()}
            for knowledge, by_model in results.items()
        }
        for name in results["blind"]
    }


@dataclass(frozen=True)
class _Overdrive:
    """What the command line says of the overdrive: a number [V], another run to measure it on, or nothing."""

    given: float | None
    other: Path | None


def _slewing(
    loop: ClosedLoop,
    gain_bandwidth: float | None,
    overdrive: _Overdrive,
    run: FollowerRun,
    tell: Callable[[str], None],
) -> SquareLawFollower:
    """Return the calibrated slewing model; `run` is only looked at to refuse it as its own reference."""
    if gain_bandwidth is not None:
        _require("--gain-bandwidth", gain_bandwidth, BANDWIDTH)
    model = slew_model(loop, GAIN_BANDWIDTH.value if gain_bandwidth is None else gain_bandwidth)
    value, how = model.overdrive, "by hand formulas" if model.amplifier != "one pole" else "assumed"
    if overdrive.given is not None and overdrive.other is not None:
        raise UsageError("--overdrive and --overdrive-from exclude each other")
    if overdrive.given is not None:
        _require("--overdrive", overdrive.given, OVERDRIVE_RANGE)
        value, how = overdrive.given, "as given"
    elif overdrive.other is not None:
        other = read_run(overdrive.other)
        if np.array_equal(other.time, run.time) and np.array_equal(other.v_out, run.v_out):
            raise UsageError("--overdrive-from must be another run than the one that is judged")
        if not slews(other, loop):
            raise UsageError(f"--overdrive-from must be a run that slews, {overdrive.other} does not")
        value, how = fit_overdrive(other, model), f"measured on {overdrive.other.name}"
    tell(f"square_law_slew, calibrated: {model.amplifier}; overdrive {value:.4g} V, {how}")
    return model.follower(value)


def closed_loop(gain: float | None, bandwidth: float | None) -> ClosedLoop | None:
    """Return what --gain and --bandwidth say of the follower, None when neither is given; UsageError for nonsense."""
    if gain is None and bandwidth is None:
        return None
    if gain is None or bandwidth is None:
        raise UsageError("--gain and --bandwidth belong together, got only one of them")
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
    """Return the value with as many digits as mean anything."""
    return float(f"{value:.{_DIGITS}g}")


class _OneLineParser(argparse.ArgumentParser):
    """argparse without its usage in front of an error."""

    def error(self, message: str) -> None:  # type: ignore[override]
        self.exit(2, f"{self.prog}: {message}\n")


def _parser() -> argparse.ArgumentParser:
    parser = _OneLineParser(
        prog="spice_compare", description=_DESCRIPTION, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("file", type=Path, metavar="FILE.csv", help="the run to compare with")
    parser.add_argument(
        "--gain",
        type=float,
        metavar="G",
        help="gain of the follower at low frequency, from an AC run of the very circuit, 0.5 to 1.5 V/V; "
        "from 10 on it is read as the open-loop gain A0 in V/V (not dB) and stands for A0/(1 + A0)",
    )
    parser.add_argument(
        "--bandwidth",
        type=float,
        metavar="HZ",
        help="frequency at which the follower's gain is 3 dB below that at low frequency, 1e-9 to 1e12 Hz",
    )
    parser.add_argument(
        "--gain-bandwidth",
        type=float,
        metavar="HZ",
        help=f"gain-bandwidth product of the op-amp, {GAIN_BANDWIDTH.value:g} where not given",
    )
    parser.add_argument("--overdrive", type=float, metavar="V", help="overdrive of the differential pair")
    parser.add_argument(
        "--overdrive-from",
        type=Path,
        metavar="OTHER.csv",
        help="measure the overdrive on this run of the same circuit, another one than FILE.csv, which has to slew",
    )
    return parser


if __name__ == "__main__":
    sys.exit(until_reader_goes(main))
