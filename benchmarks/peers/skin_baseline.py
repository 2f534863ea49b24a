# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Drift compensation of the iCub skin: a slow baseline and a threshold from the noise at rest.

Described in the documentation of the module skinManager of robotology/icub-main: the mean and the 95th percentile of
each taxel while nothing touches are baseline and touch threshold, a safety threshold is added, the baseline follows
where nothing touches, in steps of 20 ms, and an exponential average smooths the output. Contacts: neighbouring taxels
above their threshold, their centre weighted by pressure (A. Schmitz et al., IEEE Trans. Robot. 27(3), 2011,
doi:10.1109/TRO.2011.2132930).
"""

from __future__ import annotations

import numpy as np

from benchmarks.peers.peer import Array, Peer
from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.sensor.description import Sensor

PERIOD = 0.02
"""Time between two steps of the baseline [s], the module's default."""

FOLLOWING = 0.2
"""Share of an untouched reading that the baseline takes over in 1 s, in units of the threshold [1]; assumed."""

SMOOTHING = 0.5
"""Weight of the previous output, the module's default."""


class SkinBaseline(Peer):
    """Baseline that follows where nothing touches, and thresholds by percentile."""

    name = "drift filter, iCub skin"

    def __init__(self, sensor: Sensor, calibration: Calibration) -> None:
        super().__init__(sensor, calibration)
        self._every = round(PERIOD * sensor.can.scan_rate)
        self._scan = 0

    def _begin(self, rest: Array) -> None:
        self._baseline = rest.mean(axis=0)
        self._limit = np.quantile(rest, 0.95, axis=0) - self._baseline + self._threshold

    def _update(self, reading: Array) -> None:
        own = reading - self._baseline
        self.force = (1 - SMOOTHING) * own + SMOOTHING * self.force
        self.contacts = self._grouped(self.force > self._limit)
        self._scan += 1
        if self._scan % self._every == 0:
            self._follow(own)

    def _follow(self, own: Array) -> None:
        """Move untouched baselines towards the reading, touched ones by the mean of that."""
        touched = own > self._limit
        change = np.where(touched, 0.0, FOLLOWING * PERIOD * own)
        if not touched.all():
            change[touched] = change[~touched].mean()
        self._baseline += change
