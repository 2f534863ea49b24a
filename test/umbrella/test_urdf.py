# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The macro of the sensor for robot descriptions: its frames and sizes are those that the nodes publish."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

pytest.importorskip("xacro", reason="needs xacro")
pytest.importorskip("posfet_msgs", reason="needs the built workspace")

import xacro

from posfet_model.parameters import default_frame
from posfet_model.ros.info_message import info_message
from posfet_model.ros.mount import parse_mount
from posfet_model.sensor.description import SENSOR_FOLDER, load_sensor
from support.bringup_process import needs_installation
from support.paths import EXAMPLES, PACKAGE

FLAT = SENSOR_FOLDER / "posfet_5x5.yaml"


def bent_sensor(folder: Path, axis: str) -> Path:
    path = folder / f"bent_{axis}.yaml"
    text = FLAT.read_text(encoding="utf-8").replace("  cols: 5", "  cols: 4")
    for commented, used in (
        ("# bend_radius_mm: 20.0 ", "bend_radius_mm: 9.0 "),
        ("# bend_axis: x ", f"bend_axis: {axis} "),
    ):
        text = text.replace(commented, used)
    path.write_text(text, encoding="utf-8")
    return path


def numbers(element: ElementTree.Element | None, name: str) -> np.ndarray:
    return np.array([0.0] * 3 if element is None else [float(word) for word in element.get(name, "0 0 0").split()])


def matrix(rpy: np.ndarray) -> np.ndarray:
    """Return the rotation of a pose of URDF."""
    x, y, z, w = parse_mount(f"0 0 0 {' '.join(map(str, rpy))}").orientation
    axis = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + 2 * w * axis + 2 * axis @ axis


@pytest.fixture
def finger(tmp_path: Path, request: pytest.FixtureRequest) -> ElementTree.Element:
    """Return the shipped example with a flat sensor and one that is bent about the axis of the test."""
    mappings = {
        "macro": str(PACKAGE / "urdf/posfet.urdf.xacro"),
        "flat": str(FLAT),
        "bent": str(bent_sensor(tmp_path, request.param)),
    }
    document = xacro.process_file(str(EXAMPLES / "finger.urdf.xacro"), mappings=mappings)
    return ElementTree.fromstring(document.toxml())


@pytest.mark.parametrize("finger", ["x"], indirect=True)
def test_links_are_the_frames_of_the_nodes(finger: ElementTree.Element) -> None:
    links = {link.get("name") for link in finger.findall("link")}
    assert links == {"finger", default_frame("/finger/tip"), default_frame("/finger/side")}
    for joint in finger.findall("joint"):
        assert joint.get("type") == "fixed"
        assert joint.find("parent").get("link") == "finger"
        assert joint.find("child").get("link") in links


@needs_installation
def test_the_example_finds_macro_and_sensor_files_where_they_are_installed() -> None:
    document = ElementTree.fromstring(xacro.process_file(str(EXAMPLES / "finger.urdf.xacro")).toxml())
    layout = load_sensor(FLAT).layout
    for name in ("finger_tip_array", "finger_side_array"):
        [box] = document.findall(f"link[@name='{name}']/collision/geometry/box")
        assert numbers(box, "size")[:2] == pytest.approx([layout.cols * layout.pitch_x, layout.rows * layout.pitch_y])


@pytest.mark.parametrize("finger", ["x", "y"], indirect=True)
@pytest.mark.parametrize("which", ["tip", "side"])
def test_every_published_taxel_lies_on_a_face_of_the_chip(
    finger: ElementTree.Element, which: str, tmp_path: Path
) -> None:
    sensor = load_sensor(FLAT if which == "tip" else next(tmp_path.glob("bent_*.yaml")))
    layout = sensor.layout
    info = info_message(sensor, default_frame(f"finger/{which}"), True, 0)
    link = next(each for each in finger.findall("link") if each.get("name") == info.header.frame_id)
    boxes = [
        (
            numbers(part.find("origin"), "xyz"),
            matrix(numbers(part.find("origin"), "rpy")),
            numbers(part.find(".//box"), "size"),
        )
        for part in link.findall("collision")
    ]
    assert len(boxes) == (1 if which == "tip" else layout.rows if layout.bend_axis == "x" else layout.cols)
    assert len(link.findall("visual")) == len(boxes)
    for pose in info.taxel_poses:
        point = np.array([pose.position.x, pose.position.y, pose.position.z])
        x, y, z, w = (getattr(pose.orientation, name) for name in "xyzw")
        normal = np.array([2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)])
        on = []
        for middle, rotation, size in boxes:
            inside = rotation.T @ (point - middle)
            if (
                np.all(np.abs(inside[:2]) <= size[:2] / 2 - 0.4 * layout.pitch_x)
                and abs(inside[2] - size[2] / 2) < 1e-9
            ):
                on.append(rotation @ [0.0, 0.0, 1.0])
        assert len(on) == 1, point
        assert on[0] == pytest.approx(normal, abs=1e-9)
    width, height = layout.cols * layout.pitch_x, layout.rows * layout.pitch_y
    area = sum(size[0] * size[1] for *_, size in boxes)
    assert area == pytest.approx(width * height, rel=1e-9)
