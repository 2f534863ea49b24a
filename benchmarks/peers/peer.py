# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""What every peer has in common: counts to newtons by a linear calibration curve, and contacts by neighbourhood."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import FULL_SCALE_COUNT

Array = NDArray[np.float64]
Contact = tuple[float, float, float]
"""x [m], y [m] and force [N]."""

TARE_TIME = 0.3
"""Untouched time at the start in which baselines are measured [s]: as long as every scene leaves."""


class Peer(ABC):
    """A method that takes scans one by one."""

    name: str

    def __init__(self, sensor: Sensor, calibration: Calibration) -> None:
        lsb = (sensor.adc.high - sensor.adc.low) / FULL_SCALE_COUNT
        self._scale = lsb / sensor.volts_per_newton / calibration.gain
        self._tare_scans = round(TARE_TIME * sensor.can.scan_rate)
        self._positions = sensor.layout.positions
        self._shape = (sensor.layout.rows, sensor.layout.cols)
        self._threshold = sensor.contact.threshold
        self._rest: list[Array] = []
        self.force = np.zeros(sensor.layout.taxels)
        """Force of each taxel after the last scan [N]."""
        self.contacts: list[Contact] = []
        """Contacts in the last scan."""

    def process(self, counts: NDArray[np.uint16]) -> None:
        """Take the counts of one scan."""
        reading = counts * self._scale
        if len(self._rest) < self._tare_scans:
            self._rest.append(reading)
            if len(self._rest) == self._tare_scans:
                self._begin(np.array(self._rest))
            return
        self._update(reading)

    @abstractmethod
    def _begin(self, rest: Array) -> None:
        """Take the readings of the untouched start [N], shape [scans, taxels]."""

    @abstractmethod
    def _update(self, reading: Array) -> None:
        """Take one reading [N]; set forces and contacts."""

    def _grouped(self, touched: NDArray[np.bool_]) -> list[Contact]:
        """Return contacts of touched taxels that are neighbours, diagonals included, with force-weighted centres."""
        rest = set(np.flatnonzero(touched).tolist())
        cols, found = self._shape[1], []
        while rest:
            group, edge = [], [rest.pop()]
            while edge:
                taxel = edge.pop()
                group.append(taxel)
                row, col = divmod(taxel, cols)
                near = [each for each in rest if abs(each // cols - row) <= 1 and abs(each % cols - col) <= 1]
                rest.difference_update(near)
                edge += near
            found.append(self._centre(group))
        return found

    def _centre(self, taxels: Iterable[int]) -> Contact:
        chosen = list(taxels)
        weight = np.abs(self.force[chosen])
        x, y = weight @ self._positions[chosen] / weight.sum()
        return float(x), float(y), float(self.force[chosen].sum())
