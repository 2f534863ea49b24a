# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Forces of weakly touched taxels beside what certainly presses, and rests."""

from __future__ import annotations

from typing import Final

import numpy as np

from posfet_model._lib.types import Array, Mask
from posfet_model.sensor.description import Layout
from posfet_model.sensor.grid import ALL_NEIGHBOURS, neighbour_table

HELD_PLAY: Final = 0.1
"""Share by which the forces beside a taxel may change as nothing moves [1]: a hand trembles."""

HELD_TIME: Final = 0.1
"""Time for which they must not change more [s]."""


class HeldForces:
    """Follows the force of each taxel until those beside it rest.

    A warm film hides force, and where that is as strong as the force itself, a weak touch and none look the same. But
    what certainly presses a taxel beside it does not change while the object rests: so it still presses the weak one,
    as it did when it came to rest.

    Parameters
    ----------
    layout : Layout
        The array.
    """

    def __init__(self, layout: Layout) -> None:
        self._table = neighbour_table(layout, ALL_NEIGHBOURS)
        self._beside, self._force, self._rested = np.zeros((3, layout.taxels))

    def update(self, force: Array, certain: Mask, duration: float) -> None:
        """Process a block.

        Parameters
        ----------
        force : ndarray of float64, shape [taxels]
            Forces, >= 0 [N].
        certain : ndarray of bool, shape [taxels]
            Which of them are certainly some.
        duration : float
            Duration of the block [s].
        """
        around = np.append(force, 0.0)[self._table]
        total = np.zeros(len(force))
        for each in around.T:
            total = total + each
        before = self._beside
        self._beside = np.minimum(np.maximum(before, (1.0 - HELD_PLAY) * total), (1.0 + HELD_PLAY) * total)
        rests = np.append(certain, False)[self._table].any(axis=1) & (self._beside == before)
        self._rested = np.where(rests, self._rested + duration, 0.0)
        self._force = np.where(self._rested < HELD_TIME, force, self._force)

    @property
    def held(self) -> Array:
        """Forces when those beside them came to rest [N]; 0: unknown, or they do not rest."""
        return np.where(self._rested < HELD_TIME, 0.0, self._force)
