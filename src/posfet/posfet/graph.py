# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The nodes of a bring-up and their parameters, as data for the launch file and for the `bringup` executable."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from posfet.arguments import DRIVEN, SIMULATED, SOURCES_OF, given_parameters, node_parameters, params_namespaces
from posfet.ros_arguments import RosArguments
from posfet_driver.parameters import CAN_BITRATE, CAN_CHANNEL, CAN_INTERFACE, DRIVER_NODE
from posfet_model.calibration.calibration_file import load_calibration
from posfet_model.config import ConfigError, did_you_mean, is_there, read_yaml
from posfet_model.parameters import (
    AUTOSTART,
    CALIBRATION_FILE,
    CALIBRATION_FOLDER,
    DIRECT,
    FRAME_ID,
    MAX_RELATIVE,
    MODEL_NODE,
    MOUNT,
    MOUNT_POSE,
    RELIABILITY,
    SENSOR,
    STANDARD,
    TOUCH_AT_START,
    Scalar,
    default_frame,
)
from posfet_model.ros.mount import parse_mount
from posfet_model.sensor.description import Sensor, load_sensor, with_serial
from posfet_sim.device.error_model import load_error_model
from posfet_sim.parameters import (
    ADAPTER_LINK,
    BUS_CHANNEL,
    BUS_INTERFACE,
    IMPERFECTIONS,
    REPLAY_FILE,
    REPLAY_NODE,
    REPLAY_RATE,
    REPLAY_TOPIC,
    SCENE,
    SEED,
    SIM_BOARD_NODE,
)
from posfet_sim.scene import load_scene

NODES: Final = {
    "model_node": MODEL_NODE,
    "sim_board_node": SIM_BOARD_NODE,
    "driver_node": DRIVER_NODE,
    "replay_node": REPLAY_NODE,
}
"""Parameters of each node, by the name of the node."""
ALWAYS_GIVEN: Final = {*(each.name for each in SENSOR), *SOURCES_OF}
"""Parameters that are arguments of bring-up, and that its nodes get from these."""


@dataclass(frozen=True)
class NodeSpec:
    """One node of the graph."""

    package: str
    executable: str
    """Name of the executable, and of the node unless it has another."""
    namespace: str
    """Full namespace, without slashes at its ends."""
    params_file: str
    log_level: str
    parameters: Mapping[str, Scalar] = field(default_factory=dict)
    """Parameters that override those of `params_file` and of `ros_words`."""
    ros_words: tuple[str, ...] = ()
    """Further ROS arguments, `--ros-args` first."""
    given_name: str = ""
    """Name of the node where it is not that of the executable."""

    @property
    def name(self) -> str:
        """Name of the node."""
        return self.given_name or self.executable

    @property
    def arguments(self) -> list[str]:
        """The node without `parameters` as arguments of the ROS command line."""
        words = ["--ros-args", "-r", f"__node:={self.name}", "-r", f"__ns:=/{self.namespace}"]
        return [*words, "--log-level", self.log_level, *self.ros_words, "--params-file", self.params_file]

    def parameter_file(self) -> str:
        """Return `parameters` as the text of a parameter file: one for this node overrides one for all, and `-p`."""
        # JSON is YAML, and keeps the types; YAML has no escape for half of a character.
        values = {f"/{self.namespace}/{self.name}": {"ros__parameters": dict(self.parameters)}}
        import json  # noqa: PLC0415  # for nodes in processes of their own

        return json.dumps(values, ensure_ascii=False)


def check_params_file(path: str, ros: RosArguments, namespaces: Sequence[str]) -> None:
    """Raise ConfigError, one line, unless `path` holds parameters for nodes of this stack; nodes check the values.

    Parameters
    ----------
    path : str
        Path of the parameter file.
    ros : RosArguments
        Names of the nodes.
    namespaces : sequence of str
        Full namespaces that sections may name: that of the nodes, then those of other sensors with the same file.
    """
    tables = {ros.name(node): table for node, table in NODES.items()}
    if not is_there(Path(path)):
        raise ConfigError(f"params_file: no such file: {path}")
    top = read_yaml(path)
    for name in top.names():
        node = name.rpartition("/")[2]
        if node not in {*tables, "*", "**"}:
            raise top.error(name, f"no such node, known are {', '.join(tables)}")
        if not any(_matches(name, f"/{around}/{each}") for around in namespaces for each in tables):
            named = ", ".join(f"/{namespaces[0]}/{each}" for each in tables)  # ROS would pass over the section
            raise top.error(
                name,
                f"none of the nodes {named}; write /**/{node} for any namespace, or name that of another sensor in "
                "params_namespaces",
            )
        section = top.section(name)
        values = section.section("ros__parameters")
        known = {each.name for table in ([tables[node]] if node in tables else tables.values()) for each in table}
        for key in values.names():
            standard = f"{key}.".startswith(tuple(f"{each.rstrip('.')}." for each in STANDARD))
            if not standard and key not in {FRAME_ID.name, *known}:
                raise values.error(
                    key, f"unknown parameter, {did_you_mean(key, known)}known are {', '.join(sorted(known))}"
                )
            if remedy := _argument_for(key):
                raise values.error(key, remedy)
        section.end()


