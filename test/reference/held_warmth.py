"""A chip whose temperature drifts while a force is held, and the film's warmth to who knows how it drifts.

The film follows the chip with its lag. All taxels feel it, each by a little more or less: what a calibration leaves.
Two sensors tell the chip's temperature ten times a second, in steps of 1/256 K.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model.sensor.description import Sensor
from posfet_model.sensor.signal_chain import charge_per_newton

STEP: Final = 1e-3
"""Duration of a scan [s]."""

STATUS: Final = 100
"""Scans from a status of the board to the next."""

RESOLUTION: Final = 1 / 256
"""Of the temperatures in it [K]."""

BEFORE: Final = 2000
"""Scans for which the temperature wanders before the first that is seen: no board is switched on in a steady film."""

MEMORIES: Final = np.array([1e-2, 1e-1, 1.0, 1e1, 1e2, 1e3])
"""Of the Markov processes whose sum is 1/f noise, one a decade [s]."""


@dataclass(frozen=True)
class Drift:
    """How the temperature drifts, and what is left of it in the signals after calibration. All values are assumed."""

    ramp: float = 1 / 60
    """While a force is held the chip warms or cools by this [K/s]."""
    wander: float = 2e-3
    """Random walk of its temperature, all the time [K/sqrt(s)]."""
    uneven: float = 0.02
    """Standard deviation of the taxels' signals for temperature [1]."""

    def scans(self, seed: int, start: int, lag: float) -> Iterator[tuple[float, NDArray[np.float32]]]:
        """Yield the film's temperature [K] and the last readings [degC], shape [2], for ever; `BEFORE` scans first.

        start is the scan with which the ramp begins, lag [s] that of the film.
        """
        random = np.random.default_rng([seed, 1])
        ramp = self.ramp * STEP * random.choice([-1.0, 1.0])
        bias = 25.0 + random.uniform(0.0, 1.0, 2)
        share = -math.expm1(-STEP / lag)
        chip, film, index = 0.0, 0.0, -BEFORE
        readings = np.zeros(2, np.float32)
        while True:
            if index % STATUS == 0:
                readings = (np.rint((bias + chip) / RESOLUTION) * RESOLUTION).astype(np.float32)
            yield film, readings
            film += share * (chip - film)
            chip += self.wander * math.sqrt(STEP) * random.standard_normal() + (ramp if index >= start else 0.0)
            index += 1


def newton_per_kelvin(sensor: Sensor) -> float:
    """Return the signal of a taxel per warming of the film [N/K]."""
    return sensor.device.pyroelectric_coefficient / charge_per_newton(sensor)


class Warmth:
    """Kalman filter of what all taxels have in common: warmth and the mean of their 1/f noise and offsets.

    The state: the parts of the noise [N], and of the temperature the chip's [K], its slope [K/s], the film's [K], and
    that which the charge shows [K]: it leaks as long as all is at rest, and from then on counts in the force.
    """

    CHIP, SLOPE, FILM, SHOWN = -4, -3, -2, -1

    def __init__(self, sensor: Sensor, drift: Drift, white: float, flicker: float) -> None:
        """Take the variance of a reading [N2] and the density of the 1/f noise at 1 Hz [N2] of one taxel."""
        taxels, parts = sensor.layout.taxels, len(MEMORIES)
        kept, decade = np.exp(-STEP / MEMORIES), flicker * math.log(10.0) / taxels
        self._state = np.zeros(parts + 5)
        self._covariance = np.diag([*(decade for _ in MEMORIES), 1.0 / taxels, 0.0, 0.0, 0.0, 0.0])
        self._noise = np.diag([*(decade * (1.0 - kept**2)), 0.0, drift.wander**2 * STEP, 0.0, 0.0, 0.0])
        self._white, self._ramp = white / taxels, drift.ramp
        self._signal = np.array([*(1.0 for _ in range(parts + 1)), 0.0, 0.0, 0.0, newton_per_kelvin(sensor)])
        self._chip = np.eye(parts + 5)[self.CHIP]
        ratio = STEP / sensor.device.leak_time_constant
        share = -math.expm1(-STEP / sensor.device.thermal_time_constant)
        self._held = np.diag([*kept, 1.0, 1.0, 1.0, 1.0 - share, 1.0])
        self._held[self.CHIP, self.SLOPE] = STEP
        self._held[self.FILM, self.CHIP] = share
        self._held[self.SHOWN, [self.CHIP, self.FILM]] = share, -share
        self._rest = self._held.copy()
        self._rest[self.SHOWN] *= -math.expm1(-ratio) / ratio
        self._rest[self.SHOWN, self.SHOWN] = math.exp(-ratio)
        for _ in range(BEFORE):
            self._covariance = self._rest @ self._covariance @ self._rest.T + self._noise
        self._covariance[np.ix_([self.CHIP, self.FILM], [self.CHIP, self.FILM])] += 1.0  # what a kelvin is called
        self._first = math.nan
        self._index = 0
        self._touched = False
        self._sums = np.zeros(3)

    def take(self, signal: float, readings: NDArray[np.float32], touched: bool) -> None:
        """Take the mean signal of the taxels [N], which tells nothing while they are touched, and readings [degC]."""
        if self._index:
            passed = self._held if touched else self._rest
            self._state = passed @ self._state
            self._covariance = passed @ self._covariance @ passed.T + self._noise
        if touched and not self._touched:
            self._covariance[self.SLOPE, self.SLOPE] += self._ramp**2
        self._touched = touched
        if self._index % STATUS == 0:
            chip = float(readings.mean(dtype=np.float64))
            self._first = chip if self._index == 0 else self._first
            self._learn(self._chip, chip - self._first, RESOLUTION**2 / 24.0)  # of rounding, for two of them
        if not touched:
            self._learn(self._signal, signal, self._white)
        warm = self._signal[self.SHOWN] * self._state[self.SHOWN]
        self._sums += signal, self._state[: self.CHIP].sum(), warm
        self._index += 1

    def close_block(self, scans: int) -> tuple[float, float]:
        """Return what all taxels show besides force and what of it is warmth [N], means over the last scans."""
        signal, noise, warm = (self._sums / scans).tolist()
        self._sums[:] = 0.0
        return noise if self._touched else signal, warm

    def _learn(self, seen: NDArray[np.float64], value: float, variance: float) -> None:
        covered = self._covariance @ seen
        gain = covered / (seen @ covered + variance)
        self._state = self._state + gain * (value - seen @ self._state)
        self._covariance = self._covariance - np.outer(gain, covered)
