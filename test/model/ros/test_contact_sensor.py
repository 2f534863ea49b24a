# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The contacts that a controller reads in its own loop: known only while they are valid and fresh."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator

import pytest

rclpy = pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("posfet_msgs", reason="needs the built workspace")

from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from posfet_model.parameters import RELIABILITY
from posfet_model.ros.contact_sensor import ContactSensor
from posfet_model.ros.output_qos import output_qos
from posfet_msgs.msg import TactileContact, TactileContacts

pytestmark = pytest.mark.ros
TIMEOUT = 60.0


@pytest.fixture
def node() -> Iterator[Node]:
    context = Context()
    rclpy.init(context=context)
    node = rclpy.create_node("controller", context=context, namespace="robot")
    yield node
    node.destroy_node()
    rclpy.shutdown(context=context)


def touched(*forces: float, valid: bool = True, stamp: float = 0.0) -> TactileContacts:
    """Return a message, measured at a time [s], with contacts of these forces on the sensor, the last one released."""
    message = TactileContacts(data_valid=valid)
    message.header.frame_id = "thumb_array"
    message.header.stamp.sec, fraction = int(stamp), stamp % 1.0
    message.header.stamp.nanosec = round(fraction * 1e9)
    for force in forces:
        contact = TactileContact(state=TactileContact.STATE_HELD)
        contact.force.z = -force
        message.contacts.append(contact)
    message.contacts[-1].state = TactileContact.STATE_RELEASED
    return message


@pytest.mark.parametrize("reliability", RELIABILITY.choices)
def test_published_contacts_are_known_until_they_are_old_or_not_valid(node: Node, reliability: str) -> None:
    now = [0.0]
    sensor = ContactSensor(node, "thumb", max_age=0.01, clock=lambda: now[0])
    assert (sensor.known, sensor.contacts(), sensor.frame_id, sensor.age) == (False, None, "", math.inf)
    assert all(map(math.isnan, sensor.force()))
    publisher = node.create_publisher(TactileContacts, "/robot/thumb/contacts", output_qos(reliability, 1))
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(node)

    def receive(message: TactileContacts) -> None:
        end, before = time.monotonic() + TIMEOUT, sensor._newest
        while sensor._newest is before:
            publisher.publish(message)
            executor.spin_once(timeout_sec=0.05)
            assert time.monotonic() < end

    receive(touched(0.5, 0.25, 0.1))
    assert sensor.known
    assert sensor.frame_id == "thumb_array"
    assert [contact.force.z for contact in sensor.contacts()] == [-0.5, -0.25]
    assert sensor.force() == pytest.approx((0.0, 0.0, -0.75))
    now[0] = 0.011
    assert sensor.contacts() is None
    receive(touched(0.5, valid=False))
    assert sensor.contacts() is None
    assert math.isnan(sensor.force()[2])
    receive(touched(0.5, stamp=0.011))
    while not sensor.known:
        receive(touched(0.5, stamp=0.011))
    assert sensor.contacts() == ()
    assert sensor.force() == (0.0, 0.0, 0.0)
    executor.shutdown()


@pytest.mark.parametrize("age", [0.0, -1.0, math.nan, math.inf])
def test_an_age_that_is_none_is_refused(node: Node, age: float) -> None:
    with pytest.raises(ValueError, match=r"max_age must be in \(0, inf\)"):
        ContactSensor(node, "thumb", max_age=age)


def taken(node: Node, *times: tuple[float, float]) -> list[float]:
    """Return the age of each message on its arrival, for times of arrival and of measurement by another clock [s]."""
    now, ages = [0.0], []
    sensor = ContactSensor(node, "thumb", max_age=0.05, clock=lambda: now[0])
    for arrival, measured in times:
        now[0] = arrival
        sensor._take(touched(0.5, stamp=measured))
        assert sensor.known == (sensor.age <= 0.05)
        ages.append(sensor.age)
    return ages


def test_contacts_that_waited_on_their_way_are_old_though_they_have_just_arrived(node: Node) -> None:
    steady = [(0.01 * number, 5000.0 + 0.01 * number) for number in range(5)]
    waited = [(0.84, 5000.05), (0.85, 5000.06), (0.86, 5000.86), (0.87, 5000.87)]  # the last two did not
    assert taken(node, *steady, *waited) == pytest.approx([*[0.0] * 5, 0.79, 0.79, 0.0, 0.0], abs=1e-3)


def test_the_first_contacts_are_compared_with_quicker_ones_as_soon_as_there_are_any(node: Node) -> None:
    times = (1.0, 0.0), (1.01, 0.91), (1.02, 1.0), (1.52, 1.1)
    assert taken(node, *times) == pytest.approx([0.0, 0.0, 0.0, 0.4], abs=1e-3)


def test_a_clock_that_is_set_or_runs_at_another_rate_leaves_contacts_known(node: Node) -> None:
    set_back = [(number * 0.01, 5000.0 - 3600.0 * (number > 3) + 0.01 * number) for number in range(6)]
    set_on = [(number * 0.01, 5000.0 + 3600.0 * (number > 3) + 0.01 * number) for number in range(6)]
    slow = [(number * 10.0, 5000.0 + number * 10.0 * (1.0 - 1e-4)) for number in range(1000)]
    for times in (set_back, set_on, slow):
        assert max(taken(node, *times)) < 1e-3
