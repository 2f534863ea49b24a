# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Start every sensor of a hand: `ros2 launch posfet hand.launch.py hand:=FILE.yaml`.

The file lists the sensors, each with launch arguments of bringup.launch.py, which runs for each of them.
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from launch.actions import DeclareLaunchArgument, GroupAction, IncludeLaunchDescription, OpaqueFunction
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration

from posfet.arguments import ENDS, choices, description
from posfet.hand import read_hand

SENSOR = Path(__file__).with_name("bringup.launch.py")


def start_sensors(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """Return a bring-up for each sensor; a hand file that cannot be used ends the launch."""
    common = {argument.name: LaunchConfiguration(argument.name).perform(context) for argument in ENDS}
    return [
        GroupAction(  # arguments of one sensor are not those of the next
            [
                IncludeLaunchDescription(
                    PythonLaunchDescriptionSource(str(SENSOR)), launch_arguments=[*arguments.items(), *common.items()]
                )
            ]
        )
        for arguments in read_hand(LaunchConfiguration("hand").perform(context))
    ]


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
            for argument in ENDS
        ),
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=start_sensors)])
