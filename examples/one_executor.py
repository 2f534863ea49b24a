# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The stack and a controller in one process, on one executor: prints each second how strongly the sensor is touched."""

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

import posfet.bringup
from posfet_msgs.msg import TactileContacts


class Controller(Node):
    """Keeps the normal force of the newest contacts."""

    def __init__(self) -> None:
        super().__init__("controller")
        self.force = 0.0
        self.create_subscription(TactileContacts, "/hand/tactile/contacts", self.take, 10)
        self.create_timer(1.0, self.show)

    def take(self, message: TactileContacts) -> None:
        """Add up the forces of a message that is fit for control."""
        if message.data_valid:
            self.force = sum(-contact.force.z for contact in message.contacts)

    def show(self) -> None:
        """Print the force."""
        print(f"touched with {self.force:.2f} N", flush=True)


def main() -> None:
    """Run both until Ctrl-C."""
    rclpy.init()
    executor = SingleThreadedExecutor()
    with posfet.bringup.nodes(namespace="hand/tactile", source="sim", scene="hold") as stack:
        for node in (Controller(), *stack):
            executor.add_node(node)
        try:
            while not stack.failure:
                executor.spin_once(timeout_sec=0.1)
        except (KeyboardInterrupt, ExternalShutdownException):
            pass
        except RuntimeError:  # raised by a message that was being taken when Ctrl-C ended the context
            if rclpy.ok():
                raise
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
