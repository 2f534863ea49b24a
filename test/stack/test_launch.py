# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The shipped launch file, run by launch_testing: topics, contacts of the scene, exit codes."""

from __future__ import annotations

import unittest

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")
launch_testing = pytest.importorskip(
    "launch_testing", reason="needs launch_testing; test_bringup.py expects the same of the bringup executable"
)
pytest.importorskip("launch_ros", reason="needs launch_ros")

from launch import LaunchDescription
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch_testing.actions import ReadyToTest
from launch_testing.asserts import assertExitCodes

from support.expectations import Listener, expect_stack
from support.paths import LAUNCH

LAUNCH_FILE = LAUNCH / "bringup.launch.py"
IDEAL = {"imperfections": "none"}
VARIANTS = [
    {"source": "sim", **IDEAL},
    {"source": "emulator", **IDEAL},
    {"source": "sim", "composed": "false", **IDEAL},
    {"source": "emulator", "bus_interface": "virtual", "bus_channel": "launch", **IDEAL},
    {"source": "emulator", "composed": "false", **IDEAL},
]


@pytest.mark.launch_test
@launch_testing.parametrize("arguments", VARIANTS)
def generate_test_description(arguments: dict[str, str]) -> LaunchDescription:
    source = PythonLaunchDescriptionSource(str(LAUNCH_FILE))
    bringup = IncludeLaunchDescription(source, launch_arguments=arguments.items())
    return LaunchDescription([bringup, ReadyToTest()])


class TestStack(unittest.TestCase):
    def test_the_stack_reports_the_contacts_of_the_scene(self) -> None:
        with Listener() as listener:
            expect_stack(listener)


@launch_testing.post_shutdown_test()
class TestEnd(unittest.TestCase):
    def test_every_process_ended_cleanly(self, proc_info: launch_testing.ProcInfoHandler) -> None:
        assertExitCodes(proc_info)
