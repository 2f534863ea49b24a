# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The configuration of diagnostic_aggregator finds every status that the stack publishes, by the aggregator's rules."""

from __future__ import annotations

import time
from typing import Any

import pytest
import yaml

from support.expectations import TIMEOUT
from support.paths import ROOT

CONFIGURATION = ROOT / "src" / "posfet" / "config" / "diagnostics.yaml"
GROUP: dict[str, Any] = yaml.safe_load(CONFIGURATION.read_text(encoding="utf-8"))["/**"]["ros__parameters"]["tactile"]


def analyzers_of(name: str) -> list[str]:
    """Return the path of each analyzer that takes a status, by the rules of GenericAnalyzer."""
    return [each["path"] for each in GROUP["analyzers"].values() if any(text in name for text in each["contains"])]


@pytest.mark.parametrize(
    ("name", "path"),
    [
        ("tactile/model_node: reconstruction", "Models"),
        ("robot/hand/thumb/model_node: reconstruction", "Models"),
        ("tactile/driver_node: board", "Boards"),
        ("hand/palm/sim_board_node: board", "Boards"),
        ("tactile/replay_node: board", "Boards"),
        ("arm/driver_node: joints", None),
    ],
)
def test_each_status_belongs_to_one_analyzer(name: str, path: str | None) -> None:
    assert analyzers_of(name) == ([path] if path else [])


@pytest.mark.ros
def test_the_statuses_of_all_nodes_have_the_form_of_diagnostic_updater_and_belong_to_one_analyzer_each(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rclpy = pytest.importorskip("rclpy", reason="needs ROS 2")
    pytest.importorskip("posfet_msgs", reason="needs the built workspace")
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus  # noqa: PLC0415
    from rclpy.executors import SingleThreadedExecutor  # noqa: PLC0415

    import posfet.bringup  # noqa: PLC0415

    for node in ("posfet_model.ros.model_diagnostics", "posfet_driver.ros.scan_source_node"):
        monkeypatch.setattr(f"{node}.REPORT_PERIOD", 0.05)
    context, found = rclpy.Context(), {}

    def keep(message: DiagnosticArray) -> None:
        found.update({status.name: (status, message.header) for status in message.status})

    rclpy.init(context=context)
    executor = SingleThreadedExecutor(context=context)
    listener = rclpy.create_node("listener", context=context)
    listener.create_subscription(DiagnosticArray, "/diagnostics", keep, 100)
    with posfet.bringup.nodes(context, namespace="hand/thumb", source="emulator", serial="S-1") as stack:
        for node in (listener, *stack):
            executor.add_node(node)
        end = time.monotonic() + TIMEOUT
        while len(found) < 3:
            assert time.monotonic() < end, sorted(found)
            executor.spin_once(timeout_sec=0.05)
    executor.shutdown()
    listener.destroy_node()
    rclpy.shutdown(context=context)
    assert {name: analyzers_of(name) for name in found} == {
        "hand/thumb/driver_node: board": ["Boards"],
        "hand/thumb/model_node: reconstruction": ["Models"],
        "hand/thumb/sim_board_node: board": ["Boards"],
    }
    for status, header in found.values():
        assert status.hardware_id == "S-1"
        assert status.message
        assert status.level in {DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR}
        assert header.stamp.sec > 0
        assert header.frame_id == ""


@pytest.mark.ros
def test_the_aggregator_gets_parameters_of_the_types_that_it_asks_for() -> None:
    """By the parser of ROS, for a node with the name of the aggregator's, which asks for nothing by name beforehand."""
    rclpy = pytest.importorskip("rclpy", reason="needs ROS 2")
    from rclpy.parameter import Parameter  # noqa: PLC0415

    context = rclpy.Context()
    rclpy.init(context=context)
    arguments = ["--ros-args", "--params-file", str(CONFIGURATION)]
    node = rclpy.create_node(
        "analyzers", context=context, cli_args=arguments, automatically_declare_parameters_from_overrides=True
    )
    try:
        given = {name: each.type_ for name, each in node.get_parameters_by_prefix("tactile.analyzers").items()}
        assert node.get_parameter("path").type_ == Parameter.Type.STRING
    finally:
        node.destroy_node()
        rclpy.shutdown(context=context)
    wanted = {
        "contains": Parameter.Type.STRING_ARRAY,
        "path": Parameter.Type.STRING,
        "timeout": Parameter.Type.DOUBLE,  # as_double of rclcpp takes no integer
        "type": Parameter.Type.STRING,
    }
    assert given == {f"{name}.{key}": kind for name in GROUP["analyzers"] for key, kind in wanted.items()}


def test_every_analyzer_has_a_type_of_the_aggregator_and_a_time_after_which_it_says_stale() -> None:
    assert GROUP["type"] == "diagnostic_aggregator/AnalyzerGroup"
    for analyzer in GROUP["analyzers"].values():
        assert analyzer["type"] == "diagnostic_aggregator/GenericAnalyzer"
        assert analyzer["timeout"] > 1.0