def _matches(section: str, node: str) -> bool:
    """Return whether ROS applies a section of a parameter file to a node: `*` is one name, `**` any number of names."""
    wildcards = {"*": "/[^/]+", "**": "(/[^/]+)*"}
    pattern = "".join(wildcards.get(name, f"/{re.escape(name)}") for name in section.removeprefix("/").split("/"))
    return re.fullmatch(pattern, node) is not None


def check_ros_parameters(ros: RosArguments) -> None:
    """Raise ConfigError, one line, if ROS arguments set a parameter of a node that an argument overrides in any case.

    Of parameter files only the sections of nodes of this stack count, as a robot's file may be for many nodes; what
    cannot be read is left to ROS, which reads more of YAML.

    Parameters
    ----------
    ros : RosArguments
        What the ROS arguments say.
    """
    for key in ros.parameters:
        if remedy := _argument_for(key):
            raise ConfigError(f"-p {key}: {remedy}")
    ours = {ros.name(node) for node in NODES}
    for path in ros.parameter_files:
        try:
            top = read_yaml(path)
            sections = [top.section(name) for name in top.names() if name.rsplit("/", 1)[-1] in ours]
            values = [section.section("ros__parameters") for section in sections]
        except ConfigError:
            continue
        for section in values:
            for key in section.names():
                if remedy := _argument_for(key):
                    raise section.error(key, remedy)


def _argument_for(key: str) -> str:
    """Return what to do in place of setting a parameter that arguments override in any case; '' for any other."""
    if key == FRAME_ID.name:
        return "use the argument frame_id:=<name>: all nodes have the same frame"
    if key == DIRECT.name:
        return "use the argument composed:=true, which sets it; without it the model would get no scans"
    return f"use the argument {key}:=<value>, from which the nodes get it" if key in ALWAYS_GIVEN else ""


def emulated_adapter(namespace: str) -> Path:
    """Return the path at which the emulated adapter of a namespace appears, private to user and ROS domain."""
    from posfet.private_folder import private_folder  # noqa: PLC0415  # for one of the sources

    domain = os.environ.get("ROS_DOMAIN_ID") or "0"
    return private_folder() / f"{domain}-{namespace.replace('/', '-')}"


def _mount(arguments: Mapping[str, str]) -> dict[str, Scalar]:
    """Return the parameters of the mount, none without a parent frame: then the parameter file may give them."""
    parse_mount(arguments[MOUNT_POSE.name])
    mount = node_parameters(arguments, *MOUNT)
    if mount["parent_frame"]:
        return mount
    if mount[MOUNT_POSE.name] != MOUNT_POSE.default:
        raise ConfigError("mount: needs parent_frame:=<frame that the array is mounted on>")
    return {}


def _calibration(arguments: Mapping[str, str], sensor: Sensor) -> dict[str, Scalar]:
    """Return the parameter of the calibration, none without one: then the parameter file may give it."""
    path = arguments[CALIBRATION_FILE.name]
    if not path:
        return {}
    load_calibration(path, sensor)
    return {CALIBRATION_FILE.name: path}


