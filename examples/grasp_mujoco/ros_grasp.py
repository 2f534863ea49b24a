# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The same grasp over ROS: emulated CAN adapters, two stacks that drive them, and the controller as a node.

The fingertips' boards are behind pseudo-terminals, as adapters of CAN are; a driver and a model for each publish
`contacts` and `image` in `/left/tactile` and `/right/tactile`. `grip_controller` answers each pair of scans by
`grip_command`. The boards' clock waits for the answer, so that nothing depends on the speed of the computer: times are
those of the boards.
"""

from __future__ import annotations

import itertools
import tempfile
import threading
import time
from contextlib import ExitStack
from functools import partial
from pathlib import Path

import numpy as np
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import Float64MultiArray

import posfet.bringup
from examples.grasp_mujoco.controller import GripController, Touch
from examples.grasp_mujoco.fingertip import THRESHOLDS, fingertip_loads
from examples.grasp_mujoco.gripper import FINGERS, LIFT, Gripper, Task
from examples.grasp_mujoco.trial import DROPPED
from posfet_model.sensor.description import load_sensor
from posfet_msgs.msg import TactileContact, TactileContacts, TactileImage
from posfet_sim.device.error_model import ErrorModel
from posfet_sim.device.simulated_board import SimulatedBoard
from posfet_sim.emulation.bus_board import BusBoard
from posfet_sim.emulation.firmware import with_whole_period
from posfet_sim.emulation.slcan_adapter import EmulatedAdapter
from posfet_sim.physics.mujoco_loads import MujocoLoads

LEAD = 0.003
"""Time by which the boards may be ahead of the controller's last answer [s]."""
PATIENCE = 20.0
"""Time on the computer's clock after which they go on without one [s]."""
DEPTH = 100
"""Messages that wait for a slow subscriber."""
TOPICS = {"contacts": TactileContacts, "image": TactileImage}
"""What the controller subscribes to of each fingertip."""
MILLISECOND = 1_000_000
"""[ns]"""


class GripNode(Node):
    """Answers each pair of scans of both fingertips with grip force, height of the hand, and sequence of the scans."""

    def __init__(self, feedback: bool = True) -> None:
        super().__init__("grip_controller")
        self.controller = GripController(feedback=feedback)
        """The controller."""
        self._messages: dict[tuple[str, str], TactileContacts | TactileImage] = {}
        self._newest: dict[str, tuple[int, Touch]] = {}
        self._answered = -1
        self._command = self.create_publisher(Float64MultiArray, "grip_command", DEPTH)
        for name, (topic, kind) in itertools.product(FINGERS, TOPICS.items()):
            self.create_subscription(kind, f"{name}/tactile/{topic}", partial(self.take, name, topic), DEPTH)

    def take(self, name: str, topic: str, message: TactileContacts | TactileImage) -> None:
        """Take a message of a fingertip; answer once both of a scan are there from both."""
        self._messages[name, topic] = message
        contacts, image = (self._messages.get((name, each)) for each in TOPICS)
        if contacts is None or image is None or contacts.sequence != image.sequence:
            return
        self._newest[name] = message.sequence, touch_in(contacts, image)
        if len(self._newest) < len(FINGERS):
            return
        (left, left_touch), (right, right_touch) = (self._newest[each] for each in FINGERS)
        sequence = min(left, right)
        if sequence > self._answered:
            self._answered = sequence
            grip = self.controller.update(sequence * 1e-3, (left_touch, right_touch))
            self._command.publish(Float64MultiArray(data=[grip, self.controller.lift, float(sequence)]))


def touch_in(contacts: TactileContacts, image: TactileImage) -> Touch:
    """Return what the controller takes of both messages of a scan."""
    touching = [each for each in contacts.contacts if each.state != TactileContact.STATE_RELEASED]
    force = -sum(each.force.z for each in touching)
    if force <= 0:
        return Touch(valid=contacts.data_valid)
    forces = np.array(image.force).reshape(image.rows, image.cols)
    return Touch(force, forces, any(each.slipping for each in touching), contacts.data_valid)


