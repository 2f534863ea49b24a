# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Reference of the detection of telegraph noise, in NumPy; posfet_core/telegraph_noise.hpp says what it does."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from posfet_model._lib.types import Array, Mask
from reference.neighbour_estimate import NeighbourInterpolation
from reference.reductions import any_true
from reference.skin_response import SkinResponse

LEAST_STEP: Final = 8.0
"""Standard deviations of a block's mean from which another mean is another level [1]."""

AGREEING: Final = 4.0
"""Standard deviations of the difference of two blocks' means up to which they agree [1]."""

TOLERANCE: Final = 0.1
"""Part of a step by which the taxel may miss the level before [1], assumed."""

LEAKED: Final = 2.0
"""Leaked charge of a force from which it would have missed the level clearly [tolerance]."""

NEIGHBOUR_STEP: Final = 0.07
"""Part of a step beyond the noise by which no neighbour changes [1]: half of what the sharpest tip lets it feel. In a
slide, neighbours change by as much."""

RETURNS: Final = 2
"""Number of returns that identify telegraph noise [1], assumed: up, down and up again."""

MEMORY: Final = 10.0
"""Time for which a return counts [s], assumed: levels last for up to 2 s."""

CERTAINTY: Final = 4.0
"""Standard deviations by which the neighbours of a step must miss their part [1]."""

SPAN: Final = 4
"""Number of blocks over which a step is measured [1]: the two that agree, and one in between."""


class TelegraphDetector:
    """Tests the taxels of one array block by block. Signals are in one unit of the caller's choice.

    State variables per taxel: the present level and the one before, and the time on it [s]; the number of returns, and
    the time since the last one, and that but for touches [s]; means of the last blocks.

    Parameters
    ----------
    taxels : int
        Number of taxels.
    time_constant : float
        Leakage time constant [s].
    skin : SkinResponse
        What the neighbours of a pressed taxel must feel.
    surroundings : NeighbourInterpolation
        Neighbours of each taxel.
    """

    def __init__(
        self, taxels: int, time_constant: float, skin: SkinResponse, surroundings: NeighbourInterpolation
    ) -> None:
        self._time_constant = time_constant
        self._skin = skin
        self._surroundings = surroundings
        self._level, self._before = np.full((2, taxels), np.nan)
        self._returns, self._age, self._quiet, self._dwell = np.zeros((4, taxels))
        self._means = np.full((SPAN, taxels), np.nan)
        self.found = np.zeros(taxels, np.bool_)
        """Taxels with telegraph noise, shape [taxels]."""

    def close_block(self, mean: Array, variance: Array, sound: Mask, duration: float, touched: bool) -> None:
        """Process a block.

        Parameters
        ----------
        mean : ndarray of float64, shape [taxels]
            Mean signals of the block.
        variance : ndarray of float64, shape [taxels]
            Variance of each mean, in their unit squared.
        sound : ndarray of bool, shape [taxels]
            Taxels without other faults.
        duration : float
            Duration of the block [s].
        touched : bool
            Whether something touches the array.
        """
        self._age += duration
        self._quiet += 0.0 if touched else duration
        self._dwell += duration
        self._returns[self._age > MEMORY] = 0.0
        self._means[1:] = self._means[:-1]
        self._means[0] = mean
        deviation = np.sqrt(variance)
        settled = np.abs(mean - self._means[1]) < AGREEING * math.sqrt(2.0) * deviation
        away = ~(np.abs(mean - self._level) <= LEAST_STEP * deviation)  # true before the first level
        self._level = np.where(settled & ~away, mean, self._level)
        new = settled & away
        if any_true(new):
            self._returns += self._count_returns(mean, variance, sound, new)
            self._before[new] = self._level[new]
            self._level[new] = mean[new]
            self._dwell[new] = 0.0
        self.found = (self._returns >= RETURNS) | self.found & (self._quiet <= MEMORY)

    def _count_returns(self, mean: Array, variance: Array, sound: Mask, new: Mask) -> Mask:
        """Return which of the taxels on a new level have returned to the one before, without their neighbours."""
        step = np.abs(mean - self._level)
        tolerance = np.maximum(TOLERANCE * step, AGREEING * np.sqrt(2.0 * variance))
        returned: Mask = new & (np.abs(mean - self._before) < tolerance)
        if not any_true(returned):
            return returned
        change = np.nan_to_num(mean - self._means[-1])
        contradicted, testable = self._skin.contradicts(change, 2.0 * variance, sound, CERTAINTY)
        around = self._surroundings.max_neighbour(np.where(sound, np.abs(change), 0.0))
        leaks = -step * np.expm1(-self._dwell / self._time_constant) > LEAKED * tolerance
        noise = AGREEING * np.sqrt(2.0 * variance)
        returned &= (contradicted | ~testable & leaks) & (around < NEIGHBOUR_STEP * step + noise)
        self._age[returned] = self._quiet[returned] = 0.0
        return returned
