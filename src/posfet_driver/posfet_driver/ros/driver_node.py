"""The node that reads one board from a CAN bus."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent import futures
from dataclasses import replace
from typing import Any

from posfet_driver.board.board_client import Board
from posfet_driver.board.command_queue import CommandError
from posfet_driver.bus.open_bus import bus_settings
from posfet_driver.bus.port_search import BusOpener
from posfet_driver.parameters import DRIVER_NODE
from posfet_driver.protocol.messages import Command
from posfet_driver.ros.scan_source_node import ScanSourceNode
from posfet_model.ros.run_node import run_node
from posfet_model.sensor.description import Sensor
from posfet_msgs.srv import BoardCommand

ANSWER_TIMEOUT = 0.5
"""Time in which a board has to answer a command [s]."""

LISTENER_PATIENCE = 2_000_000_000
"""Time [ns] after which the board is started although nobody listens: its faults are told, and commands are carried."""


class DriverNode(ScanSourceNode):
    """Publishes the scans of a board on a CAN bus."""

    def __init__(self, **node_arguments: Any) -> None:
        super().__init__("driver_node", DRIVER_NODE, **node_arguments)
        self._patience_ends = 0
        self._commands = self.create_service(BoardCommand, "command", self._command)

    def make_source(self, sensor: Sensor, parameters: Mapping[str, Any]) -> Board:
        """Return the board on the bus that the parameters name. Raises ConfigError for what cannot work."""
        settings = bus_settings(
            parameters["can_interface"],
            parameters["can_channel"],
            sensor.can,
            bitrate=parameters["can_bitrate"],
            data_bitrate=parameters["can_data_bitrate"],
            options=parameters["can_options"],
        )
        opener = BusOpener(settings)
        link = replace(sensor.can, bitrate=settings.bitrate, data_bitrate=settings.data_bitrate)
        self._board = Board(replace(sensor, can=link), opener, presence=opener.presence)
        return self._board

    def wanted(self, now: int) -> bool:
        """Return whether to read the board already: once somebody listens, or nobody did for a while."""
        self._patience_ends = self._patience_ends or now + LISTENER_PATIENCE
        return super().wanted(now) or now >= self._patience_ends

    def _command(self, request: BoardCommand.Request, response: BoardCommand.Response) -> BoardCommand.Response:
        """Have the data thread send a command, and wait for the board's answer."""
        try:
            if not self.reading:
                raise CommandError("the driver is not configured")
            answer = self._board.submit(Command(request.command), request.argument, ANSWER_TIMEOUT)
            response.value = answer.result(2 * ANSWER_TIMEOUT).value
            response.success = True
        except ValueError:
            known = ", ".join(f"{command} {command.name}" for command in Command)
            response.message = f"command must be one of {known}, got {request.command}"
        except (CommandError, TimeoutError, futures.TimeoutError) as error:
            response.message = str(error) or "no answer: the data thread is busy"
        return response


def make_node() -> DriverNode:
    """Return the node, started."""
    node = DriverNode()
    node.start()
    return node


def main() -> None:
    """Run the node until it is told to end."""
    raise SystemExit(run_node(make_node))


if __name__ == "__main__":
    main()
