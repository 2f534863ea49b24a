"""The frame of the array in TF, below the frame that it is mounted on."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile

from posfet_model.config import ConfigError
from posfet_model.ros.mount import parse_mount


def broadcast_mount(node: Node, frame_id: str, parameters: Mapping[str, Any]) -> Publisher | None:
    """Latch the transform from `parent_frame` to `frame_id` on /tf_static, if a parent is named.

    Raises ConfigError for a `mount` that is no pose, and for a frame below itself. Without tf2_msgs a warning says that
    there is no transform.
    """
    mount = parse_mount(parameters["mount"])
    parent = parameters["parent_frame"]
    if not parent:
        return None
    if parent == frame_id:
        raise ConfigError(f"parent_frame: must not be the frame of the array itself, got '{parent}'")
    try:
        from tf2_msgs.msg import TFMessage  # noqa: PLC0415  # not there without a full ROS
    except ImportError:
        node.get_logger().warning("parent_frame: no transform is broadcast, install tf2_msgs for it")
        return None
    transform = TransformStamped(child_frame_id=frame_id)
    transform.header.frame_id = parent
    transform.header.stamp.sec, transform.header.stamp.nanosec = divmod(time.time_ns(), 1_000_000_000)
    position, orientation = transform.transform.translation, transform.transform.rotation
    position.x, position.y, position.z = mount.position
    orientation.x, orientation.y, orientation.z, orientation.w = mount.orientation
    publisher = node.create_publisher(
        TFMessage, "/tf_static", QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    )
    publisher.publish(TFMessage(transforms=[transform]))
    return publisher
