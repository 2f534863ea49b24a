# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The grasp over ROS: what the controller takes from messages, and the clock that waits for its answers."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("mujoco")
pytest.importorskip("rclpy")
pytest.importorskip("posfet_msgs.msg")

import rclpy

from examples.grasp_mujoco import ros_grasp
from examples.grasp_mujoco.ros_grasp import LEAD, PATIENCE, BoardClock, touch_in
from posfet_msgs.msg import TactileContact, TactileContacts, TactileImage

pytestmark = pytest.mark.ros


def contact(force: float, x: float, slipping: bool = False, state: int = TactileContact.STATE_HELD) -> TactileContact:
    message = TactileContact(state=state, slipping=slipping)
    message.force.z = -force
    message.centre_of_pressure.x = x
    return message


def test_contacts_are_added_up_without_released_ones() -> None:
    released = contact(0.0, 5e-3, state=TactileContact.STATE_RELEASED)
    image = TactileImage(rows=2, cols=3, force=[0.0, 0.1, float("nan"), 0.3, 0.0, 0.0])
    message = TactileContacts(contacts=[contact(0.3, 1e-3), contact(0.1, 3e-3, True), released], data_valid=True)
    touch = touch_in(message, image)
    assert touch.force == pytest.approx(0.4)
    assert touch.image is not None
    np.testing.assert_allclose(touch.image, [[0.0, 0.1, np.nan], [0.3, 0.0, 0.0]], rtol=1e-6)
    assert touch.slipping
    assert touch.valid
    free = touch_in(TactileContacts(contacts=[released], data_valid=True), image)
    assert (free.force, free.image, free.slipping, free.valid) == (0.0, None, False, True)


def test_an_answer_needs_both_messages_of_a_scan_from_both_fingertips() -> None:
    rclpy.init()
    node = ros_grasp.GripNode()
    answers: list[float] = []
    node.controller.update = lambda time, touches: answers.append(time) or 0.0  # type: ignore[method-assign]
    try:
        for name in ("left", "right"):
            node.take(name, "contacts", TactileContacts(sequence=3))
            node.take(name, "image", TactileImage(sequence=2))
        assert answers == []
        node.take("left", "image", TactileImage(sequence=3))
        assert answers == []
        node.take("right", "image", TactileImage(sequence=3))
        assert answers == [3e-3]
    finally:
        node.destroy_node()
        rclpy.shutdown()


def test_the_boards_wait_for_the_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 1_000_000_000
    monkeypatch.setattr(ros_grasp.time, "monotonic_ns", lambda: now)
    clock = BoardClock()
    now += 5_000_000
    assert clock.monotonic() == clock.begin + 5_000_000  # freely before the first answer
    clock.answered(6)
    now += 100_000_000
    assert clock.monotonic() == clock.begin + 6_000_000 + round(LEAD * 1e9)
    now += 100_000_000
    assert clock.monotonic() == clock.begin + 6_000_000 + round(LEAD * 1e9)
    clock.answered(7)
    now += 500_000
    assert clock.monotonic() == clock.begin + 6_500_000 + round(LEAD * 1e9)
    now += round(PATIENCE * 1e9) + 1_000_000
    assert clock.monotonic() > clock.begin + round(PATIENCE * 1e9)  # the controller is gone


def test_time_never_goes_back(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 0
    monkeypatch.setattr(ros_grasp.time, "monotonic_ns", lambda: now)
    clock = BoardClock()
    now = 50_000_000
    before = clock.monotonic()
    clock.answered(1)
    assert clock.monotonic() == before