class BoardClock:
    """Clock of the boards: as that of the computer, but never more than LEAD ahead of the controller's answer."""

    def __init__(self) -> None:
        self.begin = time.monotonic_ns()
        """Time 0 of the boards [ns]."""
        self._now, self._seen = self.begin, self.begin
        self._limit: int | None = None
        self._answer = self.begin  # time of the newest answer on the computer's clock [ns]
        self._lock = threading.Lock()

    def answered(self, sequence: int) -> None:
        """Note the answer to the scans of a sequence."""
        with self._lock:
            self._limit = self.begin + sequence * MILLISECOND + round(LEAD * 1e9)
            self._answer = time.monotonic_ns()

    def monotonic(self) -> int:
        """Return the time [ns]."""
        with self._lock:
            real = time.monotonic_ns()
            passed, self._seen = real - self._seen, real
            limit = self._limit
            if limit is not None and real - self._answer > PATIENCE * 1e9:
                limit = None
            self._now = self._now + passed if limit is None else max(min(self._now + passed, limit), self._now)
            return self._now

    def wall(self) -> int:
        """Return the time since the Unix epoch [ns]."""
        return time.time_ns()

    def sleep(self, seconds: float) -> None:
        """Wait [s]."""
        time.sleep(seconds)


class Engine(Node):
    """Runs the physics for both boards, which ask for it, and applies the commands of the controller."""

    def __init__(self, task: Task, clock: BoardClock) -> None:
        super().__init__("gripper")
        self.gripper = Gripper(task)
        """The physics."""
        self.raised: list[float] = []
        """Times of the physics at which a greater grip force arrived [s]."""
        self._clock = clock
        self._lock = threading.Lock()
        self._grip = 0.0
        self._answered = False  # whether the controller has answered
        self.create_subscription(Float64MultiArray, "grip_command", self._apply, DEPTH)

    def loads(self, name: str) -> MujocoLoads:
        """Return the loads of a fingertip; the physics stands still until the controller answers both boards."""
        moving = False

        def advance(until: float) -> None:
            nonlocal moving
            with self._lock:
                if not moving:
                    loads.origin = self.gripper.time - until
                    moving = self._answered
                self.gripper.advance(loads.origin + until)
                loads.read()

        loads = fingertip_loads(self.gripper, name, load_sensor(), advance)
        return loads

    def _apply(self, message: Float64MultiArray) -> None:
        grip, lift, sequence = message.data
        with self._lock:
            if grip > self._grip and lift >= LIFT:
                self.raised.append(self.gripper.time)
            self._grip, self._answered = grip, True
            self.gripper.command(grip, lift)
        self._clock.answered(int(sequence))


def run(task: Task, duration: float, seed: int = 0, feedback: bool = True) -> int:
    """Run a grasp over ROS and print what happened.

    Parameters
    ----------
    task : Task
        What is grasped.
    duration : float
        Duration of the physics [s].
    seed : int
        Seed of the boards.
    feedback : bool
        Whether the controller reacts to slip.

    Returns
    -------
    int
        1 if the object was dropped, else 0.
    """
    rclpy.init()
    clock = BoardClock()
    with ExitStack() as stack:
        stack.callback(rclpy.try_shutdown)
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        engine, grip = Engine(task, clock), GripNode(feedback)
        executor = SingleThreadedExecutor()
        sensor = with_whole_period(load_sensor())
        for side, name in enumerate(FINGERS):
            board = SimulatedBoard(sensor, engine.loads(name), 2 * seed + side, ErrorModel.default())
            adapter = EmulatedAdapter(folder / name, BusBoard(board, 2 * seed + side, clock.begin), clock)
            adapter.open()
            stack.callback(adapter.close)
            thresholds = {"contact_threshold": THRESHOLDS.threshold, "release_threshold": 0.005}
            settings = [word for key, value in thresholds.items() for word in ("-p", f"model_node:{key}:={value}")]
            nodes = stack.enter_context(
                posfet.bringup.nodes(
                    ros_arguments=settings, namespace=f"{name}/tactile", source="can", can_interface="slcan",
                    can_channel=str(folder / name),
                )
            )  # fmt: skip
            for node in nodes:
                executor.add_node(node)
        for node in (engine, grip):
            executor.add_node(node)
            stack.callback(node.destroy_node)
        while engine.gripper.time < duration and not dropped(engine, grip):
            executor.spin_once(timeout_sec=0.1)
        for slip in engine.gripper.slips:
            after = [raised - slip for raised in engine.raised if raised >= slip]
            print(
                f"{slip:.4f} s  slips; " + (f"gripped harder after {after[0] * 1e3:.1f} ms" if after else "no reaction")
            )
        fell = dropped(engine, grip)
        print(
            f"{engine.gripper.time:.3f} s  {'dropped' if fell else f'held {engine.gripper.height * 1e3:.1f} mm high'}"
        )
        return int(fell)


def dropped(engine: Engine, grip: GripNode) -> bool:
    """Return whether the lifted object has left the fingertips downwards."""
    return grip.controller.lift >= LIFT and engine.gripper.sunk > DROPPED
