# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""`posfet can`: CAN adapters and boards from the command line."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Final

import can

from posfet_driver.board.command_queue import CommandError
from posfet_driver.board.scan_source import SourceError
from posfet_driver.bus.bus_error import one_line
from posfet_driver.clock import Clock, SystemClock
from posfet_driver.parameters import CAN_BITRATE, CAN_DATA_BITRATE, CAN_OPTIONS
from posfet_driver.protocol.messages import Command
from posfet_driver.tools.bus_options import EMULATOR, Emulator
from posfet_model.command_line import positive
from posfet_model.config import ConfigError
from posfet_model.parameters import CAN_FD, SENSOR_FILE

FAILED: Final = 1
INTERRUPTED: Final = 130
"""Exit code 128 + SIGINT, as of a shell; monitor and record end normally when they are interrupted."""

ACTIONS: Final = {
    "list": ("list_boards", "list the adapters of this machine and the boards detected on them"),
    "monitor": ("monitor", "display the bus: identifiers, rates, load, scans, faults"),
    "command": ("command", "send a command to the board and print its response"),
    "record": ("record_replay", "record the bus; the file suffix selects the format: .log (candump), .asc or .blf"),
    "replay": ("record_replay", "send a recording to the bus, or with --decode only summarise it"),
    "selftest": ("self_test", "check adapter and board step by step"),
    "conform": ("conform", "check a board against every rule of docs/protocol.md; it must not be in use"),
}
"""Module of `run_<action>` and its description."""


def make_parser() -> argparse.ArgumentParser:
    """Return the parser for all actions."""
    parser = argparse.ArgumentParser(prog="posfet can", description="CAN adapters and boards.")
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION")
    parsers = {}
    for name, (_, purpose) in ACTIONS.items():
        parsers[name] = actions.add_parser(name, help=purpose, description=purpose)
        _add_bus(parsers[name], "" if name == "list" else "socketcan")
    parsers["list"].add_argument("--for", dest="seconds", type=positive, default=1.2, help="listening time [s]")
    for name in ("monitor", "record"):
        parsers[name].add_argument("--for", dest="seconds", type=positive, default=math.inf, help="duration [s]")
        parsers[name].add_argument("--start", action="store_true", help="start the board, and stop it at the end")
    parsers["selftest"].add_argument(
        "--for", dest="seconds", type=positive, default=2.0, help="duration of the scans [s]"
    )
    parsers["conform"].add_argument("--json", action="store_true", help="print the findings as JSON")
    parsers["conform"].add_argument(
        "--seed", type=_word, default=0, help="order of the checks, tags, periods, arguments"
    )
    parsers["conform"].add_argument(
        "--power-cycle", action="store_true", help="ask for the board to be switched off and on"
    )
    names = [command.name.lower() for command in Command]
    parsers["command"].add_argument("name", choices=names, help="the command")
    parsers["command"].add_argument("argument", nargs="?", type=_word, help="set_rate: scan period [us]")
    parsers["record"].add_argument("file", type=Path, metavar="FILE", help="file to write: .log, .asc or .blf")
    parsers["replay"].add_argument("file", type=Path, metavar="FILE", help="recording to read: .log, .asc or .blf")
    parsers["replay"].add_argument("--decode", action="store_true", help="only summarise the recording; needs no bus")
    parsers["replay"].add_argument("--speed", type=positive, default=1.0, help="playback speed factor")
    return parser


def _add_bus(parser: argparse.ArgumentParser, interface: str) -> None:
    described = f"python-can interface, or {EMULATOR}: a simulated board (default: {interface or 'all'})"
    parser.add_argument("-i", "--interface", default=interface, help=described)
    parser.add_argument("-c", "--channel", default="", help="can0, /dev/ttyACM0, ... (default: can0 with socketcan)")
    parser.add_argument("-s", "--sensor", default=SENSOR_FILE.default, help=SENSOR_FILE.help)
    parser.add_argument("--fd", choices=CAN_FD.choices, default=CAN_FD.default, help=CAN_FD.help)
    parser.add_argument("--bitrate", type=_word, default=CAN_BITRATE.default, help=CAN_BITRATE.help)
    parser.add_argument("--data-bitrate", type=_word, default=CAN_DATA_BITRATE.default, help=CAN_DATA_BITRATE.help)
    parser.add_argument("-o", "--option", action="append", default=[], help=CAN_OPTIONS.description)


def _word(text: str) -> int:
    try:
        value = int(text, 0)
    except ValueError:
        value = -1
    if not 0 <= value <= 0xFFFF_FFFF:
        raise argparse.ArgumentTypeError(f"must be a whole number in [0, 4294967295], got '{text}'")
    return value


def main(words: Sequence[str] | None = None, emulator: Emulator | None = None, clock: Clock | None = None) -> int:
    """Run one action.

    Parameters
    ----------
    words : sequence of str, optional
        Arguments of the command line; by default those of this process.
    emulator : Emulator, optional
        Serves the simulated board of `-i emulator`; without one that interface is refused.
    clock : Clock, optional
        Clock of all time-outs and durations; by default the system's.

    Returns
    -------
    int
        Exit code: 0, 1 with one line on stderr, or 130 when it was interrupted.
    """
    options = make_parser().parse_args(words)
    options.emulator = emulator
    options.clock = clock or SystemClock()
    module, _ = ACTIONS[options.action]
    try:
        run: Callable[[argparse.Namespace], int] = getattr(
            import_module(f"posfet_driver.tools.{module}"), f"run_{options.action}"
        )
        return run(options)
    except (ConfigError, CommandError, SourceError, can.CanError, OSError) as error:
        print(f"posfet can {options.action}: {one_line(error)}", file=sys.stderr)
        return FAILED
    except KeyboardInterrupt:
        return INTERRUPTED


if __name__ == "__main__":
    raise SystemExit(main())
