# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Static transform from the frame that the array is mounted on to the frame of the array."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile

from posfet_model._lib.units import NANOSECONDS
from posfet_model.config import ConfigError
from posfet_model.ros.mount import parse_mount


def broadcast_mount(node: Node, frame_id: str, parameters: Mapping[str, Any]) -> Publisher | None:
    """Publish the transform from `parent_frame` to `frame_id` on /tf_static (transient local), if a parent is given.

    Parameters
    ----------
    node : Node
        Node that publishes.
    frame_id : str
        Frame of the array.
    parameters : mapping
        Values of `posfet_model.parameters.MOUNT` by name.

    Returns
    -------
    Publisher or None
        None without a parent frame, and, with a warning, without tf2_msgs.

    Raises
    ------
    ConfigError
        If `mount` is not a pose, or if the parent frame is the frame of the array.
    """
    mount = parse_mount(parameters["mount"])
    parent = parameters["parent_frame"]
    if not parent:
        return None
    if parent == frame_id:
        raise ConfigError(f"parent_frame: must not be the frame of the array itself, got '{parent}'")
    try:
        from tf2_msgs.msg import TFMessage  # noqa: PLC0415  # part of a full ROS only
    except ImportError:
        node.get_logger().warning("parent_frame: no transform is broadcast; install tf2_msgs")
        return None
    transform = TransformStamped(child_frame_id=frame_id)
    transform.header.frame_id = parent
    transform.header.stamp.sec, transform.header.stamp.nanosec = divmod(time.time_ns(), NANOSECONDS)
    position, orientation = transform.transform.translation, transform.transform.rotation
    position.x, position.y, position.z = mount.position
    orientation.x, orientation.y, orientation.z, orientation.w = mount.orientation
    publisher = node.create_publisher(
        TFMessage, "/tf_static", QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    )
    publisher.publish(TFMessage(transforms=[transform]))
    return publisher
