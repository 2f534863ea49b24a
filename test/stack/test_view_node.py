# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""What a display takes from a running stack: description, diagnostics, services, and the newest messages."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import pytest

rclpy = pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("posfet_msgs", reason="needs the built posfet_msgs")

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point, Vector3
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile

from posfet import display_loop
from posfet.array_view import array_view
from posfet.diagnosis import diagnosis
from posfet.display_loop import show
from posfet.display_node import display_node
from posfet.lines import Lines
from posfet.stack_client import StackClient
from posfet.view_node import ViewNode
from posfet_model.ros.info_message import info_message
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.surface import Surface
from posfet_msgs.msg import TactileContact, TactileContacts, TactileImage, TactileInfo, TactileTruth
from posfet_msgs.srv import Tare

pytestmark = pytest.mark.ros
TIMEOUT = 60.0


@pytest.mark.parametrize("axis", ["x", "y"])
@pytest.mark.parametrize("radius", [5e-3, math.inf])
def test_the_geometry_of_info_is_that_of_the_sensor(sensor: Sensor, radius: float, axis: str) -> None:
    layout = replace(sensor.layout, bend_radius=radius, bend_axis=axis)
    array = array_view(info_message(replace(sensor, layout=layout), "frame", True, 0))
    assert array.bend_radius == pytest.approx(radius)
    assert array.pitch == pytest.approx((layout.pitch_x, layout.pitch_y))
    assert (array.rows, array.cols, array.name, array.simulated) == (layout.rows, layout.cols, sensor.name, True)
    if math.isfinite(radius):
        assert array.bend_axis == axis
    for x, y in ((1e-3, 2e-3), (-2.5e-3, 0.5e-3)):
        assert array.on_surface(*Surface.of(layout).point(x, y)) == pytest.approx((x, y))


def test_a_status_of_another_stack_is_none_of_ours() -> None:
    remedy = KeyValue(key="fault: no traffic", value="no signal; check cable")
    status = DiagnosticStatus(name="hand/driver_node: board", level=b"\2", message="no traffic", values=[remedy])
    found = diagnosis(status, "hand")
    assert found is not None
    assert (found.name, found.level, found.text) == ("driver_node: board", 2, "no traffic")
    assert found.remedies == {"no traffic": "no signal; check cable"}
    assert diagnosis(status, "han") is None


class Stack:
    """Publishes as a stack does, with a client and a view on it."""

    def __init__(self) -> None:
        self.node = rclpy.create_node("stack", namespace="tactile")
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.info = self.node.create_publisher(TactileInfo, "info", latched)
        kinds = {"image": TactileImage, "contacts": TactileContacts, "truth": TactileTruth}
        self.topics = {topic: self.node.create_publisher(kind, f"view/{topic}", 100) for topic, kind in kinds.items()}
        self.diagnostics = self.node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self.node.create_service(Tare, "tare", self.tare)
        self.client = StackClient(display_node("tactile"), "tactile")
        self.view = ViewNode(self.client)
        self.executor = SingleThreadedExecutor()
        for node in (self.node, self.client.node):
            self.executor.add_node(node)

    def tare(self, request: Tare.Request, response: Tare.Response) -> Tare.Response:
        response.success, response.message = not request.force, "tared"
        return response

    def wait(self, condition: Callable[[], object]) -> None:
        end = time.monotonic() + TIMEOUT
        while not condition():
            assert time.monotonic() < end
            self.executor.spin_once(0.01)

    def publish(self, sequence: int, *topics: str) -> None:
        contact = TactileContact(id=7, state=TactileContact.STATE_HELD, normal_force_deviation=0.25, area=9e-6)
        contact.centre_of_pressure = Point(x=1e-3, y=-0.5e-3, z=0.0)
        contact.normal, contact.force = Vector3(z=1.0), Vector3(z=-1.25)
        contact.major_axis, contact.minor_axis = Vector3(x=0.6e-3), Vector3(y=0.5e-3)
        contact.velocity = Vector3(x=math.nan, y=math.nan, z=math.nan)
        gone = TactileContact(id=6, state=TactileContact.STATE_RELEASED)
        messages = {
            "image": TactileImage(
                sequence=sequence,
                rows=1,
                cols=3,
                force=[0.0, 1.25, math.nan],
                standard_deviation=[0.5, 0.25, math.nan],
                status=[0, 0, 1],
                total_force=1.25,
                total_force_standard_deviation=0.5,
            ),
            "contacts": TactileContacts(sequence=sequence, contacts=[gone, contact], data_valid=True),
            "truth": TactileTruth(sequence=sequence, contact_centres=[Point(x=1e-3)], contact_forces=[1.5]),
        }
        for topic in topics or messages:
            messages[topic].header.stamp.sec = sequence
            self.topics[topic].publish(messages[topic])


@pytest.fixture
def stack() -> Iterator[Stack]:
    rclpy.init()
    made = Stack()
    made.wait(lambda: all(topic.get_subscription_count() for topic in made.topics.values()))
    yield made
    made.executor.shutdown()
    for node in (made.view, made.client.node, made.node):
        node.destroy_node()
    rclpy.shutdown()


