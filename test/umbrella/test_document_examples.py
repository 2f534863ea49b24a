# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Examples of documents that are parts of something larger: integration.md, firmware.md, design.md."""

from __future__ import annotations

import ast
import inspect
import io
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest

from posfet.arguments import parse
from posfet.hand import read_hand
from posfet_model.design_command import main as design
from support.bringup_process import needs_installation
from support.document_blocks import Block, blocks
from support.paths import DOCS, ROOT

STUBS = """
#include "posfet_board.h"
extern uint8_t next_boot_number(void);
extern uint32_t now_us(void *);
extern bool send_frame(void *, const posfet_frame *);
extern bool sample(void *, uint16_t[], uint32_t *);
extern void temperatures(void *, int16_t[2], uint32_t *);
extern uint16_t supply_mv(void *, uint32_t *);
extern uint8_t self_test(void *);
extern bool can_peek(posfet_frame *);
extern void can_drop(void);
extern void sleep_until_interrupt_or(uint32_t);
"""
"""What a board's own code provides, in front of the example."""


def block(document: str, start: str) -> Block:
    """Return the block of a document that starts with a text."""
    [found] = [each for each in blocks(DOCS / document) if each.text.startswith(start)]
    return found


def test_the_launch_file_includes_ours_with_arguments_that_exist() -> None:
    pytest.importorskip("launch_ros", reason="needs the package launch_ros")
    from launch import actions, launch_description_sources  # noqa: PLC0415
    from launch_ros import actions as ros_actions  # noqa: PLC0415
    from launch_ros import substitutions  # noqa: PLC0415

    names = {**vars(actions), **vars(launch_description_sources), **vars(ros_actions), **vars(substitutions)}
    text = block("integration.md", "GroupAction(").text
    assert isinstance(eval(text, names), actions.GroupAction)


@needs_installation
@pytest.mark.parametrize("start", ["IncludeLaunchDescription(", "<include"], ids=["Python", "XML"])
def test_one_line_includes_the_installed_launch_file(start: str) -> None:
    pytest.importorskip("launch_ros", reason="needs the package launch_ros")
    pytest.importorskip("launch_xml", reason="needs the package launch_xml")
    from launch import LaunchContext, actions, launch_description_sources  # noqa: PLC0415
    from launch.frontend import Parser  # noqa: PLC0415
    from launch_ros import substitutions  # noqa: PLC0415

    text = block("integration.md", start).text
    if start.startswith("<"):
        root, parser = Parser.load(io.StringIO(f"<launch>{text}</launch>"))
        [included] = parser.parse_description(root).entities
    else:
        included = eval(text, {**vars(actions), **vars(launch_description_sources), **vars(substitutions)})
    assert isinstance(included, actions.IncludeLaunchDescription)
    description = included.launch_description_source.get_launch_description(LaunchContext())
    assert {"source", "namespace", "required"} <= {each.name for each in description.get_launch_arguments()}


def test_the_included_arguments_exist() -> None:
    text = block("integration.md", "GroupAction(").text
    [given] = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Dict)]
    values = ast.literal_eval(given)
    known = {name for name in values if name not in {"required", "respawn"}}
    parse([f"{name}:={values[name]}" for name in known])
    assert "required" in values


def test_the_list_of_a_hand_is_valid(tmp_path: Path) -> None:
    path = tmp_path / "hand.yaml"
    path.write_text(block("integration.md", "name: hand").text, encoding="utf-8")
    for name in ("thumb", "palm", "thumb_calibration"):
        (tmp_path / f"{name}.yaml").write_text("", encoding="utf-8")
    assert [sensor["namespace"] for sensor in read_hand(str(path))] == ["hand/thumb", "hand/palm"]


def test_the_robot_description_has_the_sensor(tmp_path: Path) -> None:
    xacro = pytest.importorskip("xacro", reason="needs xacro")
    macro = ROOT / "src/posfet/urdf/posfet.urdf.xacro"
    text = block("integration.md", "<xacro:include").text.replace("$(find posfet)/urdf/posfet.urdf.xacro", str(macro))
    shutil.copy(ROOT / "src/posfet_model/posfet_model/sensor/sensors/posfet_5x5.yaml", tmp_path / "thumb.yaml")
    text = text.replace("thumb.yaml", str(tmp_path / "thumb.yaml"))
    path = tmp_path / "robot.urdf.xacro"
    path.write_text(
        f'<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro"><link name="thumb_tip"/>{text}</robot>', "utf-8"
    )
    assert 'name="hand_thumb_array"' in xacro.process_file(str(path)).toxml()


def test_the_controller_calls_what_exists() -> None:
    sensor = pytest.importorskip("posfet_model.ros.contact_sensor", reason="needs ROS 2").ContactSensor
    text = block("integration.md", "from posfet_model.ros.contact_sensor").text
    [call] = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Call) and node.args]
    inspect.signature(sensor).bind(*call.args, **{word.arg: word.value for word in call.keywords})
    assert callable(sensor.contacts)


def test_the_main_function_of_a_board_compiles(tmp_path: Path) -> None:
    compiler = shutil.which("gcc")
    if compiler is None:
        pytest.skip("needs gcc")
    source = tmp_path / "main.c"
    example = block("firmware.md", "static posfet_board").text
    source.write_text(STUBS + example, encoding="utf-8")
    words = [compiler, "-std=c99", "-fsyntax-only", "-Wall", "-Werror", "-I", str(ROOT / "firmware/board"), str(source)]
    result = subprocess.run(words, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr


def test_the_design_commands_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    text = (ROOT / "src/posfet_model/posfet_model/design/designs/square_millimetre.yaml").read_text(encoding="utf-8")
    Path("mine.yaml").write_text(text, encoding="utf-8")
    Path("in.csv").write_text("t,vin\n0,0\n1e-6,0.001\n", encoding="utf-8")
    lines = [shlex.split(line, comments=True) for line in block("design.md", "posfet design").text.splitlines()]
    assert len(lines) == 6
    for words in lines:
        assert words[:2] == ["posfet", "design"]
        assert design(words[2:]) == 0, capsys.readouterr()
