# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Diagnostics of a source of scans."""

from __future__ import annotations

import time
from collections.abc import Sequence

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from rclpy.qos import QoSProfile

from posfet_driver.board.fault_monitor import worst
from posfet_driver.board.faults import FaultKind
from posfet_driver.board.scan_source import SourceReport
from posfet_model.ros.diagnostic_array import diagnostic_array, hardware_id
from posfet_model.sensor.description import Sensor


class SourceDiagnostics:
    """Publishes the state of a source on `/diagnostics`.

    Parameters
    ----------
    node : Node
        Node that publishes.
    sensor : Sensor
        Sensor description.
    """

    def __init__(self, node: Node, sensor: Sensor) -> None:
        self._name = f"{node.get_fully_qualified_name()}: board"
        self._hardware = hardware_id(sensor, node.get_namespace())
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", QoSProfile(depth=10))

    def publish(self, report: SourceReport, scan_rate: float, faults: Sequence[FaultKind]) -> None:
        """Publish a report.

        Parameters
        ----------
        report : SourceReport
            State of the source.
        scan_rate : float
            Rate of complete scans since the previous report [Hz].
        faults : sequence of FaultKind
            Faults that are present, the most severe first.
        """
        self._publisher.publish(
            report_diagnostics(report, self._name, self._hardware, scan_rate, time.time_ns(), faults)
        )


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
