# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The shipped launch file: its arguments, and the exit code of `ros2 launch` after bad input."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("launch", reason="needs launch; test_bringup.py expects the same of the bringup executable")
pytest.importorskip("launch_ros", reason="needs launch_ros")

from launch import LaunchDescription, LaunchService
from launch.actions import (
    DeclareLaunchArgument,
    ExecuteProcess,
    GroupAction,
    IncludeLaunchDescription,
    SetLaunchConfiguration,
)
from launch.launch_description_sources import PythonLaunchDescriptionSource, load_python_launch_file_as_module

from posfet.arguments import ARGUMENTS, LAUNCH_ARGUMENTS, choices
from posfet_model.config import ConfigError
from posfet_model.ros.exit_codes import INTERRUPTED, PROCESS_FAILED
from support.bringup_process import needs_installation
from support.paths import LAUNCH

pytestmark = [pytest.mark.ros, pytest.mark.process, needs_installation]

LAUNCH_FILE = str(LAUNCH / "bringup.launch.py")


def launched(**arguments: str) -> int:
    """Run the launch file until it ends, and return the exit code that `ros2 launch` would have."""
    source = PythonLaunchDescriptionSource(LAUNCH_FILE)
    service = LaunchService(noninteractive=True)
    service.include_launch_description(
        LaunchDescription([IncludeLaunchDescription(source, launch_arguments=arguments.items())])
    )
    return service.run()


def test_every_argument_is_declared_with_default_choices_and_description() -> None:
    declared = load_python_launch_file_as_module(LAUNCH_FILE).generate_launch_description().get_launch_arguments()
    table = [*ARGUMENTS, *LAUNCH_ARGUMENTS]
    assert [argument.name for argument in declared] == [argument.name for argument in table]
    for argument, expected in zip(declared, table, strict=True):
        assert "".join(part.text for part in argument.default_value) == expected.default_text
        assert tuple(argument.choices or ()) == choices(expected)
        assert expected.description in argument.description


@pytest.mark.parametrize("composed", ["true", "false"])
def test_invalid_input_gives_exit_code_1(composed: str) -> None:
    assert launched(composed=composed, scene="nowhere") == 1
    assert launched(composed=composed, can_bitrate="fast") == 1
    assert launched(composed=composed, source="usb") == 1
    assert launched(composed=composed, web="on") == 1


def test_the_browser_view_needs_one_process() -> None:
    assert launched(composed="false", web="true") == 1
    module = load_python_launch_file_as_module(LAUNCH_FILE)
    with pytest.raises(ConfigError, match=r"^web: needs composed:=true"):
        module.processes(None, {"composed": "false"}, ["--web"], None)


@pytest.mark.parametrize(("forwarding", "expected"), [(True, 1), (False, 0)])
def test_a_group_keeps_arguments_of_other_files_out(
    monkeypatch: pytest.MonkeyPatch, forwarding: bool, expected: int
) -> None:
    module = load_python_launch_file_as_module(LAUNCH_FILE)
    monkeypatch.setattr(module, "Node", lambda **given: ExecuteProcess(cmd=["true"], on_exit=given["on_exit"]))
    ours = [SetLaunchConfiguration("source", "can"), *module.generate_launch_description().entities]
    group = GroupAction(ours, forwarding=forwarding)
    service = LaunchService(noninteractive=True)
    of_the_robot = DeclareLaunchArgument("scene", default_value="kitchen")  # with source:=can ours would be refused
    service.include_launch_description(LaunchDescription([of_the_robot, group]))
    assert service.run() == expected


def ended_with(monkeypatch: pytest.MonkeyPatch, folder: Path, codes: list[int]) -> tuple[int, int]:
    """Run the launch file with processes that end with one code after the other.

    Return the exit code, and the number of processes that were started.
    """
    log = folder / "starts"
    log.touch()
    program = f"""
import sys
with open({str(log)!r}, "r+") as log:
    count = len(log.readlines())
    log.write(" ".join(sys.argv[1:]) + "\\n")
sys.exit({codes}[count])
"""

    class Substitute(ExecuteProcess):
        """Stands for a node: the launch file's own handler decides what follows its end."""

        def __init__(self, *, package: str, executable: str, on_exit: object, **_: object) -> None:
            super().__init__(cmd=[sys.executable, "-c", program, package, executable], on_exit=on_exit)

    module = load_python_launch_file_as_module(LAUNCH_FILE)
    monkeypatch.setattr(module, "Node", Substitute)
    service = LaunchService(noninteractive=True)
    service.include_launch_description(module.generate_launch_description())
    code = service.run()
    started = log.read_text(encoding="utf-8").splitlines()
    assert set(started) == {"posfet bringup"}
    return code, len(started)


@pytest.mark.parametrize(
    ("codes", "expected"),
    [
        ([PROCESS_FAILED, PROCESS_FAILED, 0], (0, 3)),
        ([PROCESS_FAILED, 1], (1, 2)),
        ([1], (1, 1)),
        ([INTERRUPTED], (1, 1)),
        ([0], (0, 1)),
    ],
    ids=["started again each time", "only after internal errors", "bad input", "interrupted", "done"],
)
def test_a_process_that_gave_up_on_internal_errors_is_started_again(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, codes: list[int], expected: tuple[int, int]
) -> None:
    assert ended_with(monkeypatch, tmp_path, codes) == expected
