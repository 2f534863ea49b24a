# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The node of a display, which is made before anything else is loaded."""

from __future__ import annotations

from collections.abc import Sequence

from rclpy.node import Node


def display_node(namespace: str, ros_words: Sequence[str] = ()) -> Node:
    """Return the node through which a display follows a stack.

    Parameters
    ----------
    namespace : str
        Full namespace of the stack, without slashes at its ends.
    ros_words : sequence of str, optional
        ROS arguments of the stack, which may rename its topics.
    """
    return Node(
        "view_node",
        namespace=namespace,
        cli_args=[*ros_words],
        use_global_arguments=False,
        start_parameter_services=False,  # it has no parameters of its own
    )
