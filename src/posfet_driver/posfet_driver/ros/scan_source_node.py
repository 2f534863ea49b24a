# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Lifecycle node around a source of scans: common base of the driver and the simulated board."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn

from posfet_driver.board.fault_monitor import FaultMonitor, changes
from posfet_driver.board.faults import FaultKind, Health
from posfet_driver.board.scan_source import ManagedDevice, ScanSource, SourceError, SourceReport, StreamingSource
from posfet_driver.clock import Clock, SystemClock
from posfet_driver.parameters import SCAN_SOURCE_NODE
from posfet_driver.ros.raw_message import RawMessage
from posfet_model.config import ConfigError
from posfet_model.parameters import Parameter
from posfet_model.ros.lifecycle import AT_ONCE, SupervisedLifecycleNode
from posfet_model.ros.output_qos import output_qos
from posfet_model.ros.ros_parameters import declare, declared_frame, declared_sensor
from posfet_model.ros.subscriptions import SUBSCRIBER_CHECK_PERIOD, SubscriptionCache
from posfet_model.ros.supervision import RESTART_PERIOD, RestartPolicy, described
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import Scan
from posfet_msgs.msg import TactileRaw

if TYPE_CHECKING:
    from posfet_driver.ros.source_diagnostics import SourceDiagnostics

RAW_DEPTH = 1000
"""Depth of the publisher's queue: one second of scans for a delayed subscriber."""
READ_TIMEOUT = 0.1
"""Longest wait of the data thread [s]: bounds the time that a shutdown takes."""
REPORT_PERIOD = 1.0
"""Period of the diagnostics [s]."""


