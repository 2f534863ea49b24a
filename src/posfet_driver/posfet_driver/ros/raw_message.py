# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The message on `raw`."""

from __future__ import annotations

from array import array

from posfet_model._lib.units import NANOSECONDS
from posfet_model.sensor.description import Layout
from posfet_model.sensor.scan import TEMPERATURE_SENSORS, Scan
from posfet_msgs.msg import TactileRaw


class RawMessage:
    """One TactileRaw that is reused for every scan.

    Parameters
    ----------
    layout : Layout
        Layout of the array.
    frame_id : str
        Coordinate frame of the array.
    """

    def __init__(self, layout: Layout, frame_id: str) -> None:
        self._message = TactileRaw(rows=layout.rows, cols=layout.cols)
        self._message.header.frame_id = frame_id
        self._counts = array("H", bytes(2 * layout.taxels))
        self._temperatures = array("f", bytes(4 * TEMPERATURE_SENSORS))

    def fill(self, scan: Scan) -> TactileRaw:
        """Return the message of `scan`; the next call overwrites it."""
        message = self._message
        stamp = message.header.stamp
        stamp.sec, stamp.nanosec = divmod(scan.stamp, NANOSECONDS)
        message.layout_id = scan.layout_id
        message.sequence = scan.sequence
        message.device_time = scan.device_time
        memoryview(self._counts)[:] = scan.counts.data
        message.counts = self._counts
        memoryview(self._temperatures)[:] = scan.temperatures.data
        message.temperatures = self._temperatures
        message.status = int(scan.status)
        message.frames_lost = scan.frames_lost
        message.stamp_uncertainty = scan.stamp_uncertainty
        return message
