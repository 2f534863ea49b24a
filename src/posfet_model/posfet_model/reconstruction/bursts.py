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

A jump of nearly all taxels by similar amounts, of half of them by more than the least jump, is refused as well: a
supply or ground disturbed for a moment looks like that, while a touch that begins on the whole array at once and lasts
for one scan is rare.

Indistinguishable, and refused when they last for one scan: a sharp tip on the outer half of an outermost taxel,
whose force the skin spreads off the array; a plate that hits the whole array evenly. Indistinguishable, and are
accepted: a burst on a patch of taxels with the profile of a touch; any burst on a skin thinner than `LEAST_SPREAD`, or
on an array without neighbours.

Compiled: `posfet_core`, bursts.hpp and jumps.hpp.
"""

from __future__ import annotations

import math
from typing import Final

from posfet_core import scan_path
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.signal_chain import charge_per_newton, force_noise_rms
from posfet_model.sensor.skin_response import SkinResponse

LEAST_JUMP: Final = 0.5
"""Least jump of a taxel that is tested [contact threshold], assumed: a smaller one causes no contact."""

NOISE_FREE: Final = 8.0
"""Standard deviations of the noise beyond which a difference of changes is a jump [1]."""

MOST_IN_A_ROW: Final = scan_path.MOST_IN_A_ROW
"""Number of consecutive scans that are refused at most."""


class BurstDetector(scan_path.BurstDetector):
    """Finds the scans with a burst, scan by scan.

    `is_burst` takes the charge densities [C/m2] and the sequence number of a scan, and the taxels that are not tested;
    it keeps the charges unless the scan has a burst. `set_usual_change` takes the median difference of two changes of
    each taxel [N], initially none.

    Parameters
    ----------
    sensor : Sensor
        Description of the sensor.
    """

    def __init__(self, sensor: Sensor) -> None:
        scale = charge_per_newton(sensor)
        noise = math.sqrt(6.0) * force_noise_rms(sensor)  # of a second difference
        least = max(LEAST_JUMP * sensor.contact.threshold, NOISE_FREE * noise) * scale
        super().__init__(SkinResponse(sensor), least, (noise * scale) ** 2, scale)
