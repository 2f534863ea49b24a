# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The example of an SROS2 policy: it allows the stack what it does, a controller to read, an operator to calibrate."""

from __future__ import annotations

import time
from collections.abc import Iterator
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

rclpy = pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("posfet_msgs", reason="needs the built posfet_msgs")

from rclpy.node import Node
from rclpy.parameter import Parameter

from posfet.display_node import display_node
from posfet.record import RecorderNode
from posfet.stack_client import StackClient
from posfet.view_node import ViewNode
from posfet.web.recording import TOPICS
from posfet_driver.ros.driver_node import DriverNode
from posfet_model.ros.model_node import ModelNode
from posfet_sim.recording.mcap_file import MessageFile
from posfet_sim.ros.replay_node import ReplayNode
from posfet_sim.ros.sim_board_node import SimBoardNode
from support.expectations import TIMEOUT
from support.paths import DATA, DOCS, ROOT

pytestmark = pytest.mark.ros
POLICY = ROOT / "src" / "posfet" / "config" / "sros2_policy.xml"
RULES = {"topics": ("topic", {"publish", "subscribe"}), "services": ("service", {"reply", "request"})}


def allowed(enclave: str, rule: str) -> set[str]:
    """Return the full names for which an enclave has a rule: publish, subscribe, reply or request."""
    names = set()
    for profile in (
        ElementTree.parse(POLICY).getroot().iterfind(f"enclaves/enclave[@path='{enclave}']/profiles/profile")
    ):
        space, node = profile.attrib["ns"].rstrip("/"), profile.attrib["node"]
        for expressions in profile:
            if expressions.get(rule) == "ALLOW":
                for expression in expressions:
                    text = expression.text or ""
                    names.add(text if text[0] == "/" else f"{space}/{text.replace('~', node)}")
    return names


@pytest.fixture
def nodes(request: pytest.FixtureRequest) -> Iterator[list[Node]]:
    rclpy.init()
    made = request.param()
    yield made
    for node in made:
        node.destroy_node()
    rclpy.shutdown()


def make_view() -> list[Node]:
    node = display_node("tactile")
    return [node, ViewNode(StackClient(node, "tactile"))]


def make_replay(parameter_overrides: list[Parameter], **arguments: Any) -> Node:
    recording = Parameter("replay_file", value=str(DATA / "recording" / "posfet_0.2.0.mcap"))
    return ReplayNode(parameter_overrides=[*parameter_overrides, recording], **arguments)


def make_others(kind: Any) -> Any:
    simulated_time = Parameter("use_sim_time", value=True)  # subscribes to /clock

    def make() -> list[Node]:
        node = kind(namespace="/tactile", parameter_overrides=[simulated_time])
        node.serve()  # as when an executor begins to spin
        return [node]

    return make


def test_the_policy_has_the_form_that_sros2_expects() -> None:
    """Check what the schema of policies 0.2.0 in sros2 requires."""
    policy = ElementTree.parse(POLICY).getroot()
    assert (policy.tag, policy.attrib) == ("policy", {"version": "0.2.0"})
    assert [child.tag for child in policy] == ["enclaves"]
    for enclave in policy[0]:
        assert (enclave.tag, set(enclave.attrib)) == ("enclave", {"path"})
        assert [child.tag for child in enclave] == ["profiles"]
        for profile in enclave[0]:
            assert (profile.tag, set(profile.attrib)) == ("profile", {"ns", "node"})
            for expressions in profile:
                tag, rules = RULES[expressions.tag]
                assert set(expressions.attrib) <= rules
                assert set(expressions.attrib.values()) == {"ALLOW"}
                assert {expression.tag for expression in expressions} == {tag}


@pytest.mark.parametrize(
    ("nodes", "count"),
    [
        (make_others(ModelNode), 15),
        (make_others(DriverNode), 13),
        (make_others(SimBoardNode), 13),
        (make_others(make_replay), 12),
        (make_view, 2),
    ],
    indirect=["nodes"],
)
def test_the_stack_may_do_all_that_its_nodes_do(nodes: list[Node], count: int) -> None:
    """Check the names in use; `count` services: of a lifecycle 5, of parameters 6, the description, and its own."""
    services: set[str] = set()
    for node in nodes:
        name, space = node.get_name(), node.get_namespace()
        published = {topic for topic, _ in node.get_publisher_names_and_types_by_node(name, space)}
        subscribed = {topic for topic, _ in node.get_subscriber_names_and_types_by_node(name, space)}
        served = {service for service, _ in node.get_service_names_and_types_by_node(name, space)}
        called = {service for service, _ in node.get_client_names_and_types_by_node(name, space)}
        services |= served
        assert "/rosout" in published
        assert published <= allowed("/tactile", "publish")
        assert subscribed <= allowed("/tactile", "subscribe")
        assert served <= allowed("/tactile", "reply")
        assert called <= allowed("/tactile", "request")
    assert len(services) == count


def test_a_controller_can_only_read_and_an_operator_also_calibrates() -> None:
    assert not allowed("/grasp_controller", "request")
    for enclave in ("/grasp_controller", "/operator"):
        assert allowed(enclave, "publish") == {"/rosout", "/parameter_events"}
        assert "/tactile/contacts" in allowed(enclave, "subscribe")
    assert allowed("/operator", "request") == {
        "/tactile/tare",
        "/tactile/calibration/load",
        "/tactile/calibration/save",
    }


def test_the_page_on_security_names_every_service_of_the_stack() -> None:
    page = (DOCS / "security.md").read_text(encoding="utf-8")
    for service in ("tare", "command", "calibration/load", "calibration/save", "scene/load", "change_state"):
        assert service in page
        assert any(name.endswith(f"/{service}") for name in allowed("/tactile", "reply"))


def test_a_recording_from_the_browser_may_do_all_that_it_does(tmp_path: Path) -> None:
    pytest.importorskip("mcap", reason="recordings need the package mcap")
    rclpy.init()
    nodes = [make_others(kind)()[0] for kind in (ModelNode, DriverNode)]  # publish what is recorded
    file = MessageFile(tmp_path / "x.mcap", "test")
    recorder = RecorderNode(file, ["tactile"], TOPICS)
    try:
        end = time.monotonic() + TIMEOUT
        while len(recorder.subscribed) < len(TOPICS):
            assert time.monotonic() < end, recorder.subscribed
            recorder._discover()
            time.sleep(0.02)
        for name in (recorder.get_name(), f"{recorder.get_name()}_topics"):
            for rule, found in (
                ("publish", recorder.get_publisher_names_and_types_by_node(name, "/")),
                ("subscribe", recorder.get_subscriber_names_and_types_by_node(name, "/")),
                ("reply", recorder.get_service_names_and_types_by_node(name, "/")),
                ("request", recorder.get_client_names_and_types_by_node(name, "/")),
            ):
                rules = allowed("/tactile", rule)
                assert [used for used, _ in found if not any(fnmatchcase(used, each) for each in rules)] == []
    finally:
        file.close()
        for node in (*nodes, recorder):
            node.destroy_node()
        rclpy.shutdown()
