# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Detection of faulty taxels and of their recovery, at run time.

Compiled: `posfet_core`, taxel_faults.hpp says what is found, telegraph_noise.hpp what else counts as noise.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Final

from posfet_core import scan_path
from posfet_model._lib.types import Mask
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.signal_chain import force_noise_rms, volts_per_code, volts_per_count
from posfet_model.sensor.skin_response import LEAST_SPREAD, SkinResponse

INFORMATIVE: Final = scan_path.INFORMATIVE
"""Standard deviations of noise from which a force is informative about that of its neighbour [1]."""

CERTAINTY: Final = 1e-12
"""Probability that noise leaves the counts of a working taxel constant for as long as a stuck one requires [1]."""

LONGEST_RUN: Final = 100_000
"""Number of scans beyond which constant counts are not informative: noise far below one code may never change them."""


class TaxelStatus(IntEnum):
    """Status of a taxel; the values are those of TAXEL_* in posfet_msgs/TactileImage."""

    OK = 0
    DEAD = 1
    STUCK = 2
    SATURATED = 3
    ABSENT = 4
    NOISY = 5


class TaxelFaultDetector(scan_path.TaxelFaultDetector):
    """Tests the taxels of one array block by block; the counts of each scan are added to `history`.

    `close_block` takes the duration of a block [s]; of each taxel the mean force [N], its variance at rest [N2], the
    charge at the gate as a force [N], whether it is at the end of its range, in or near a contact, and whether its
    offset is known. It returns whether the set of `faulty` taxels changed. `measure_noise` ends a block without a test.

    Parameters
    ----------
    sensor : Sensor
        Description of the sensor.
    known_dead : ndarray of bool, shape [rows * cols], optional
        Taxels known not to respond: these stay dead.
    """

    def __init__(self, sensor: Sensor, known_dead: Mask | None = None) -> None:
        layout, device, contact = sensor.layout, sensor.device, sensor.contact
        figures = scan_path.TaxelFigures(
            threshold=contact.threshold,
            release_threshold=contact.threshold - contact.deadband,
            noise=force_noise_rms(sensor),
            newton_per_count=volts_per_count(sensor) / sensor.volts_per_newton,
            force_max=device.force_max,
            time_constant=device.leak_time_constant,
            longest_run=longest_run(sensor),
            coarse=coarse(sensor),
            spread_by_skin=device.contact_spread / max(layout.pitch_x, layout.pitch_y) >= LEAST_SPREAD,
        )
        super().__init__(SkinResponse(sensor), figures, known_dead)


def coarse(sensor: Sensor) -> bool:
    """Return whether the quantisation noise of the codes is larger than that of the input.

    Parameters
    ----------
    sensor : Sensor
        Description of the sensor.

    Returns
    -------
    bool
        Whether it is.
    """
    step = volts_per_code(sensor)
    return step * step / 12 > sensor.adc.noise**2


def longest_run(sensor: Sensor) -> float:
    """Return the greatest number of scans in which the counts of a working taxel may stay constant.

    Counts stay constant while the noise stays within one code of the ADC; the worst case is a signal at its centre.

    Parameters
    ----------
    sensor : Sensor
        Description of the sensor.

    Returns
    -------
    float
        Number of scans [1], >= 2; inf: no limit.
    """
    half = 0.5 * volts_per_code(sensor)
    if sensor.adc.noise == 0.0:
        return math.inf
    leaves = math.erfc(half / (math.sqrt(2.0) * sensor.adc.noise))
    if leaves >= 1.0 or leaves * LONGEST_RUN < -math.log(CERTAINTY):
        return math.inf
    return max(2.0, math.log(CERTAINTY) / math.log1p(-leaves))
