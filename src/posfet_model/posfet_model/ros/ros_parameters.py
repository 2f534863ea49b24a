"""Parameters of a node as one table: declared with description and range, checked, returned as plain values."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node

from posfet_model._lib.validation import interval
from posfet_model.config import ConfigError
from posfet_model.sensor.description import FRAME_CHOICES, Sensor, load_sensor, with_frames

Value: TypeAlias = "bool | int | float | str | list[str]"


@dataclass(frozen=True)
class Parameter:
    """One parameter, set at start-up and read-only from then on. The type is that of the default."""

    name: str
    default: Value
    description: str
    low: float = -math.inf
    high: float = math.inf
    choices: tuple[str, ...] = ()

    @property
    def allowed(self) -> str:
        """What may be given, in words."""
        if self.choices:
            return f"one of {', '.join(self.choices)}"
        kind = _KINDS[type(self.default)]
        bounded = math.isfinite(self.low) or math.isfinite(self.high)
        return f"{kind} in {interval(self.low, self.high)}" if bounded else kind

    def check(self, value: object) -> str:
        """Return '' when `value` may be given, else what may be given and what was."""
        fits = type(value) is type(self.default) or (isinstance(self.default, float) and type(value) is int)
        if fits and isinstance(value, (int, float)) and not isinstance(value, bool):
            fits = math.isfinite(value) and self.low <= value <= self.high
        if fits and isinstance(value, str):
            fits = bool(value) or not self.default
        if fits and isinstance(value, list):
            fits = all(isinstance(item, str) for item in value)
        if fits and self.choices:
            fits = value in self.choices
        return "" if fits else f"must be {self.allowed}, got {value!r}"


_KINDS = {bool: "true or false", int: "a whole number", float: "a number", str: "text", list: "a list of texts"}

STANDARD = ("use_sim_time", "start_type_description_service", "qos_overrides.")
"""Parameters that every node has or may be given."""

SENSOR_FILE = Parameter("sensor_file", "posfet_5x5", "Sensor description: a YAML file, or the name of a shipped one")
CAN_FD = Parameter(
    "can_fd", "auto", "Frames of the board: CAN FD or classic; auto: as in the sensor file", choices=FRAME_CHOICES
)
SENSOR = (SENSOR_FILE, CAN_FD)
"""What tells a node its sensor."""
FRAME_ID = Parameter(
    "frame_id", "", "Frame of the array: x along columns, y along rows, z outward; empty: <namespace>_array"
)


def declare(node: Node, table: Sequence[Parameter]) -> Mapping[str, Any]:
    """Declare the parameters of `table`, all that `node` has, and return their checked values by name.

    Raises ConfigError, one line naming node, parameter, what is allowed and what was given; also for a parameter that
    the node does not know, which rclpy would ignore.
    """
    name = node.get_fully_qualified_name()
    known = [parameter.name for parameter in table]
    for given in _given(node):
        if given not in known and not given.startswith(STANDARD):
            raise ConfigError(f"{name}: {given}: unknown parameter, known are {', '.join(known)}")
    if node.get_parameter("use_sim_time").value:
        raise ConfigError(
            f"{name}: use_sim_time: must be false: stamps are times of acquisition, by this machine's clock"
        )
    values: dict[str, Any] = {}
    for parameter in table:
        # rclpy's own ranges let lists and NaN through and its types end in a traceback: all of it is checked here.
        descriptor = ParameterDescriptor(
            description=parameter.description,
            additional_constraints=parameter.allowed,
            read_only=True,
            dynamic_typing=True,
        )
        value = node.declare_parameter(parameter.name, parameter.default, descriptor).value
        reason = parameter.check(value)
        if reason:
            raise ConfigError(f"{name}: {parameter.name}: {reason}")
        values[parameter.name] = float(value) if isinstance(parameter.default, float) else value
    return values


def _given(node: Node) -> list[str]:
    """Return the names of the parameters that were given to `node`, sorted.

    rclpy has no public way to ask for those that are not declared; where the private one is gone, none are known, and
    a misspelt name goes unnoticed.
    """
    return sorted(getattr(node, "_parameter_overrides", ()))


def declared_sensor(values: Mapping[str, Any]) -> Sensor:
    """Return the sensor that the declared parameters of SENSOR name. Raises ConfigError, one line, for a bad file."""
    return with_frames(load_sensor(values["sensor_file"]), values["can_fd"])


def declared_frame(node: Node, values: Mapping[str, Any]) -> str:
    """Return the frame that the declared FRAME_ID names; every namespace has one of its own."""
    return values["frame_id"] or "_".join([*node.get_namespace().strip("/").split("/"), "array"]).lstrip("_")
