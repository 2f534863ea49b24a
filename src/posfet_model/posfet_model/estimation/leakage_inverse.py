# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Leakage compensation (inverse high-pass): force increments from leaking charges, scan by scan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from posfet_model._lib.first_order import mean_decay
from posfet_model._lib.types import Array


@dataclass(frozen=True)
class LeakageCoefficients:
    """Coefficients of one time step h for each taxel, shapes [taxels]; read-only."""

    ratio: Array
    """h/tau [1]."""
    now: Array
    """Factor of the charge density at the end of the step [N m2/C]."""
    before: Array
    """Factor of the charge density at the start of the step [N m2/C]."""


class LeakageInverse:
    """Inverse of the first-order high-pass that charge leakage makes of the force, one time constant per taxel.

    With signals s = k*sigma, a step h changes the force by ``(s1 - s0)/mean + h/tau*s0``, where mean is
    (1 - exp(-h/tau))/(h/tau), as in `charge.invert_first_order_hold`.

    State variables: the charge densities of the last scan [C/m2]. The coefficients of recent steps are cached.

    Parameters
    ----------
    time_constant : ndarray of float64, shape [taxels]
        Leakage time constants tau [s], > 0.
    newton_per_charge : ndarray of float64, shape [taxels]
        k, force per charge density [N m2/C].
    """

    CACHE_SIZE = 64
    """Number of different steps whose coefficients are kept."""

    def __init__(self, time_constant: Array, newton_per_charge: Array) -> None:
        self._time_constant = time_constant
        self._newton_per_charge = newton_per_charge
        self._cache: dict[float, LeakageCoefficients] = {}
        self._charge = np.zeros(len(time_constant))

    @property
    def signal(self) -> Array:
        """Charges of the last scan as forces, without leakage compensation [N], shape [taxels]."""
        signal: Array = self._charge * self._newton_per_charge
        return signal

    def start(self, charge: Array) -> None:
        """Set the charge densities [C/m2] of a first scan, which has no predecessor."""
        self._charge[...] = charge

    def advance(self, charge: Array, step: float, out: Array) -> LeakageCoefficients:
        """Process the charge densities [C/m2] a step [s] later; return the coefficients of the step.

        The force increments [N] are written into `out`.

        Parameters
        ----------
        charge : ndarray of float64, shape [taxels]
            Charge densities [C/m2].
        step : float
            Time since the last scan [s].
        out : ndarray of float64, shape [taxels]
            Force increments [N], overwritten.
        """
        coefficients = self._cache.get(step) or self._compute(step)
        last = self._charge
        np.multiply(charge, coefficients.now, out=out)
        last *= coefficients.before
        out += last
        last[...] = charge
        return coefficients

    def _compute(self, step: float) -> LeakageCoefficients:
        if len(self._cache) >= self.CACHE_SIZE:
            self._cache.clear()
        ratio = step / self._time_constant
        now = self._newton_per_charge / mean_decay(ratio)
        found = self._cache[step] = LeakageCoefficients(ratio, now, self._newton_per_charge * ratio - now)
        return found
