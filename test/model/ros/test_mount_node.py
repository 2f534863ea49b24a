# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The frame of the array in the TF tree of a robot."""

from __future__ import annotations

import time
from collections.abc import Iterator
from importlib.util import find_spec

import pytest

rclpy = pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("posfet_msgs", reason="needs the built posfet_msgs")

from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from posfet_model.config import ConfigError
from posfet_model.parameters import MOUNT
from posfet_model.ros.mount_node import broadcast_mount
from posfet_model.ros.ros_parameters import declare

pytestmark = pytest.mark.ros

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
DEADLINE = 120.0


@pytest.fixture
def context() -> Iterator[Context]:
    made = Context()
    rclpy.init(context=made)
    yield made
    rclpy.shutdown(context=made)


def mounted(context: Context, parent: str, pose: str = "0.1 0 0.01 0 0 0") -> Node:
    arguments = ["--ros-args", "-p", f"parent_frame:='{parent}'", "-p", f"mount:='{pose}'"]
    node = Node("model_node", context=context, cli_args=arguments)
    broadcast_mount(node, "thumb_array", declare(node, MOUNT))
    return node


def test_late_subscribers_receive_the_transform(context: Context) -> None:
    messages = pytest.importorskip("tf2_msgs.msg", reason="needs tf2_msgs")
    node, peer = mounted(context, "thumb_tip"), Node("peer", context=context)
    received: list[messages.TFMessage] = []
    peer.create_subscription(messages.TFMessage, "/tf_static", received.append, LATCHED)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(peer)
    end = time.monotonic() + DEADLINE
    while not received and time.monotonic() < end:
        executor.spin_once(timeout_sec=0.05)
    [transform] = received[0].transforms
    assert (transform.header.frame_id, transform.child_frame_id) == ("thumb_tip", "thumb_array")
    translation, rotation = transform.transform.translation, transform.transform.rotation
    assert (translation.x, translation.y, translation.z) == (0.1, 0.0, 0.01)
    assert (rotation.x, rotation.y, rotation.z, rotation.w) == (0.0, 0.0, 0.0, 1.0)
    executor.shutdown()
    peer.destroy_node()
    node.destroy_node()


@pytest.mark.parametrize("parent", ["", "thumb_tip"])
def test_nothing_is_broadcast_without_a_parent_or_without_tf(context: Context, parent: str) -> None:
    if parent and find_spec("tf2_msgs"):
        pytest.skip("tf2_msgs is installed")
    node = mounted(context, parent)
    assert "/tf_static" not in [name for name, _ in node.get_publisher_names_and_types_by_node("model_node", "/")]
    node.destroy_node()


@pytest.mark.parametrize(
    ("parent", "pose", "reason"),
    [
        ("thumb_array", "0 0 0 0 0 0", "parent_frame: must not be the frame of the array itself"),
        ("thumb_tip", "0 0 0", "mount: must be six numbers"),
    ],
)
def test_an_invalid_mount_is_rejected(context: Context, parent: str, pose: str, reason: str) -> None:
    with pytest.raises(ConfigError, match=reason):
        mounted(context, parent, pose)
