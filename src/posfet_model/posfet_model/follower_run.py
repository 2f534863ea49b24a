"""Runs of a follower from any simulator or bench: the file format, and how far each follower model is off."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model.follower import (
    VOLTAGE_LIMIT,
    ClosedLoop,
    Follower,
    IdealFollower,
    OnePoleFollower,
    SquareLawFollower,
    StaticFollower,
    TwoPoleFollower,
    close_loop,
)
from posfet_model.paper import AMPLIFIER_GAIN, GAIN_BANDWIDTH
from posfet_model.slew_model import OVERDRIVE, SlewModel

HEADER: Final = "time,v_in,v_out"

SECOND_POLE_QUALITY: Final = 0.4
"""Quality of `TwoPoleFollower` where nothing is known of the second pole: it is assumed at 1/0.4^2 = 6.25 times the
gain-bandwidth product. Circuit C has it at 4 times, circuit B hides it behind a zero."""

OVERDRIVE_SEARCH: Final = (0.01, 10.0)
"""Range in which the overdrive is fitted [V]."""

LEAST_SWING: Final = (1e-12, 1e-9)
"""Least peak-to-peak of v_out: in V, and as a share of the largest voltage in the file: less is no full scale."""

_TIME_LIMIT: Final = 1e9
_FIT_ROWS: Final = 20_000
_FIT_SLEW_SHARE: Final = 0.3


class RunFileError(ValueError):
    """A file is not a follower run; the message is one line with file, line number and what is wrong."""


@dataclass(frozen=True, eq=False)
class FollowerRun:
    """One run, all fields of shape [t], t >= 2."""

    time: NDArray[np.float64]
    """[s], never falling."""
    v_in: NDArray[np.float64]
    """[V]"""
    v_out: NDArray[np.float64]
    """[V], its peak-to-peak at least `LEAST_SWING`."""


@dataclass(frozen=True)
class Deviation:
    """How far a model is off, in percent of the peak-to-peak of the run's output, first values removed."""

    max_pct: float
    """Largest absolute deviation of all samples."""
    rms_pct: float
    """Root mean square over time (trapezoidal rule), so that uneven steps weigh by their length."""


