# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Parameters of a node as seen and set by other nodes: types, ranges, descriptions, and rejected values."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import pytest

rclpy = pytest.importorskip("rclpy", reason="needs ROS 2")

from rcl_interfaces.msg import ParameterType
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from posfet_model.config import ConfigError
from posfet_model.parameters import Parameter
from posfet_model.ros.ros_parameters import declare
from posfet_model.ros.supervision import SupervisedNode

pytestmark = pytest.mark.ros

TABLE = (
    Parameter("bitrate", 0, "Bitrate", unit="bit/s", low=0, high=1_000_000),
    Parameter("rate", 1000.0, "Scan rate", unit="Hz", low=1.0, high=4000.0, read_only=False),
    Parameter("least", 1.0, "Smallest force", unit="N", low=0.0),
    Parameter("frames", "auto", "Frames", choices=("auto", "true"), read_only=False),
    Parameter("on", True, "Whether it is on"),
    Parameter("file", "", "File", empty="none"),
    Parameter("options", [""], "Options"),
)


@pytest.fixture
def context() -> Iterator[Context]:
    made = Context()
    rclpy.init(context=made)
    yield made
    rclpy.shutdown(context=made)


def node_with(context: Context, *words: str) -> Node:
    arguments = ["--ros-args", *(part for word in words for part in ("-p", word))] if words else []
    return Node("probe", context=context, cli_args=arguments, use_global_arguments=False)


def test_descriptors_have_type_range_description_and_constraints(context: Context) -> None:
    node = node_with(context)
    values = declare(node, TABLE)
    assert values == {parameter.name: parameter.default for parameter in TABLE}
    bitrate, rate, least, frames, on, file, options = (node.describe_parameter(parameter.name) for parameter in TABLE)
    types = [descriptor.type for descriptor in (bitrate, rate, least, frames, on, file, options)]
    assert types == [
        ParameterType.PARAMETER_INTEGER,
        ParameterType.PARAMETER_DOUBLE,
        ParameterType.PARAMETER_DOUBLE,
        ParameterType.PARAMETER_STRING,
        ParameterType.PARAMETER_BOOL,
        ParameterType.PARAMETER_STRING,
        ParameterType.PARAMETER_STRING_ARRAY,
    ]
    assert not any(descriptor.dynamic_typing for descriptor in (bitrate, rate, frames, options))
    [whole] = bitrate.integer_range
    assert (whole.from_value, whole.to_value, whole.step) == (0, 1_000_000, 1)
    [real] = rate.floating_point_range
    assert (real.from_value, real.to_value, real.step) == (1.0, 4000.0, 0.0)
    [half] = least.floating_point_range
    assert half.from_value == 0.0
    assert math.isfinite(half.to_value)
    assert not frames.integer_range
    assert not frames.floating_point_range
    assert bitrate.description == "Bitrate [bit/s]"
    assert file.description == "File; empty: none"
    assert bitrate.additional_constraints == "a whole number in [0, 1000000] bit/s"
    assert frames.additional_constraints == "one of auto, true"
    assert [descriptor.read_only for descriptor in (bitrate, rate)] == [True, False]
    node.destroy_node()


@pytest.mark.parametrize(
    ("word", "reason"),
    [
        ("bitrate:=fast", "bitrate: must be a whole number in [0, 1000000] bit/s, got 'fast'"),
        ("bitrate:=5.0", "bitrate: must be a whole number in [0, 1000000] bit/s, got 5.0"),
        ("bitrate:=true", "bitrate: must be a whole number in [0, 1000000] bit/s, got True"),
        ("bitrate:=1000001", "bitrate: must be a whole number in [0, 1000000] bit/s, got 1000001"),
        ("bitrate:=[1, 2]", "bitrate: must be a whole number in [0, 1000000] bit/s, got "),
        ("rate:=5", "rate: must be a number with a decimal point in [1, 4000] Hz, got 5"),
        ("rate:=.nan", "rate: must be a number with a decimal point in [1, 4000] Hz, got nan"),
        ("rate:=.inf", "rate: must be a number with a decimal point in [1, 4000] Hz, got inf"),
        ("frames:=classic", "frames: must be one of auto, true, got 'classic'"),
        ("frames:=true", "frames: must be one of auto, true, got True"),
        ("on:='no thanks'", "on: must be true or false, got 'no thanks'"),
        ("file:=5", "file: must be text, got 5"),
        ("options:=text", "options: must be a list of texts, got 'text'"),
        ("options:=[1, 2]", "options: must be a list of texts, got "),
    ],
)
def test_an_invalid_value_is_rejected_in_one_line(context: Context, word: str, reason: str) -> None:
    node = node_with(context, word)
    with pytest.raises(ConfigError) as refused:
        declare(node, TABLE)
    assert str(refused.value).startswith(f"/probe: {reason}")
    assert "\n" not in str(refused.value)
    node.destroy_node()


def test_parameters_that_a_launch_file_gives_to_all_nodes_are_ignored_with_a_warning(
    context: Context, capfd: pytest.CaptureFixture[str]
) -> None:
    node = node_with(context, "bit_rate:=5", "use_sim_time:=true")
    assert "bit_rate" not in declare(node, TABLE)
    assert node.get_parameter("use_sim_time").value is True
    node.destroy_node()
    warning = [line for line in capfd.readouterr().err.splitlines() if "ignored" in line]
    assert len(warning) == 1
    assert warning[0].endswith("ignored, this node has no such parameter: bit_rate")


def test_timers_run_while_simulated_time_stands_still(context: Context) -> None:
    node = SupervisedNode("probe", context=context, parameter_overrides=[RosParameter("use_sim_time", value=True)])
    calls: list[int] = []

    def count() -> None:
        calls.append(node.get_clock().now().nanoseconds)

    node.create_timer(0.001, count)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    while len(calls) < 3:
        executor.spin_once(timeout_sec=10.0)
    assert set(calls) == {0}  # no /clock
    executor.shutdown()
    node.destroy_node()


def test_given_values_keep_their_types(context: Context) -> None:
    node = node_with(context, "bitrate:=500000", "rate:=50.0", "frames:='true'", "options:=[a=1, b=2]", "on:=false")
    values = declare(node, TABLE)
    assert (values["bitrate"], values["rate"], values["frames"], values["on"]) == (500_000, 50.0, "true", False)
    assert list(values["options"]) == ["a=1", "b=2"]
    node.destroy_node()


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("rate", 50.0, ""),
        ("rate", 5000.0, "rate"),
        ("rate", math.nan, "nan"),
        ("rate", 5, "type"),
        ("frames", "true", ""),
        ("frames", "classic", "frames: must be one of auto, true, got 'classic'"),
        ("bitrate", 5, "read-only"),
    ],
)
def test_a_running_node_accepts_only_valid_values_of_writable_parameters(
    context: Context, name: str, value: Any, reason: str
) -> None:
    node = node_with(context)
    declare(node, TABLE)
    before = node.get_parameter(name).value
    [result] = node.set_parameters([RosParameter(name, value=value)])
    assert result.successful == (not reason)
    assert reason in result.reason
    assert node.get_parameter(name).value == (before if reason else value)
    node.destroy_node()
