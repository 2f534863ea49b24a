# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Node of the simulated board: publishes its scans as `raw` or sends them over CAN, and publishes the ground truth."""

from __future__ import annotations

import time
from array import array
from collections import deque
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from geometry_msgs.msg import Point, Pose, Quaternion, Vector3
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn

from posfet_driver.board.scan_source import ManagedDevice
from posfet_driver.clock import Clock
from posfet_driver.ros.scan_source_node import ScanSourceNode
from posfet_model._lib.shown import shown
from posfet_model._lib.units import NANOSECONDS
from posfet_model.config import ConfigError
from posfet_model.ros.display_scans import DisplayScans
from posfet_model.ros.output_qos import output_qos
from posfet_model.ros.run_node import run_node
from posfet_model.ros.subscriptions import SubscriptionCache
from posfet_model.sensor.description import Layout, Sensor
from posfet_model.sensor.scan import Scan
from posfet_msgs.msg import TactileTruth
from posfet_msgs.srv import LoadScene
from posfet_sim.device.error_model import load_error_model
from posfet_sim.device.ground_truth import Truth
from posfet_sim.emulation.realtime_source import SimulationSource
from posfet_sim.loads import ObjectsState
from posfet_sim.parameters import SIM_BOARD_NODE
from posfet_sim.scene import load_scene

if TYPE_CHECKING:
    from posfet_sim.emulation.bus_peer import SimulatedBusPeer

TRUTH_DEPTH = 10
"""Queue depth of the topics `truth` and `view/truth`."""
SCAN_TIMES_KEPT = 2000
"""Number of the latest scans whose sampling times are kept."""


class TruthMessage:
    """A TactileTruth message that is reused for every scan."""

    def __init__(self, layout: Layout, frame_id: str) -> None:
        """Create the message for an array and a frame."""
        self._message = TactileTruth(layout_id=layout.id, rows=layout.rows, cols=layout.cols)
        self._message.header.frame_id = frame_id

    def fill(self, truth: Truth, sequence: int, stamp: int) -> TactileTruth:
        """Return the message for a ground truth; the next call overwrites it.

        Parameters
        ----------
        truth : Truth
            Ground truth of the scan.
        sequence : int
            Sequence of the scan.
        stamp : int
            Stamp of the scan [ns] since the Unix epoch.
        """
        message = self._message
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, NANOSECONDS)
        message.sequence = sequence
        message.force = _floats(truth.force)
        message.status = array("B", truth.taxel_status.tobytes())
        message.temperature = truth.film_temperature
        message.chip_temperature = truth.chip_temperature
        objects = truth.objects
        message.objects = list(objects.names)
        poses = zip(objects.positions.tolist(), objects.orientations.tolist(), strict=True)
        message.poses = [
            Pose(position=_point(*position), orientation=_quaternion(*orientation)) for position, orientation in poses
        ]
        message.contact_objects = array("H", objects.contact_objects.tolist())
        message.contact_centres = [_point(x, y, 0.0) for x, y in objects.contact_centres.tolist()]
        message.contact_normals = [Vector3(x=x, y=y, z=z) for x, y, z in objects.contact_normals.tolist()]
        message.contact_forces = _floats(objects.contact_forces)
        return message


