# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Reads the board with python-can and cantools, publishes `raw`."""

from __future__ import annotations

import sys
from importlib.resources import files

import can
import cantools
import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from posfet_model.sensor.description import load_sensor
from posfet_msgs.msg import TactileRaw


class BaselineDriver(Node):
    """Driver of one board with a single block per scan."""

    def __init__(self, sensor_file: str, channel: str) -> None:
        super().__init__("driver_node", namespace="tactile")
        self.sensor = load_sensor(sensor_file)
        self.database = cantools.database.load_file(str(files("posfet_driver") / "protocol" / "posfet.dbc"))
        self.block = self.database.get_message_by_name("ScanBlockFd")
        self.raw = self.create_publisher(TactileRaw, "raw", 1000)
        self.bus = can.Bus(interface="slcan", channel=channel, bitrate=1_000_000, sleep_after_open=0)
        self.notifier = can.Notifier(self.bus, [self.on_message], timeout=0.1)
        self.starter = self.create_timer(0.5, self.start_board)

    def start_board(self) -> None:
        """Start the board once there is a subscriber."""
        if self.raw.get_subscription_count() == 0:
            return
        command = self.database.get_message_by_name("Command")
        data = command.encode({"CommandCode": 1, "CommandTag": 0, "CommandArgument": 0})
        self.bus.send(can.Message(arbitration_id=command.frame_id, data=data, is_extended_id=False))
        self.starter.cancel()

    def on_message(self, message: can.Message) -> None:
        """Decode one frame and publish it."""
        if message.arbitration_id != self.block.frame_id:
            return
        signals = self.block.decode(message.data, decode_choices=False, scaling=False)
        raw = TactileRaw()
        raw.header.stamp = self.get_clock().now().to_msg()
        raw.layout_id = self.sensor.layout.id
        raw.rows, raw.cols = self.sensor.layout.rows, self.sensor.layout.cols
        raw.sequence = signals["Sequence"]
        raw.device_time = signals["DeviceTime"]
        raw.counts = [signals[f"Count{index}"] for index in range(self.sensor.layout.taxels)]
        self.raw.publish(raw)


def main() -> None:
    """Run until interrupted."""
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = BaselineDriver(*sys.argv[1:3])
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.notifier.stop(1.0)
        node.bus.shutdown()


if __name__ == "__main__":
    main()
