# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The model node: scans in, forces and contacts out, each message computed only if it has subscribers."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Set
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn

from posfet_model.calibration.calibration_file import load_calibration
from posfet_model.calibration.calibration_folder import CalibrationFolder
from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.config import ConfigError
from posfet_model.parameters import MODEL_NODE, default_frame
from posfet_model.reconstruction.contacts_sink import Mutex
from posfet_model.reconstruction.reconstructor import Reconstruction, Reconstructor, Tare
from posfet_model.reconstruction.settings import ReconstructionSettings
from posfet_model.ros.direct_contacts import DirectContacts, StreamingSource
from posfet_model.ros.lifecycle import SupervisedLifecycleNode
from posfet_model.ros.model_outputs import ModelOutputs
from posfet_model.ros.model_settings import reconstruction_settings
from posfet_model.ros.mount import parse_mount
from posfet_model.ros.mount_node import broadcast_mount
from posfet_model.ros.output_qos import OUTPUT_DEPTH, output_qos
from posfet_model.ros.queue_delay import QueueDelay
from posfet_model.ros.ros_parameters import declare, declared_sensor
from posfet_model.ros.run_node import run_node
from posfet_model.ros.scan_reader import ScanReader
from posfet_model.ros.subscriptions import SUBSCRIBER_CHECK_PERIOD
from posfet_model.sensor.scan import Scan
from posfet_msgs.msg import TactileRaw

if TYPE_CHECKING:
    from posfet_model.ros.model_diagnostics import ModelDiagnostics
    from posfet_model.ros.model_report import ModelReport
    from posfet_model.ros.model_snapshot import Snapshot

RAW_DEPTH = 1000
"""Depth of the scan queue: one second at 1 kHz, for a process that is delayed."""

ATTEMPTS = 3
"""Number of times that a reconstructor is made while scans go on: if a contact began meanwhile, it is not used, as it
would give the id of that contact again."""


