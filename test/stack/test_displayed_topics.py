# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Every topic, message type, field, quality of service and frame of the written displays is that of a running stack."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from contextlib import ExitStack
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import yaml

rclpy = pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("posfet_msgs", reason="needs the built workspace")

from rclpy.context import Context

import posfet.bringup
from posfet.displays import main
from posfet_msgs.msg import TactileInfo
from support.bringup_process import needs_installation
from support.expectations import Listener

pytestmark = [pytest.mark.ros, pytest.mark.process, needs_installation]

SENSORS = {"hand/thumb": "posfet_5x5", "hand/palm": "posfet_16x16"}
TYPES = {
    "PointCloud2": "sensor_msgs/msg/PointCloud2",
    "MarkerArray": "visualization_msgs/msg/MarkerArray",
    "Wrench": "geometry_msgs/msg/WrenchStamped",
    "Image": "sensor_msgs/msg/Image",
}
"""Message of each display of rviz_default_plugins."""


class Shown(NamedTuple):
    """What a display subscribes to."""

    topic: str
    types: set[str]
    """Types that it can show; empty: any."""
    fields: str = ""
    """Path of fields in the message; '': the whole message."""


def of_rviz(manager: dict[str, Any]) -> Iterator[Shown]:
    for display in manager["Displays"]:
        if "Topic" in display:
            assert display["Topic"]["Reliability Policy"] == "Best Effort", "takes from publishers of both kinds"
            yield Shown(display["Topic"]["Value"], {TYPES[display["Class"].removeprefix("rviz_default_plugins/")]})


def of_foxglove(layout: dict[str, Any]) -> Iterator[Shown]:
    for name, panel in layout["configById"].items():
        kind = name.partition("!")[0]
        if kind == "3D":
            yield from (Shown(topic, {TYPES["PointCloud2"], TYPES["MarkerArray"]}) for topic in panel["topics"])
        elif kind == "Image":
            yield Shown(panel["imageMode"]["imageTopic"], {TYPES["Image"]})
        elif kind == "Plot":
            yield from (Shown(*_split(path["value"])) for path in panel["paths"])
        elif kind == "RawMessages":
            yield Shown(*_split(panel["topicPath"]))
        elif kind == "DiagnosticSummary":
            yield Shown(panel["topicToRender"], {"diagnostic_msgs/msg/DiagnosticArray"})
        else:
            assert kind == "Tab", name


def _split(path: str) -> tuple[str, set[str], str]:
    topic, _, fields = path.partition(".")
    return topic, set(), fields


def has_fields(kind: str, path: str) -> bool:
    """Return whether a message type has the fields of a path; only the last one may be no message."""
    for name in filter(None, re.sub(r"\[.*?\]", "", path).split(".")):
        package, _, message = kind.split("/")
        fields = getattr(import_module(f"{package}.msg"), message).get_fields_and_field_types()
        if name not in fields:
            return False
        kind = re.sub(r"sequence<(.*?)(, \d+)?>|\[\d+\]", r"\1", fields[name]).replace("/", "/msg/")
    return True


@pytest.fixture(scope="module")
def graph() -> Iterator[Listener]:
    """Run two sensors, and return a listener that knows all of their topics."""
    context = Context()
    rclpy.init(context=context)
    with ExitStack() as stack:
        stack.callback(rclpy.shutdown, context=context)
        for name, sensor in SENSORS.items():
            arguments = {"namespace": name, "sensor_file": sensor, "scene": "idle"}
            for node in stack.enter_context(posfet.bringup.nodes(context, **arguments)):
                node.serve()  # as when an executor begins to spin
        yield stack.enter_context(Listener(""))


@pytest.fixture
def files(tmp_path: Path) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return what RViz and Foxglove read."""
    assert main([*SENSORS, "--out", str(tmp_path / "hand")]) == 0
    texts = [(tmp_path / f"hand.{end}").read_text(encoding="utf-8") for end in ("rviz", "json")]
    return yaml.safe_load(texts[0])["Visualization Manager"], json.loads(texts[1])


def test_displays_show_topics_types_and_fields_of_the_running_graph(
    graph: Listener, files: tuple[dict[str, Any], dict[str, Any]]
) -> None:
    shown = [*of_rviz(files[0]), *of_foxglove(files[1])]
    assert len(shown) == len(SENSORS) * (4 + 5) + 1
    model_nodes = {f"/{name}/model_node" for name in SENSORS}
    graph.wait(lambda: model_nodes <= graph.node_names(), "the nodes of every sensor")
    graph.wait(
        lambda: {each.topic for each in shown} <= set(graph.published_topics(model_nodes)), "the topics of the displays"
    )
    published = graph.published_topics(model_nodes)
    for each in shown:
        (kind,) = published[each.topic]
        assert kind in (each.types or {kind}), each
        assert has_fields(kind, each.fields), each
        assert graph.is_reliable(each.topic), each


def test_displays_are_in_frames_of_the_running_graph(
    graph: Listener, files: tuple[dict[str, Any], dict[str, Any]]
) -> None:
    infos = {name: graph.collect(TactileInfo, f"/{name}/info", transient_local=True) for name in SENSORS}
    graph.wait(lambda: all(infos.values()), "info of every sensor")
    frames = [info[0].header.frame_id for info in infos.values()]
    manager, layout = files
    assert [each["Reference Frame"] for each in manager["Displays"] if "Reference Frame" in each] == frames
    assert manager["Global Options"]["Fixed Frame"] == frames[0]
    assert layout["configById"]["3D!array"]["followTf"] == frames[0]


@pytest.mark.parametrize(
    ("path", "there"),
    [("total_force", True), ("contacts[:]", False), ("header.stamp.sec", True), ("header.stamp.second", False)],
)
def test_fields_that_a_message_does_not_have_are_found(path: str, there: bool) -> None:
    assert has_fields("posfet_msgs/msg/TactileImage", path) is there
