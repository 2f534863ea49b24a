# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Start every sensor of a hand: `ros2 launch posfet hand.launch.py hand:=FILE.yaml`.

The file lists the sensors, each with launch arguments of bringup.launch.py, which runs for each of them.
"""

import os
from dataclasses import replace
from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from launch.actions import DeclareLaunchArgument, GroupAction, IncludeLaunchDescription, LogInfo, OpaqueFunction
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from posfet.arguments import ENDS, WEB, choices, description
from posfet.hand import read_hand
from posfet.web.options import web_words
from posfet_model.config import ConfigError
from posfet_model.ros.start import PARENT

SENSOR = Path(__file__).with_name("bringup.launch.py")
PAGE = replace(WEB, description="Show all sensors on one page in a browser on this machine: true, false, or a port")


def start_sensors(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """Return a bring-up for each sensor; bad input ends the launch only if they are required."""
    common = {argument.name: LaunchConfiguration(argument.name).perform(context) for argument in ENDS}
    hand = LaunchConfiguration("hand").perform(context)
    try:
        page = web_words(LaunchConfiguration(WEB.name).perform(context))
        sensors = read_hand(hand)
    except ConfigError as error:
        if common["required"] == "true":
            raise
        return [LogInfo(msg=f"posfet: {error}; the rest goes on (required:=false)")]
    common[WEB.name] = "false"  # one page for all
    included = [
        GroupAction(  # arguments of one sensor are not those of the next
            [
                IncludeLaunchDescription(
                    PythonLaunchDescriptionSource(str(SENSOR)), launch_arguments=[*arguments.items(), *common.items()]
                )
            ]
        )
        for arguments in sensors
    ]
    return [*included, *([view(hand, page)] if page else [])]


def view(hand: str, page: list[str]) -> Node:
    """Return the process that shows all sensors; they go on when it ends."""
    return Node(
        package="posfet",
        executable="view",
        arguments=["--hand", hand, *page],
        output="screen",
        additional_env={PARENT: str(os.getpid())},  # as for the sensors
    )


def generate_launch_description() -> LaunchDescription:
    """Return the arguments and the action that starts the sensors."""
    shipped = f"{get_package_share_directory('posfet')}/config/hand.yaml"
    declared = [
        DeclareLaunchArgument("hand", default_value=shipped, description="YAML file with the sensors of the hand"),
        *(
            DeclareLaunchArgument(
                argument.name,
                default_value=argument.default_text,
                description=description(argument),
                choices=choices(argument) or None,
            )
            for argument in (*ENDS, PAGE)
        ),
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=start_sensors)])
