# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Reference of the detection of bursts, in NumPy; posfet_model/reconstruction/bursts.py says what it does."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from posfet_model._lib.types import Array, Mask
from posfet_model.reconstruction.bursts import LEAST_JUMP, NOISE_FREE
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.signal_chain import charge_per_newton, force_noise_rms
from reference.reductions import any_true
from reference.skin_response import SkinResponse

MOST_IN_A_ROW: Final = 3
"""Number of consecutive scans that are refused at most."""

PERSISTING: Final = 0.5
"""Share of a jump that is left in the next scan unless it was a burst [1]."""

USUAL_CHANGES: Final = 8.0
"""A jump is more than this many median differences of changes [1]: strong hum and vibration change in every scan."""

CERTAINTY: Final = 1.0
"""Standard deviations by which the neighbours of a jump must miss their part [1]: low, since a touch that is refused in
error is seen in the next scan."""

FEWEST_TAXELS: Final = 9
"""Number of taxels from which a jump of all of them, at least half of which jump by more than the least, is no touch: a
fingertip covers fewer."""

EVENLY: Final = 0.15
"""Share of the greatest jump from which others are similar to it [1]: a fingertip presses its edge less."""

MOST_TAXELS: Final = 0.85
"""Share of the taxels that jump by similar amounts in a burst [1]: it lifts some of them by next to nothing."""


class BurstDetector:
    """Finds the scans with a burst, scan by scan.

    State variables: charges in the last scan without a burst, and their change in it; the jump that was refused last;
    the taxels that jumped in the last scan; the number of consecutive refused scans; the sequence of the last scan.

    Parameters
    ----------
    sensor : Sensor
        Description of the sensor.
    """

    def __init__(self, sensor: Sensor) -> None:
        taxels, self._scale = sensor.layout.taxels, charge_per_newton(sensor)
        noise = math.sqrt(6.0) * force_noise_rms(sensor)  # of a second difference
        self._variance = np.full(taxels, (noise * self._scale) ** 2)
        self._least = max(LEAST_JUMP * sensor.contact.threshold, NOISE_FREE * noise) * self._scale
        self._skin = SkinResponse(sensor)
        self._sequence = -2
        self._limit = np.full(taxels, self._least)
        self._last, self._change, self._before, self._jump, self._size, self._refused = np.zeros((6, taxels))
        self._moved = np.zeros(taxels, np.bool_)
        self._in_a_row = 0

    def set_usual_change(self, change: Array) -> None:
        """Set the median difference of two changes of each taxel [N], shape [rows * cols]; initially none."""
        np.maximum(self._least, USUAL_CHANGES * self._scale * change, out=self._limit)

    def is_burst(self, charge: Array, sequence: int, faulty: Mask) -> bool:
        """Return whether a scan has a burst, and keep its charges if not.

        Parameters
        ----------
        charge : ndarray of float64, shape [rows * cols]
            Charge densities of the scan [C/m2].
        sequence : int
            Sequence number of the scan.
        faulty : ndarray of bool, shape [rows * cols]
            Taxels that are not tested.
        """
        adjacent, self._sequence = sequence == self._sequence + 1, sequence
        change = np.subtract(charge, self._last, out=self._change)
        jump = np.subtract(change, self._before, out=self._jump)
        jumped = np.abs(jump, out=self._size) > self._limit
        if not adjacent:
            jumped[:] = False
            change[:] = 0.0
        elif any_true(jumped):
            jumped &= ~faulty
            fresh = jumped & ~self._moved
            if any_true(fresh) and not self._persists() and self._is_no_touch(jump, fresh, ~faulty):
                self._refused[:] = np.where(jumped, jump, 0.0)
                self._in_a_row += 1
                return True
        self._moved = jumped
        self._in_a_row = 0
        self._last[:] = charge
        self._before[:] = change
        return False

    def _persists(self) -> bool:
        """Return whether the jump that was refused in the last scan is still there, or too many were refused."""
        if not self._in_a_row:
            return False
        left = self._jump * self._refused >= PERSISTING * self._refused * self._refused
        return self._in_a_row >= MOST_IN_A_ROW or bool(left.all())

    def _is_no_touch(self, jump: Array, fresh: Mask, sound: Mask) -> bool:
        """Return whether no touch can have caused the jump of the `fresh` taxels."""
        contradicted, _ = self._skin.contradicts(jump, self._variance, sound, CERTAINTY, one_sided=True)
        if any_true(contradicted & fresh):
            return True
        if np.count_nonzero(sound) < FEWEST_TAXELS or 2 * np.count_nonzero(sound & fresh) < np.count_nonzero(sound):
            return False
        jumps = jump[sound]
        similar = np.count_nonzero(jumps / jumps[np.argmax(np.abs(jumps))] >= EVENLY)
        return similar >= MOST_TAXELS * np.count_nonzero(sound)
