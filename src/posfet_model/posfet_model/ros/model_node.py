"""The model node: scans in, forces and contacts out, each message computed only if it has subscribers."""

from __future__ import annotations

import threading
import time
from array import array
from collections.abc import Callable, Set
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from numpy.typing import NDArray
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import Image, PointCloud2
from visualization_msgs.msg import MarkerArray

from posfet_model.calibration.calibration_file import load_calibration
from posfet_model.calibration.calibration_folder import CalibrationFolder
from posfet_model.config import ConfigError
from posfet_model.contacts.tracker import Contact
from posfet_model.estimation.choice import Estimator
from posfet_model.parameters import MODEL_NODE
from posfet_model.reconstruction.diagnostics import Period, judge
from posfet_model.reconstruction.force_image import ForceImage
from posfet_model.reconstruction.reconstructor import Reconstruction, Reconstructor
from posfet_model.reconstruction.scan_clock import ScanCounts
from posfet_model.reconstruction.settings import ReconstructionSettings
from posfet_model.ros.contacts_cdr import ContactsBytes
from posfet_model.ros.conversions import (
    ContactsMessage,
    ForceImageMessage,
    ImageMessage,
    MarkersMessage,
    PointsMessage,
    ScanReader,
    VibrationMessage,
    WrenchMessage,
    contacts_writer,
    info_message,
)
from posfet_model.ros.diagnostic_array import diagnostic_array
from posfet_model.ros.mount_node import broadcast_mount
from posfet_model.ros.ros_parameters import declare, declared_frame, declared_sensor
from posfet_model.ros.run_node import run_node
from posfet_model.ros.subscriptions import SubscriptionCache
from posfet_model.ros.supervision import SupervisedNode
from posfet_model.sensor.scan import Scan
from posfet_msgs.msg import TactileContacts, TactileImage, TactileInfo, TactileRaw, TactileVibration
from posfet_msgs.srv import CalibrationFile
from posfet_msgs.srv import Tare as TareService

OUTPUT_DEPTH = 10
RAW_DEPTH = 1000
"""Depth of the scan queue: one second at 1 kHz, for a process that is delayed."""
REPORT_PERIOD = 1.0
"""Period of the diagnostics [s]."""
MARKER_PERIOD = 33_000_000
"""Shortest time between two marker messages [ns]; markers are for display only."""
READER_GRACE_PERIOD = 1e-4
"""Pause before block maintenance [s], so that the subscribers of a message run first."""


@dataclass(frozen=True)
class Snapshot:
    """Copy of the newest reconstruction, for a display."""

    stamp: int
    """Acquisition time [ns] since the Unix epoch."""
    sequence: int
    valid: bool
    force: NDArray[np.float32]
    """[N], shape [rows, cols]; NaN: unknown."""
    status: NDArray[np.uint8]
    """Values of TaxelStatus, shape [rows, cols]."""
    total: float
    """Total force [N]; NaN: unknown."""
    contacts: tuple[Contact, ...]
    scans: int
    """Scans accepted since the start."""
    missed: int
    """Scans that were never received."""
    calibration: str
    """Date of the calibration, or what its absence costs, in one line."""


