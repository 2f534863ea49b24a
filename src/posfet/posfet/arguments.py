"""The arguments of the bring-up: one table for the launch file and for the `bringup` executable."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from posfet_model.config import ConfigError


@dataclass(frozen=True)
class Argument:
    """One launch argument, given as `name:=value`."""

    name: str
    default: str
    description: str
    choices: tuple[str, ...] = ()


BOOLEAN: Final = ("true", "false")
HIGHEST_BITRATE: Final = 1_000_000
LOG_LEVELS: Final = ("debug", "info", "warn", "error", "fatal")

ARGUMENTS: Final = (
    Argument(
        "source",
        "sim",
        "Where scans come from: sim (simulated board), can (a board on a CAN bus), emulator (simulated board behind an "
        "emulated slcan adapter: the whole wire path)",
        ("sim", "can", "emulator"),
    ),
    Argument("can_interface", "socketcan", "python-can interface of source:=can: socketcan, slcan, pcan, kvaser, ..."),
    Argument("can_channel", "can0", "Channel of that interface: can0, /dev/ttyACM0, PCAN_USBBUS1, ..."),
    Argument("can_bitrate", "0", "Nominal bitrate in bit/s; 0: as in the sensor file"),
    Argument("can_fd", "auto", "CAN FD or classic CAN; auto: as in the sensor file", ("auto", *BOOLEAN)),
    Argument("namespace", "tactile", "Namespace of nodes and topics, one for each sensor"),
    Argument("sensor_file", "posfet_5x5", "Sensor description: a YAML file, or the name of a shipped one"),
    Argument(
        "calibration_file", "", "Calibration of this very sensor: a YAML file; empty: as params_file has it, or none"
    ),
    Argument("parent_frame", "", "TF frame that the array is mounted on; empty: no transform is broadcast"),
    Argument("mount", "0 0 0 0 0 0", "Pose of the array in parent_frame: x y z [m] roll pitch yaw [rad]"),
    Argument("params_file", "", "YAML file with node parameters; empty: config/parameters.yaml of this package"),
    Argument("scene", "press_slide_lift", "What happens to the simulated board: a YAML file, or a shipped scene"),
    Argument("imperfections", "default", "What the simulated board lacks of an ideal one: none, default, a YAML file"),
    Argument(
        "bus_interface",
        "",
        "python-can interface on which board and driver of source:=emulator meet: socketcan, udp_multicast, ...; "
        "virtual needs composed:=true; empty: the emulated slcan adapter",
    ),
    Argument("bus_channel", "", "Channel of that interface"),
    Argument("composed", "true", "All nodes in one process, the fastest way; false: a process for each", BOOLEAN),
    Argument("log_level", "info", "Least severe log messages that are shown", LOG_LEVELS),
)


def defaults() -> dict[str, str]:
    """Return every argument with its default."""
    return {argument.name: argument.default for argument in ARGUMENTS}


def parse(words: Sequence[str]) -> dict[str, str]:
    """Return every argument by name, from words `name:=value` and the defaults.

    Raises ConfigError, one line, for an unknown argument, one given twice, or a value that is not a choice.
    """
    given: dict[str, str] = {}
    for word in words:
        name, separator, value = word.partition(":=")
        if not separator:
            raise ConfigError(f"{word}: must be an argument name:=value, for instance source:=emulator")
        if name in given:
            raise ConfigError(f"{name}: is given twice")
        given[name] = value
    return check({**defaults(), **given})


def check(values: dict[str, str]) -> dict[str, str]:
    """Return `values` when each is an argument with an allowed value; raise ConfigError, one line, when not."""
    known = {argument.name: argument for argument in ARGUMENTS}
    for name, value in values.items():
        if name not in known:
            raise ConfigError(f"{name}: unknown argument, known are {', '.join(known)}")
        choices = known[name].choices
        if choices and value not in choices:
            raise ConfigError(f"{name}: must be one of {', '.join(choices)}, got '{value}'")
    bitrate = values["can_bitrate"]
    if not bitrate.isdecimal() or int(bitrate) > HIGHEST_BITRATE:
        raise ConfigError(f"can_bitrate: must be a whole number in [0, {HIGHEST_BITRATE}] bit/s, got '{bitrate}'")
    return values


def describe() -> str:
    """Return every argument with its description, as `--show-args` prints it."""
    lines = ["Arguments (pass them as name:=value):"]
    for argument in ARGUMENTS:
        choices = f" One of {', '.join(argument.choices)}." if argument.choices else ""
        lines += ["", f"  {argument.name}", f"      {argument.description}.{choices} (default: '{argument.default}')"]
    return "\n".join(lines)
