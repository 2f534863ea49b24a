# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Declare the ROS parameters of a node from its table, with type, range and description, and check their values."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.exceptions import ParameterException
from rclpy.node import Node

from posfet_model.config import ConfigError
from posfet_model.parameters import STANDARD, Parameter, default_frame
from posfet_model.ros.supervision import SupervisedNode
from posfet_model.sensor.description import Sensor, load_sensor, with_frames, with_serial


def descriptor(parameter: Parameter) -> ParameterDescriptor:
    """Return the ROS descriptor of a parameter, statically typed, with the range that rqt needs for a slider."""
    unit = f" [{parameter.unit}]" if parameter.unit else ""
    described = ParameterDescriptor(
        description=f"{parameter.summary}{unit}",
        additional_constraints=parameter.allowed,
        read_only=parameter.read_only,
    )
    if not parameter.bounded:
        return described
    if parameter.type_name == "integer":
        limit = 2**63 - 1
        low, high = max(parameter.low, -limit), min(parameter.high, limit)
        described.integer_range = [IntegerRange(from_value=int(low), to_value=int(high), step=1)]
    elif parameter.type_name == "double":
        largest = sys.float_info.max
        low, high = max(parameter.low, -largest), min(parameter.high, largest)
        described.floating_point_range = [FloatingPointRange(from_value=low, to_value=high, step=0.0)]
    return described


Prepare = Callable[[Mapping[str, Any]], Callable[[], object]]
"""Takes all parameters with changes in them; returns what applies the changes, or raises ConfigError."""


def declare(node: Node, table: Sequence[Parameter], prepare: Prepare | None = None) -> dict[str, Any]:
    """Declare all parameters of a node and return their checked values by name.

    One that the node does not have is ignored with a warning: a launch file may give its parameters to all nodes.

    Parameters
    ----------
    node : Node
        Node without declared parameters.
    table : sequence of Parameter
        All parameters of the node.
    prepare : callable, optional
        Applies changes while the node runs: all that are set together, or none of them.

    Returns
    -------
    dict
        The values by name, updated when they change.

    Raises
    ------
    ConfigError
        For a value that is not allowed: one line with node, parameter, what is allowed and what was given.
    """
    name = node.get_fully_qualified_name()
    known = [parameter.name for parameter in table]
    given = _given(node)
    unknown = [key for key in sorted(given) if key not in known and not key.startswith(STANDARD)]
    if unknown:
        node.get_logger().warning(f"ignored, this node has no such parameter: {', '.join(unknown)}")
    values: dict[str, Any] = {}
    for parameter in table:
        try:
            value = node.declare_parameter(parameter.name, parameter.default, descriptor(parameter)).value
        except ParameterException as error:
            found = getattr(given.get(parameter.name), "value", None)
            raise ConfigError(f"{name}: {parameter.name}: must be {parameter.allowed}, got {found!r}") from error
        # rclpy checks neither texts nor the items of lists, and not every version rejects NaN.
        reason = parameter.check(value)
        if reason:
            raise ConfigError(f"{name}: {parameter.name}: {reason}")
        values[parameter.name] = value
    _Changes(node, {each.name: each for each in table if not each.read_only}, values, prepare)
    if isinstance(node, SupervisedNode):
        node.fixed_parameters = {each.name: each.fixed for each in table if each.read_only}
    return values


class _Changes:
    """Checks parameters that are set while the node runs, and applies all changes of one call, or none."""

    def __init__(
        self, node: Node, writable: Mapping[str, Parameter], values: dict[str, Any], prepare: Prepare | None
    ) -> None:
        self._writable, self._values, self._prepare = writable, values, prepare
        self._changed: dict[str, Any] = {}
        self._apply: Callable[[], object] | None = None
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._set)

    def _check(self, changes: Sequence[Any]) -> SetParametersResult:
        self._apply = None
        ours = {change.name: change.value for change in changes if change.name in self._writable}
        reasons = [f"{name}: {reason}" for name, value in ours.items() if (reason := self._writable[name].check(value))]
        if ours and not reasons and self._prepare:
            try:
                self._apply = self._prepare({**self._values, **ours})
            except ConfigError as error:
                reasons = [str(error)]
        self._changed = ours
        return SetParametersResult(successful=not reasons, reason="; ".join(reasons))

    def _set(self, _: object) -> None:
        """Apply what was checked, once no callback of the node rejects it."""
        self._values.update(self._changed)
        apply, self._apply = self._apply, None
        if apply:
            apply()


def _given(node: Node) -> Mapping[str, Any]:
    """Return the rclpy parameters that were given to `node`, by name.

    rclpy has no public access to those that are not declared. Where the private one is missing, none are known, and a
    misspelt name goes unnoticed.
    """
    return getattr(node, "_parameter_overrides", {})


def declared_sensor(values: Mapping[str, Any]) -> Sensor:
    """Return the sensor that the declared parameters of SENSOR name. Raises ConfigError, one line, for a bad file."""
    return with_serial(with_frames(load_sensor(values["sensor_file"]), values["can_fd"]), values["serial"])


def declared_frame(node: Node, values: Mapping[str, Any]) -> str:
    """Return the frame that the declared FRAME_ID names; the default is unique for each namespace.

    Parameters
    ----------
    node : Node
        Node with its namespace.
    values : mapping of str to object
        Checked parameters of the node by name.
    """
    return values["frame_id"] or default_frame(node.get_namespace())