def test_a_snapshot_has_the_newest_messages_of_one_scan(stack: Stack) -> None:
    assert stack.view.snapshot() is None
    for sequence in range(100, 140):
        stack.publish(sequence)
    stack.publish(140, "image")  # of this scan the contacts are still to come
    stack.wait(lambda: (found := stack.view.snapshot()) and found.sequence == 139)
    snapshot = stack.view.snapshot()
    assert snapshot is not None
    assert (snapshot.stamp, snapshot.data_valid, snapshot.total_force) == (139 * 10**9, True, 1.25)
    assert snapshot.force.tolist()[:2] == [0.0, 1.25]
    assert math.isnan(snapshot.force[2])
    assert snapshot.standard_deviation is not None
    assert snapshot.standard_deviation.tolist()[:2] == [0.5, 0.25]
    assert snapshot.status is not None
    assert snapshot.status.tolist() == [0, 0, 1]
    (contact,) = snapshot.contacts
    assert (contact.id, contact.state, contact.force, contact.standard_deviation) == (7, "held", 1.25, 0.25)
    assert (contact.x, contact.y) == (1e-3, -0.5e-3)
    assert (contact.major_axis, contact.minor_axis) == ((0.6e-3, 0.0), (0.0, 0.5e-3))
    assert all(map(math.isnan, contact.velocity))
    assert [true.force for true in snapshot.truth] == [1.5]


def test_a_board_that_restarts_is_followed(stack: Stack) -> None:
    stack.publish(100)
    stack.wait(lambda: (found := stack.view.snapshot()) and found.sequence == 100)
    stack.publish(3)
    stack.wait(lambda: (found := stack.view.snapshot()) and found.sequence == 3)
    stack.publish(4, "image", "contacts")  # a real board has no ground truth
    stack.publish(5, "image", "contacts")


def test_true_contacts_are_shown_where_the_model_is_later_than_the_simulation(stack: Stack) -> None:
    stack.publish(100)
    stack.wait(lambda: (found := stack.view.snapshot()) and found.truth)
    for sequence in range(101, 131):
        stack.publish(sequence, "truth")
        stack.view.snapshot()
    stack.publish(110, "image", "contacts")
    stack.wait(lambda: (found := stack.view.snapshot()) and found.sequence == 110)
    assert stack.view.snapshot().truth
    stack.publish(500, "image", "contacts")
    stack.wait(lambda: (found := stack.view.snapshot()) and found.sequence == 500)
    assert not stack.view.snapshot().truth, "those of another time are none"


def test_the_client_follows_description_and_diagnostics(stack: Stack, sensor: Sensor) -> None:
    stack.info.publish(info_message(sensor, "frame", True, 0))
    values = [KeyValue(key="frames lost", value="3"), KeyValue(key="calibration", value="of 2026-01-01")]
    ours = DiagnosticStatus(name="tactile/driver_node: board", message="scans arrive", values=values)
    theirs = DiagnosticStatus(name="hand/driver_node: board", message="no traffic", values=values)
    stack.wait(stack.diagnostics.get_subscription_count)
    stack.diagnostics.publish(DiagnosticArray(status=[ours, theirs]))
    stack.wait(lambda: stack.client.array and stack.client.diagnoses)
    assert list(stack.client.diagnoses) == ["driver_node: board"]
    assert (stack.client.state, stack.client.frames_lost, stack.client.scans_lost) == ("scans arrive", 3, 0)
    assert stack.client.calibration == "of 2026-01-01"
    stack.publish(100)
    stack.wait(lambda: (found := stack.view.snapshot()) and found.frames_lost == 3)


def test_a_status_that_is_not_repeated_is_said_to_be_old(stack: Stack, monkeypatch: pytest.MonkeyPatch) -> None:
    values = [KeyValue(key="frames lost", value="3")]
    status = DiagnosticStatus(name="tactile/driver_node: board", message="receiving scans", values=values)
    stack.wait(stack.diagnostics.get_subscription_count)
    stack.diagnostics.publish(DiagnosticArray(status=[status]))
    stack.wait(lambda: stack.client.state == "receiving scans")
    now = time.monotonic()
    monkeypatch.setattr("posfet.stack_client.time.monotonic", lambda: now + 60.0)
    (old,) = stack.client.diagnoses.values()
    assert (old.level, old.text) == (2, "no report for 60 s; the last one: receiving scans")
    assert stack.client.state == old.text


def test_the_client_calls_the_services_that_are_there(stack: Stack) -> None:
    stack.wait(lambda: stack.client.actions() == ("tare",))
    answers: list[tuple[bool, str]] = []
    stack.client.request("tare", False, lambda *answer: answers.append(answer))
    stack.wait(lambda: answers)
    assert answers == [(True, "tared")]
    stack.client.request("scene/load", "press", lambda *answer: answers.append(answer))
    assert answers[1] == (False, "scene/load: nobody serves it; is the stack still running?")


def test_what_a_view_waits_for_names_its_topics_and_the_stacks_that_run(stack: Stack) -> None:
    topics = "nothing on /tactile/view/image and /tactile/view/contacts"
    assert stack.view.awaited() == f"{topics}; it is published there: posfet diagnostics shows the state"
    client = StackClient(stack.client.node, "thumb")
    other = ViewNode(client, ["--ros-args", "-r", "view/image:=picture"])
    try:
        topics = "nothing on /thumb/picture and /thumb/view/contacts"
        assert other.awaited() == f"{topics}; running are /tactile"
        stack.publish(100)
        stack.wait(lambda: not stack.view.awaited())
    finally:
        other.destroy_node()


def test_a_display_says_once_after_a_while_what_it_waits_for(
    stack: Stack, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(display_loop, "PATIENCE", 0.0)
    asked: list[int] = []

    def awaited() -> str:
        asked.append(1)
        return "nothing on /palm/view/image"

    updates = iter(range(5))
    stop = lambda: next(updates, None) is None  # noqa: E731
    assert show(Lines(stack.view), [stack.client.node], math.inf, stack.view.state, stop, awaited) == 0
    assert asked == [1]
    assert capfd.readouterr().err == "posfet: nothing on /palm/view/image\n"
