"""A recording for a calibration from a real board: its frames, and what a test stand pressed with meanwhile.

The frames are a file of `posfet can record`. The stand's file has where its ball was and how hard it pressed; which
share of that each taxel bears follows from Hertz and the cover, as in a scene. The two clocks need not be the same to
better than `FARTHEST`: by how much the stand's is late is found from what both saw of the force.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_driver.bus.message_conversion import frame_of
from posfet_driver.bus.recording import messages
from posfet_driver.protocol.decoder import Decoder, ScanReady
from posfet_model.calibration.least_squares_fit import Recording
from posfet_model.config import ConfigError
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import ScanStatus
from posfet_model.sensor.signal_chain import InverseChain, charge_per_newton
from posfet_sim.contact.indenters import Sphere
from posfet_sim.scene import Scene, SceneLoads, SceneObject, Track
from posfet_sim.scene.trajectories import Pose, Span

FoundArray = NDArray[np.float64]

COLUMNS: Final = ("time_s", "x_mm", "y_mm", "force_N")
"""Of the stand's file: time by its clock, the middle of the contact in the frame of the array, and the force."""

LIMITS: Final = {"time_s": (0.0, 1e11), "x_mm": (-1000.0, 1000.0), "y_mm": (-1000.0, 1000.0), "force_N": (-10.0, 1e3)}
"""A force below 0 is noise of the stand, and counts as none."""

FARTHEST: Final = 0.5
"""Greatest delay between the two clocks that is looked for [s]."""

SMOOTHING: Final = 0.01
"""Time over which rates are averaged before they are compared [s]."""

ALIKE: Final = 0.5
"""Least correlation of the rates that the two files tell [1]."""

AT_ONCE: Final = 256
"""Scans whose forces are found together."""


@dataclass(frozen=True, eq=False)
class Reference:
    """What the stand did, in straight lines between its readings; the path of a scene's object."""

    times: FoundArray
    """[s], ascending."""
    values: FoundArray
    """x, y [m] and force [N], shape [3, readings]."""

    def at(self, time: float) -> Pose:
        """Return the pose at a time [s]."""
        x, y, force = (float(np.interp(time, self.times, row)) for row in self.values)
        return x, y, 0.0, force

    def changes(self) -> list[Span]:
        """Return the whole of it."""
        return [(float(self.times[0]), float(self.times[-1]))]

    def top_load(self) -> float:
        """Return the greatest force [N]."""
        return float(self.values[2].max())

    def shifted(self, seconds: float) -> Reference:
        """Return it with times that are greater by `seconds`."""
        return Reference(self.times + seconds, self.values)


@dataclass(frozen=True, eq=False)
class Scans:
    """What the board sent."""

    time: FoundArray
    """[s], shape [scans]."""
    counts: NDArray[np.uint16]
    """Shape [scans, rows * cols]."""
    temperature: FoundArray
    """Mean of the chip's sensors [degC], shape [scans]."""


def read_scans(file: Path, sensor: Sensor) -> Scans:
    """Return the scans in a recording of the bus. Raises ConfigError, one line, when they do not make a recording."""
    decoder = Decoder(sensor)
    decoder.receiving = True
    stamps: list[int] = []
    counts, temperatures = [], []
    for message in messages(file):
        for decoded in decoder.decode([frame_of(message)], round(message.timestamp * 1e9), 0):
            if not isinstance(decoded, ScanReady):
                continue
            scan = decoded.scan
            if stamps and (scan.status & (ScanStatus.BOARD_RESET | ScanStatus.ADC_FAULT) or scan.stamp <= stamps[-1]):
                raise ConfigError(f"{file}: the board was reset or its ADC failed after {len(stamps)} scans")
            stamps.append(scan.stamp)
            counts.append(scan.counts.copy())
            temperatures.append(float(np.mean(scan.temperatures)))
    if not stamps:
        raise ConfigError(f"{file}: no scan is in it: compare the sensor file with the board")
    if not np.isfinite(temperatures).any():
        raise ConfigError(f"{file}: no temperature is in it: the board's status frames are missing")
    time = np.array(stamps, np.float64) * 1e-9
    return Scans(time, np.array(counts), even_temperature(time, np.array(temperatures)))


def even_temperature(time: FoundArray, temperature: FoundArray) -> FoundArray:
    """Return the temperatures [degC] of all scans, in straight lines between status frames, which come ten a second."""
    known = np.flatnonzero(np.isfinite(temperature))
    fresh = known[np.concatenate([[True], np.diff(temperature[known]) != 0])]
    ends = np.unique(np.append(fresh, known[-1]))
    even: FoundArray = np.interp(time, time[ends], temperature[ends])
    return even


