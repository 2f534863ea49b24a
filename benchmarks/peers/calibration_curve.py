# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Calibration curve and centroid, as in tactile_toolbox.

Described in the repository ubi-agni/tactile_toolbox: each taxel has a calibration curve from raw value to force, and
the contact of a sensor is one point, the mean of the taxels' positions weighted by their magnitudes, with the sum of
their forces. The curve is a straight line here, as the readout is linear.
"""

from __future__ import annotations

from benchmarks.peers.peer import Array, Peer


class CalibrationCurve(Peer):
    """Force by curve; one contact per array."""

    name = "curve and centroid, tactile_toolbox"

    def _begin(self, rest: Array) -> None:
        self._zero = rest.mean(axis=0)

    def _update(self, reading: Array) -> None:
        self.force = reading - self._zero
        above = self.force.max() > self._threshold
        self.contacts = [self._centre(range(len(self.force)))] if above else []
