# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Recording for the calibration of a real board: its frames, and the reference of a calibration rig.

The frames are a file of `posfet can record`. The file of the rig has position and force of its ball over time; the
force on each taxel follows from Hertz theory and the elastomer skin, as in a scene. The delay between the two clocks is
estimated from the force that both measured, together with the leakage time constant of the board: a wrong one would
look like a delay. It must be below `MAX_DELAY`.
"""

from __future__ import annotations

import csv
import io
import math
from array import array
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_driver.bus.message_conversion import frame_of
from posfet_driver.bus.recording import FORMATS, messages
from posfet_driver.protocol.decoded import ScanReady
from posfet_driver.protocol.mapped_decoder import make_decoder
from posfet_model._lib.minima import golden_section
from posfet_model._lib.shown import shown
from posfet_model._lib.types import Array
from posfet_model.calibration.bench_signals import Recording
from posfet_model.calibration.leaky_response import low_pass
from posfet_model.calibration.taxel_calibration import NOMINAL_WARMTH_FORCE, NOMINAL_WARMTH_TIME_CONSTANT
from posfet_model.config import ConfigError, read_text
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import Scan, ScanStatus
from posfet_model.sensor.signal_chain import InverseSignalChain, charge_per_newton
from posfet_sim.contact.indenters import Sphere
from posfet_sim.recording.recorded_scans import RecordedScans
from posfet_sim.scene import Keyframes, Scene, SceneLoads, SceneObject
from posfet_sim.scene.keyframes import Pose, Span

MCAP: Final = ".mcap"
"""Suffix of a recording of raw scans; those of the bus have other ones."""

COLUMNS: Final = ("time_s", "x_mm", "y_mm", "force_N")
"""Columns of the file of the rig: time of its clock, centre of the contact in the frame of the array, and force."""

LIMITS: Final = {"time_s": (0.0, 1e11), "x_mm": (-1000.0, 1000.0), "y_mm": (-1000.0, 1000.0), "force_N": (-10.0, 1e3)}
"""Allowed values of each column; a force below 0 is noise of the rig and counts as 0."""

MAX_REFERENCE: Final = 64_000_000
"""Largest size of the file of the rig [byte]: half an hour of readings at 1 kHz."""

TAIL: Final = 4096
"""Size of the end of a growing file that has its newest reading [byte]."""

MAX_DELAY: Final = 0.5
"""Maximum delay between the two clocks [s]."""

MAINS_PERIODS: Final = (1.0 / 50.0, 1.0 / 60.0)
"""Averaging times of the rates before they are correlated [s]: periods of the mains, whose hum all taxels share."""

LEAK_RANGE: Final = (0.5, 2.0)
"""Range of the leakage time constant, over the nominal one [1]."""

LEAK_STEPS: Final = 16
"""Steps in which it is found [1], to 1e-3: the delay is wrong by less than 5 us."""

SLOW_CHARGE: Final = 1.0
"""Time constant with which charge of a film that relaxes or creeps comes in [s], assumed."""

WARMED_LEVELS: Final = 200
"""Number of forces for which the warmed taxels are counted [1]."""

MIN_CORRELATION: Final = 0.5
"""Minimum correlation of the rates in the two files [1]."""

BATCH: Final = 256
"""Number of scans whose forces are computed at once."""


@dataclass(frozen=True, eq=False)
class Reference:
    """Readings of the rig, piecewise linear over time; the path of an object of a scene."""

    times: Array
    """Times [s], ascending, shape [readings]."""
    values: Array
    """x, y [m] and force [N], shape [3, readings]."""

    def at(self, time: float) -> Pose:
        """Return the pose at a time [s]."""
        times, rows = self._numbers
        at = bisect_right(times, time) - 1
        if at < 0 or at == len(times) - 1 or times[at] == time:
            x, y, force = (row[max(at, 0)] for row in rows)
        else:
            step, since = times[at + 1] - times[at], time - times[at]
            x, y, force = ((row[at + 1] - row[at]) / step * since + row[at] for row in rows)
        return x, y, 0.0, force

    @cached_property
    def _numbers(self) -> tuple[array[float], list[array[float]]]:
        """Times and values as numbers of Python: a pose at a time is found faster than by NumPy."""
        return array("d", self.times.tobytes()), [array("d", row.tobytes()) for row in self.values]

    def changes(self) -> list[Span]:
        """Return the interval of all readings [s]."""
        return [(float(self.times[0]), float(self.times[-1]))]

    def max_load(self) -> float:
        """Return the maximum force [N]."""
        return float(self.values[2].max())

    def shifted(self, seconds: float) -> Reference:
        """Return the readings with `seconds` [s] added to their times."""
        return Reference(self.times + seconds, self.values)


@dataclass(frozen=True, eq=False)
class Scans:
    """Scans of the board."""

    time: Array
    """Stamps [s], shape [scans]."""
    counts: NDArray[np.uint16]
    """Counts, shape [scans, rows * cols]."""
    temperature: Array
    """Mean of the temperature sensors [degC], shape [scans]."""
    problem: str = ""
    """What could not be read of the recording, in one line; '' if everything could."""


def read_scans(file: Path, sensor: Sensor) -> Scans:
    """Return the scans in a recording.

    Parameters
    ----------
    file : Path
        File of `posfet can record`, or MCAP file with the topic `raw`.
    sensor : Sensor
        Sensor description.

    Returns
    -------
    Scans
        All complete scans.

    Raises
    ------
    ConfigError
        There is no scan or no temperature in it, or the board was reset. The message is one line.
    """
    if file.suffix.lower() not in {MCAP, *FORMATS}:
        raise ConfigError(f"{file}: must end with one of {', '.join((MCAP, *FORMATS))}")
    stamps: list[int] = []
    counts, temperatures = [], []
    recorded = RecordedScans(file, sensor) if file.suffix.lower() == MCAP else None
    for scan in _decoded(file, sensor) if recorded is None else recorded.scans():
        if stamps and (scan.status & (ScanStatus.BOARD_RESET | ScanStatus.ADC_FAULT) or scan.stamp <= stamps[-1]):
            raise ConfigError(f"{file}: the board was reset or its ADC failed after {len(stamps)} scans")
        stamps.append(scan.stamp)
        counts.append(scan.counts.copy())
        temperatures.append(float(np.mean(scan.temperatures)))
    if not stamps:
        raise ConfigError(f"{file}: no scan in it: compare the sensor file with the board")
    if not np.isfinite(temperatures).any():
        missing = "no signal of temperatures (protocol in the sensor file)" if sensor.mapping else "no status frame"
        raise ConfigError(f"{file}: no temperature in it: {missing} of the board was recorded")
    time = np.array(stamps, np.float64) * 1e-9
    problem = "" if recorded is None else recorded.problem
    return Scans(time, np.array(counts), interpolated_temperature(time, np.array(temperatures)), problem)


def _decoded(file: Path, sensor: Sensor) -> Iterator[Scan]:
    """Iterate over the scans in a recording of the bus."""
    decoder = make_decoder(sensor)
    decoder.start()
    for message in messages(file):
        for decoded in decoder.decode([frame_of(message)], round(message.timestamp * 1e9), 0):
            if isinstance(decoded, ScanReady):
                yield decoded.scan


def interpolated_temperature(time: Array, temperature: Array) -> Array:
    """Interpolate the temperatures linearly between status frames, of which there are ten per second.

    Parameters
    ----------
    time : numpy.ndarray
        Stamps [s], shape [scans].
    temperature : numpy.ndarray
        Temperature of the latest status frame [degC], NaN before the first, shape [scans].

    Returns
    -------
    numpy.ndarray
        Temperature of each scan [degC], shape [scans].
    """
    known = np.flatnonzero(np.isfinite(temperature))
    fresh = known[np.concatenate([[True], np.diff(temperature[known]) != 0])]
    ends = np.unique(np.append(fresh, known[-1]))
    interpolated: Array = np.interp(time, time[ends], temperature[ends])
    return interpolated


def read_reference(file: Path) -> Reference:
    """Return the readings in a file of the rig.

    Parameters
    ----------
    file : Path
        CSV file with `COLUMNS`.

    Raises
    ------
    ConfigError
        The file cannot be used. The message is one line naming file, line and column.
    """
    rows = csv.reader(io.StringIO(read_text(file, MAX_REFERENCE), newline=""))
    readings = array("d")
    try:
        if [name.strip() for name in next(rows, [])] != list(COLUMNS):
            raise ConfigError(f"{file}: line 1: must be '{','.join(COLUMNS)}'")
        for line, row in enumerate(rows, 2):
            if row:
                readings.extend(_reading(file, line, row))
    except csv.Error as error:
        raise ConfigError(f"{file}: not a CSV text file") from error
    values = np.array(readings).reshape(-1, len(COLUMNS))
    if len(values) < 2:
        raise ConfigError(f"{file}: must have two readings or more, got {len(values)}")
    late = np.flatnonzero(np.diff(values[:, 0]) <= 0)
    if len(late):
        raise ConfigError(f"{file}: reading {late[0] + 2}: time_s must be after that of the previous reading")
    x, y = values[:, 1:3].T * 1e-3
    return Reference(values[:, 0], np.stack([x, y, np.maximum(values[:, 3], 0.0)]))


def last_force(file: Path) -> float | None:
    """Return the newest force [N] in a file of the rig, which may still be growing; None if there is none."""
    try:
        with file.open("rb") as stream:
            stream.seek(max(stream.seek(0, 2) - TAIL, 0))
            whole = stream.read().decode("ascii", "replace").split("\n")[:-1]
        return _reading(file, 0, whole[-1].split(","))[-1]
    except (OSError, ConfigError, IndexError):
        return None


def _reading(file: Path, line: int, row: list[str]) -> list[float]:
    if len(row) != len(COLUMNS):
        raise ConfigError(f"{file}: line {line}: must have {len(COLUMNS)} values, got {len(row)}")
    values = []
    for name, text in zip(COLUMNS, row, strict=True):
        low, high = LIMITS[name]
        try:
            value = float(text)
        except ValueError:
            value = np.nan
        if not low <= value <= high:
            raise ConfigError(f"{file}: line {line}: {name} must be a number in [{low:g}, {high:g}], got {shown(text)}")
        values.append(value)
    return values


def combine(sensor: Sensor, scans: Scans, reference: Reference, ball: Sphere) -> tuple[Recording, float]:
    """Combine the scans of a board with the readings of the rig.

    Parameters
    ----------
    sensor : Sensor
        Sensor description.
    scans : Scans
        Scans of the board.
    reference : Reference
        Readings of the rig.
    ball : Sphere
        Ball of the rig; its modulus is the effective one, with the elastomer skin.

    Returns
    -------
    tuple of (Recording, float)
        The recording, and the delay of the clock of the rig [s].

    Raises
    ------
    ValueError
        The two do not match, or the force exceeds the validity of Hertz theory. The message is one line.
    """
    if reference.max_load() > ball.max_force:
        raise ValueError(
            f"a force of {reference.max_load():g} N is above the maximum of the ball, {ball.max_force:g} N"
        )
    begin, end = float(scans.time[0]), float(scans.time[-1])
    if reference.times[0] > begin + MAX_DELAY or reference.times[-1] < end - MAX_DELAY:
        raise ValueError(
            f"the reference must last from {begin:.1f} to {end:.1f} s as the frames do, "
            f"got {reference.times[0]:.1f} to {reference.times[-1]:.1f} s"
        )
    late = _delay(sensor, scans, reference, ball)
    aligned = reference.shifted(-late - begin)
    time = scans.time - begin

    def force_under(ratio: float, at: Array) -> Array:
        spread = ratio * sensor.device.contact_spread
        return _forces(replace(sensor, device=replace(sensor.device, contact_spread=spread)), at, aligned, ball)

    applied = np.interp(time, aligned.times, aligned.values[2])
    return Recording(time, scans.counts, scans.temperature, force_under(1.0, time), applied, force_under), late


def _delay(sensor: Sensor, scans: Scans, reference: Reference, ball: Sphere) -> float:
    """Return the delay of the reference [s], by correlation of the signal with what the force of the reference gives.

    That is charge at once, and charge that comes in slowly, as a film relaxes, creeps and is warmed by what touches it,
    each as much as correlates most. The leakage time constant is the one with which both correlate most, too.
    """
    step = float(np.median(np.diff(scans.time)))
    grid = np.arange(scans.time[0], scans.time[-1], step)
    chain, scale, charge = InverseSignalChain(sensor), charge_per_newton(sensor), np.empty(sensor.layout.taxels)
    signal = np.array([float(chain.charge(counts, charge).sum()) / scale for counts in scans.counts])
    force = np.interp(grid, reference.times, reference.values[2])
    slow = low_pass(grid, force, SLOW_CHARGE)
    warmth = low_pass(grid, _warmed(sensor, ball, force), NOMINAL_WARMTH_TIME_CONSTANT)
    measured, *rates = (
        _smoothed(np.diff(values), step) for values in (np.interp(grid, scans.time, signal), force, slow, warmth)
    )
    correlation = _Correlation(measured, rates, step)
    nominal = sensor.device.leak_time_constant
    low, high = (math.log(limit * nominal) for limit in LEAK_RANGE)
    found = golden_section(lambda at: -correlation.best(math.exp(at))[0], low, high, LEAK_STEPS)
    best, delay = correlation.best(math.exp(found))
    if not best > MIN_CORRELATION:
        raise ValueError(f"the reference does not match the recording within {MAX_DELAY:g} s: compare the clocks")
    return delay


def _warmed(sensor: Sensor, ball: Sphere, force: Array) -> Array:
    """Return how many taxels a ball warms on the middle of the array with a force [N], like it in shape."""
    levels = np.linspace(0.0, math.sqrt(float(force.max())), WARMED_LEVELS) ** 2
    pressed = Reference(levels, np.stack([0.0 * levels, 0.0 * levels, levels]))
    warmed = -np.expm1(-_forces(sensor, levels, pressed, ball) / NOMINAL_WARMTH_FORCE).sum(axis=1)
    counted: Array = np.interp(force, levels, warmed)
    return counted


def _smoothed(rate: Array, step: float) -> Array:
    """Return the rate per step [N] without its mean, averaged over periods of the mains."""
    rate = rate - rate.mean()
    for period in MAINS_PERIODS:
        scans = max(1, round(period / step))
        rate = np.convolve(rate, np.full(scans, 1.0 / scans), "same")
    return rate


class _Correlation:
    """Correlates the changes of a signal with those that its causes give, once they leak.

    Parameters
    ----------
    measured : ndarray
        Change of the signal in each step [N], shape [steps].
    rates : sequence of ndarray
        Change of each cause in each step, that of the force first, shapes [steps].
    step : float
        Step [s].
    """

    def __init__(self, measured: Array, rates: Sequence[Array], step: float) -> None:
        self._step, self._size = step, 1 << (2 * len(measured)).bit_length()
        self._measured = np.conj(np.fft.rfft(measured, self._size))
        self._norm = float(np.linalg.norm(measured))
        self._rates = [np.fft.rfft(rate, self._size) for rate in rates]
        self._before = np.exp(-2j * np.pi * np.fft.rfftfreq(self._size))
        """What delays by a step."""
        self._lags = min(round(MAX_DELAY / step), len(measured) - 1)

    def best(self, time_constant: float) -> tuple[float, float]:
        """Return the greatest correlation [1] of all delays within `MAX_DELAY`, and its delay [s].

        Parameters
        ----------
        time_constant : float
            Leakage time constant [s].
        """
        # The causes are linear within a step: signal[n] = kept*signal[n-1] + time_constant/step*(1 - kept)*rate[n].
        kept = math.exp(-self._step / time_constant)
        leaking = (time_constant / self._step * (1.0 - kept)) * (1.0 - self._before) / (1.0 - kept * self._before)
        expected = np.stack([np.fft.irfft(leaking * rate, self._size) for rate in self._rates])
        if self._norm == 0.0 or not expected[0].any():
            return 0.0, 0.0
        # Independent of each other, so that the squares of their correlations are added.
        independent = np.linalg.qr(expected.T)[0].T
        independent *= np.sign((independent * expected).sum(axis=1))[:, None]
        # Lags from -self._lags - 1 to self._lags + 1.
        lags = np.arange(-self._lags - 1, self._lags + 2)
        each = np.stack([np.fft.irfft(np.fft.rfft(part) * self._measured, self._size)[lags] for part in independent])
        around = np.copysign(np.sqrt((each**2).sum(axis=0)), each[0])
        at = int(around[1:-1].argmax()) + 1
        before, here, after = around[at - 1 : at + 2].tolist()
        bend = before - 2.0 * here + after
        fine = 0.5 * (before - after) / bend if bend < 0.0 else 0.0
        return (here + 0.25 * (after - before) * fine) / self._norm, self._step * (at - self._lags - 1 + fine)


def _forces(sensor: Sensor, time: Array, reference: Reference, ball: Sphere) -> Array:
    """Return the force on each taxel [N], shape [scans, rows * cols]."""
    layout, path = sensor.layout, SceneObject("ball", ball, reference)
    loads = SceneLoads(Scene("bench", "a ball on a rig", np.inf, (path,), Keyframes((0.0,), ((25.0,),))), sensor)
    forces = np.zeros((len(time), layout.rows, layout.cols))
    for begin in range(0, len(time), BATCH):
        these = forces[begin : begin + BATCH]
        for patch in loads.forces(time[begin : begin + BATCH].tolist()):
            these[:, patch.rows, patch.cols] += patch.force
    return forces.reshape(len(time), layout.taxels)
