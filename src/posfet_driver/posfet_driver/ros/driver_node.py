# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Node that reads one board on a CAN bus."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Future
from dataclasses import replace
from typing import Any

from posfet_driver.board.board_client import Board
from posfet_driver.board.command_queue import CommandError
from posfet_driver.board.listening_board import ListeningBoard
from posfet_driver.bus.open_bus import bus_settings
from posfet_driver.bus.port_search import BusOpener
from posfet_driver.clock import Clock
from posfet_driver.parameters import DRIVER_NODE
from posfet_driver.protocol.identifiers import board_frames
from posfet_driver.protocol.messages import Command, Response
from posfet_driver.ros.command_service import CommandService
from posfet_driver.ros.scan_source_node import ScanSourceNode
from posfet_model.ros.run_node import run_node
from posfet_model.sensor.description import Sensor

SUBSCRIBER_TIMEOUT = 2_000_000_000
"""Time after which the board is started without a subscriber, for its diagnostics and commands [ns]."""


class DriverNode(ScanSourceNode):
    """Publishes the scans of a board on a CAN bus."""

    def __init__(self, clock: Clock | None = None, **node_arguments: Any) -> None:
        super().__init__("driver_node", DRIVER_NODE, clock, **node_arguments)
        self._start_at = 0
        self._commanded = False

    def serve(self) -> None:
        """Create the diagnostics and the service."""
        super().serve()
        CommandService(self, self._submit)

    def make_source(self, sensor: Sensor, parameters: Mapping[str, Any]) -> Board | ListeningBoard:
        """Return the board on the bus of the parameters. Raises ConfigError when it can never be opened."""
        settings = bus_settings(
            parameters["can_interface"],
            parameters["can_channel"],
            sensor.can,
            bitrate=parameters["can_bitrate"],
            data_bitrate=parameters["can_data_bitrate"],
            options=parameters["can_options"],
        )
        opener = BusOpener(settings, board_frames(sensor))
        link = replace(sensor.can, bitrate=settings.bitrate, data_bitrate=settings.data_bitrate)
        kind = ListeningBoard if sensor.mapping else Board
        self._board = kind(replace(sensor, can=link), opener, self.clock, opener.presence)
        return self._board

    def reading_wanted(self, now: int) -> bool:
        """Return whether to read the board at the monotonic time `now` [ns]: subscribed to, commanded, or after 2 s."""
        self._start_at = self._start_at or now + SUBSCRIBER_TIMEOUT
        return super().reading_wanted(now) or self._commanded or now >= self._start_at

    def _submit(self, command: Command, argument: int, timeout: float) -> Future[Response]:
        """Submit a command of the service to the data thread."""
        if not self.reading or self.failure:
            raise CommandError(self.failure or "the driver is not configured")
        self._commanded = True
        return self._board.submit(command, argument, timeout)


def make_node() -> DriverNode:
    """Return the node, started."""
    node = DriverNode()
    node.start()
    return node


def main() -> None:
    """Run the node until it is shut down."""
    raise SystemExit(run_node(make_node))


if __name__ == "__main__":
    main()
