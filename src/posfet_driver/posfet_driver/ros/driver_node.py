"""Node that reads one board on a CAN bus."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent import futures
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
from posfet_driver.protocol.messages import Command
from posfet_driver.ros.scan_source_node import ScanSourceNode
from posfet_model.ros.run_node import run_node
from posfet_model.sensor.description import Sensor
from posfet_msgs.srv import BoardCommand

RESPONSE_TIMEOUT = 0.5
"""Time within which a board has to respond to a command [s]."""

SUBSCRIBER_TIMEOUT = 2_000_000_000
"""Time after which the board is started without a subscriber, for its diagnostics and commands [ns]."""


class DriverNode(ScanSourceNode):
    """Publishes the scans of a board on a CAN bus."""

    def __init__(self, clock: Clock | None = None, **node_arguments: Any) -> None:
        super().__init__("driver_node", DRIVER_NODE, clock, **node_arguments)
        self._start_at = 0
        self._commands = self.create_service(BoardCommand, "command", self._command)

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
        """Return whether to read the board at the monotonic time `now` [ns]: with a subscriber, or after 2 s."""
        self._start_at = self._start_at or now + SUBSCRIBER_TIMEOUT
        return super().reading_wanted(now) or now >= self._start_at

    def _command(self, request: BoardCommand.Request, response: BoardCommand.Response) -> BoardCommand.Response:
        """Send a command through the data thread and wait for the board's response."""
        try:
            if not self.reading:
                raise CommandError("the driver is not configured")
            pending = self._board.submit(Command(request.command), request.argument, RESPONSE_TIMEOUT)
            response.value = pending.result(2 * RESPONSE_TIMEOUT).value
            response.success = True
        except ValueError:
            known = ", ".join(f"{command} {command.name}" for command in Command)
            response.message = f"command must be one of {known}, got {request.command}"
        except (CommandError, TimeoutError, futures.TimeoutError) as error:
            response.message = str(error) or "no response: the data thread is busy"
        return response


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
