"""One command to a board without a driver: `posfet can command`."""

from __future__ import annotations

import argparse
from typing import Final

from rich.console import Console

from posfet_driver.board_report import version
from posfet_driver.bus import open_bus
from posfet_driver.can_tool import bus_of
from posfet_driver.commands import CommandError
from posfet_driver.frames import CLASSIC, Frame, FrameBus
from posfet_driver.messages import COMMAND_OFFSET, RESPONSE_OFFSET, Command, Request, Response, Result
from posfet_driver.source import Clock

ANSWER_TIMEOUT: Final = 0.5
"""Time in which a board has to answer [s]."""


def ask(
    bus: FrameBus, base: int, clock: Clock, command: Command, argument: int = 0, heard: list[Frame] | None = None
) -> Response:
    """Send a command and return the board's answer; other frames that come meanwhile are added to `heard`.

    Raises CommandError, one line, when the board refuses or does not answer, and can.CanError when the bus is gone.
    """
    tag = clock.monotonic() & 0xFF
    bus.write_frame((base + COMMAND_OFFSET, CLASSIC, Request(command, tag, argument).pack()))
    end = clock.monotonic() + round(ANSWER_TIMEOUT * 1e9)
    answer: Response | None = None
    while answer is None:
        left = (end - clock.monotonic()) / 1e9
        frames = bus.read_frames(max(left, 0.0))
        if left <= 0 and not frames:  # what came while this process was held up has been read
            raise CommandError(f"{command.name}: no answer within {ANSWER_TIMEOUT:g} s at base identifier 0x{base:X}")
        for frame in frames:
            response = Response.unpack(frame[2]) if frame[:2] == (base + RESPONSE_OFFSET, CLASSIC) else None
            if response and (response.command, response.tag) == (command, tag):
                answer = response
            elif heard is not None:
                heard.append(frame)
    if answer.result != Result.OK:
        raise CommandError(f"{command.name}: refused by the board: {answer.reason}")
    return answer


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
