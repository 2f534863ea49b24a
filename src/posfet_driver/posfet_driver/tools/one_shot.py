# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Access to a board without the driver node: one command and its response, and scanning while a block runs."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Iterator
from typing import Final

from posfet_driver.board.command_queue import CommandError
from posfet_driver.board.listening_board import LISTENS_ONLY
from posfet_driver.bus.frame import CLASSIC, Frame
from posfet_driver.bus.frame_bus import FrameBus
from posfet_driver.clock import Clock
from posfet_driver.protocol.messages import (
    COMMAND_OFFSET,
    RESPONSE_OFFSET,
    Command,
    Identification,
    Request,
    Response,
)
from posfet_driver.tools.bus_options import EMULATOR
from posfet_model.sensor.description import Sensor

RESPONSE_TIMEOUT: Final = 0.5
"""Time within which a board has to respond [s]."""


def request(
    bus: FrameBus, base: int, clock: Clock, command: Command, argument: int = 0, others: list[Frame] | None = None
) -> Response:
    """Send a command and return the board's response.

    Parameters
    ----------
    bus : FrameBus
        The bus.
    base : int
        The board's base identifier.
    clock : Clock
        Clock of the time-out.
    command : Command
        The command.
    argument : int, default 0
        Its argument.
    others : list of Frame, optional
        Receives the other frames that arrive meanwhile.

    Returns
    -------
    Response
        The response, which confirms the command.

    Raises
    ------
    CommandError
        When the board refuses or does not respond; one line.
    can.CanError
        When the bus fails.
    """
    tag = clock.monotonic() & 0xFF
    bus.write_frame((base + COMMAND_OFFSET, CLASSIC, Request(command, tag, argument).pack()))
    end = clock.monotonic() + round(RESPONSE_TIMEOUT * 1e9)
    matching: Response | None = None
    while matching is None:
        left = (end - clock.monotonic()) / 1e9
        frames = bus.read_frames(max(left, 0.0))
        if left <= 0 and not frames:  # frames that arrived while this process was suspended have been read
            raise CommandError(
                f"{command.name}: no response within {RESPONSE_TIMEOUT:g} s at base identifier 0x{base:X}"
            )
        for frame in frames:
            response = Response.unpack(frame[2]) if frame[:2] == (base + RESPONSE_OFFSET, CLASSIC) else None
            if response and (response.command, response.tag) == (command, tag):
                matching = response
            elif others is not None:
                others.append(frame)
    if not matching.confirms(argument):
        raise CommandError(f"{command.name}: refused by the board: {matching.reason}")
    return matching


def described(board: Identification) -> str:
    """Return what a board is in words.

    Parameters
    ----------
    board : Identification
        What the board has stated.
    """
    frames = "CAN FD" if board.fd else "classic CAN"
    return f"layout {board.layout}, protocol {board.protocol}, {frames}, firmware {board.firmware_major}.x"


@contextlib.contextmanager
def started(bus: FrameBus, sensor: Sensor, options: argparse.Namespace) -> Iterator[None]:
    """Start the board for the duration of the block if the options say so; an emulated board always.

    Parameters
    ----------
    bus : FrameBus
        Open bus.
    sensor : Sensor
        Sensor description.
    options : argparse.Namespace
        Options of the command line.
    """
    base = sensor.can.base_id
    wanted = options.start or options.interface == EMULATOR
    if wanted and sensor.mapping:
        raise CommandError(f"--start: {LISTENS_ONLY}")
    if wanted:
        request(bus, base, options.clock, Command.SET_RATE, round(1e6 / sensor.can.scan_rate))
        request(bus, base, options.clock, Command.START)
    try:
        yield
    finally:
        if wanted:
            request(bus, base, options.clock, Command.STOP)
