"""Which nodes run, with which parameters: one description for the launch file and for the `bringup` executable."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from posfet.arguments import defaults
from posfet_model.calibration.calibration_file import load_calibration
from posfet_model.command_line import checked_namespace
from posfet_model.config import ConfigError, read_yaml
from posfet_model.ros.mount import parse_mount
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_sim.device.error_model import load_error_model
from posfet_sim.emulation.adapter_lock import is_served
from posfet_sim.scene import load_scene

Value = bool | int | float | str

NODES: Final = ("model_node", "sim_board_node", "driver_node")


@dataclass(frozen=True)
class NodeSpec:
    """One node of the graph."""

    package: str
    executable: str
    """Name of the executable, and of the node."""
    namespace: str
    params_file: str
    log_level: str
    parameters: Mapping[str, Value] = field(default_factory=dict)
    """Parameters of this start; they win over those of the file."""

    @property
    def arguments(self) -> list[str]:
        """Arguments of the ROS command line that start this node as described."""
        words = ["--ros-args", "-r", f"__node:={self.executable}", "-r", f"__ns:=/{self.namespace}"]
        words += ["--log-level", self.log_level, "--params-file", self.params_file]
        for name, value in self.parameters.items():
            words += ["-p", f"{name}:={_yaml(value)}"]
        return words


def _yaml(value: Value) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return "'" + value.replace("'", "''") + "'"  # a bare 5 or true would become another type
    return repr(value)


def check_params_file(path: str) -> None:
    """Raise ConfigError, one line, unless `path` holds parameters of nodes of this stack; their values they check."""
    if not Path(path).is_file():
        raise ConfigError(f"params_file: no such file: {path}")
    top = read_yaml(path)
    for name in top.names():
        node = name.rsplit("/", 1)[-1]
        if node not in {*NODES, "*", "**"}:
            raise top.error(name, f"no such node, there are {', '.join(NODES)}")
        section = top.section(name)
        section.section("ros__parameters")
        section.end()


def emulated_adapter(namespace: str) -> Path:
    """Return the path at which the emulated adapter of a namespace appears, private to user and ROS domain."""
    folder = os.environ.get("XDG_RUNTIME_DIR") or tempfile.gettempdir()
    domain = os.environ.get("ROS_DOMAIN_ID") or "0"
    name = f"posfet-{os.getuid()}-{domain}-{namespace.replace('/', '-')}"
    return Path(folder) / name


def _place(arguments: Mapping[str, str]) -> dict[str, Value]:
    """Return where the array is mounted, nothing without a parent: then the parameter file may say so."""
    parse_mount(arguments["mount"])
    if arguments["parent_frame"]:
        return {name: arguments[name] for name in ("parent_frame", "mount")}
    if arguments["mount"] != defaults()["mount"]:
        raise ConfigError("mount: needs parent_frame:=<frame that the array is mounted on>")
    return {}


def _calibration(arguments: Mapping[str, str], sensor: Sensor) -> dict[str, Value]:
    """Return which calibration the model uses, nothing without one: then the parameter file may say so."""
    path = arguments["calibration_file"]
    if not path:
        return {}
    load_calibration(path, sensor)
    return {"calibration_file": path}


def _bus(arguments: Mapping[str, str], namespace: str) -> tuple[dict[str, Value], dict[str, Value]]:
    """Return the bus as the driver is told of it, and as the simulated board is."""
    interface, channel = arguments["bus_interface"], arguments["bus_channel"]
    if arguments["source"] != "emulator":
        if interface or channel:
            raise ConfigError("bus_interface: needs source:=emulator, the simulated board on a bus")
        return {name: arguments[name] for name in ("can_interface", "can_channel")}, {"adapter_link": ""}
    if interface:
        board: dict[str, Value] = {"bus_interface": interface, "bus_channel": channel}
        return {"can_interface": interface, "can_channel": channel}, {"adapter_link": "", **board}
    if channel:
        raise ConfigError("bus_channel: needs a bus_interface")
    adapter = str(emulated_adapter(namespace))
    if is_served(adapter):
        raise ConfigError(f"{adapter}: an emulated adapter is running here already; use another namespace")
    return {"can_interface": "slcan", "can_channel": adapter}, {"adapter_link": adapter}


def graph(arguments: Mapping[str, str], params_file: str) -> list[NodeSpec]:
    """Return the nodes for bring-up `arguments`, the source of scans last, so that nobody misses its first one.

    Raises ConfigError when the namespace or a file cannot be used: said once here, not by every node.
    """
    namespace = checked_namespace(arguments["namespace"])
    check_params_file(params_file)
    source = arguments["source"]
    described = load_sensor(arguments["sensor_file"])
    if source != "can":
        load_scene(arguments["scene"], described)
        load_error_model(arguments["imperfections"])
    sensor: dict[str, Value] = {name: arguments[name] for name in ("sensor_file", "can_fd")}
    bus, board = _bus(arguments, namespace)

    def node(package: str, executable: str, parameters: Mapping[str, Value]) -> NodeSpec:
        own = {**sensor, **parameters}
        return NodeSpec(package, executable, namespace, params_file, arguments["log_level"], own)

    known = {**_place(arguments), **_calibration(arguments, described)}
    nodes = [node("posfet_model", "model_node", {"simulated": source != "can", **known})]
    if source != "can":
        simulated = {name: arguments[name] for name in ("scene", "imperfections")}
        nodes.append(node("posfet_sim", "sim_board_node", {**simulated, **board}))
    if source != "sim":
        nodes.append(node("posfet_driver", "driver_node", {**bus, "can_bitrate": int(arguments["can_bitrate"])}))
    return nodes
