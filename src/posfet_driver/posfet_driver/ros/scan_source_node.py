"""The lifecycle node around a source of scans: what the driver and the simulated board have in common."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.qos import QoSProfile

from posfet_driver.board.faults import Fault, FaultWatch, changes
from posfet_driver.board.scan_source import Health, ScanSource, SourceError, SourceReport
from posfet_driver.parameters import SCAN_SOURCE_NODE
from posfet_driver.ros.conversions import RawMessage, diagnostic_array
from posfet_model.config import ConfigError
from posfet_model.parameters import Parameter
from posfet_model.ros.ros_parameters import declare, declared_frame, declared_sensor
from posfet_model.ros.subscriptions import SubscriptionCache
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import Scan
from posfet_msgs.msg import TactileRaw

RAW_DEPTH = 1000
"""Scans that wait for a process that is held up: one second of them."""
READ_TIMEOUT = 0.1
"""Longest wait of the data thread [s]: bounds the time that an end takes."""
WANTED_PERIOD = 0.01
"""Time between two questions whether the source is wanted [s]."""
REPORT_PERIOD = 1.0
"""Time between two diagnostics [s]."""


def _refusing(change_state: Callable[..., Any]) -> Callable[..., Any]:
    """Return rclpy's service of transitions, with an answer where it would end the process: no such transition now."""

    def change(request: Any, response: Any) -> Any:
        try:
            return change_state(request, response)
        except rclpy_implementation.RCLError:  # which rcl has logged
            response.success = False
            return response

    return change


