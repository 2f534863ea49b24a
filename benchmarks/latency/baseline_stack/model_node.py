# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Counts to forces and contacts with NumPy and scipy.ndimage, publishes `contacts`."""

from __future__ import annotations

import contextlib
import sys

import numpy as np
import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from scipy import ndimage

from posfet_model.sensor.description import load_sensor
from posfet_msgs.msg import TactileContact, TactileContacts, TactileRaw

OFFSET_SCANS = 200
"""Number of scans whose mean is the offset."""


class BaselineModel(Node):
    """Compensates the charge leakage by integration and labels taxels above the threshold."""

    def __init__(self, sensor_file: str) -> None:
        super().__init__("model_node", namespace="tactile")
        self.sensor = load_sensor(sensor_file)
        shape = self.sensor.layout.rows, self.sensor.layout.cols
        self.offset_samples: list[np.ndarray] = []
        self.offset = np.zeros(shape)
        self.last, self.force = np.zeros(shape), np.zeros(shape)
        self.contacts = self.create_publisher(TactileContacts, "contacts", 10)
        self.subscription = self.create_subscription(TactileRaw, "raw", self.on_raw, 1000)

    def on_raw(self, raw: TactileRaw) -> None:
        """Process one scan."""
        sensor = self.sensor
        counts = np.array(raw.counts, dtype=float).reshape(raw.rows, raw.cols)
        volts = counts / 65535 * (sensor.adc.high - sensor.adc.low) + sensor.adc.low
        if len(self.offset_samples) < OFFSET_SCANS:
            self.offset_samples.append(volts)
            self.offset = np.mean(self.offset_samples, axis=0)
        signal = (volts - self.offset) / sensor.volts_per_newton
        self.force += signal - self.last + self.last / (sensor.can.scan_rate * sensor.device.leak_time_constant)
        self.last = signal
        self.contacts.publish(self.message(raw))

    def message(self, raw: TactileRaw) -> TactileContacts:
        """Return the contacts of a scan."""
        sensor, message = self.sensor, TactileContacts()
        message.header = raw.header
        message.layout_id, message.sequence, message.name = raw.layout_id, raw.sequence, sensor.name
        message.threshold, message.data_valid = sensor.contact.threshold, True
        labels, count = ndimage.label(self.force > sensor.contact.threshold, np.ones((3, 3)))
        numbers = range(1, count + 1)
        centres = ndimage.center_of_mass(self.force, labels, numbers)
        totals = ndimage.sum(self.force, labels, numbers)
        for number, (row, col), total in zip(numbers, centres, totals, strict=True):
            contact = TactileContact(id=number, state=TactileContact.STATE_HELD)
            contact.centre_of_pressure.x = (col - (raw.cols - 1) / 2) * sensor.layout.pitch_x
            contact.centre_of_pressure.y = (row - (raw.rows - 1) / 2) * sensor.layout.pitch_y
            contact.force.z = -float(total)
            contact.taxels = np.flatnonzero(labels == number).tolist()
            contact.area = len(contact.taxels) * sensor.layout.taxel_area
            message.contacts.append(contact)
        return message


def main() -> None:
    """Run until interrupted."""
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = BaselineModel(sys.argv[1])
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        executor.spin()


if __name__ == "__main__":
    main()
