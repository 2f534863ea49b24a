# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""One process or several: the same nodes, topics and parameters."""

from __future__ import annotations

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("posfet_msgs", reason="needs the built workspace")

from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.parameter import parameter_value_to_python

from support.bringup_process import needs_installation, running
from support.expectations import Listener
from support.long_cases import long_cases

pytestmark = [pytest.mark.ros, pytest.mark.process, needs_installation]

DIFFERENT = {("/tactile/model_node", "direct")}
"""Expected differences: in one process the model is called directly, and the display needs no node."""


OWN = (
    "raw",
    "truth",
    "contacts",
    "image",
    "view/contacts",
    "view/image",
    "view/truth",
    "wrench",
    "wrench_estimate",
    "force_image",
    "points",
    "vibration",
    "markers",
    "info",
)
SHARED = ("/diagnostics", "/rosout", "/parameter_events")


def describe(listener: Listener, nodes: set[str]) -> tuple[dict[str, list[str]], dict[tuple[str, str], object]]:
    """Return topics with their types, and the value of every parameter by node and name."""
    listener.wait(lambda: nodes <= listener.node_names(), f"the nodes {sorted(nodes)}")
    expected = {*SHARED, *(f"/tactile/{name}" for name in OWN)}
    expected |= {f"{node}/transition_event" for node in nodes}
    listener.wait(lambda: expected <= set(listener.published_topics(nodes)), f"the topics {sorted(expected)}")
    parameters = {}
    for node in sorted(nodes):
        names = listener.call(ListParameters, f"{node}/list_parameters", ListParameters.Request()).result.names
        request = GetParameters.Request(names=names)
        values = listener.call(GetParameters, f"{node}/get_parameters", request).values
        for name, value in zip(names, values, strict=True):
            if (node, name) not in DIFFERENT:
                parameters[node, name] = parameter_value_to_python(value)
    return listener.published_topics(nodes), parameters


@pytest.mark.parametrize(
    ("source", "nodes"),
    long_cases(
        {
            "sim-nodes0": ("sim", {"/tactile/model_node", "/tactile/sim_board_node"}),
            "emulator-nodes1": ("emulator", {"/tactile/model_node", "/tactile/sim_board_node", "/tactile/driver_node"}),
        },
        ["emulator-nodes1"],
    ),
)
def test_both_graphs_are_identical(source: str, nodes: set[str]) -> None:
    described = []
    for composed in ("true", "false"):
        with running(f"source:={source}", f"composed:={composed}", "scene:=hold"), Listener() as listener:
            described.append(describe(listener, nodes))
    (topics, parameters), (separate_topics, separate_parameters) = described
    assert topics == separate_topics  # nothing beyond what was waited for
    assert parameters == separate_parameters
    assert parameters["/tactile/sim_board_node", "scene"] == "hold"
