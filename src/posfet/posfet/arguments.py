# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The arguments of the launch file and of the `bringup` executable, as one table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

from posfet_driver.parameters import CAN_BITRATE, CAN_CHANNEL, CAN_INTERFACE
from posfet_model.command_line import checked_namespace
from posfet_model.config import ConfigError, did_you_mean
from posfet_model.parameters import (
    AUTOSTART,
    CALIBRATION_FILE,
    CALIBRATION_FOLDER,
    CAN_FD,
    FRAME_ID,
    MAX_RELATIVE,
    MOUNT_POSE,
    PARENT_FRAME,
    RELIABILITY,
    SENSOR_FILE,
    SERIAL,
    TOUCH_AT_START,
    Parameter,
    Scalar,
)
from posfet_sim.parameters import (
    BUS_CHANNEL,
    BUS_INTERFACE,
    IMPERFECTIONS,
    REPLAY_FILE,
    REPLAY_RATE,
    REPLAY_TOPIC,
    SCENE,
    SEED,
)

SIMULATED: Final = ("sim", "emulator")
"""Sources with the simulated board."""
DRIVEN: Final = ("can", "emulator")
"""Sources with the driver."""
SOURCES_OF: Final = {
    CAN_INTERFACE.name: ("can",),
    CAN_CHANNEL.name: ("can",),
    CAN_BITRATE.name: DRIVEN,
    SCENE.name: SIMULATED,
    IMPERFECTIONS.name: SIMULATED,
    SEED.name: SIMULATED,
    BUS_INTERFACE.name: ("emulator",),
    BUS_CHANNEL.name: ("emulator",),
    REPLAY_FILE.name: ("replay",),
    REPLAY_RATE.name: ("replay",),
    REPLAY_TOPIC.name: ("replay",),
}
"""Sources with which an argument may be given, by its name; one that is not here goes with all."""


def _for_sources(parameter: Parameter) -> Parameter:
    """Return a node's parameter as an argument that goes with some sources only."""
    sources = " or ".join(SOURCES_OF[parameter.name])
    return replace(parameter, description=f"With source:={sources}: {parameter.description}")


def _optional(parameter: Parameter) -> Parameter:
    """Return a node's parameter as an argument that leaves the parameter file its value when it is not given."""
    limits = f", {parameter.allowed}" if parameter.bounded or parameter.choices else ""
    return Parameter(
        parameter.name,
        "",
        f"{parameter.description}{limits}",
        empty=f"as in params_file, otherwise {parameter.empty or parameter.default_text}",
        frame=parameter.frame,
    )


_OPTIONAL: Final = (
    CALIBRATION_FILE,
    CALIBRATION_FOLDER,
    MAX_RELATIVE,
    TOUCH_AT_START,
    PARENT_FRAME,
    AUTOSTART,
    RELIABILITY,
)
"""Parameters whose arguments are texts, since they may be left to the parameter file."""
NAMESPACE: Final = Parameter("namespace", "tactile", "Namespace of nodes and topics, one for each sensor")
PARAMS_NAMESPACES: Final = Parameter(
    "params_namespaces",
    "",
    "Namespaces, joined by commas, of further sensors that params_file has sections for",
    empty="none; hand.launch.py: all sensors of the hand",
)
LOG_LEVELS: Final = ("debug", "info", "warn", "error", "fatal")

ARGUMENTS: Final = (
    Parameter(
        "source",
        "sim",
        "Source of scans: sim (simulated board), can (board on a CAN bus), emulator (simulated board behind an "
        "emulated slcan adapter, so that the whole communication link is used), replay (a recording)",
        choices=("sim", "can", "emulator", "replay"),
    ),
    _for_sources(CAN_INTERFACE),
    _for_sources(CAN_CHANNEL),
    _for_sources(CAN_BITRATE),
    CAN_FD,
    NAMESPACE,
    SENSOR_FILE,
    SERIAL,
    _optional(CALIBRATION_FILE),
    _optional(CALIBRATION_FOLDER),
    _optional(MAX_RELATIVE),
    _optional(TOUCH_AT_START),
    FRAME_ID,
    _optional(PARENT_FRAME),
    MOUNT_POSE,
    Parameter("params_file", "", "YAML file with node parameters", empty="config/parameters.yaml of package posfet"),
    PARAMS_NAMESPACES,
    _for_sources(SCENE),
    _for_sources(IMPERFECTIONS),
    _for_sources(SEED),
    _for_sources(BUS_INTERFACE),
    _for_sources(BUS_CHANNEL),
    _for_sources(REPLAY_FILE),
    _for_sources(REPLAY_RATE),
    _for_sources(REPLAY_TOPIC),
    _optional(AUTOSTART),
    _optional(RELIABILITY),
    Parameter("composed", True, "Run all nodes in one process, which is fastest; false: one process for each node"),
    Parameter("log_level", "info", "Lowest severity of the log messages shown", choices=LOG_LEVELS),
)