class ModelNode(SupervisedLifecycleNode):
    """Publishes forces and contacts, reconstructed from the scans of `raw` or from those passed to `process`.

    configure loads the calibration, with baselines unknown; activate processes scans; deactivate ignores them; cleanup
    forgets all that was estimated. The frame of the array is that of the scans on `raw`: `info` and the transform of
    the mount follow with the first one. Scans passed to `process` have none, see `use_frame`.

    Parameters
    ----------
    **node_arguments : object
        Arguments of the node, as for `rclpy.node.Node`.

    Raises
    ------
    ConfigError
        At construction, if a parameter or file cannot be used.
    """

    def __init__(self, **node_arguments: Any) -> None:
        super().__init__("model_node", **node_arguments)
        self._lock = Mutex()
        self._reconstructor: Reconstructor | None = None
        try:
            self.parameters = declare(self, MODEL_NODE, self._prepare)
            self.sensor = declared_sensor(self.parameters)
            settings = reconstruction_settings(self.sensor, self.parameters)
            self._calibrations = CalibrationFolder(self.parameters["calibration_folder"], self.sensor)
            parse_mount(self.parameters["mount"])
        except ConfigError:
            self.destroy_node()
            raise
        self._active = False
        self._result: Reconstruction | None = None
        self._next_id = 1
        self._reader = ScanReader(self.sensor.layout)
        given = self.parameters
        qos = output_qos(given["reliability"], OUTPUT_DEPTH)
        self._outputs = ModelOutputs(self, given["contacts_as_bytes"], qos, given["display_rate"])
        self._direct = DirectContacts(self._outputs, self._lock)
        self._mount: Any = None
        self._raw: Any = None
        self._settings = ReconstructionSettings()
        self._use_settings(settings)
        self._queue = QueueDelay(self)
        self._diagnostics: ModelDiagnostics | None = None
        if self.parameters["direct"]:
            self.use_frame(default_frame(self.get_namespace()))
        else:
            self.add_maps()

    def serve(self) -> None:
        """Create the services, those of the parameters included, and the diagnostics."""
        from posfet_model.ros.model_diagnostics import ModelDiagnostics  # noqa: PLC0415  # loaded once scans arrive
        from posfet_model.ros.model_services import ModelServices  # noqa: PLC0415  # and this

        super().serve()
        services = ModelServices(
            self, self._calibrations, lambda: self._reconstructor, self._use_calibration, self._tare
        )
        self._diagnostics = ModelDiagnostics(
            self,
            self.sensor,
            self._observed,
            self._queue,
            folder_problem=services.folder_problem,
            shared=self._shared_topics,
        )

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Load the calibration."""
        result = self.configured(self._begin, self._end)
        return super().on_configure(state) if result == TransitionCallbackReturn.SUCCESS else result

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Process scans."""
        if not self.parameters["direct"]:
            self._queue.start()
            qos = output_qos(self.parameters["reliability"], RAW_DEPTH)  # best effort takes from publishers of both
            self._raw = self.create_subscription(TactileRaw, "raw", self._receive, qos)
        self._active = True
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Ignore scans."""
        self._pause()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Forget all that was estimated."""
        self._end()
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Ignore scans, and forget all that was estimated."""
        self._end()
        return super().on_shutdown(state)

    def _begin(self) -> None:
        path = self.parameters["calibration_file"]
        self._use_calibration(load_calibration(path, self.sensor) if path else None)

    def _pause(self) -> None:
        with self._lock:  # a scan that is being processed is the last one
            self._active = False
            self._direct.close()
        if self._raw is not None:
            self.destroy_subscription(self._raw)
            self._raw = None
            self._queue.stop()

    def _end(self) -> None:
        self._pause()
        with self._lock:
            self._keep_id()
            self._reconstructor = self._result = None

    def _keep_id(self) -> None:
        """Let the next reconstructor go on with the ids of the contacts of this one; the lock is held."""
        if self._reconstructor is not None:
            self._next_id = self._reconstructor.next_id

    def _use_calibration(self, calibration: Calibration | None) -> Reconstructor:
        """Begin to estimate with a calibration; None: nominal values."""
        for _ in range(ATTEMPTS):
            with self._lock:
                self._keep_id()
            first = self._next_id
            made = self._make(calibration)
            with self._lock:
                if self._reconstructor is None or self._reconstructor.next_id == first:
                    self._replace(made)
                    return made
        with self._lock:  # contacts begin all the time: scans wait for it
            self._keep_id()
            made = self._make(calibration)
            self._replace(made)
        return made

    def _make(self, calibration: Calibration | None) -> Reconstructor:
        return Reconstructor(self.sensor, calibration, self._settings, self._next_id)

    def _replace(self, reconstructor: Reconstructor) -> None:
        """Use another reconstructor from the next scan on; the lock is held."""
        self._reconstructor, self._result = reconstructor, None
        self._direct.close()
        if self._diagnostics is not None:
            self._diagnostics.forget()

    def _prepare(self, parameters: Mapping[str, Any]) -> Callable[[], object]:
        """Return what applies changed parameters between two scans; raise ConfigError if they do not fit."""
        settings = reconstruction_settings(self.sensor, parameters)
        return lambda: self._use_settings(settings)

    def _use_settings(self, settings: ReconstructionSettings) -> None:
        with self._lock:
            before, self._settings = self._settings, settings
            self._outputs.display.change(self.parameters["display_rate"])
            if self._reconstructor is not None and settings != before:
                self._reconstructor.change(settings)
            if self._outputs.frame_id and settings.contact != before.contact:
                self._describe(self._outputs.frame_id)

    def add_maps(self) -> None:
        """Publish the topics beside `contacts` from now on; in one process, once the scans have begun."""
        from posfet_model.ros.map_outputs import MapOutputs  # noqa: PLC0415  # loaded while scans are processed

        qos = output_qos(self.parameters["reliability"], OUTPUT_DEPTH)
        maps = MapOutputs(self, self.parameters["simulated"], qos, self._outputs.display)
        with self._lock:
            self._outputs.add(maps)

    def use_frame(self, frame_id: str) -> None:
        """Use another frame of the array from the next message on, publish `info`, and where the array is mounted.

        Parameters
        ----------
        frame_id : str
            Frame of the array; its owner is the source of scans.

        Raises
        ------
        ConfigError
            If the array would be mounted on itself; one line.
        """
        if frame_id == self._outputs.frame_id:
            return
        with self._lock:
            self._describe(frame_id)
        if self._mount is not None:
            self.destroy_publisher(self._mount)
        self._mount = None
        self._mount = broadcast_mount(self, frame_id, self.parameters)

    def _describe(self, frame_id: str) -> None:
        self._direct.close()
        self._outputs.describe(replace(self.sensor, contact=self._settings.contact or self.sensor.contact), frame_id)

    def process(self, scan: Scan) -> None:
        """Process one scan while active, and publish the messages that have subscribers, contacts first.

        A scan that cannot be used also gives messages, with `data_valid` false. For one thread at a time.

        Parameters
        ----------
        scan : Scan
            The scan.
        """
        with self._lock:
            reconstructor = self._reconstructor
            if not self._active or reconstructor is None:
                return
            now = time.monotonic_ns()
            outputs = self._outputs
            subscribed = outputs.subscribed(now)
            reconstructor.vibration_wanted = outputs.vibration_wanted(subscribed)
            result = reconstructor.process(scan)
            if result.accepted:
                self._result = result
            elif not result.unusable:
                return
            if subscribed:
                outputs.publish(reconstructor, result, subscribed)
            if reconstructor.maintenance_due:
                reconstructor.run_maintenance()

    def stream(self, source: StreamingSource, timeout: float) -> Scan | None:
        """Have the scans of a source processed without Python while nothing but their contacts is wanted.

        Parameters
        ----------
        source : StreamingSource
            The source; its thread calls this.
        timeout : float
            Longest time to wait [s].

        Returns
        -------
        Scan or None
            A scan that was not processed: for `process`.
        """
        with self._lock:
            reconstructor = self._reconstructor
            subscribed = self._outputs.subscribed(time.monotonic_ns())
            direct = (
                self._active
                and reconstructor is not None
                and self._result is not None
                and self._outputs.contacts_alone(subscribed)
                and self._direct.open(reconstructor, bool(subscribed))
            )
        if not direct:
            return source.read(timeout)
        scan = self._direct.stream(source, timeout if subscribed else min(timeout, SUBSCRIBER_CHECK_PERIOD))
        with self._lock:
            self._complete(reconstructor, subscribed)
        return scan

    def _complete(self, reconstructor: Reconstructor | None, subscribed: Set[Any]) -> None:
        """Do after scans were processed without Python what needs it."""
        if reconstructor is None or reconstructor is not self._reconstructor or not self._active:
            return
        if self._direct.take_failure():
            self._outputs.publish(reconstructor, reconstructor.refresh(), subscribed)

    def latest(self) -> Snapshot | None:
        """Return a copy of the newest reconstruction, None before the first scan. For any thread."""
        from posfet_model.ros.model_snapshot import snapshot  # noqa: PLC0415  # for displays only

        with self._lock:
            if self._result is None or self._reconstructor is None:
                return None
            return snapshot(self._reconstructor, self._reconstructor.refresh(), self.sensor.layout)

    def _receive(self, message: TactileRaw) -> None:
        if self._queue.too_late():
            return
        frame_id = message.header.frame_id or default_frame(self.get_namespace())
        if frame_id != self._outputs.frame_id:
            try:
                self.use_frame(frame_id)
            except ConfigError as error:
                self.get_logger().error(str(error))
        self.process(self._reader.read(message))

    def _tare(self, force: bool) -> Tare | None:
        with self._lock:
            return self._reconstructor.tare(force) if self._active and self._reconstructor else None

    def _shared_topics(self) -> list[str]:
        """Return those of `raw` and `contacts` that have more than one publisher, whose messages are mixed."""
        topics = [each.topic_name for each in (self._raw, self._outputs.contacts) if each is not None]
        return [topic for topic in topics if self.count_publishers(topic) > 1]

    def _observed(self) -> tuple[bool, ModelReport | None]:
        """Return whether scans are processed, and the state of the reconstructor; None without one."""
        from posfet_model.ros.model_report import ModelReport  # noqa: PLC0415  # for diagnostics only

        with self._lock:
            model = self._reconstructor
            return self._active, ModelReport(model, model.refresh() if self._result else None) if model else None


def make_node() -> ModelNode:
    """Return the node, started unless its parameter autostart is false."""
    node = ModelNode()
    try:
        node.start()
    except ConfigError:
        node.destroy_node()
        raise
    return node


def main() -> None:
    """Run the node until Ctrl-C or SIGTERM."""
    raise SystemExit(run_node(make_node))
