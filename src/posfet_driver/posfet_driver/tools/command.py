"""One command to a board without a driver: `posfet can command`."""

from __future__ import annotations

import argparse

from rich.console import Console

from posfet_driver.board.command_queue import CommandError
from posfet_driver.bus.open_bus import open_bus
from posfet_driver.protocol.messages import Command, Response, version
from posfet_driver.tools.bus_options import bus_of
from posfet_driver.tools.one_shot import ask


def describe(answer: Response) -> str:
    """Return what the value of an answer means."""
    match answer.command:
        case Command.IDENTIFY:
            return f"layout {answer.value & 0xFFFF}, firmware {version(answer.value >> 16)}"
        case Command.SET_RATE:
            return f"scan period {answer.value} us"
        case Command.SELF_TEST:
            return "no fault found"
        case _:
            return f"next scan {answer.value}"


def run_command(options: argparse.Namespace) -> int:
    """Run the action; return the exit code."""
    command = Command[options.name.upper()]
    if (command == Command.SET_RATE) != (options.argument is not None):
        wanted = "needs the scan period [us]" if command == Command.SET_RATE else "takes no argument"
        raise CommandError(f"{options.name}: {wanted}")
    with bus_of(options) as (sensor, settings):
        bus = open_bus(settings)
        try:
            answer = ask(bus, sensor.can.base_id, options.clock, command, options.argument or 0)
        finally:
            bus.shutdown()
    reset = " (switched on since the last START)" if answer.reset else ""
    Console(highlight=False, markup=False).print(f"{options.name}: ok, {describe(answer)}{reset}")
    return 0
