"""The shipped launch file: its arguments, and the exit code of `ros2 launch` after bad input."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("launch", reason="needs launch; test_bringup.py expects the same of the bringup executable")
pytest.importorskip("launch_ros", reason="needs launch_ros")

from launch import LaunchDescription, LaunchService
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource, load_python_launch_file_as_module

from posfet.arguments import ARGUMENTS, choices, defaults
from support.bringup_process import needs_installation

pytestmark = [pytest.mark.ros, pytest.mark.process, needs_installation]

LAUNCH_FILE = str(Path(__file__).parents[2] / "launch" / "bringup.launch.py")


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
    assert [argument.name for argument in declared] == [argument.name for argument in ARGUMENTS]
    for argument, expected in zip(declared, ARGUMENTS, strict=True):
        assert "".join(part.text for part in argument.default_value) == defaults()[expected.name]
        assert tuple(argument.choices or ()) == choices(expected)
        assert expected.description in argument.description


@pytest.mark.parametrize("composed", ["true", "false"])
def test_invalid_input_gives_exit_code_1(composed: str) -> None:
    assert launched(composed=composed, scene="nowhere") == 1
    assert launched(composed=composed, can_bitrate="fast") == 1
    assert launched(composed=composed, source="usb") == 1
