# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Conversion of scans and reports to ROS messages."""

from __future__ import annotations

from array import array
from collections.abc import Sequence

from diagnostic_msgs.msg import DiagnosticArray

from posfet_driver.board.fault_monitor import worst
from posfet_driver.board.faults import FaultKind
from posfet_driver.board.scan_source import SourceReport
from posfet_model._lib.units import NANOSECONDS
from posfet_model.ros.diagnostic_array import diagnostic_array
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


def report_diagnostics(
    report: SourceReport, name: str, hardware_id: str, scan_rate: float, stamp: int, faults: Sequence[FaultKind] = ()
) -> DiagnosticArray:
    """Return the message for /diagnostics.

    Parameters
    ----------
    report : SourceReport
        State of the source.
    name : str
        Name of the status.
    hardware_id : str
        Serial number or name of the array.
    scan_rate : float
        Rate of complete scans since the previous report [Hz].
    stamp : int
        Time since the Unix epoch [ns].
    faults : sequence of FaultKind, optional
        Faults that are present, the most severe first.

    Returns
    -------
    DiagnosticArray
        One status with state, counters, values, and a remedy for each fault.
    """
    values = {
        "scans": str(report.scans),
        "scan rate [Hz]": f"{scan_rate:.1f}",
        "frames lost": str(report.frames_lost),
        **{kind.label: str(count) for kind, count in report.fault_counts.items()},
        **{event: str(count) for event, count in report.counters.items()},
        **report.values,
        **{f"fault: {fault.label}": f"{fault.meaning}; {fault.remedy}" for fault in faults},
    }
    text = "; ".join([report.state, *(fault.label for fault in faults)])
    return diagnostic_array(worst(faults, report.health), name, text, hardware_id, values, stamp)
