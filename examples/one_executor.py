# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The stack and a controller in one process, on one executor: prints each second how strongly the sensor is touched."""

import math
import signal
import threading

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

import posfet.bringup
from posfet_model.ros.contact_sensor import ContactSensor


class Controller(Node):
    """Reads the contacts in a loop of its own, and takes none for true that are not valid or old."""

    def __init__(self) -> None:
        super().__init__("controller")
        self.sensor = ContactSensor(self, "/hand/tactile", max_age=0.5)
        self.create_timer(1.0, self.show)

    def show(self) -> None:
        """Print the force; a controller that moves something holds or stops where it is unknown."""
        if self.sensor.known:
            print(f"touched with {math.hypot(*self.sensor.force()):.2f} N", flush=True)
        else:
            print("contacts unknown", flush=True)


def main() -> None:
    """Run both until Ctrl-C."""
    stopped = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stopped.set())  # in place of rclpy's handlers, which interrupt what is running
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    executor = SingleThreadedExecutor()
    with posfet.bringup.nodes(namespace="hand/tactile", source="sim", scene="hold") as stack:
        for node in (Controller(), *stack):
            executor.add_node(node)
        while not (stopped.is_set() or stack.failure):
            executor.spin_once(timeout_sec=0.1)
    rclpy.shutdown()


if __name__ == "__main__":
    main()
