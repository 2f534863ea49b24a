"""`posfet can`: adapters and boards at the bench, from the command line."""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Final

import can

from posfet_driver.bus import BusSettings, bus_settings, one_line
from posfet_driver.commands import CommandError
from posfet_driver.messages import Command
from posfet_driver.source import Clock, SourceError, SystemClock
from posfet_model.command_line import positive
from posfet_model.config import ConfigError
from posfet_model.sensor import DEFAULT_SENSOR, FRAME_CHOICES, Sensor, load_sensor, with_frames

EMULATOR: Final = "emulator"
"""The interface that is a simulated board behind an emulated adapter, started for the time of one command."""
FAILED: Final = 1
INTERRUPTED: Final = 130
"""As shells tell it; monitor and record are meant to be interrupted, and end well."""

ACTIONS: Final = {
    "list": ("can_list", "adapters of this machine, and the boards that are heard on them"),
    "monitor": ("can_monitor", "what is on the bus: identifiers, rates, load, scans, faults"),
    "command": ("can_command", "send a command to the board and show its answer"),
    "record": ("can_files", "record the bus: .log (candump), .asc or .blf by the name of the file"),
    "replay": ("can_files", "send a recording to the bus, or with --decode only tell what is in it"),
    "selftest": ("can_selftest", "check adapter and board, one thing after the other"),
}
"""Module in which `run_<action>` is, and what it does."""


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of all actions."""
    parser = argparse.ArgumentParser(prog="posfet can", description="Adapters and boards at the bench.")
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION")
    parsers = {}
    for name, (_, purpose) in ACTIONS.items():
        parsers[name] = actions.add_parser(name, help=purpose, description=purpose)
        _add_bus(parsers[name], "" if name == "list" else "socketcan")
    parsers["list"].add_argument("--for", dest="seconds", type=positive, default=0.5, help="how long to listen [s]")
    for name in ("monitor", "record"):
        parsers[name].add_argument("--for", dest="seconds", type=positive, default=math.inf, help="how long [s]")
        parsers[name].add_argument("--start", action="store_true", help="start the board, and stop it at the end")
    parsers["selftest"].add_argument("--for", dest="seconds", type=positive, default=2.0, help="time of scans [s]")
    names = [command.name.lower() for command in Command]
    parsers["command"].add_argument("name", choices=names, help="the command")
    parsers["command"].add_argument("argument", nargs="?", type=_word, help="set_rate: scan period [us]")
    for name in ("record", "replay"):
        parsers[name].add_argument("file", type=Path)
    parsers["replay"].add_argument("--decode", action="store_true", help="only tell what is in it; needs no bus")
    parsers["replay"].add_argument("--speed", type=positive, default=1.0, help="times as fast as it was recorded")
    return parser


def _add_bus(parser: argparse.ArgumentParser, interface: str) -> None:
    described = f"python-can interface, or {EMULATOR}: a simulated board (default: {interface or 'all there are'})"
    parser.add_argument("-i", "--interface", default=interface, help=described)
    parser.add_argument("-c", "--channel", default="", help="can0, /dev/ttyACM0, ... (default: can0 with socketcan)")
    parser.add_argument("-s", "--sensor", default=DEFAULT_SENSOR, help=f"sensor file (default: {DEFAULT_SENSOR})")
    parser.add_argument("--fd", choices=FRAME_CHOICES, default="auto", help="frames (default: as in the sensor file)")
    parser.add_argument("--bitrate", type=_word, default=0, help="nominal bitrate (default: as in the sensor file)")
    parser.add_argument("--data-bitrate", type=_word, default=0, help="bitrate of FD data (default: as in the file)")
    parser.add_argument("-o", "--option", action="append", default=[], help="key=value for the interface")


def _word(text: str) -> int:
    try:
        value = int(text, 0)
    except ValueError:
        value = -1
    if not 0 <= value <= 0xFFFF_FFFF:
        raise argparse.ArgumentTypeError(f"must be a whole number in [0, 4294967295], got '{text}'")
    return value


def sensor_of(options: argparse.Namespace) -> Sensor:
    """Return the sensor that the options name. Raises ConfigError, one line, for a bad file."""
    return with_frames(load_sensor(options.sensor), options.fd)


@contextmanager
def bus_of(options: argparse.Namespace) -> Iterator[tuple[Sensor, BusSettings]]:
    """Yield sensor and bus settings that the options name; an emulated board lives as long as the block.

    Raises ConfigError, one line, for what cannot be used.
    """
    sensor = sensor_of(options)
    if options.interface != EMULATOR:
        channel = options.channel or ("can0" if options.interface == "socketcan" else "")
        yield sensor, _settings(options, sensor, options.interface, channel)
        return
    from posfet_driver.adapter_source import AdapterSource  # noqa: PLC0415  # only an emulation needs the simulation
    from posfet_driver.scene import DEFAULT_SCENE, load_scene  # noqa: PLC0415

    with tempfile.TemporaryDirectory(prefix="posfet-") as folder:
        channel = str(Path(folder) / "can0")
        source = AdapterSource(sensor, load_scene(DEFAULT_SCENE, sensor), 0, channel, options.clock)
        source.open()
        try:
            yield sensor, _settings(options, sensor, "slcan", channel)
        finally:
            source.close()


def _settings(options: argparse.Namespace, sensor: Sensor, interface: str, channel: str) -> BusSettings:
    return bus_settings(
        interface,
        channel,
        sensor.can,
        bitrate=options.bitrate,
        data_bitrate=options.data_bitrate,
        options=options.option,
    )


def main(words: Sequence[str] | None = None, clock: Clock | None = None) -> int:
    """Run one action; return the exit code: 0, 1 with one line on stderr, or 130 when it was interrupted.

    Times are those of `clock` (that of this machine by default).
    """
    options = make_parser().parse_args(words)
    options.clock = clock or SystemClock()
    module, _ = ACTIONS[options.action]
    try:
        run: Callable[[argparse.Namespace], int] = getattr(
            import_module(f"posfet_driver.{module}"), f"run_{options.action}"
        )
        return run(options)
    except (ConfigError, CommandError, SourceError, can.CanError, OSError) as error:
        print(f"posfet can {options.action}: {one_line(error)}", file=sys.stderr)
        return FAILED
    except KeyboardInterrupt:
        return INTERRUPTED


if __name__ == "__main__":
    raise SystemExit(main())
