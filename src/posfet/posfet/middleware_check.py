# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Whether the middleware carries messages between participants, for `posfet doctor`."""

from __future__ import annotations

import time
from typing import Any, Final

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import Empty

from posfet_model.ros import middleware

TOPIC: Final = "/posfet_doctor"
SEND_PERIOD: Final = 0.1
"""Period at which the message is sent [s]."""


def exchange(timeout: float) -> tuple[float | None, list[str]]:
    """Return the time until a message arrived, and the namespaces of the sensors that were seen meanwhile.

    Parameters
    ----------
    timeout : float
        Longest time to wait [s].

    Returns
    -------
    tuple of float or None, list of str
        Time until the first message of one participant reached the other one [s], None if none did; namespaces.
    """
    contexts = [Context(), Context()]
    executor: Any = None
    nodes: list[Node] = []
    arrived: list[float] = []
    try:
        with middleware.applied():
            for number, context in enumerate(contexts):
                rclpy.init(args=[], context=context, signal_handler_options=SignalHandlerOptions.NO)
                nodes.append(rclpy.create_node(f"posfet_doctor_{number}", context=context))
        talker, listener = nodes
        publisher = talker.create_publisher(Empty, TOPIC, 10)
        begin = time.monotonic()
        listener.create_subscription(Empty, TOPIC, lambda _: arrived.append(time.monotonic() - begin), 10)
        executor = SingleThreadedExecutor(context=contexts[1])
        executor.add_node(listener)
        while not arrived and time.monotonic() - begin < timeout:
            publisher.publish(Empty())
            executor.spin_once(SEND_PERIOD)
        sensors = [
            name.removesuffix("/raw")
            for name, kinds in listener.get_topic_names_and_types()
            if name.endswith("/raw") and kinds == ["posfet_msgs/msg/TactileRaw"]
        ]
    finally:
        if executor is not None:
            executor.shutdown()
        for node in nodes:
            node.destroy_node()
        for context in contexts:
            context.try_shutdown()
    return (arrived[0] if arrived else None), sensors
