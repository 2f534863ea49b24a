"""Scans and reports as ROS messages."""

from __future__ import annotations

from array import array
from collections.abc import Sequence

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from posfet_driver.board.faults import Fault, worst
from posfet_driver.board.scan_source import SourceReport
from posfet_model._lib.units import NANOSECONDS
from posfet_model.sensor.description import Layout
from posfet_model.sensor.scan import TEMPERATURE_SENSORS, Scan
from posfet_msgs.msg import TactileRaw


class RawMessage:
    """One TactileRaw that is filled again and again, so that a scan costs no new message."""

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
        return message


def diagnostic_array(
    report: SourceReport, name: str, hardware_id: str, scan_rate: float, stamp: int, faults: Sequence[Fault] = ()
) -> DiagnosticArray:
    """Return `report` as it is published on /diagnostics, with the faults that are present, the worst first.

    `scan_rate` [Hz] is the rate of whole scans since the last report, `stamp` [ns] the time since the epoch.
    """
    values = {
        "scans": str(report.scans),
        "scan rate [Hz]": f"{scan_rate:.1f}",
        "frames lost": str(report.frames_lost),
        **{key: str(count) for key, count in report.counters.items()},
        **report.values,
        **{f"fault: {fault.name}": f"{fault.meaning}; {fault.remedy}" for fault in faults},
    }
    status = DiagnosticStatus(
        level=bytes([worst(faults, report.health)]),
        name=name,
        message="; ".join([report.state, *(fault.name for fault in faults)]),
        hardware_id=hardware_id,
        values=[KeyValue(key=key, value=value) for key, value in values.items()],
    )
    message = DiagnosticArray(status=[status])
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, NANOSECONDS)
    return message