class ScanSourceNode(LifecycleNode):  # type: ignore[misc]  # rclpy has no types
    """Publishes the scans of a source.

    configure opens the source and starts the one data thread, which reads once `wanted`; activate lets
    scans out, to `sink` and, when somebody subscribes, to `raw`; deactivate holds them back, while the source is still
    read so that nothing old is waiting; cleanup closes the source. Raises ConfigError at construction for a parameter
    or file that cannot be used.
    """

    def __init__(
        self, node_name: str, parameters: Sequence[Parameter] = SCAN_SOURCE_NODE, **node_arguments: Any
    ) -> None:
        super().__init__(node_name, **node_arguments)
        self._service_change_state.callback = _refusing(self._service_change_state.callback)
        self.sink: Callable[[Scan], None] | None = None
        """Called with every scan in the data thread, before anything is published; set it while not active."""
        try:
            self.parameters = declare(self, parameters)
            self.sensor = declared_sensor(self.parameters)
            self.source = self.make_source(self.sensor, self.parameters)
        except ConfigError:
            self.destroy_node()
            raise
        self.frame_id = declared_frame(self, self.parameters)
        self._raw_message = RawMessage(self.sensor.layout, self.frame_id)
        self._raw = self.create_publisher(TactileRaw, "raw", RAW_DEPTH)
        self._raw_listeners = SubscriptionCache(self._raw)
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", QoSProfile(depth=10))
        self._report_timer = self.create_timer(REPORT_PERIOD, self._report, autostart=False)
        self._thread: threading.Thread | None = None
        self._stop = threading.Event()
        self._active = False
        self._begun = False
        self._starting = False
        self._failure = ""
        self._said = ""
        self._watch = FaultWatch()
        self._faults: list[Fault] = []
        self._reported = (0, 0)

    def make_source(self, sensor: Sensor, parameters: Mapping[str, Any]) -> ScanSource:
        """Return the source, not opened yet. Raises ConfigError for what cannot work."""
        raise NotImplementedError

    def start(self) -> None:
        """Configure and activate, unless the parameter autostart is false.

        Raises ConfigError, one line, when the source cannot be opened.
        """
        if not self.parameters["autostart"]:
            return
        self._starting = True
        configured = self.trigger_configure()
        self._starting = False
        if configured != TransitionCallbackReturn.SUCCESS:
            raise ConfigError(f"{self.get_fully_qualified_name()}: {self._failure}")
        self.trigger_activate()

    @property
    def reading(self) -> bool:
        """Whether the data thread runs: between configure and cleanup."""
        return self._thread is not None

    def wanted(self, now: int) -> bool:
        """Return whether to read the source already: once its scans are listened to; `now` is a monotonic time [ns]."""
        if not self._begun:
            self._begun = bool(self.sink) or self._raw_listeners.any(now)
        return self._begun

    def deliver(self, scan: Scan, now: int) -> None:
        """Hand on one scan in the data thread; `now` is a monotonic time [ns]."""
        if self.sink:
            self.sink(scan)
        if self._raw_listeners.any(now):
            self._raw.publish(self._raw_message.fill(scan))

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Open the source and start reading."""
        try:
            self._begin()
        except (ConfigError, SourceError) as error:
            self._failure = str(error)
            if not self._starting:  # else the caller of `start` is told
                self.get_logger().error(self._failure)
            return TransitionCallbackReturn.FAILURE
        return super().on_configure(state)

    def restart(self) -> None:
        """Close the source and open it again, if it is being read; raises ConfigError or SourceError as `open` does."""
        active = self._active
        if self.reading:
            self._end()
            self._begin()
            self._active = active

    def _begin(self) -> None:
        self.source.open()
        self._reported = (self.source.report().scans, time.monotonic_ns())
        self._stop.clear()
        self._thread = threading.Thread(target=self._run, name=f"{self.get_name()} data", daemon=True)
        self._thread.start()
        self._report_timer.reset()
        self._say(self.source.report())

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Let scans out."""
        self._active = True
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Hold scans back."""
        self._active = False
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
        """End the data thread, close the source, then give back what the node holds."""
        if hasattr(self, "_stop"):
            self._end()
        super().destroy_node()

    def _end(self) -> None:
        self._active = False
        self._stop.set()
        self._report_timer.cancel()
        if self._thread:
            self._thread.join()
            self._thread = None
            self.source.close()

    def _run(self) -> None:
        read = self.source.read
        try:
            while not self.wanted(time.monotonic_ns()) and not self._stop.wait(WANTED_PERIOD):
                pass
            while not self._stop.is_set():
                scan = read(READ_TIMEOUT)
                if scan is not None and self._active:
                    self.deliver(scan, time.monotonic_ns())
        except rclpy_implementation.RCLError:
            if self.context.ok():  # else the process is being ended, which nobody tells this thread first
                raise

    def _report(self) -> None:
        if self._thread and not self._thread.is_alive():
            raise RuntimeError("the data thread has ended on the error above")  # better gone than silent
        report = self.source.report()
        now = time.monotonic_ns()
        scans, before = self._reported
        self._reported = (report.scans, now)
        scan_rate = (report.scans - scans) * 1e9 / max(now - before, 1)
        name = f"{self.get_fully_qualified_name()}: board"
        hardware_id = self.sensor.serial or self.sensor.name
        faults = self._watch.present(report, now)
        self._diagnostics.publish(diagnostic_array(report, name, hardware_id, scan_rate, time.time_ns(), faults))
        self._say(report)
        self._say_faults(faults)

    def _say_faults(self, faults: list[Fault]) -> None:
        """Log each fault once when it comes and once when it is over."""
        come, gone = changes(self._faults, faults)
        self._faults = faults
        for fault in come:
            if fault.health >= Health.ERROR:
                self.get_logger().error(fault.text)
            else:
                self.get_logger().warning(fault.text)
        for fault in gone:
            self.get_logger().info(f"{fault.name}: over")

    def _say(self, report: SourceReport) -> None:
        """Log the state once a change, however often it is reported."""
        if report.state == self._said:
            return
        self._said = report.state
        if report.health == Health.OK:
            self.get_logger().info(report.state)
        elif report.health == Health.WARN:
            self.get_logger().warning(report.state)
        else:
            self.get_logger().error(report.state)
