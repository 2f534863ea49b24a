# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""What a force that is held tells of the causes that make it seem to change.

The uncorrected force of an integration with tau' instead of the true tau is F' = (1 - b)*F + b*x, where x is the charge
that is left and b = 1 - tau/tau'. While a force is held, or changes at a constant rate, F' follows the decay of x,
which a linear trend does not explain. So the force of all touched taxels in a window of blocks is fitted by
``a + c*t + b*x``. The slope b measures all shared states with a response of that shape: leak first, and warmth and
creep as far as theirs is alike.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from posfet_model._lib.types import Array

HOP: Final = 4
"""Blocks from one window to the next, which has most of its blocks in common with it."""

MISFIT: Final = 2.0
"""Mean square residual above which a force is not steady, in variances of its points [1]."""

MODEL_ERROR: Final = 2e-3
"""Residual of a steady force beyond that, as a share of the change of the charge [1]."""

LARGEST_CHANGE: Final = 0.015
"""Relative change of a steady force in a window [1]: a larger one may be nonlinear, too."""

INFORMATIVE: Final = 0.03
"""Standard deviation of b above which a window is not informative [1]."""

TREMOR: Final = 0.1
"""Part of the change of a force within a window that looks like a decay of the charge in another one [1]."""

UNSTEADY_WINDOWS: Final = 8.0
"""Windows in which a force that was less steady is forgotten [1]: about two thirds of a second."""

STEADINESS: Final = 0.02
"""Error of b as a force is never quite steady: standard deviation [1], assumed."""


@dataclass(frozen=True)
class SharedMeasurement:
    """A measurement of the shared states: innovation = sensitivity.(true - estimated states) + noise."""

    innovation: float
    """Measured less expected value."""
    sensitivity: Array
    """Sensitivity to the shared states, shape [shared]."""
    variance: float
    """Variance of the noise."""


class SteadyForce:
    """Finds what forces that are held tell, and how steady they have been."""

    def __init__(self) -> None:
        """Start with a force that has been steady."""
        self._unsteadiness = 0.0

    def observe(
        self, time: Array, force: Array, charge: Array, response: Array, warmed: float, noise: float
    ) -> SharedMeasurement | None:
        """Return what the touched taxels together tell in a window; None: nothing, or their force is not steady.

        Parameters
        ----------
        time : ndarray of float64, shape [blocks]
            Times of the blocks [s].
        force : ndarray of float64, shape [blocks, taxels]
            Estimated forces, with the present shared states [N].
        charge : ndarray of float64, shape [blocks, taxels]
            Charges that are left, as forces, up to a constant [N].
        response : ndarray of float64, shape [blocks, shared]
            Response of the error of their sum to the shared states; zero for states that are not constant.
        warmed : float
            By how much the film's temperature may have changed that sum within the window [N].
        noise : float
            Variance of the noise of each sum of forces and of charges, which is the same noise [N2].
        """
        points, total = len(time), float(force.sum()) / len(time)
        if warmed > LARGEST_CHANGE * total:
            return None
        before = time - time.mean()
        rate = before / (before @ before)

        def detrended(values: Array) -> Array:
            left: Array = values - values.mean(axis=0)
            left -= np.multiply.outer(before, rate @ left)
            return left

        decay = detrended(charge.sum(axis=1))
        square = float(decay @ decay) - (points - 2) * noise
        if square * INFORMATIVE**2 <= noise:
            return None
        course = detrended(force.sum(axis=1))
        slope = (float(decay @ course) - (points - 2) * noise) / square
        residual = float(np.square(course - slope * decay).sum()) / (points - 3)
        # Also of each taxel: an object that slides keeps its force, but not the forces of the taxels.
        duration = float(time[-1] - time[0])
        motion = rate @ (force - slope * charge) * duration
        moved = float(np.abs(motion).sum())
        if residual > MISFIT * noise * (1.0 - slope) ** 2 + MODEL_ERROR**2 / points * square:
            return None
        if moved > LARGEST_CHANGE * total:
            return None
        sensitivity = decay @ detrended(response) / square
        # A tremor changes the force in one window, by more than two deviations of its noise, and bends its course in
        # the next one.
        noisy = 4.0 * noise * (1.0 - slope) ** 2 * float(rate @ rate) * duration**2
        changed = math.sqrt(max(float(motion.sum()) ** 2 - noisy, 0.0))
        self._unsteadiness = max(self._unsteadiness * (1.0 - 1.0 / UNSTEADY_WINDOWS), changed / total)
        bent = TREMOR * self._unsteadiness * total
        # Windows overlap: each counts for its new blocks only.
        variance = STEADINESS**2 + (noise + points * bent**2) / square
        return SharedMeasurement(slope, sensitivity, points / HOP * variance)