def read_run(path: Path) -> FollowerRun:
    """Return the run in a CSV file with the header ``time,v_in,v_out`` [s, V, V].

    Lines starting with # and empty lines are skipped. Steps may be uneven; two lines of the same time are a jump.
    Raises RunFileError for a file that cannot be read or does not hold such a run.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not a text file"
        raise RunFileError(f"{path}: cannot be read: {reason}") from error
    numbers = [i for i, line in enumerate(lines, 1) if line.strip() and not line.lstrip().startswith("#")]
    if not numbers or "".join(lines[numbers[0] - 1].split()) != HEADER:
        where, got = (numbers[0], repr(lines[numbers[0] - 1][:60])) if numbers else (1, "nothing")
        raise RunFileError(f"{path}:{where}: header must be {HEADER}, got {got}")
    rows = numbers[1:]
    if len(rows) < 2:
        raise RunFileError(f"{path}:{len(lines) or 1}: a run needs at least 2 rows, got {len(rows)}")
    table = _parse(path, lines, rows)
    _check(path, table, rows)
    return FollowerRun(*table)


def _parse(path: Path, lines: list[str], rows: list[int]) -> NDArray[np.float64]:
    """Return the columns, shape [3, t]; RunFileError naming the first line that is not three numbers."""
    try:
        table = np.loadtxt([lines[i - 1] for i in rows], delimiter=",", ndmin=2, comments=None)
        if table.shape[1] == 3:
            return np.ascontiguousarray(table.T)
    except ValueError:
        pass  # the loop below finds the line
    for i in rows:
        cells = lines[i - 1].split(",")
        if len(cells) != 3:
            raise RunFileError(f"{path}:{i}: 3 values ({HEADER}) wanted, got {len(cells)}")
        for name, cell in zip(HEADER.split(","), cells, strict=True):
            if not _is_number(cell):
                raise RunFileError(f"{path}:{i}: {name} must be a number, got {cell.strip()[:40]!r}")
    raise RunFileError(f"{path}: cannot be read as numbers")


def _is_number(cell: str) -> bool:
    """Return whether a cell is a number as other programs write them: Python alone takes 1_000 for one."""
    try:
        float(cell)
    except ValueError:
        return False
    return "_" not in cell


def _check(path: Path, table: NDArray[np.float64], rows: list[int]) -> None:
    """Raise RunFileError for values out of range, time that falls or stands still, and an output that does not move."""
    for name, column, limit in zip(HEADER.split(","), table, (_TIME_LIMIT, VOLTAGE_LIMIT, VOLTAGE_LIMIT), strict=True):
        bad = ~(np.abs(column) <= limit)
        if bad.any():
            first = int(bad.argmax())
            allowed = f"[{-limit:g}, {limit:g}]"
            raise RunFileError(f"{path}:{rows[first]}: {name} must be in {allowed}, got {column[first]:g}")
    time, _, v_out = table
    falling = np.diff(time) < 0
    if falling.any():
        first = int(falling.argmax())
        raise RunFileError(
            f"{path}:{rows[first + 1]}: time must not fall, got {time[first + 1]:g} after {time[first]:g}"
        )
    if time[-1] == time[0]:
        raise RunFileError(f"{path}:{rows[-1]}: time must rise, got {time[0]:g} s in every row")
    swing, least = float(np.ptp(v_out)), max(LEAST_SWING[0], LEAST_SWING[1] * float(np.max(np.abs(table[1:]))))
    if swing < least:
        raise RunFileError(
            f"{path}:{rows[-1]}: v_out must move by {least:g} V or more, got {swing:g} V; it is the full scale"
        )


def blind_models() -> dict[str, Follower]:
    """Return the models of an amplifier of which 42.3 dB and 1.5 MHz are known (Sec. V), all else assumed."""
    loop = close_loop(AMPLIFIER_GAIN.value, GAIN_BANDWIDTH.value)
    # The second pole goes beside the dominant one, so the lag of slow signals stays 1/(2*pi*bandwidth).
    two_pole = TwoPoleFollower(
        gain=loop.gain, natural_frequency=loop.bandwidth / SECOND_POLE_QUALITY, quality=SECOND_POLE_QUALITY
    )
    return _models(loop, two_pole, SlewModel("nothing known", loop, OVERDRIVE).follower())


def calibrated_models(loop: ClosedLoop, slewing: SquareLawFollower) -> dict[str, Follower]:
    """Return the models of a follower of known gain and -3 dB frequency; the slewing one comes from `slew_model`."""
    two_pole = TwoPoleFollower.from_bandwidth(loop.gain, loop.bandwidth, SECOND_POLE_QUALITY)
    return _models(loop, two_pole, slewing)


def _models(loop: ClosedLoop, two_pole: TwoPoleFollower, slewing: SquareLawFollower) -> dict[str, Follower]:
    return {
        "ideal": IdealFollower(),
        "static": StaticFollower(gain=loop.gain),
        "one_pole": OnePoleFollower(gain=loop.gain, bandwidth=loop.bandwidth),
        "two_pole": two_pole,
        "square_law_slew": slewing,
    }


def deviation(run: FollowerRun, model: Follower) -> Deviation:
    """Return how far a model started at rest with the run's first input is off the run's output."""
    answer = model.run(run.time, run.v_in).v_out
    error = (answer - answer[0]) - (run.v_out - run.v_out[0])
    squares = 0.5 * (error[1:] ** 2 + error[:-1] ** 2) * np.diff(run.time)
    scale = 100 / float(np.ptp(run.v_out))
    return Deviation(
        max_pct=float(np.max(np.abs(error))) * scale,
        rms_pct=math.sqrt(float(np.sum(squares)) / float(run.time[-1] - run.time[0])) * scale,
    )


def deviations(run: FollowerRun, models: Mapping[str, Follower]) -> dict[str, Deviation]:
    """Return the deviation of each model."""
    return {name: deviation(run, model) for name, model in models.items()}


def slews(run: FollowerRun, loop: ClosedLoop) -> bool:
    """Return whether the run asks for a third or more of the slew rate at `OVERDRIVE`: less says nothing about it."""
    lag = run.v_in - OnePoleFollower(gain=loop.gain, bandwidth=loop.bandwidth).run(run.time, run.v_in).v_out / loop.gain
    return bool(np.max(np.abs(lag)) >= _FIT_SLEW_SHARE * OVERDRIVE)


def fit_overdrive(run: FollowerRun, model: SlewModel) -> float:
    """Return the overdrive [V], in [0.01, 10], with which the slewing follower is least off a run, in rms.

    A small-signal analysis does not show the tail current, only a run that slews does (see `slews`; another gives a
    number that means nothing). Judge the result by other runs than this. Runs of more than 20000 rows are thinned.
    """
    keep = np.unique(np.append(np.arange(0, run.time.size, -(-run.time.size // _FIT_ROWS)), run.time.size - 1))
    thinned = FollowerRun(run.time[keep], run.v_in[keep], run.v_out[keep])

    def rms(log_overdrive: float) -> float:
        return deviation(thinned, model.follower(math.exp(log_overdrive))).rms_pct

    low, high = (math.log(v) for v in OVERDRIVE_SEARCH)
    grid = np.linspace(low, high, 15)
    best = int(np.argmin([rms(float(point)) for point in grid]))
    return math.exp(_least(rms, float(grid[max(best - 1, 0)]), float(grid[min(best + 1, grid.size - 1)])))


def _least(function: Callable[[float], float], low: float, high: float) -> float:
    """Return the place of the minimum between low and high, by golden section, to 1/1000 of the bracket."""
    golden = (math.sqrt(5) - 1) / 2
    left, right = high - golden * (high - low), low + golden * (high - low)
    at_left, at_right = function(left), function(right)
    for _ in range(14):
        if at_left < at_right:
            high, right, at_right = right, left, at_left
            left = high - golden * (high - low)
            at_left = function(left)
        else:
            low, left, at_left = left, right, at_right
            right = low + golden * (high - low)
            at_right = function(right)
    return 0.5 * (low + high)
