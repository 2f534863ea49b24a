"""A board spoken to without a driver: one command and its answer, and scanning for the length of a block."""

from __future__ import annotations

import argparse
import contextlib
import time
from collections.abc import Iterator
from typing import Final

from posfet_driver.board.command_queue import CommandError
from posfet_driver.bus.frame import CLASSIC, Frame
from posfet_driver.bus.frame_bus import FrameBus
from posfet_driver.protocol.messages import COMMAND_OFFSET, RESPONSE_OFFSET, Command, Request, Response, Result
from posfet_driver.tools.bus_options import EMULATOR
from posfet_model.sensor.description import Sensor

ANSWER_TIMEOUT: Final = 0.5
"""Time in which a board has to answer [s]."""


def ask(bus: FrameBus, base: int, command: Command, argument: int = 0, heard: list[Frame] | None = None) -> Response:
    """Send a command and return the board's answer; other frames that come meanwhile are added to `heard`.

    Raises CommandError, one line, when the board refuses or does not answer, and can.CanError when the bus is gone.
    """
    tag = time.monotonic_ns() & 0xFF
    bus.write_frame((base + COMMAND_OFFSET, CLASSIC, Request(command, tag, argument).pack()))
    end = time.monotonic() + ANSWER_TIMEOUT
    answer: Response | None = None
    while answer is None:
        left = end - time.monotonic()
        if left <= 0:
            raise CommandError(f"{command.name}: no answer within {ANSWER_TIMEOUT:g} s at base identifier 0x{base:X}")
        for frame in bus.read_frames(left):
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
        ask(bus, base, Command.SET_RATE, round(1e6 / sensor.can.scan_rate))
        ask(bus, base, Command.START)
    try:
        yield
    finally:
        if wanted:
            ask(bus, base, Command.STOP)
