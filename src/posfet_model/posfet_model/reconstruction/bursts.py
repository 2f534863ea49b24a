# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Single scans with electromagnetic interference: refused when they come, without delay for any other scan.

A burst lifts or lowers the signal of one, some or all taxels in one scan, and is over in the next one. A tap may be as
short, so that its duration does not distinguish them. Their distribution over the taxels does: the elastomer skin lets
the neighbours of a pressed taxel feel part of the force (skin_response.py), and a burst on single taxels does not.
So a scan in which some taxel jumps alone, which did not in the scan before, is refused. If the next scan shows the same
jump, that was no burst: it is accepted, and the jump was seen one scan late. A jump is a change that differs from the
one before, so that a fast slide is none. After lost scans nothing is tested.

A jump of all taxels by similar amounts is refused as well: a supply or ground disturbed for a moment looks like that,
while a touch that begins on the whole array at once and lasts for one scan is rare.

Indistinguishable, and refused when they last for one scan: a sharp tip on the outer half of an outermost taxel,
whose force the skin spreads off the array; a plate that hits the whole array evenly. Indistinguishable, and are
accepted: a burst on a patch of taxels with the profile of a touch; any burst on a skin thinner than `LEAST_SPREAD`, or
on an array without neighbours.

What happens in every scan is compiled: `posfet_core`, jumps.hpp.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from posfet_core import scan_path
from posfet_model._lib.reductions import any_true
from posfet_model._lib.types import Array, Mask
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.signal_chain import charge_per_newton, force_noise_rms
from posfet_model.sensor.skin_response import SkinResponse

LEAST_JUMP: Final = 0.5
"""Least jump of a taxel that is tested [contact threshold], assumed: a smaller one causes no contact."""

NOISE_FREE: Final = 8.0
"""Standard deviations of the noise beyond which a difference of changes is a jump [1]."""

USUAL_CHANGES: Final = 8.0
"""A jump is more than this many median differences of changes [1]: strong hum and vibration change in every scan."""

CERTAINTY: Final = 1.0
"""Standard deviations by which the neighbours of a jump must miss their part [1]: low, since a touch that is refused in
error is seen in the next scan."""

MOST_IN_A_ROW: Final = scan_path.MOST_IN_A_ROW
"""Number of consecutive scans that are refused at most."""

FEWEST_TAXELS: Final = 9
"""Number of taxels from which a jump of all of them is no touch: a fingertip covers fewer."""

EVENLY: Final = 0.3
"""Least over greatest jump from which all taxels jump by similar amounts [1]: a fingertip presses its edge less."""


class BurstDetector:
    """Finds the scans with a burst, scan by scan.

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
        self._jumps = scan_path.JumpDetector(taxels, self._least)
        self._skin = SkinResponse(sensor)
        self._sequence = -2

    def set_usual_change(self, change: Array) -> None:
        """Set the median difference of two changes of each taxel [N], shape [rows * cols]; initially none."""
        self._jumps.set_limits(np.maximum(self._least, USUAL_CHANGES * self._scale * change))

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
        jumps = self._jumps
        if not jumps.examine(charge, adjacent, faulty):
            return False
        found = self._is_no_touch(jumps.jump, jumps.fresh, ~faulty)
        if found:
            jumps.refuse()
        else:
            jumps.accept()
        return found

    def _is_no_touch(self, jump: Array, fresh: Mask, sound: Mask) -> bool:
        """Return whether no touch can have caused the jump of the `fresh` taxels."""
        contradicted, _ = self._skin.contradicts(jump, self._variance, sound, CERTAINTY, one_sided=True)
        if any_true(contradicted & fresh):
            return True
        if np.count_nonzero(sound) < FEWEST_TAXELS or any_true(sound & ~fresh):
            return False
        least, greatest = float(jump[sound].min()), float(jump[sound].max())
        return min(least / greatest, greatest / least) >= EVENLY
