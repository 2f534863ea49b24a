# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""TactileRaw messages read as scans."""

from __future__ import annotations

from typing import Final

import numpy as np

from posfet_model._lib.units import NANOSECONDS
from posfet_model.sensor.description import Layout
from posfet_model.sensor.scan import Scan
from posfet_msgs.msg import TactileRaw

UNRELATED_LAYOUT: Final = 0
"""Layout id that no sensor has: theirs begin at 1."""


class ScanReader:
    """Reads TactileRaw messages as scans."""

    def __init__(self, layout: Layout) -> None:
        self._shape = layout.rows, layout.cols
        self._scan = Scan.empty(layout.id, layout.taxels)

    def read(self, message: TactileRaw) -> Scan:
        """Return the message as a scan, which shares the arrays of the message and is overwritten by the next call."""
        scan = self._scan
        stamp = message.header.stamp
        # Nanoseconds beyond a second are not allowed, and could lead out of the range of the seconds.
        scan.stamp = stamp.sec * NANOSECONDS + min(stamp.nanosec, NANOSECONDS - 1)
        # A scan has no rows and columns of its own: a message with others is treated as of another layout.
        fits = (message.rows, message.cols) == self._shape
        scan.layout_id = message.layout_id if fits else UNRELATED_LAYOUT
        scan.sequence = message.sequence
        scan.device_time = message.device_time
        scan.counts = np.asarray(message.counts)
        scan.temperatures = np.asarray(message.temperatures)
        scan.status = message.status
        scan.frames_lost = message.frames_lost
        scan.stamp_uncertainty = message.stamp_uncertainty
        return scan
