# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Print what touches the sensor, twice a second, until Ctrl-C."""

import signal
import threading

import rclpy
from rclpy.experimental import EventsExecutor
from rclpy.signals import SignalHandlerOptions

from posfet_msgs.msg import TactileContact, TactileContacts


def described(contact: TactileContact) -> str:
    """Return one contact in words; a push has a negative z component."""
    centre = contact.centre_of_pressure
    return f"#{contact.id}: {-contact.force.z:.2f} N at ({centre.x * 1e3:+.2f}, {centre.y * 1e3:+.2f}) mm"


def show(message: TactileContacts) -> None:
    """Print the contacts, unless they are not for control."""
    text = ", ".join(map(described, message.contacts)) or "no contact"
    node.get_logger().info(text if message.data_valid else "forces unknown", throttle_duration_sec=0.5)


stopped = threading.Event()
for number in (signal.SIGINT, signal.SIGTERM):
    signal.signal(number, lambda *_: stopped.set())  # in place of rclpy's handlers, which interrupt what is running
rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
node = rclpy.create_node("listener")
node.create_subscription(TactileContacts, "/tactile/contacts", show, 10)
executor = EventsExecutor()
executor.add_node(node)
while not stopped.is_set():
    executor.spin_once(timeout_sec=0.1)
rclpy.shutdown()