class ScanSourceNode(SupervisedLifecycleNode):
    """Publishes the scans of a source.

    configure opens the source and starts the one data thread, which reads once `reading_wanted`; activate passes
    scans to `sink` and, when there is a subscriber, publishes them on `raw`; deactivate discards them, while the source
    is still read so that no old scan is waiting; cleanup closes the source. A device that is no `ScanSource`, such as
    a simulated board on a bus, is opened, reported on and closed in the same way; it has no data thread.

    When reading the source raises, or the source reports that it has failed, the source is closed and reopened, once
    within `RESTART_PERIOD`. When that does not help, `failure` is set, on which `spin` ends the process.

    Parameters
    ----------
    node_name : str
        Name of the node.
    parameters : sequence of Parameter, optional
        Parameters besides those of every source.
    clock : Clock, optional
        Clock of the source; by default the system's. Diagnostics always use the system's.
    **node_arguments
        Arguments of rclpy's LifecycleNode.

    Raises
    ------
    ConfigError
        When a parameter or file cannot be used.
    """

    EXPECTED = (ConfigError, SourceError)
    source: ManagedDevice

    def __init__(
        self,
        node_name: str,
        parameters: Sequence[Parameter] = SCAN_SOURCE_NODE,
        clock: Clock | None = None,
        **node_arguments: Any,
    ) -> None:
        super().__init__(node_name, **node_arguments)
        self.clock = clock or SystemClock()
        """Clock of the source."""
        self.sink: Callable[[Scan], None] | None = None
        """Called with every scan in the data thread, before anything is published; set it while inactive."""
        self.stream: Callable[[StreamingSource, float], Scan | None] | None = None
        """Has scans of the source, up to a time-out [s], processed without Python, and returns one that was not; in
        place of `deliver`, from a source that can do it and while nobody subscribes to `raw`. Set it while inactive."""
        try:
            self.parameters = declare(self, parameters)
            self.sensor = declared_sensor(self.parameters)
            self.source = self.make_source(self.sensor, self.parameters)
        except ConfigError:
            self.destroy_node()
            raise
        self.frame_id = declared_frame(self, self.parameters)
        self._raw_message = RawMessage(self.sensor.layout, self.frame_id)
        self._raw = self.create_publisher(TactileRaw, "raw", output_qos(self.parameters["reliability"], RAW_DEPTH))
        self._raw_listeners = SubscriptionCache(self._raw)
        self._diagnostics: SourceDiagnostics | None = None
        self._report_timer = self.create_timer(REPORT_PERIOD, self._report, autostart=False)
        self._begin_timer = self.create_timer(AT_ONCE, self._log_begin, autostart=False)
        self._thread: threading.Thread | None = None
        self._open = False
        self._stop = threading.Event()
        self._active = False
        self._subscribed = False
        self._restarts = RestartPolicy()
        self._logged_state = ""
        self._monitor = FaultMonitor()
        self._faults: list[FaultKind] = []
        self._reported = (0, 0)  # scans and time [ns] of the newest report

    def serve(self) -> None:
        """Create the services of the parameters, and the diagnostics."""
        from posfet_driver.ros.source_diagnostics import SourceDiagnostics  # noqa: PLC0415  # loaded once scans arrive

        super().serve()
        self._diagnostics = SourceDiagnostics(self, self.sensor)

    def make_source(self, sensor: Sensor, parameters: Mapping[str, Any]) -> ManagedDevice:
        """Return the source, not opened yet. Raises ConfigError when it can never be opened.

        Parameters
        ----------
        sensor : Sensor
            Sensor description.
        parameters : mapping of str to object
            Checked parameters of the node by name.
        """
        raise NotImplementedError

    @property
    def reading(self) -> bool:
        """Whether the source is open: between configure and cleanup."""
        return self._open

    def reading_wanted(self, now: int) -> bool:
        """Return whether to read the source at the monotonic time `now` [ns]: from the first subscriber on."""
        if not self._subscribed:
            self._subscribed = bool(self.sink) or self._raw_listeners.any(now)
        return self._subscribed

    def deliver(self, scan: Scan, now: int) -> None:
        """Deliver one scan in the data thread; `now` is a monotonic time [ns].

        Parameters
        ----------
        scan : Scan
            Scan to deliver; the source may overwrite it after this call.
        now : int
            Monotonic time [ns].
        """
        if self.sink:
            self.sink(scan)
        if self._raw_listeners.any(now):
            self._raw.publish(self._raw_message.fill(scan))

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Open the source and start reading."""
        result = self.configured(self._begin, self._end)
        return super().on_configure(state) if result == TransitionCallbackReturn.SUCCESS else result

    def restart(self) -> None:
        """Close and reopen the source, if it is being read. Raises ConfigError or SourceError as `open` does."""
        active = self._active
        if self.reading:
            self._end()
            self._begin()
            self._active = active

    def _begin(self) -> None:
        self.source.open()
        self._open = True
        self.failure = ""
        self._begun = self.source.report()
        self._reported = (self._begun.scans, time.monotonic_ns())
        self._stop.clear()
        if isinstance(self.source, ScanSource):
            self._thread = threading.Thread(
                target=self._run, args=(self.source,), name=f"{self.get_name()} data", daemon=True
            )
            self._thread.start()
        self._report_timer.reset()
        self._begin_timer.reset()

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Deliver scans."""
        self._active = True
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Discard scans."""
        self._active = False
        self._wake()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop reading and close the source."""
        self._end()
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop reading and close the source."""
        self._end()
        return super().on_shutdown(state)

    def destroy_node(self) -> None:
        """Stop the data thread, close the source, and destroy the node."""
        if hasattr(self, "_stop"):
            self._end()
        super().destroy_node()

    def _end(self) -> None:
        self._active = False
        self._stop.set()
        self._wake()
        self._report_timer.cancel()
        if self._thread:
            self._thread.join()
            self._thread = None
        if self._open:
            self._open = False
            self.source.close()

    def _run(self, source: ScanSource) -> None:
        """Read the source until the end; the main function of the data thread."""
        while not self._stop.is_set():
            try:
                self._read(source)
            except Exception as error:
                shutting_down = isinstance(error, rclpy_implementation.RCLError) and not self.context.ok()
                if shutting_down or not self._restarted("data thread", error):
                    return

    def _read(self, source: ScanSource) -> None:
        """Read the source and deliver its scans."""
        streaming = source if isinstance(source, StreamingSource) else None
        while not self.reading_wanted(time.monotonic_ns()) and not self._stop.wait(SUBSCRIBER_CHECK_PERIOD):
            pass
        while not self._stop.is_set():
            if self.stream and streaming and self._active and not self._raw_listeners.any(time.monotonic_ns()):
                scan = self.stream(streaming, READ_TIMEOUT)
            else:
                scan = source.read(READ_TIMEOUT)
            if scan is not None and self._active:
                self.deliver(scan, time.monotonic_ns())

    def _wake(self) -> None:
        """Have no more scans processed without Python before the data thread looks whether they are wanted."""
        if isinstance(self.source, StreamingSource):
            self.source.wake()

    def _restarted(self, cause: str, error: Exception | str) -> bool:
        """Reopen the source after an internal error; return whether it works again, else set `failure`."""
        self.internal_errors.add(cause, error)
        if self._restarts.allows():
            try:
                self.source.close()
                self.source.open()
                self.get_logger().warning(f"{cause}: restarted")
                return True
            except Exception as again:
                error = again
                self.internal_errors.add(f"restart of the {cause}", error)
        text = error if isinstance(error, str) else described(error)
        self.failure = f"{self.get_fully_qualified_name()}: {cause} failed again within {RESTART_PERIOD:.0f} s: {text}"
        self.get_logger().fatal(self.failure)
        return False

    def _report(self) -> None:
        report = self._supervised_report()
        now = time.monotonic_ns()
        scans, before = self._reported
        self._reported = (report.scans, now)
        scan_rate = (report.scans - scans) * 1e9 / max(now - before, 1)
        faults = self._monitor.present(report, now)
        if self._diagnostics is not None:
            self._diagnostics.publish(report, scan_rate, faults)
        self._log_state(report)
        self._log_faults(faults)

    def _supervised_report(self) -> SourceReport:
        """Return the report of the source with the internal errors; restart a source that has failed."""
        try:
            report = self.source.report()
        except Exception as error:
            self.internal_errors.add("report", error)
            report = SourceReport(Health.ERROR, "the source cannot report its state", self._reported[0], 0)
        if report.failure and not self.failure:
            self._restarted("source", report.failure)
        if isinstance(self.source, ScanSource) and not self._active:
            report = replace(report, state=f"{report.state}; inactive: scans are discarded")
        if self._thread and not self._thread.is_alive() and not self.failure and self.context.ok():
            self.failure = f"{self.get_fully_qualified_name()}: the data thread has ended"
        errors = self.internal_errors
        if not errors.total:
            return report
        return replace(
            report,
            health=Health.ERROR if self.failure else report.health,
            state=self.failure or report.state,
            fault_counts={FaultKind.INTERNAL_ERRORS: errors.total, **report.fault_counts},
            values={**report.values, **errors.values()},
        )

    def _log_faults(self, faults: list[FaultKind]) -> None:
        """Log each fault once when it appears and once when it clears."""
        appeared, cleared = changes(self._faults, faults)
        self._faults = faults
        if not self.parameters["log_faults"]:
            return
        for fault in appeared:
            if fault.health >= Health.ERROR:
                self.get_logger().error(fault.text)
            else:
                self.get_logger().warning(fault.text)
        for fault in cleared:
            self.get_logger().info(f"{fault.label}: cleared")

    def _log_begin(self) -> None:
        """Log the first state, once: the first line of a process takes as long as making a node."""
        self._begin_timer.cancel()
        self._log_state(self._begun)

    def _log_state(self, report: SourceReport) -> None:
        """Log the state when it changes."""
        if report.state == self._logged_state:
            return
        self._logged_state = report.state
        if report.health == Health.OK:
            self.get_logger().info(report.state)
        elif report.health == Health.WARN:
            self.get_logger().warning(report.state)
        else:
            self.get_logger().error(report.state)
