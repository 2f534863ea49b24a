"""Command: how far each follower model is off a run of a follower. `python -m posfet_model.spice_compare --help`."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Final

from posfet_model.follower import ClosedLoop
from posfet_model.follower_run import (
    OVERDRIVE,
    SECOND_POLE_QUALITY,
    RunFileError,
    blind_models,
    calibrated_models,
    deviations,
    fit_overdrive,
    read_run,
    slews,
)

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
"calibrated" appears when --gain and --bandwidth are given. They say nothing about slewing, so the square-law model's
overdrive is then fitted to this very run, if it slews (--overdrive gives it instead).
Standard output is the JSON and nothing else; standard error says what --gain was taken for where it looks like dB, and
which overdrive was taken."""


class UsageError(ValueError):
    """The options make no sense; the message is one line."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Compare and print; return the exit code: 0, or 1 with one line on stderr when file or options are bad."""
    options = _parser().parse_args(arguments)
    try:
        result = compare(options.file, options.gain, options.bandwidth, options.overdrive, _note)
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
    overdrive: float | None = None,
    tell: Callable[[str], None] = lambda text: None,
) -> dict[str, dict[str, dict[str, float]]]:
    """Return the deviations in percent, by model and by "blind" or "calibrated"; arguments as on the command line.

    `tell` gets a line for each thing that a reader of the numbers should know. Raises RunFileError or UsageError.
    """
    loop = closed_loop(gain, bandwidth)
    if overdrive is not None:
        if loop is None:
            raise UsageError("--overdrive needs --gain and --bandwidth")
        _require("--overdrive", overdrive, OVERDRIVE_RANGE)
    run = read_run(file)
    results = {"blind": deviations(run, blind_models())}
    if loop is not None:
        if gain is not None and LIKE_DECIBELS[0] <= gain <= LIKE_DECIBELS[1]:
            tell(f"--gain {gain:g} is taken for an open-loop gain in V/V, not dB: a follower of {loop.gain:.6g} V/V")
        if overdrive is None:
            overdrive = fit_overdrive(run, loop)
            how = "was fitted to this very run" if slews(run, loop) else "is assumed, this run does not slew"
            tell(f"the overdrive of the calibrated square_law_slew, {overdrive:.4g} V, {how}")
        results["calibrated"] = deviations(run, calibrated_models(loop, overdrive))
    return {
        name: {
            knowledge: {key: _rounded(value) for key, value in asdict(by_model[name]).items()}
            for knowledge, by_model in results.items()
        }
        for name in results["blind"]
    }


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
    parser.add_argument("--overdrive", type=float, metavar="V", help="overdrive of the differential pair, not fitted")
    return parser


if __name__ == "__main__":
    sys.exit(main())
