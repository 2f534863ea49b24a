"""The shipped RViz and Foxglove files show topics that the model node publishes."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

REPOSITORY = Path(__file__).parents[2]
UMBRELLA = REPOSITORY / "src" / "posfet"
README = (REPOSITORY / "README.md").read_text(encoding="utf-8")
MODEL_NODE = "".join(
    (REPOSITORY / "src/posfet_model/posfet_model/ros" / name).read_text(encoding="utf-8")
    for name in ("model_node.py", "model_outputs.py")
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
    for topic, kind in shown.items():
        assert published()[topic.removeprefix("/tactile/")].removesuffix("Stamped") == kind


def test_foxglove_shows_published_topics_on_panels_of_the_layout() -> None:
    layout = json.loads((UMBRELLA / "foxglove/tactile.json").read_text(encoding="utf-8"))
    topics = {re.split(r"[.\[]", text)[0] for text in texts(layout["configById"]) if text.startswith("/")}
    assert {topic.removeprefix("/tactile/") for topic in topics} <= set(published())
    assert {"/tactile/points", "/tactile/contacts", "/diagnostics"} <= topics
    panels = [text for text in texts(layout["layout"]) if "!" in text]
    assert sorted(panels) == sorted(layout["configById"])


def test_the_readme_names_both_files() -> None:
    assert "rviz/tactile.rviz" in README
    assert "foxglove/tactile.json" in README
