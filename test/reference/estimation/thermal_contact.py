# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""What the readings of taxels show of the thermal contact, where warmth hides forces."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.types import Array, Mask

BLOCKS = 5
WARMED = 0.5
LEFT = 0.25
LEFT_BLOCKS = 3


class ThermalContact:
    """Finds which taxels something warms, and which contacts have been left.

    A taxel whose film is warm reads less than its force, and its warmth follows the thermal contact with a known time
    constant. So its reading tends to a value: the force less all that its thermal contact hides. No force is below
    zero, so that a reading that stays below it is warmed by something; but that of a film that was left cools to zero.

    Parameters
    ----------
    taxels : int
        Number of taxels.
    warmth_time : float
        Time constant with which the film warms and cools [s].
    threshold : float
        Reading below which one is below zero beyond errors [N].
    """

    def __init__(self, taxels: int, warmth_time: float, threshold: float) -> None:
        self._warmth_time, self._threshold = warmth_time, threshold
        self._readings: deque[Array] = deque(maxlen=BLOCKS + 1)
        self._tends = np.zeros(taxels)
        self._cooled_for = np.zeros(taxels, np.int64)

    def reset(self) -> None:
        """Forget all readings."""
        self._readings.clear()
        self._cooled_for[:] = 0

    def update(self, reading: Array, duration: float) -> None:
        """Process a block.

        Parameters
        ----------
        reading : ndarray of float64, shape [taxels]
            What taxels read but for their warmth [N].
        duration : float
            Duration of the block [s].
        """
        self._readings.append(reading)
        left = math.exp(-BLOCKS * duration / self._warmth_time)
        self._tends = (reading - left * self._readings[0]) / (1.0 - left)

    @property
    def _known(self) -> bool:
        return len(self._readings) > BLOCKS

    @property
    def tends_to(self) -> Array | None:
        """Value that the reading of each taxel tends to [N], shape [taxels]; None: unknown yet."""
        return self._tends if self._known else None

    @property
    def warmed(self) -> Mask:
        """Whether something warms each taxel, shape [taxels]."""
        if not self._known:
            return np.zeros(len(self._tends), np.bool_)
        below: Mask = (np.array(self._readings) < -self._threshold).all(axis=0)
        return below & (self._tends < WARMED * self._readings[-1])

    def find_left(self, contacts: Sequence[NDArray[np.intp]]) -> Mask:
        """Return the taxels of contacts that were left, shape [taxels]. Once per block.

        Parameters
        ----------
        contacts : sequence of ndarray of int
            Taxels of each contact.
        """
        left = np.zeros(len(self._tends), np.bool_)
        for contact in contacts:
            left[contact] = self.cools(contact)
        self._cooled_for = np.where(left, self._cooled_for + 1, 0)
        found: Mask = self._cooled_for >= LEFT_BLOCKS
        return found

    def cools(self, contact: NDArray[np.intp]) -> bool:
        """Return whether a contact reads less than none, and all of it tends to none.

        Parameters
        ----------
        contact : ndarray of int
            Its taxels.
        """
        if not self._known or len(contact) == 0:
            return False
        lowest = min(float(self._readings[-1][contact].min()), 0.0)
        return bool(lowest < -self._threshold and np.abs(self._tends[contact]).max() < -LEFT * lowest)
