# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Diagnostics of the model node."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

from diagnostic_msgs.msg import DiagnosticArray

from posfet_model.reconstruction.diagnostics import Level, Verdict
from posfet_model.reconstruction.scan_clock import ScanCounts
from posfet_model.ros.diagnostic_array import diagnostic_array, hardware_id
from posfet_model.ros.model_report import ModelReport
from posfet_model.ros.output_qos import OUTPUT_DEPTH
from posfet_model.ros.queue_delay import LONGEST, QueueDelay
from posfet_model.ros.supervision import SupervisedNode
from posfet_model.sensor.description import Sensor

REPORT_PERIOD = 1.0
"""Period of the diagnostics [s]."""
LEASE = 20.0
"""Time after which the middleware forgets a process that was killed [s]: the default of Fast DDS."""


class ModelDiagnostics:
    """Publishes a status once per `REPORT_PERIOD` while there is something to report.

    Parameters
    ----------
    node : SupervisedNode
        Node that publishes.
    sensor : Sensor
        Sensor description.
    observe : callable
        Returns whether scans are processed, and a report on them; None while there is nothing to report.
    queue : QueueDelay
        Knows the scans that came too late.
    folder_problem : str, optional
        Why no calibration can be saved, in one line.
    shared : callable, optional
        Returns the topics of this node that others publish, too.
    """

    def __init__(
        self,
        node: SupervisedNode,
        sensor: Sensor,
        observe: Callable[[], tuple[bool, ModelReport | None]],
        queue: QueueDelay,
        folder_problem: str = "",
        shared: Callable[[], Sequence[str]] = tuple,
    ) -> None:
        self._node, self._observe, self._queue = node, observe, queue
        self._constant = {"calibration folder": folder_problem} if folder_problem else {}
        self._shared, self._said = shared, False
        self._dropped = 0
        self._hardware = hardware_id(sensor, node.get_namespace())
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", OUTPUT_DEPTH)
        self._reported = ScanCounts()
        self._without = 0.0  # time since the last report that knew new scans [s]
        node.create_timer(REPORT_PERIOD, self._report)

    def forget(self) -> None:
        """Count scans and events from 0, as a new reconstructor does."""
        self._reported, self._without = ScanCounts(), 0.0

    def _report(self) -> None:
        active, report = self._observe()
        if report is None:
            return
        before, self._reported = self._reported, report.counts
        quiet = active and report.counts.accepted == before.accepted
        self._without = self._without + REPORT_PERIOD if quiet else 0.0
        verdict = self._with_shared(self._with_dropped(report.verdict(before, self._without)))
        level, text = (verdict.level, verdict.text) if active else (0, "inactive: scans are ignored")
        values = report.values(before, REPORT_PERIOD)
        values["dropped as too late"] = str(self._queue.dropped)
        values |= self._constant | self._node.internal_errors.values()
        name = f"{self._node.get_fully_qualified_name()}: reconstruction"
        self._publisher.publish(diagnostic_array(level, name, text, self._hardware, values, time.time_ns()))

    def _with_dropped(self, verdict: Verdict) -> Verdict:
        """Return the verdict with the scans that came too late since the last one; they are the cause of others."""
        dropped, self._dropped = self._queue.dropped - self._dropped, self._queue.dropped
        if not dropped:
            return verdict
        why = f"{dropped} scans dropped, more than {LONGEST:g} s late: they come faster than they are processed"
        return _with_warning(verdict, f"{why}; lower the scan rate, or free a processor")

    def _with_shared(self, verdict: Verdict) -> Verdict:
        """Return the verdict with the topics that others publish, too; log that once when it begins."""
        topics = self._shared()
        if not topics:
            self._said = False
            return verdict
        text = f"another node publishes {' and '.join(topics)}, too: give each sensor a namespace of its own"
        if not self._said:
            self._node.get_logger().warning(f"{text} (a process that was killed counts for {LEASE:.0f} s)")
        self._said = True
        return _with_warning(verdict, text)


def _with_warning(verdict: Verdict, text: str) -> Verdict:
    """Return a verdict that says `text`, after an error and in place of anything less."""
    if verdict.level == Level.ERROR:
        return Verdict(verdict.level, f"{verdict.text}; {text}")
    return Verdict(Level.WARN, text)
