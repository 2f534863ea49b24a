# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Process that subscribes to the contacts: `python -m benchmarks.latency.processes.listener OUT`.

It stores the bytes of each message with their time of arrival and deserialises them at the end. Prints `first` on the
first message.
"""

from __future__ import annotations

import sys
import time
from array import array
from pathlib import Path

import numpy as np
from rclpy.node import Node
from rclpy.serialization import deserialize_message

from posfet_model.ros.run_node import ros, spin
from posfet_msgs.msg import TactileContacts

DEPTH = 1000


class Listener(Node):  # type: ignore[misc]  # rclpy has no types
    """Stores every contacts message."""

    def __init__(self) -> None:
        super().__init__("listener", namespace="tactile")
        self.times = array("q")
        self.messages: list[bytes] = []
        self.create_subscription(TactileContacts, "contacts", self._take, DEPTH, raw=True)

    def _take(self, message: bytes) -> None:
        self.times.append(time.monotonic_ns())
        self.messages.append(message)
        if len(self.messages) == 1:
            print("first", flush=True)


def main() -> None:
    """Listen until interrupted, then write sequence, arrival time [ns] and number of contacts, shape [3, n]."""
    with ros([]) as stack:
        node = Listener()
        stack.callback(node.destroy_node)
        print("ready", flush=True)
        spin([node])
        read = [deserialize_message(message, TactileContacts) for message in node.messages]
        rows = [[message.sequence for message in read], list(node.times), [len(message.contacts) for message in read]]
        np.save(Path(sys.argv[1]), np.array(rows, np.int64))


if __name__ == "__main__":
    main()
