# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Send one command to a board without the driver node: `posfet can command`."""

from __future__ import annotations

import argparse

from rich.console import Console

from posfet_driver.board.command_queue import CommandError
from posfet_driver.board.listening_board import LISTENS_ONLY
from posfet_driver.bus.open_bus import open_bus
from posfet_driver.protocol.messages import Command, Identification, Response
from posfet_driver.tools.bus_options import bus_of
from posfet_driver.tools.one_shot import described, request


def describe(response: Response) -> str:
    """Return the value of a response in words."""
    match response.command:
        case Command.IDENTIFY:
            return described(Identification.unpack(response.value))
        case Command.SET_RATE:
            return f"scan period {response.value} us"
        case Command.SELF_TEST:
            return "no fault found"
        case _:
            return f"next scan {response.value}"


def run_command(options: argparse.Namespace) -> int:
    """Run `posfet can command`; return the exit code."""
    command = Command[options.name.upper()]
    if (command == Command.SET_RATE) != (options.argument is not None):
        wanted = "needs the scan period [us]" if command == Command.SET_RATE else "takes no argument"
        raise CommandError(f"{options.name}: {wanted}")
    with bus_of(options) as (sensor, settings):
        if sensor.mapping:
            raise CommandError(f"{options.name}: {LISTENS_ONLY}")
        bus = open_bus(settings)
        try:
            response = request(bus, sensor.can.base_id, options.clock, command, options.argument or 0)
        finally:
            bus.shutdown()
    Console(highlight=False, markup=False).print(f"{options.name}: ok, {describe(response)}")
    return 0
