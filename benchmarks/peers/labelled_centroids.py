# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Labelled regions and centres of mass by scipy.ndimage, the usual way to find contacts in an image of an array.

Functions `label` and `center_of_mass` (P. Virtanen et al., Nature Methods 17, 2020, doi:10.1038/s41592-019-0686-2).
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from benchmarks.peers.peer import Array, Peer
from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.sensor.description import Sensor


class LabelledCentroids(Peer):
    """Readings above those at rest; a contact for each connected region above the threshold."""

    name = "label and centre of mass, scipy"

    def __init__(self, sensor: Sensor, calibration: Calibration) -> None:
        super().__init__(sensor, calibration)
        x, y = self._positions.T.reshape(2, *self._shape)
        self._axes = x[0], y[:, 0]

    def _begin(self, rest: Array) -> None:
        self._zero = rest.mean(axis=0)

    def _update(self, reading: Array) -> None:
        self.force = reading - self._zero
        image = self.force.reshape(self._shape)
        labels, count = ndimage.label(image > self._threshold, np.ones((3, 3)))
        self.contacts = []
        if not count:
            return
        numbers = range(1, count + 1)
        forces = ndimage.sum_labels(image, labels, numbers)
        for (row, col), force in zip(ndimage.center_of_mass(image, labels, numbers), forces, strict=True):
            x = float(np.interp(col, np.arange(self._shape[1]), self._axes[0]))
            y = float(np.interp(row, np.arange(self._shape[0]), self._axes[1]))
            self.contacts.append((x, y, float(force)))