class SimBoardNode(ScanSourceNode):
    """The simulated board as a lifecycle node; see `ScanSourceNode` for the transitions.

    It delivers scans itself (`SimulationSource`), or is a peer on a CAN bus whose scans a driver receives
    (`SimulatedBusPeer`). `truth`, and `view/truth` for displays, are computed and published only for subscribers. The
    constructor raises ConfigError for an invalid parameter, sensor or scene.

    Parameters
    ----------
    node_name : str, optional
        Name of the node.
    clock : Clock, optional
        Clock of the host.
    **node_arguments : object
        Further arguments of the node, as for `rclpy.node.Node`.
    """

    source: SimulationSource | SimulatedBusPeer

    def __init__(self, node_name: str = "sim_board_node", clock: Clock | None = None, **node_arguments: Any) -> None:
        super().__init__(node_name, SIM_BOARD_NODE, clock, **node_arguments)
        self._resume: bool | None = None  # closed since it could not be opened again: whether it was active before
        self._truth_message = TruthMessage(self.sensor.layout, self.frame_id)
        qos = output_qos(self.parameters["reliability"], TRUTH_DEPTH)
        self._truth = self.create_publisher(TactileTruth, "truth", qos)
        self._view_truth = self.create_publisher(TactileTruth, "view/truth", qos)
        self._truth_listeners = SubscriptionCache(self._truth, self._view_truth)
        self._display = DisplayScans(self.parameters["display_rate"])
        self._taken: deque[tuple[int, float]] = deque(
            maxlen=SCAN_TIMES_KEPT
        )  # sequence and time [s] of the latest scans

    def serve(self) -> None:
        """Create the diagnostics and the service."""
        super().serve()
        self.create_service(LoadScene, "scene/load", self._load_scene)

    def make_source(self, sensor: Sensor, parameters: Mapping[str, Any]) -> ManagedDevice:
        """Return the simulated board in real time: direct, behind an adapter, or on a bus."""
        scene = load_scene(parameters["scene"], sensor)
        error_model = load_error_model(parameters["imperfections"])
        link = parameters["adapter_link"]
        if not link and not parameters["bus_interface"]:
            return SimulationSource(sensor, scene, parameters["seed"], self.clock, error_model)
        from posfet_driver.bus.open_bus import bus_settings  # noqa: PLC0415
        from posfet_sim.emulation.bus_peer import SimulatedBusPeer  # noqa: PLC0415  # python-can takes 0.1 s to load

        if parameters["bus_interface"]:
            link = bus_settings(parameters["bus_interface"], parameters["bus_channel"], sensor.can)
        peer = SimulatedBusPeer(sensor, scene, parameters["seed"], link, self.clock, error_model)
        peer.on_scan = self._scan_sent
        return peer

    def reading_wanted(self, now: int) -> bool:
        """Return whether the scene may begin; on a bus the driver decides that."""
        return not isinstance(self.source, SimulationSource) or super().reading_wanted(now)

    def objects_in(self, sequence: int) -> ObjectsState | None:
        """Return the objects at the latest scan of a sequence; None when it is too old. Thread-safe."""
        times = [time for taken, time in self._taken.copy() if taken == sequence]
        return self.source.board.objects(times[-1]) if times else None

    def deliver(self, scan: Scan, now: int) -> None:
        """Deliver one scan, then its ground truth."""
        super().deliver(scan, now)
        self._publish_truth(scan.sequence, scan.stamp, now)

    def _load_scene(self, request: LoadScene.Request, response: LoadScene.Response) -> LoadScene.Response:
        """Restart the board with another scene; if it does not start, with the one before."""
        try:
            scene = load_scene(request.scene, self.sensor)
        except ConfigError as error:
            response.success, response.message = False, str(error)
            return response
        earlier, self.source.scene = self.source.scene, scene
        reason = self._restart()
        if not reason:
            response.success, response.message = True, f"scene {shown(scene.name)} from its start"
            return response
        self.source.scene = earlier
        closed = self._restart()
        state = "the board is closed" if closed else f"scene {shown(earlier.name)} from its start"
        response.success, response.message = False, f"scene {shown(scene.name)} does not start: {reason}; {state}"
        self.get_logger().error(response.message)
        return response

    def _restart(self) -> str:
        """Restart the board unless it is closed on purpose; return '', or why it failed and was closed."""
        active = self._active
        try:
            if self._resume is None:
                self.restart()
                return ""
        except Exception as error:  # whatever it is, the state of the node must be true
            if active:
                self.trigger_deactivate()
            self.trigger_cleanup()
            self._resume = active
            return _reason(error)
        resume = self._resume
        if self.trigger_configure() != TransitionCallbackReturn.SUCCESS:
            return self.refusal
        if resume:
            self.trigger_activate()
        return ""

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Open the source and start reading."""
        result = super().on_configure(state)
        if result == TransitionCallbackReturn.SUCCESS:
            self._resume = None
        return result

    def _scan_sent(self, scan: Scan, stamp: int) -> None:
        """Publish the ground truth of a scan that was sent on the bus; runs in the thread of the bus."""
        try:
            if self._active:
                self._publish_truth(scan.sequence, stamp, time.monotonic_ns())
        except rclpy_implementation.RCLError:
            if self.context.ok():  # else the process is shutting down
                raise

    def _publish_truth(self, sequence: int, stamp: int, now: int) -> None:
        self._taken.append((sequence, self.source.board.time))
        subscribed = self._truth_listeners.subscribed(now)
        wanted = [self._truth] if self._truth in subscribed else []
        if self._view_truth in subscribed:
            self._display.change(self.parameters["display_rate"])
            if self._display.due(stamp):
                wanted.append(self._view_truth)
        if wanted:
            message = self._truth_message.fill(self.source.board.truth(), sequence, stamp)
            for publisher in wanted:
                publisher.publish(message)


def _reason(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__


def _floats(values: np.ndarray[Any, Any]) -> array[float]:
    """Return values as a float32 array, which rclpy takes without a check of each element."""
    return array("f", values.astype(np.float32).tobytes())


def _point(x: float, y: float, z: float) -> Point:
    return Point(x=x, y=y, z=z)


def _quaternion(x: float, y: float, z: float, w: float) -> Quaternion:
    return Quaternion(x=x, y=y, z=z, w=w)


def make_node() -> SimBoardNode:
    """Return the node, started unless its parameter autostart is false."""
    node = SimBoardNode()
    node.start()
    return node


def main() -> None:
    """Run the node until it is interrupted."""
    raise SystemExit(run_node(make_node))
