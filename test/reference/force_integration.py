# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Reference of the integration of leaking charges to forces, in NumPy; posfet_core, force_integration.hpp, says why."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from reference.thermometers import Thermometers

Array = NDArray[np.float64]

FEWEST = 5
"""With fewer taxels a uniform change is no evidence of a temperature [1]."""

LEAST_LOADED = 0.2
"""Quantile of the forces that represents the least-loaded taxels [1]."""

LEAK_STEP: Final = 1.0 / 32.0
"""Temperatures by which the leakage is distinguished [K]."""
GREATEST_LEAK: Final = 1.5
"""Greatest logarithm of what a temperature makes of the leakage [1]."""


def round_half_away(value: float) -> float:
    """Return the nearest whole number; a half is rounded away from zero."""
    return value if math.isnan(value) else math.copysign(math.floor(abs(value) + 0.5), value)


class ForceIntegration:
    """Forces of all taxels, and their sums over a block of scans; arrays of shape [taxels].

    State variables: charge densities of the last scan [C/m2]; forces, corrections and sums [N], variance and deviation
    of what leaked within long steps; the watched taxels.

    Parameters
    ----------
    time_constant : ndarray of float64
        Leakage time constants [s], > 0.
    newton_per_charge : ndarray of float64
        Force per charge density [N m2/C].
    newton_per_kelvin : ndarray of float64
        Force per temperature of the film [N/K].
    long_step : float
        Step from which on the time of a jump within it is unknown [s].
    greatest_loss : float
        Deviation of what leaked in one step, summed over the taxels, with which forces are not valid [N].
    noticeable : float
        Force of a taxel from which a scan is tested for a uniform change [N].
    fastest : float
        Greatest rate of the film's temperature [K/s].
    negligible : float
        Uniform change of the film's temperature with which forces are still valid [K].
    causes : int
        Number of causes of errors that the forces have in common.
    leak_per_kelvin : float
        Increase of the leak rates per temperature, of their logarithm [1/K].
    leak_temperature : float
        Temperature at which they are as given [degC]; NaN: unknown.
    """

    def __init__(
        self,
        time_constant: Array,
        newton_per_charge: Array,
        newton_per_kelvin: Array,
        long_step: float,
        greatest_loss: float = math.inf,
        noticeable: float = math.inf,
        fastest: float = 0.0,
        negligible: float = 0.0,
        causes: int = 1,
        leak_per_kelvin: float = 0.0,
        leak_temperature: float = math.nan,
    ):
        self._tau, self._per_charge = time_constant, newton_per_charge
        self._per_kelvin, self._long_step = newton_per_kelvin, long_step
        taxels = len(time_constant)
        self._charge, self.raw, self.change, self.correction, self.rate = np.zeros((5, taxels))
        self.force, self.sum, self.raw_sum, self.jumped, self.lost = np.zeros((5, taxels))
        self._limits = greatest_loss, noticeable, fastest, negligible
        self.clipped, self.held, self.rise_deviation = np.zeros(taxels), np.zeros(taxels), 0.0
        self.correlated_error = np.zeros((taxels, causes))
        self.offset_known, self.ignored = np.zeros((2, taxels), np.bool_)
        self.started = self.valid = False
        self.age = 0.0
        self.reading = self.sensors = math.nan
        self.thermometers = Thermometers()
        self._leak_per_kelvin, self._leak_temperature = leak_per_kelvin, leak_temperature
        self.warmer, self.leak = math.nan, 1.0
        self.watch_none()
        self.start_block()

    @property
    def signal(self) -> Array:
        """Charges of the last scan as forces [N]."""
        return self._charge * self._per_charge

    def start(self, charge: Array) -> None:
        """Set the charge densities of a first scan [C/m2]."""
        self._charge = charge.copy()

    def process(self, charge: Array, temperatures: NDArray[np.float32], step: float) -> bool:
        """Process a scan and the temperatures [degC] in it; return whether it has a predecessor."""
        reading = self.thermometers.read(temperatures, step if self.started else math.inf)
        if not math.isnan(reading):
            self.reading = self.sensors = reading
        if not self.started:
            return False
        lost = self.advance(charge, step)
        self.scans += 1
        self.elapsed += step
        self.age += step
        self.square += step * step
        if lost > 0.0:
            self.correlated_error[:, -1] = self.lost
            self.valid = self.valid and lost < self._limits[0]
        return True

    def compensate_common_mode(self, touched: bool) -> None:
        """Keep a uniform change out of the forces of a scan."""
        _, noticeable, fastest, negligible = self._limits
        self.follow_untouched()
        if touched or not self._may_remove:
            return
        per_kelvin = abs(float(self._per_kelvin.mean()))
        removed = self.remove_uniform(self.ignored, noticeable, fastest * self.elapsed * per_kelvin - self.compensated)
        if removed > 0.0:
            self.compensated += removed
            self.valid = self.valid and self.compensated <= negligible * per_kelvin

    def clip(self, saturated: NDArray[np.bool_], step: float) -> None:
        """Note what leaked unseen of the saturated taxels in a step."""
        self.clipped[saturated] += np.abs(self.signal[saturated]) * (step * self.leak / self._tau[saturated])

    def advance(self, charge: Array, step: float) -> float:
        """Process a scan, `step` seconds after the one before; return the deviation of what leaked in a long step."""
        ratio = step * self.leak / self._tau
        mean = -np.expm1(-ratio) / ratio
        self.change = (charge / mean + self._charge * (ratio - 1.0 / mean)) * self._per_charge
        self._charge = charge.copy()
        self.raw = self.raw + self.change
        self.raw_sum = self.raw_sum + self.raw
        self.correction = self.correction + self.rate * step
        self.force = self.raw - self.correction
        self.sum = self.sum + self.force
        if step <= self._long_step:
            return 0.0
        lost = np.abs(self.change) * ratio / np.sqrt(12.0)
        self.jumped = self.jumped + lost**2
        self.lost = np.sqrt(self.lost**2 + lost**2)
        return float(lost.sum(where=~self.ignored))

    def start_block(self, may_remove: bool = False) -> None:
        """Clear the sums of the block; a uniform change may be removed in it."""
        self._may_remove = may_remove
        self.scans = self.elapsed = self.square = self.compensated = 0.0
        self.sum, self.raw_sum, self.jumped = np.zeros((3, len(self._tau)))
        # As the sensors' temperature has it, up to their noise.
        self.warmer = LEAK_STEP * round_half_away((self.thermometers.temperature - self._leak_temperature) / LEAK_STEP)
        if not math.isnan(self.warmer):
            limited = min(max(self._leak_per_kelvin * self.warmer, -GREATEST_LEAK), GREATEST_LEAK)
            self.leak = math.exp(limited)

    def watch(self, untouched: NDArray[np.intp], small: Array, share: float) -> None:
        """Set the untouched taxels, their small forces [N], and the film's share of a uniform change."""
        self._untouched, self._small, self._share = untouched, small, share

    def watch_none(self) -> None:
        """Watch no taxel."""
        self.watch(np.zeros(0, np.intp), np.zeros(0), 0.0)

    def follow_untouched(self) -> None:
        """Subtract what the watched taxels show of the film's temperature."""
        if len(self._untouched):
            kelvin = (self.force[self._untouched] - self._small) / self._per_kelvin[self._untouched]
            self._shift(self._share * float(np.median(kelvin)))

    def remove_uniform(self, ignored: NDArray[np.bool_], noticeable: float, most: float) -> float:
        """Subtract a uniform change of the other taxels [N]; return it."""
        usable = np.sort(self.force[~ignored])
        if len(usable) < FEWEST or usable[-1] < noticeable:
            return 0.0
        least = min(float(usable[int(LEAST_LOADED * len(usable))]), most)
        if least <= 0.0:
            return 0.0
        self._shift(least / float(self._per_kelvin.mean()))
        return least

    def _shift(self, kelvin: float) -> None:
        self.correction = self.correction + self._per_kelvin * kelvin
        self.force = self.force - self._per_kelvin * kelvin
