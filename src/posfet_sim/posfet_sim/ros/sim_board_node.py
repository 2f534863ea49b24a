"""Node of the simulated board: publishes its scans as `raw`, or speaks as a CAN adapter; and the ground truth."""

from __future__ import annotations

import time
from array import array
from collections import deque
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from geometry_msgs.msg import Point, Pose, Quaternion, Vector3
from rclpy.impl.implementation_singleton import rclpy_implementation

from posfet_driver.board.scan_source import ScanSource, SourceError
from posfet_driver.ros.conversions import NANOSECONDS
from posfet_driver.ros.scan_source_node import ScanSourceNode
from posfet_model.config import ConfigError
from posfet_model.ros.run_node import run_node
from posfet_model.ros.subscriptions import SubscriptionCache
from posfet_model.sensor.description import Layout, Sensor
from posfet_model.sensor.scan import Scan
from posfet_msgs.msg import TactileTruth
from posfet_msgs.srv import LoadScene
from posfet_sim.device.ground_truth import Truth
from posfet_sim.device.imperfections import load_imperfections
from posfet_sim.emulation.realtime_source import SimulationSource
from posfet_sim.loads import ObjectsState
from posfet_sim.parameters import SIM_BOARD_NODE
from posfet_sim.scene import load_scene

if TYPE_CHECKING:
    from posfet_sim.emulation.emulated_source import AdapterSource

TRUTH_DEPTH = 10
REMEMBERED = 2000
"""Scans of which it is known when the board took them."""


class TruthMessage:
    """One TactileTruth that is filled again and again."""

    def __init__(self, layout: Layout, frame_id: str) -> None:
        self._message = TactileTruth(layout_id=layout.id, rows=layout.rows, cols=layout.cols)
        self._message.header.frame_id = frame_id

    def fill(self, truth: Truth, sequence: int, stamp: int) -> TactileTruth:
        """Return the message of `truth` for the scan of that number and stamp [ns]; the next call overwrites it."""
        message = self._message
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, NANOSECONDS)
        message.sequence = sequence
        message.force = _floats(truth.force)
        message.status = array("B", truth.taxel_status.tobytes())
        message.temperature = truth.film_temperature
        message.chip_temperature = truth.chip_temperature
        objects = truth.objects
        message.objects = list(objects.names)
        places = zip(objects.positions.tolist(), objects.orientations.tolist(), strict=True)
        message.poses = [Pose(position=_point(*place), orientation=_quaternion(*turn)) for place, turn in places]
        message.contact_objects = array("H", objects.contact_objects.tolist())
        message.contact_centres = [_point(x, y, 0.0) for x, y in objects.contact_centres.tolist()]
        message.contact_normals = [Vector3(x=x, y=y, z=z) for x, y, z in objects.contact_normals.tolist()]
        message.contact_forces = _floats(objects.contact_forces)
        return message


class SimBoardNode(ScanSourceNode):
    """The simulated board as a node; what `ScanSourceNode` says of life and end holds here.

    `truth` is computed and published only when somebody subscribes. Raises ConfigError at construction for a
    parameter, sensor or scene that cannot be used.
    """

    source: SimulationSource | AdapterSource

    def __init__(self, node_name: str = "sim_board_node", **node_arguments: Any) -> None:
        super().__init__(node_name, SIM_BOARD_NODE, **node_arguments)
        self._truth_message = TruthMessage(self.sensor.layout, self.frame_id)
        self._truth = self.create_publisher(TactileTruth, "truth", TRUTH_DEPTH)
        self._truth_listeners = SubscriptionCache(self._truth)
        self.create_service(LoadScene, "scene/load", self._load_scene)
        self._taken: deque[tuple[int, float]] = deque(maxlen=REMEMBERED)  # numbers and times [s] of the newest scans

    def make_source(self, sensor: Sensor, parameters: Mapping[str, Any]) -> ScanSource:
        """Return the simulated board in real time: bare, behind an adapter, or on a bus."""
        scene = load_scene(parameters["scene"], sensor)
        imperfections = load_imperfections(parameters["imperfections"])
        link = parameters["adapter_link"]
        if not link and not parameters["bus_interface"]:
            return SimulationSource(sensor, scene, parameters["seed"], imperfections=imperfections)
        from posfet_driver.bus.open_bus import bus_settings  # noqa: PLC0415
        from posfet_sim.emulation.emulated_source import AdapterSource  # noqa: PLC0415  # python-can takes 0.1 s to load

        if parameters["bus_interface"]:
            link = bus_settings(parameters["bus_interface"], parameters["bus_channel"], sensor.can)
        source = AdapterSource(sensor, scene, parameters["seed"], link, imperfections=imperfections)
        source.on_scan = self._scan_sent
        return source

    def wanted(self, now: int) -> bool:
        """Return whether the scene may begin; on a bus that is for the driver to say."""
        return not isinstance(self.source, SimulationSource) or super().wanted(now)

    def objects_in(self, sequence: int) -> ObjectsState | None:
        """Return what the objects did in the newest scan of that number, None when that is long ago. For any thread."""
        times = [time for number, time in self._taken.copy() if number == sequence]
        return self.source.board.objects(times[-1]) if times else None

    def deliver(self, scan: Scan, now: int) -> None:
        """Hand on one scan, then what truly was."""
        super().deliver(scan, now)
        self._tell_truth(scan.sequence, scan.stamp, now)

    def _load_scene(self, request: LoadScene.Request, response: LoadScene.Response) -> LoadScene.Response:
        """Switch the board off, and on again with another scene."""
        try:
            self.source.scene = load_scene(request.scene, self.sensor)
            self.restart()
        except (ConfigError, SourceError) as error:
            response.success, response.message = False, str(error)
            return response
        response.success, response.message = True, f"scene '{self.source.scene.name}' from its beginning"
        return response

    def _scan_sent(self, scan: Scan, stamp: int) -> None:
        """Tell what truly was in a scan that went out on the adapter, in whose thread this is."""
        try:
            if self._active:
                self._tell_truth(scan.sequence, stamp, time.monotonic_ns())
        except rclpy_implementation.RCLError:
            if self.context.ok():  # else the process is being ended
                raise

    def _tell_truth(self, sequence: int, stamp: int, now: int) -> None:
        self._taken.append((sequence, self.source.board.time))
        if self._truth_listeners.any(now):
            self._truth.publish(self._truth_message.fill(self.source.board.truth(), sequence, stamp))


def _floats(values: np.ndarray[Any, Any]) -> array[float]:
    """Return values as float32, in the form that rclpy takes without looking at each one."""
    return array("f", values.astype(np.float32).tobytes())


def _point(x: float, y: float, z: float) -> Point:
    return Point(x=x, y=y, z=z)


def _quaternion(x: float, y: float, z: float, w: float) -> Quaternion:
    return Quaternion(x=x, y=y, z=z, w=w)


def make_node() -> SimBoardNode:
    """Return the node, started unless its parameter autostart says otherwise."""
    node = SimBoardNode()
    node.start()
    return node


def main() -> None:
    """Run the simulated board until it is interrupted."""
    raise SystemExit(run_node(make_node))
