# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The node that replays a recording: its scans in place of those of a board, and the time of the recording."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock as ClockMessage

from posfet_driver.clock import Clock
from posfet_driver.ros.scan_source_node import ScanSourceNode
from posfet_model._lib.units import NANOSECONDS
from posfet_model.config import ConfigError
from posfet_model.ros.run_node import run_node
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import Scan
from posfet_sim.parameters import REPLAY_NODE
from posfet_sim.recording.recorded_scans import RecordedScans
from posfet_sim.recording.replay_source import ReplaySource

CLOCK_PERIOD: Final = NANOSECONDS // 100
"""Period of `/clock` [ns], in the time of the recording."""


class ReplayNode(ScanSourceNode):
    """A recording as a lifecycle node; see `ScanSourceNode` for the transitions.

    Publishes the scans with their stamps, and those stamps on `/clock`. The constructor raises ConfigError for an
    invalid parameter or a file without scans of the sensor.

    Parameters
    ----------
    node_name : str, optional
        Name of the node.
    clock : Clock, optional
        Clock of the host.
    **node_arguments : object
        Further arguments of the node, as for `rclpy.node.Node`.
    """

    source: ReplaySource

    def __init__(self, node_name: str = "replay_node", clock: Clock | None = None, **node_arguments: Any) -> None:
        super().__init__(node_name, REPLAY_NODE, clock, **node_arguments)
        self._time = self.create_publisher(ClockMessage, "/clock", QoSProfile(depth=10))
        self._published = 0

    def make_source(self, sensor: Sensor, parameters: Mapping[str, Any]) -> ReplaySource:
        """Return the recording as a source."""
        if not parameters["replay_file"]:
            raise ConfigError("replay_file: is missing; name a recording: replay_file:=<file.mcap>")
        scans = RecordedScans(Path(parameters["replay_file"]), sensor, parameters["replay_topic"])
        return ReplaySource(scans, parameters["replay_rate"], scans.simulated(), self.clock)

    def reading_wanted(self, now: int) -> bool:
        """Return whether the replay may begin: no scan is read before it can be delivered."""
        return self._active and super().reading_wanted(now)

    def deliver(self, scan: Scan, now: int) -> None:
        """Deliver one scan, after its time."""
        if not 0 <= scan.stamp - self._published < CLOCK_PERIOD:
            self._published = scan.stamp
            message = ClockMessage()
            message.clock.sec, message.clock.nanosec = divmod(scan.stamp, NANOSECONDS)
            self._time.publish(message)
        super().deliver(scan, now)


def make_node() -> ReplayNode:
    """Return the node, started unless its parameter autostart is false."""
    node = ReplayNode()
    node.start()
    return node


def main() -> None:
    """Run the node until it is interrupted."""
    raise SystemExit(run_node(make_node))