def read_reference(file: Path) -> Reference:
    """Return what a stand's file tells. Raises ConfigError, one line naming file, line and column."""
    try:
        with file.open(newline="", encoding="utf-8") as stream:
            rows = list(csv.reader(stream))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        reason = error.strerror if isinstance(error, OSError) else "not a text of comma-separated values"
        raise ConfigError(f"{file}: {reason}") from error
    if not rows or [name.strip() for name in rows[0]] != list(COLUMNS):
        raise ConfigError(f"{file}: line 1: must be '{','.join(COLUMNS)}'")
    values = np.array([_reading(file, line, row) for line, row in enumerate(rows[1:], 2) if row])
    if len(values) < 2:
        raise ConfigError(f"{file}: must have two readings or more, got {len(values)}")
    late = np.flatnonzero(np.diff(values[:, 0]) <= 0)
    if len(late):
        raise ConfigError(f"{file}: reading {late[0] + 2}: time_s must be after that of the reading before")
    x, y = values[:, 1:3].T * 1e-3
    return Reference(values[:, 0], np.stack([x, y, np.maximum(values[:, 3], 0.0)]))


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
            raise ConfigError(f"{file}: line {line}: {name} must be a number in [{low:g}, {high:g}], got '{text}'")
        values.append(value)
    return values


def combine(sensor: Sensor, scans: Scans, reference: Reference, ball: Sphere) -> tuple[Recording, float]:
    """Return the recording of both, and by how much the stand's clock is late [s].

    Raises ValueError, one line, when the two do not belong together, or the ball is pressed harder than Hertz holds.
    """
    if reference.top_load() > ball.greatest_force:
        raise ValueError(
            f"a force of {reference.top_load():g} N is above the ball's greatest, {ball.greatest_force:g} N"
        )
    begin, end = float(scans.time[0]), float(scans.time[-1])
    if reference.times[0] > begin + FARTHEST or reference.times[-1] < end - FARTHEST:
        raise ValueError(
            f"the reference must last from {begin:.1f} to {end:.1f} s as the frames do, "
            f"got {reference.times[0]:.1f} to {reference.times[-1]:.1f} s"
        )
    late = _delay(sensor, scans, reference)
    mine = reference.shifted(-late - begin)
    time = scans.time - begin
    return Recording(time, scans.counts, scans.temperature, _forces(sensor, time, mine, ball)), late


def _delay(sensor: Sensor, scans: Scans, reference: Reference) -> float:
    """Return by how much the reference is late [s]: where its rate is most like that of the force the signals tell."""
    step = float(np.median(np.diff(scans.time)))
    grid = np.arange(scans.time[0], scans.time[-1], step)
    chain, scale, charge = InverseChain(sensor), charge_per_newton(sensor), np.empty(sensor.layout.taxels)
    signal = np.array([float(chain.charge(counts, charge).sum()) / scale for counts in scans.counts])
    signal = np.interp(grid, scans.time, signal)
    told = np.diff(signal) + 0.5 * (signal[1:] + signal[:-1]) * (step / sensor.device.leak_time_constant)
    pressed = np.diff(np.interp(grid, reference.times, reference.values[2]))
    window = np.ones(max(1, round(SMOOTHING / step)))
    told, pressed = (np.convolve(rate - rate.mean(), window, "same") for rate in (told, pressed))
    size = 1 << (2 * len(told)).bit_length()
    product = np.fft.rfft(pressed, size) * np.conj(np.fft.rfft(told, size))
    most = min(round(FARTHEST / step), len(told) - 1)
    alike = np.roll(np.fft.irfft(product, size), most + 1)[: 2 * most + 3]  # lags from -most - 1 to most + 1
    best = int(alike[1:-1].argmax()) + 1
    if not alike[best] > ALIKE * np.linalg.norm(told) * np.linalg.norm(pressed):
        raise ValueError(f"the reference does not follow what was recorded within {FARTHEST:g} s: compare the clocks")
    before, here, after = alike[best - 1 : best + 2]
    return step * float(best - most - 1 + 0.5 * (before - after) / (before - 2.0 * here + after))


def _forces(sensor: Sensor, time: FoundArray, reference: Reference, ball: Sphere) -> FoundArray:
    """Return the force on each taxel [N], shape [scans, rows * cols]."""
    layout, path = sensor.layout, SceneObject("ball", ball, reference)
    loads = SceneLoads(Scene("bench", "a ball on a stand", np.inf, (path,), Track((0.0,), ((25.0,),))), sensor)
    forces = np.zeros((len(time), layout.rows, layout.cols))
    for begin in range(0, len(time), AT_ONCE):
        these = forces[begin : begin + AT_ONCE]
        for patch in loads.forces(time[begin : begin + AT_ONCE].tolist()):
            these[:, patch.rows, patch.cols] += patch.force
    return forces.reshape(len(time), layout.taxels)