def _bus(arguments: Mapping[str, str], namespace: str) -> tuple[dict[str, Scalar], dict[str, Scalar]]:
    """Return the parameters of the bus for the driver and for the simulated board."""
    interface, channel = arguments[BUS_INTERFACE.name], arguments[BUS_CHANNEL.name]
    if arguments["source"] != "emulator":
        return node_parameters(arguments, CAN_INTERFACE, CAN_CHANNEL), {ADAPTER_LINK.name: ""}
    if interface == "virtual" and arguments["composed"] != "true":
        raise ConfigError(
            "bus_interface: virtual is a bus within one process; use composed:=true, or another interface"
        )
    if interface:
        board = node_parameters(arguments, BUS_INTERFACE, BUS_CHANNEL)
        return {CAN_INTERFACE.name: interface, CAN_CHANNEL.name: channel}, {ADAPTER_LINK.name: "", **board}
    if channel:
        raise ConfigError("bus_channel: needs a bus_interface")
    from posfet_sim.emulation.adapter_lock import is_served  # noqa: PLC0415  # for one of the sources

    adapter = str(emulated_adapter(namespace))
    if is_served(adapter):
        raise ConfigError(f"{adapter}: an emulated adapter is running here already; use another namespace")
    return {CAN_INTERFACE.name: "slcan", CAN_CHANNEL.name: adapter}, {ADAPTER_LINK.name: adapter}


def _replayed(arguments: Mapping[str, str], sensor: Sensor) -> bool:
    """Return whether the recording is that of a simulated board; raise ConfigError if it has no scans of the sensor."""
    from posfet_sim.recording.recorded_scans import RecordedScans  # noqa: PLC0415  # other starts need no MCAP

    path = arguments[REPLAY_FILE.name]
    if not path:
        raise ConfigError("replay_file: is missing; source:=replay needs replay_file:=<file.mcap>")
    return RecordedScans(Path(path), sensor, arguments[REPLAY_TOPIC.name]).simulated()


def graph(arguments: Mapping[str, str], params_file: str, ros: RosArguments | None = None) -> list[NodeSpec]:
    """Return the nodes for checked bring-up arguments.

    The source of scans is last, so that its subscribers exist before its first scan.

    Parameters
    ----------
    arguments : mapping of str to str
        Every argument by name, as `posfet.arguments.parse` returns them.
    params_file : str
        Path of a YAML file with node parameters.
    ros : RosArguments, optional
        ROS arguments for the nodes; default: none.

    Raises
    ------
    ConfigError
        If the namespace or a file cannot be used: one line here instead of one from every node.
    """
    ros = ros or RosArguments()
    namespace = ros.within(arguments["namespace"])
    check_params_file(params_file, ros, [namespace, *map(ros.within, params_namespaces(arguments))])
    check_ros_parameters(ros)
    source = arguments["source"]
    sensor = with_serial(load_sensor(arguments["sensor_file"]), arguments["serial"])
    if source in SIMULATED:
        load_scene(arguments[SCENE.name], sensor)
        load_error_model(arguments[IMPERFECTIONS.name])
    shared = node_parameters(arguments, *SENSOR) | given_parameters(arguments, AUTOSTART, RELIABILITY)
    frame: dict[str, Scalar] = {FRAME_ID.name: arguments[FRAME_ID.name] or default_frame(namespace)}
    simulated = _replayed(arguments, sensor) if source == "replay" else source in SIMULATED
    driver_bus, board_bus = _bus(arguments, namespace)

    def node(package: str, executable: str, parameters: Mapping[str, Scalar]) -> NodeSpec:
        values = {**shared, **parameters}
        name = ros.name(executable)
        return NodeSpec(
            package, executable, namespace, params_file, arguments["log_level"], values, ros.words, given_name=name
        )

    model: dict[str, Scalar] = {"simulated": simulated, **_mount(arguments), **_calibration(arguments, sensor)}
    if model.get("parent_frame") == frame[FRAME_ID.name]:
        raise ConfigError(f"parent_frame: must not be the frame of the array itself, got '{model['parent_frame']}'")
    model |= given_parameters(arguments, CALIBRATION_FOLDER, MAX_RELATIVE, TOUCH_AT_START)
    nodes = [node("posfet_model", "model_node", model)]
    if source in SIMULATED:
        board = node_parameters(arguments, SCENE, IMPERFECTIONS, SEED)
        nodes.append(node("posfet_sim", "sim_board_node", {**frame, **board, **board_bus}))
    if source == "replay":
        recording = node_parameters(arguments, REPLAY_FILE, REPLAY_RATE, REPLAY_TOPIC)
        nodes.append(node("posfet_sim", "replay_node", {**frame, **recording}))
    if source in DRIVEN:
        bus = {**driver_bus, **node_parameters(arguments, CAN_BITRATE)}
        nodes.append(node("posfet_driver", "driver_node", {**frame, **bus}))
    return nodes
