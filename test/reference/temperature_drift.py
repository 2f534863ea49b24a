# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Temperature drift of the chip while a force is held, and an estimator of its effect that knows the drift model.

The film follows the chip with its thermal lag. The pyroelectric response differs slightly between the taxels: the
residual of a calibration. Two sensors measure the chip temperature at 10 Hz with a resolution of 1/256 K.
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

STATUS_PERIOD: Final = 100
"""Number of scans between two status frames of the board."""

RESOLUTION: Final = 1 / 256
"""Resolution of the temperatures in a status frame [K]."""

WARM_UP_SCANS: Final = 2000
"""Number of scans of random walk before the first observed one: the film is not in equilibrium at switch-on."""

TIME_CONSTANTS: Final = np.array([1e-2, 1e-1, 1.0, 1e1, 1e2, 1e3])
"""Time constants of the Markov processes whose sum is 1/f noise, one per decade [s]."""


@dataclass(frozen=True)
class Drift:
    """Drift of the temperature, and its residual in the signals after calibration. All values are assumed."""

    ramp: float = 1 / 60
    """Rate at which the chip warms or cools while a force is held [K/s]."""
    random_walk: float = 2e-3
    """Intensity of the random walk of the chip temperature, at all times [K/sqrt(s)]."""
    spread: float = 0.02
    """Relative standard deviation of the pyroelectric response between the taxels [1]."""

    def scans(self, seed: int, start: int, lag: float) -> Iterator[tuple[float, NDArray[np.float32]]]:
        """Yield the film temperature [K] and the last readings [degC], shape [2], without end.

        The first `WARM_UP_SCANS` scans come before scan 0. The ramp begins with scan `start`; `lag` [s] is the thermal
        lag of the film.
        """
        random = np.random.default_rng([seed, 1])
        ramp = self.ramp * STEP * random.choice([-1.0, 1.0])
        bias = 25.0 + random.uniform(0.0, 1.0, 2)
        share = -math.expm1(-STEP / lag)
        chip, film, index = 0.0, 0.0, -WARM_UP_SCANS
        readings = np.zeros(2, np.float32)
        while True:
            if index % STATUS_PERIOD == 0:
                readings = (np.rint((bias + chip) / RESOLUTION) * RESOLUTION).astype(np.float32)
            yield film, readings
            film += share * (chip - film)
            chip += self.random_walk * math.sqrt(STEP) * random.standard_normal() + (ramp if index >= start else 0.0)
            index += 1


def newton_per_kelvin(sensor: Sensor) -> float:
    """Return the signal of a taxel per temperature rise of the film [N/K]."""
    return sensor.device.pyroelectric_coefficient / charge_per_newton(sensor)


class CommonModeFilter:
    """Kalman filter of the common-mode signal: temperature rise, and the mean of 1/f noise and offsets.

    The state: the components of the noise [N], the chip temperature [K], its slope [K/s], the film temperature [K], and
    the temperature rise that the charge shows [K]. The last one decays by leakage at rest; during a touch the estimated
    force includes it.
    """

    CHIP, SLOPE, FILM, CHARGE = -4, -3, -2, -1

    def __init__(self, sensor: Sensor, drift: Drift, white: float, flicker: float) -> None:
        """Set the variance of a reading [N2] and the density of the 1/f noise at 1 Hz [N2] of one taxel."""
        taxels, parts = sensor.layout.taxels, len(TIME_CONSTANTS)
        decay, decade = np.exp(-STEP / TIME_CONSTANTS), flicker * math.log(10.0) / taxels
        self._state = np.zeros(parts + 5)
        self._covariance = np.diag([*(decade for _ in TIME_CONSTANTS), 1.0 / taxels, 0.0, 0.0, 0.0, 0.0])
        self._noise = np.diag([*(decade * (1.0 - decay**2)), 0.0, drift.random_walk**2 * STEP, 0.0, 0.0, 0.0])
        self._white, self._ramp = white / taxels, drift.ramp
        self._signal = np.array([*(1.0 for _ in range(parts + 1)), 0.0, 0.0, 0.0, newton_per_kelvin(sensor)])
        self._chip = np.eye(parts + 5)[self.CHIP]
        ratio = STEP / sensor.device.leak_time_constant
        share = -math.expm1(-STEP / sensor.device.thermal_time_constant)
        self._during_touch = np.diag([*decay, 1.0, 1.0, 1.0, 1.0 - share, 1.0])
        self._during_touch[self.CHIP, self.SLOPE] = STEP
        self._during_touch[self.FILM, self.CHIP] = share
        self._during_touch[self.CHARGE, [self.CHIP, self.FILM]] = share, -share
        self._at_rest = self._during_touch.copy()
        self._at_rest[self.CHARGE] *= -math.expm1(-ratio) / ratio
        self._at_rest[self.CHARGE, self.CHARGE] = math.exp(-ratio)
        for _ in range(WARM_UP_SCANS):
            self._covariance = self._at_rest @ self._covariance @ self._at_rest.T + self._noise
        self._covariance[np.ix_([self.CHIP, self.FILM], [self.CHIP, self.FILM])] += (
            1.0  # the absolute temperature is unknown
        )
        self._first = math.nan
        self._index = 0
        self._touched = False
        self._sums = np.zeros(3)

    def update(self, signal: float, readings: NDArray[np.float32], touched: bool) -> None:
        """Process the mean signal of the taxels [N], which is uninformative during a touch, and readings [degC]."""
        if self._index:
            transition = self._during_touch if touched else self._at_rest
            self._state = transition @ self._state
            self._covariance = transition @ self._covariance @ transition.T + self._noise
        if touched and not self._touched:
            self._covariance[self.SLOPE, self.SLOPE] += self._ramp**2
        self._touched = touched
        if self._index % STATUS_PERIOD == 0:
            chip = float(readings.mean(dtype=np.float64))
            self._first = chip if self._index == 0 else self._first
            self._correct(
                self._chip, chip - self._first, RESOLUTION**2 / 24.0
            )  # variance of the rounding, mean of two readings
        if not touched:
            self._correct(self._signal, signal, self._white)
        thermal = self._signal[self.CHARGE] * self._state[self.CHARGE]
        self._sums += signal, self._state[: self.CHIP].sum(), thermal
        self._index += 1

    def close_block(self, scans: int) -> tuple[float, float]:
        """Return the common-mode signal without force, and its thermal part [N], means over the last scans."""
        signal, noise, thermal = (self._sums / scans).tolist()
        self._sums[:] = 0.0
        return noise if self._touched else signal, thermal

    def _correct(self, observation: NDArray[np.float64], value: float, variance: float) -> None:
        covered = self._covariance @ observation
        gain = covered / (observation @ covered + variance)
        self._state = self._state + gain * (value - observation @ self._state)
        self._covariance = self._covariance - np.outer(gain, covered)
