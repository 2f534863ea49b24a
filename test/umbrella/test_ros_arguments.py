# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""ROS arguments of bringup: what concerns namespaces and names is taken, the rest is handed on as it is."""

from __future__ import annotations

import pytest

from posfet.arguments import parse
from posfet.graph import graph
from posfet.ros_arguments import RosArguments, split
from posfet_model.config import ConfigError


def test_ros_arguments_end_at_two_dashes_and_keep_their_order() -> None:
    words = ["scene:=hold", "--ros-args", "-p", "x:=1", "-r", "a:=b", "--", "--for", "5", "--ros-args", "-e", "/x"]
    rest, ros = split(words)
    assert rest == ["scene:=hold", "--for", "5"]
    assert ros == RosArguments(words=("--ros-args", "-p", "x:=1", "-r", "a:=b", "-e", "/x"))


@pytest.mark.parametrize("words", [[], ["--ros-args"], ["--ros-args", "--", "--ros-args"]])
def test_without_ros_arguments_nothing_is_handed_on(words: list[str]) -> None:
    assert split(words) == ([], RosArguments())


@pytest.mark.parametrize(
    ("rule", "namespace", "full"),
    [
        ("__ns:=/robot", "tactile", "robot/tactile"),
        ("__ns:=/robot/left/", "hand/thumb", "robot/left/hand/thumb"),
        ("__ns:=/robot", "/tactile", "tactile"),
        ("__ns:=/", "tactile", "tactile"),
    ],
)
def test_the_argument_namespace_is_below_that_of_ros_unless_it_is_absolute(
    rule: str, namespace: str, full: str
) -> None:
    _, ros = split(["--ros-args", "--remap", rule])
    assert ros.within(namespace) == full
    assert not ros.words


def test_nodes_are_renamed_one_by_one_or_all_by_a_prefix() -> None:
    _, one = split(["--ros-args", "-r", "model_node:__node:=brain", "-r", "model_node:__node:=ignored"])
    assert (one.name("model_node"), one.name("driver_node")) == ("brain", "driver_node")
    _, all_of_them = split(["--ros-args", "-r", "__node:=palm", "-r", "model_node:__name:=brain"])
    assert (all_of_them.name("model_node"), all_of_them.name("driver_node")) == ("brain", "palm_driver_node")


@pytest.mark.parametrize(
    ("rule", "reason"),
    [
        ("__node:=a/b", "__node: must be a name without slashes, got 'a/b'"),
        ("model_node:__node:=9", "namespace: must be names"),
        ("__ns:=/a b", "namespace: must be names"),
        ("model_node:__ns:=/x", "the nodes of a sensor share one namespace"),
    ],
)
def test_invalid_names_are_refused_in_one_line(rule: str, reason: str) -> None:
    with pytest.raises(ConfigError, match=reason):
        split(["--ros-args", "-r", rule])


def test_a_remap_without_a_rule_is_left_to_ros() -> None:
    assert split(["--ros-args", "-r"])[1].words == ("--ros-args", "-r")


def test_the_graph_has_the_names_namespace_and_other_arguments_of_ros(tmp_path: pytest.TempPathFactory) -> None:
    path = f"{tmp_path}/parameters.yaml"
    with open(path, "w", encoding="utf-8") as file:
        file.write("/**:\n  ros__parameters:\n    use_sim_time: true\n    qos_overrides: {a: 1}\n")
    _, ros = split(["--ros-args", "-r", "__ns:=/robot", "-r", "model_node:__node:=brain", "-r", "contacts:=touch"])
    model, board = graph(parse(["scene:=hold"]), path, ros)
    assert [(spec.namespace, spec.name) for spec in (model, board)] == [
        ("robot/tactile", "brain"),
        ("robot/tactile", "sim_board_node"),
    ]
    assert model.arguments[:5] == ["--ros-args", "-r", "__node:=brain", "-r", "__ns:=/robot/tactile"]
    assert "contacts:=touch" in model.arguments
    assert '"/robot/tactile/sim_board_node": {"ros__parameters": {' in board.parameter_file()
    assert '"scene": "hold"' in board.parameter_file()


@pytest.mark.parametrize(
    ("node", "key"), [("/**", "frames"), ("/**/driver_node", "scene"), ("/tactile/model_node", "can_channel")]
)
def test_a_parameter_file_names_parameters_of_its_nodes_only(
    tmp_path: pytest.TempPathFactory, node: str, key: str
) -> None:
    path = f"{tmp_path}/parameters.yaml"
    with open(path, "w", encoding="utf-8") as file:
        file.write(f"{node}:\n  ros__parameters:\n    {key}: 1\n")
    with pytest.raises(ConfigError, match=rf"{key}: unknown parameter, (did you mean .*)?known are"):
        graph(parse([]), path)
