# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The shipped RViz and Foxglove files show topics that the model node publishes."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

pytest.importorskip("ament_index_python", reason="needs ROS 2")

from posfet.displays import main
from posfet.hand import read_hand
from support.paths import ROOT

REPOSITORY = ROOT
UMBRELLA = REPOSITORY / "src" / "posfet"
DOCUMENT = (REPOSITORY / "docs/displays.md").read_text(encoding="utf-8")
MODEL_NODE = "".join(
    (REPOSITORY / "src/posfet_model/posfet_model/ros" / name).read_text(encoding="utf-8")
    for name in ("model_diagnostics.py", "model_outputs.py", "map_outputs.py")
)


def published() -> dict[str, str]:
    """Return the message type, without its package, of each topic that the model node publishes."""
    return {name: kind for kind, name in re.findall(r'create_publisher\((\w+), "([a-z_/]+)"', MODEL_NODE)}


def texts(value: Any) -> Iterator[str]:
    """Yield every string of a document, including keys."""
    if isinstance(value, dict):
        for key, item in value.items():
            yield str(key)
            yield from texts(item)
    elif isinstance(value, list):
        for item in value:
            yield from texts(item)
    elif isinstance(value, str):
        yield value


def test_rviz_shows_topics_of_their_type_in_the_frame_of_the_array() -> None:
    manager = yaml.safe_load((UMBRELLA / "rviz/tactile.rviz").read_text(encoding="utf-8"))["Visualization Manager"]
    assert manager["Global Options"]["Fixed Frame"] == "tactile_array"
    shown = {
        display["Topic"]["Value"]: display["Class"].removeprefix("rviz_default_plugins/")
        for display in manager["Displays"]
        if "Topic" in display
    }
    assert set(shown) == {"/tactile/points", "/tactile/markers", "/tactile/wrench", "/tactile/force_image"}
    topics = [display["Topic"] for display in manager["Displays"] if "Topic" in display]
    assert {topic["Reliability Policy"] for topic in topics} == {"Best Effort"}, "takes from publishers of both kinds"
    for topic, kind in shown.items():
        assert published()[topic.removeprefix("/tactile/")].removesuffix("Stamped") == kind


def test_foxglove_shows_published_topics_on_panels_of_the_layout() -> None:
    layout = json.loads((UMBRELLA / "foxglove/tactile.json").read_text(encoding="utf-8"))
    topics = {re.split(r"[.\[]", text)[0] for text in texts(layout["configById"]) if text.startswith("/")}
    assert {topic.removeprefix("/tactile/") for topic in topics} <= set(published())
    assert {"/tactile/points", "/tactile/view/contacts", "/diagnostics"} <= topics
    panels = [text for text in texts(layout["layout"]) if "!" in text]
    assert sorted(panels) == sorted(layout["configById"])


def test_the_document_names_both_files() -> None:
    assert "rviz/tactile.rviz" in DOCUMENT
    assert "foxglove/tactile.json" in DOCUMENT


def shown_topics(document: Any) -> set[str]:
    return {re.split(r"[.\[]", text)[0] for text in texts(document) if text.startswith("/")}


def test_displays_of_a_hand_show_every_sensor_in_its_frame(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    hand = UMBRELLA / "config/hand.yaml"
    assert main(["--hand", str(hand), "--fixed-frame", "wrist", "--out", str(tmp_path / "hand")]) == 0
    assert capsys.readouterr().out.splitlines() == [f"{tmp_path}/hand.{end}: written" for end in ("rviz", "json")]
    manager = yaml.safe_load((tmp_path / "hand.rviz").read_text(encoding="utf-8"))["Visualization Manager"]
    assert manager["Global Options"]["Fixed Frame"] == "wrist"
    names = [sensor["namespace"] for sensor in read_hand(hand)]
    grids = [each["Reference Frame"] for each in manager["Displays"] if each["Class"].endswith("Grid")]
    assert grids == [f"{name.replace('/', '_')}_array" for name in names]
    labels = [each["Name"] for each in manager["Displays"]]
    assert len(labels) == len(set(labels)) == 5 * len(names)
    of_one = shown_topics(yaml.safe_load((UMBRELLA / "rviz/tactile.rviz").read_text(encoding="utf-8")))
    assert shown_topics(manager) == {topic.replace("/tactile", f"/{name}") for topic in of_one for name in names}

    layout = json.loads((tmp_path / "hand.json").read_text(encoding="utf-8"))
    of_one = shown_topics(json.loads((UMBRELLA / "foxglove/tactile.json").read_text(encoding="utf-8"))["configById"])
    expected = {topic.replace("/tactile", f"/{name}") for topic in of_one for name in names}
    assert shown_topics(layout["configById"]) == expected
    tabs = layout["configById"]["Tab!sensors"]["tabs"]
    assert [tab["title"] for tab in tabs] == names
    used = [text for text in texts([layout["layout"], tabs]) if "!" in text]
    assert sorted(used) == sorted(layout["configById"])


def test_displays_need_a_namespace_that_is_valid(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["hand/9", "--out", str(tmp_path / "hand")]) == 1
    assert capsys.readouterr().err.startswith("namespace: must be names of")
    assert not list(tmp_path.iterdir())
