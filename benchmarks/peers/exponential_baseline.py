# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Exponential baseline tracking, as common in vendors' drivers of tactile and touch sensors.

The baseline is an exponential average of the readings that is held while a taxel is above its threshold; the output is
the reading above the baseline (for instance the drift compensation that vendors of capacitive controllers describe in
their application notes).
"""

from __future__ import annotations

import numpy as np

from benchmarks.peers.peer import Array, Peer
from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.sensor.description import Sensor

TIME_CONSTANT = 2.0
"""Time constant of the baseline [s]; assumed."""


class ExponentialBaseline(Peer):
    """Reading above an average that waits while touched."""

    name = "exponential baseline"

    def __init__(self, sensor: Sensor, calibration: Calibration) -> None:
        super().__init__(sensor, calibration)
        self._share = 1.0 / (TIME_CONSTANT * sensor.can.scan_rate)

    def _begin(self, rest: Array) -> None:
        self._baseline = rest.mean(axis=0)

    def _update(self, reading: Array) -> None:
        self.force = reading - self._baseline
        touched = self.force > self._threshold
        self._baseline += np.where(touched, 0.0, self._share * self.force)
        self.contacts = self._grouped(touched) if touched.any() else []
