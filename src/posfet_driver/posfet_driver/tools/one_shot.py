"""A board spoken to without a driver: one command and its answer, and scanning for the length of a block."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Iterator
from typing import Final

from posfet_driver.board.command_queue import CommandError
from posfet_driver.bus.frame import CLASSIC, Frame
from posfet_driver.bus.frame_bus import FrameBus
from posfet_driver.clock import Clock
from posfet_driver.protocol.messages import COMMAND_OFFSET, RESPONSE_OFFSET, Command, Request, Response, Result
from posfet_driver.tools.bus_options import EMULATOR
from posfet_model.sensor.description import Sensor

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


@contextlib.contextmanager
def started(bus: FrameBus, sensor: Sensor, options: argparse.Namespace) -> Iterator[None]:
    """Have the board scan for the time of the block, when that is wanted; an emulated one nobody else could start."""
    base = sensor.can.base_id
    wanted = options.start or options.interface == EMULATOR
    if wanted:
        ask(bus, base, options.clock, Command.SET_RATE, round(1e6 / sensor.can.scan_rate))
        ask(bus, base, options.clock, Command.START)
    try:
        yield
    finally:
        if wanted:
            ask(bus, base, options.clock, Command.STOP)