ENDS: Final = (
    Parameter(
        "required",
        True,
        "Shut the whole launch down when a process of this stack has ended for good; false: log it and leave the rest "
        "running",
    ),
    Parameter(
        "respawn",
        "on_internal_error",
        "When an ended process is started again: on_internal_error (exit code 3), always (after a second, also when it "
        "could not start), never",
        choices=("on_internal_error", "always", "never"),
    ),
)
"""Arguments of the launch files that say what follows the end of a process."""
WEB: Final = Parameter(
    "web",
    "false",
    "Show it in a browser on this machine: true (at the port of the last time, or any), false, or a port; needs "
    "composed:=true",
)
LAUNCH_ARGUMENTS: Final = (*ENDS, WEB)
"""Arguments that only the launch file has."""


def written_as(argument: Parameter) -> tuple[type, ...]:
    """Return the types that an argument may have in a YAML file; a text needs quotes where YAML reads another type."""
    values = (argument.default, *(each.default for each in _OPTIONAL if each.name == argument.name))
    if any(isinstance(value, bool) for value in values) or "true" in argument.choices:
        return str, bool
    return (str, int, float) if any(isinstance(value, (int, float)) for value in values) else (str,)


def choices(argument: Parameter) -> tuple[str, ...]:
    """Return the texts allowed for an argument, empty for any text."""
    return ("true", "false") if isinstance(argument.default, bool) else argument.choices


def description(argument: Parameter) -> str:
    """Return the description of an argument, with its range and unit if it has them."""
    bounds = f", {argument.allowed}" if argument.bounded else ""
    return f"{argument.summary}{bounds}"


def defaults() -> dict[str, str]:
    """Return every argument with its default, as text."""
    return {argument.name: argument.default_text for argument in ARGUMENTS}


def parse(words: Sequence[str]) -> dict[str, str]:
    """Return every argument by name, from words `name:=value` and the defaults.

    Raises ConfigError, one line, for an unknown argument, one given twice, or a value that is not allowed.

    Parameters
    ----------
    words : sequence of str
        Words of the command line.
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
    """Return all arguments if each is known, has an allowed value and goes with the source; ConfigError otherwise."""
    known = {argument.name: argument for argument in ARGUMENTS}
    for name, value in values.items():
        if name not in known:
            if name in {argument.name for argument in LAUNCH_ARGUMENTS}:
                raise ConfigError(f"{name}: is an argument of the launch file only")
            raise ConfigError(f"{name}: unknown argument, {did_you_mean(name, known)}posfet bringup -s lists all")
        if name == NAMESPACE.name:
            checked_namespace(value)
            continue
        if name == PARAMS_NAMESPACES.name:
            params_namespaces(values)
            continue
        try:
            known[name].parse(value)
        except ValueError as error:
            raise ConfigError(f"{name}: {error}") from error
    source = values["source"]
    for name, sources in SOURCES_OF.items():
        if source not in sources and known[name].parse(values[name]) != known[name].default:
            wanted = " or ".join(f"source:={each}" for each in sources)
            raise ConfigError(f"{name}: needs {wanted}; leave it out with source:={source}")
    return values


def params_namespaces(values: Mapping[str, str]) -> list[str]:
    """Return the namespaces of the argument `params_namespaces`, as they were given; ConfigError if one is not valid.

    Parameters
    ----------
    values : mapping of str to str
        Every argument by name.
    """
    names = [name.strip() for name in values[PARAMS_NAMESPACES.name].split(",") if name.strip()]
    for name in names:
        try:
            checked_namespace(name)
        except ConfigError as error:
            raise ConfigError(f"{PARAMS_NAMESPACES.name}: {error}") from error
    return names


def node_parameters(values: Mapping[str, str], *arguments: Parameter) -> dict[str, Scalar]:
    """Return `arguments` as node parameters: by name, with values of the parameter's type."""
    return {argument.name: argument.parse(values[argument.name]) for argument in arguments}


def given_parameters(values: Mapping[str, str], *parameters: Parameter) -> dict[str, Scalar]:
    """Return those of a node's parameters that are given as arguments: the parameter file may give the others.

    Raises ConfigError, one line, for a value that is not allowed.

    Parameters
    ----------
    values : mapping of str to str
        Every argument by name.
    *parameters : Parameter
        Parameters of the node whose arguments are optional.
    """
    found = {}
    for parameter in parameters:
        text = values[parameter.name]
        try:
            if text:
                found[parameter.name] = parameter.parse(text)
        except ValueError as error:
            raise ConfigError(f"{parameter.name}: {error}") from error
    return found


def describe() -> str:
    """Return every argument with its description, as `--show-args` prints it."""
    lines = ["Arguments (pass them as name:=value):"]
    for argument in ARGUMENTS:
        allowed = choices(argument)
        options = f" One of {', '.join(allowed)}." if allowed else ""
        lines += ["", f"  {argument.name}", f"      {description(argument)}.{options}"]
        lines[-1] += f" (default: '{argument.default_text}')"
    return "\n".join(lines)
