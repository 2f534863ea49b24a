# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Whether something may touch that warmth hides."""

from __future__ import annotations

import numpy as np

from posfet_model._lib.types import Array, Mask
from reference.estimation.thermal_contact import ThermalContact

READS = 0.35
"""Share of the contact threshold by which what a taxel reads differs from none [1]."""
BRIEF = 0.5
"""Time after which warmth may hide a touch, in time constants of that warmth [1]."""
COOLING = 6
"""Blocks in a row in which all that is touched cools if it was left [1]."""


class HiddenTouch:
    """Knows whether something may touch a film that hides it.

    Parameters
    ----------
    taxels : int
        Number of taxels.
    warmth_time : float
        Time constant with which the film warms and cools [s].
    threshold : float
        Contact threshold [N].
    """

    def __init__(self, taxels: int, warmth_time: float, threshold: float) -> None:
        self.least, self._brief = READS * threshold, BRIEF * warmth_time
        self.pressed = np.zeros(taxels, np.bool_)
        """Taxels whose reading has fallen, as they are pressed, shape [taxels]."""
        self._may_touch, self._touched_for, self._cools_for = False, 0.0, 0

    @property
    def may_touch(self) -> bool:
        """Whether something may touch, although no force shows it."""
        return self._may_touch or bool(self.pressed.any())

    def forget(self) -> None:
        """Forget all: nothing touches."""
        self._may_touch, self._touched_for, self._cools_for = False, 0.0, 0
        self.pressed[:] = False

    def follow_readings(self, force: Array, hides: bool) -> None:
        """Process a block: a taxel whose reading has risen again is no longer pressed.

        Parameters
        ----------
        force : ndarray of float64, shape [taxels]
            Mean forces [N].
        hides : bool
            Whether the film hides some.
        """
        self.pressed &= hides & (force < -self.least)

    def follow_touch(self, touched: Mask, force: Array, thermal: ThermalContact, hides: bool, duration: float) -> None:
        """Process the touched taxels of a block, and what their readings tend to.

        Parameters
        ----------
        touched : ndarray of bool, shape [taxels]
            Taxels whose force is not known to be none.
        force : ndarray of float64, shape [taxels]
            Forces [N].
        thermal : ThermalContact
            What the readings show.
        hides : bool
            Whether the film hides forces.
        duration : float
            Duration of the block [s].
        """
        contact, tends = touched.nonzero()[0], thermal.tends_to
        presses = (force > self.least) | (True if tends is None else np.abs(tends) > self.least)
        self._touched_for = self._touched_for + duration if len(contact) else 0.0
        begun = hides and bool(presses[contact].any()) and self._touched_for > self._brief
        self._cools_for = self._cools_for + 1 if thermal.cools(contact) else 0
        self._may_touch = (self._may_touch or begun) and self._cools_for < COOLING