class ModelNode(SupervisedNode):
    """Publishes forces and contacts, reconstructed from the scans of `raw` or from those passed to `process`.

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
        try:
            parameters = declare(self, MODEL_NODE)
            self.sensor = declared_sensor(parameters)
            path = parameters["calibration_file"]
            calibration = load_calibration(path, self.sensor) if path else None
            self._calibrations = CalibrationFolder(parameters["calibration_folder"], self.sensor)
            frame_id = declared_frame(self, parameters)
            self._mount = broadcast_mount(self, frame_id, parameters)
        except ConfigError:
            self.destroy_node()
            raise
        layout = self.sensor.layout
        settings = ReconstructionSettings(max_relative_uncertainty=parameters["max_relative_uncertainty"])
        self._estimation = Estimator(parameters["estimator"]), settings
        self._reconstructor = Reconstructor(self.sensor, calibration, *self._estimation)
        self._lock = threading.Lock()
        self._result: Reconstruction | None = None
        self._reader = ScanReader(layout)
        image, wrench = ImageMessage(layout, frame_id), WrenchMessage(layout, frame_id)
        force_image, points = ForceImageMessage(layout, frame_id), PointsMessage(layout, frame_id)
        self._contacts_message: ContactsMessage | ContactsBytes = ContactsMessage(self.sensor, frame_id)
        if parameters["contacts_as_bytes"]:
            self._contacts_message = contacts_writer(self.sensor, frame_id)
        self._markers_message = MarkersMessage(layout, frame_id)
        self._contacts = self.create_publisher(TactileContacts, "contacts", OUTPUT_DEPTH)
        if isinstance(self._contacts_message, ContactsBytes):
            # Publish without the checks of the message type in rclpy, which cost twice as much as publishing itself.
            self._contacts.publish = self._contacts.handle.publish_raw
        self._markers = self.create_publisher(MarkerArray, "markers", OUTPUT_DEPTH)
        self._maps: tuple[tuple[Publisher, Callable[[Reconstruction, ForceImage], Any]], ...] = (
            (self.create_publisher(TactileImage, "image", OUTPUT_DEPTH), image.fill),
            (self.create_publisher(WrenchStamped, "wrench", OUTPUT_DEPTH), wrench.fill),
            (self.create_publisher(Image, "force_image", OUTPUT_DEPTH), force_image.fill),
            (self.create_publisher(PointCloud2, "points", OUTPUT_DEPTH), points.fill),
        )
        self._vibration_message = VibrationMessage(layout, frame_id)
        self._vibration = self.create_publisher(TactileVibration, "vibration", OUTPUT_DEPTH)
        maps = (publisher for publisher, _ in self._maps)
        self._subscription_cache = SubscriptionCache(self._contacts, self._markers, self._vibration, *maps)
        self._only_contacts = {self._contacts}
        self._next_markers = 0
        transient_local = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._info = self.create_publisher(TactileInfo, "info", transient_local)
        self._info.publish(info_message(self.sensor, frame_id, parameters["simulated"], time.time_ns()))
        self._diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", OUTPUT_DEPTH)
        self._reported = ScanCounts()
        self.create_timer(REPORT_PERIOD, self._report)
        self.create_service(TareService, "tare", self._tare)
        self.create_service(CalibrationFile, "calibration/load", self._load)
        self.create_service(CalibrationFile, "calibration/save", self._save)
        if not parameters["direct"]:
            self.create_subscription(TactileRaw, "raw", self._receive, RAW_DEPTH)

    def process(self, scan: Scan) -> None:
        """Process one scan and publish the messages that have subscribers, contacts first.

        A scan that cannot be used also gives messages, with `data_valid` false. For one thread at a time.

        Parameters
        ----------
        scan : Scan
            The scan.
        """
        with self._lock:
            now = time.monotonic_ns()
            subscribed = self._subscription_cache.subscribed(now)
            self._reconstructor.vibration_wanted = self._vibration in subscribed
            result = self._reconstructor.process(scan)
            if result.accepted:
                self._result = result
            elif not result.unusable:
                return
            if self._contacts in subscribed:
                self._contacts.publish(self._contacts_message.fill(result))
            if subscribed != self._only_contacts:
                self._publish_others(result, subscribed, now)
            if self._reconstructor.maintenance_due:
                time.sleep(READER_GRACE_PERIOD)
                self._reconstructor.run_maintenance()

    def _publish_others(self, result: Reconstruction, subscribed: Set[Any], now: int) -> None:
        """Publish the other messages that have subscribers."""
        maps = [entry for entry in self._maps if entry[0] in subscribed]
        if maps:
            image = self._reconstructor.image()
            for publisher, fill in maps:
                publisher.publish(fill(result, image))
        if self._vibration in subscribed:
            self._vibration.publish(self._vibration_message.fill(result, self._reconstructor.vibration()))
        if now >= self._next_markers and self._markers in subscribed:
            self._next_markers = now + MARKER_PERIOD
            self._markers.publish(self._markers_message.fill(result))

    def latest(self) -> Snapshot | None:
        """Return a copy of the newest reconstruction, None before the first scan. For any thread."""
        with self._lock:
            if self._result is None:
                return None
            image, counts = self._reconstructor.image(), self._reconstructor.counts
            shape = self.sensor.layout.rows, self.sensor.layout.cols
            return Snapshot(
                stamp=self._result.stamp,
                sequence=self._result.sequence,
                valid=self._result.valid,
                force=image.force.reshape(shape).copy(),
                status=image.status.reshape(shape).copy(),
                total=image.total,
                contacts=self._result.contacts,
                scans=counts.accepted,
                missed=counts.missed,
                calibration=self._reconstructor.calibration.summary,
            )

    def _receive(self, message: TactileRaw) -> None:
        self.process(self._reader.read(message))

    def _tare(self, request: Any, response: Any) -> Any:
        with self._lock:
            tare = self._reconstructor.tare(request.force)
        response.success, response.message = tare.done, tare.message
        response.force_change = array("f", tare.force_change.tolist())
        return response

    def _load(self, request: Any, response: Any) -> Any:
        try:
            calibration = self._calibrations.load(request.path)
        except ConfigError as error:
            response.success, response.message = False, str(error)
            return response
        reconstructor = Reconstructor(self.sensor, calibration, *self._estimation)
        with self._lock:
            self._reconstructor = reconstructor
            self._result = None
            self._reported = ScanCounts()
        response.success = True
        date = reconstructor.calibration.date or "no date"
        response.message = f"calibration of {date} in use; baselines are estimated again"
        return response

    def _save(self, request: Any, response: Any) -> Any:
        try:
            path = self._calibrations.save(request.path, self._reconstructor.calibration)
        except ConfigError as error:
            response.success, response.message = False, str(error)
            return response
        response.success, response.message = True, f"{path}: written"
        return response

    def _report(self) -> None:
        with self._lock:
            counts = self._reconstructor.counts.snapshot()
            saturated = self._result.saturated if self._result else 0
            unsettled, restarts = self._reconstructor.unsettled, self._reconstructor.restarts
            bad = self._reconstructor.faulty
            temperature_known, rate = self._reconstructor.temperature_known, self._reconstructor.rate
            hum_frequency, hum_amplitude = self._reconstructor.hum_frequency, self._reconstructor.hum_amplitude
            calibration = self._reconstructor.calibration
        before, self._reported = self._reported, counts
        verdict = judge(
            Period.between(before, counts, unsettled, saturated, bad, temperature_known, calibration.calibrated)
        )
        values = {name.replace("_", " "): str(count) for name, count in asdict(counts).items()}
        values["calibration"] = calibration.summary
        values["scan rate received [Hz]"] = f"{(counts.accepted - before.accepted) / REPORT_PERIOD:.0f}"
        values["scan rate by the board's clock [Hz]"] = f"{rate:.1f}"
        values["taxels without a baseline"] = str(unsettled)
        values["taxels saturated"] = str(saturated)
        values["taxels dead, stuck or noisy"] = str(bad)
        values["baseline restarts"] = str(restarts)
        values["mains hum removed, RMS [mN]"] = f"{hum_amplitude * 1e3:.2f}"
        values["mains hum frequency [Hz]"] = f"{hum_frequency:.2f}"
        values |= self.internal_errors.values()
        name = f"{self.get_fully_qualified_name()}: reconstruction"
        hardware_id = self.sensor.serial or self.sensor.name
        self._diagnostics.publish(
            diagnostic_array(verdict.level, name, verdict.text, hardware_id, values, time.time_ns())
        )


def main() -> None:
    """Run the node until Ctrl-C or SIGTERM."""
    raise SystemExit(run_node(ModelNode))
