# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Reference of the integration of leaking charges to forces, in NumPy; posfet_core, force_integration.hpp, says why."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FEWEST = 5
"""With fewer taxels a uniform change is no evidence of a temperature [1]."""

LEAST_LOADED = 0.2
"""Quantile of the forces that represents the least-loaded taxels [1]."""


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
    """

    def __init__(self, time_constant: Array, newton_per_charge: Array, newton_per_kelvin: Array, long_step: float):
        self._tau, self._per_charge = time_constant, newton_per_charge
        self._per_kelvin, self._long_step = newton_per_kelvin, long_step
        taxels = len(time_constant)
        self._charge, self.raw, self.change, self.correction, self.rate = np.zeros((5, taxels))
        self.force, self.sum, self.raw_sum, self.jumped, self.lost = np.zeros((5, taxels))
        self.watch_none()

    @property
    def signal(self) -> Array:
        """Charges of the last scan as forces [N]."""
        return self._charge * self._per_charge

    def start(self, charge: Array) -> None:
        """Set the charge densities of a first scan [C/m2]."""
        self._charge = charge.copy()

    def advance(self, charge: Array, step: float) -> float:
        """Process a scan, `step` seconds after the one before; return the deviation of what leaked in a long step."""
        ratio = step / self._tau
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
        return float(lost.sum())

    def start_block(self) -> None:
        """Clear the sums of the block."""
        self.sum, self.raw_sum, self.jumped = np.zeros((3, len(self._tau)))

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
