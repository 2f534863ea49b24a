# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Start the POSFET tactile stack: `ros2 launch posfet bringup.launch.py -s` lists the arguments.

Other launch files may include it, under PushRosNamespace, SetRemap and SetParameter as well.
"""

import atexit
import os
import shutil
import signal
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from launch import Action, LaunchContext, LaunchDescription, LaunchDescriptionEntity
from launch.actions import DeclareLaunchArgument, ExecuteProcess, LogInfo, OpaqueFunction, Shutdown, TimerAction
from launch.events.process import ProcessExited
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from posfet.arguments import ARGUMENTS, LAUNCH_ARGUMENTS, check, choices, description
from posfet.bringup import default_params_file
from posfet.graph import NodeSpec, graph
from posfet.ros_arguments import RosArguments
from posfet.web.options import web_words
from posfet_model.config import ConfigError
from posfet_model.ros.exit_codes import PROCESS_FAILED
from posfet_model.ros.start import PARENT

RESPAWN_DELAY = 1.0
"""Time before a process is started again that did not end on an internal error [s]."""

ENDED_WELL = (0, -signal.SIGINT, -signal.SIGTERM)
"""Exit codes of a process that was asked to end; a crash, and the kernel when memory is short, use other signals."""


def again(event: ProcessExited, ended: Callable[..., Any]) -> Action:
    """Return the same process once more: namespace, parameters and remaps of an enclosing group are in its command."""
    name = event.process_name.rsplit("-", 1)[0]
    return ExecuteProcess(
        cmd=event.cmd, cwd=event.cwd, env=event.env, name=name, prefix="", output="screen", on_exit=ended
    )


def on_exit(required: bool, respawn: str) -> Callable[..., list[LaunchDescriptionEntity]]:
    """Return what is done when a process has ended: start it again, end the launch, or leave the rest running."""

    def ended(event: ProcessExited, context: LaunchContext) -> list[LaunchDescriptionEntity]:
        if context.is_shutdown:
            return []
        if event.returncode == PROCESS_FAILED and respawn != "never":
            return [again(event, ended)]
        if respawn == "always":
            return [TimerAction(period=RESPAWN_DELAY, actions=[again(event, ended)])]
        if not required:
            return [LogInfo(msg=f"{event.process_name} has ended; the rest goes on (required:=false)")]
        if event.returncode not in ENDED_WELL:  # `ros2 launch` then returns 1
            raise RuntimeError(f"{event.process_name} failed with exit code {event.returncode}")
        return [Shutdown(reason=f"{event.process_name} has ended")]

    return ended


def start_nodes(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """Return the processes; bad input ends the launch only if they are required."""
    values = {argument.name: LaunchConfiguration(argument.name).perform(context) for argument in ARGUMENTS}
    required, respawn, web = (LaunchConfiguration(argument.name).perform(context) for argument in LAUNCH_ARGUMENTS)
    try:
        return processes(context, check(values), web_words(web), on_exit(required == "true", respawn))
    except ConfigError as error:
        if required == "true":
            raise
        return [LogInfo(msg=f"posfet: {error}; the rest goes on (required:=false)")]


def processes(
    context: LaunchContext, arguments: dict[str, str], web: list[str], ended: Callable[..., Any]
) -> list[Node]:
    """Return one process with all nodes, which computes the graph itself, or one for each with composed:=false."""
    if web and arguments["composed"] != "true":
        raise ConfigError("web: needs composed:=true; `posfet view --web NAMESPACE` shows a stack of any kind")
    common: dict[str, Any] = {
        "output": "screen",
        "on_exit": ended,
        # ros2 launch leaves its processes running when it ends on SIGTERM or SIGKILL: they end with it.
        "additional_env": {PARENT: str(os.getpid())},
    }
    if arguments["composed"] == "true":
        words = [*(f"{name}:={value}" for name, value in arguments.items()), *web]
        return [Node(package="posfet", executable="bringup", arguments=words, **common)]
    around = RosArguments(context.launch_configurations.get("ros_namespace", "").strip("/"))
    return [
        Node(
            package=spec.package,
            executable=spec.executable,
            name=spec.name,
            namespace=f"/{spec.namespace}",
            parameters=[spec.params_file, parameter_file(spec)],
            ros_arguments=["--log-level", spec.log_level],
            **common,
        )
        for spec in graph(arguments, arguments["params_file"] or default_params_file(), around)
    ]


def parameter_file(spec: NodeSpec) -> str:
    """Return the path of a file with the node's parameters, removed when the launch ends, unless a signal kills it.

    A dictionary would not do: launch_ros writes texts without quotes where PyYAML needs none, and ROS reads 0815, 1e5
    and y as numbers and a boolean.
    """
    folder = tempfile.mkdtemp(prefix="posfet-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    path = Path(folder, f"{spec.executable}.yaml")
    path.write_text(spec.parameter_file(), encoding="utf-8")
    return str(path)


def generate_launch_description() -> LaunchDescription:
    """Return the arguments and the action that starts the nodes."""
    declared = [
        DeclareLaunchArgument(
            argument.name,
            default_value=argument.default_text,
            description=description(argument),
            choices=choices(argument) or None,
        )
        for argument in (*ARGUMENTS, *LAUNCH_ARGUMENTS)
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=start_nodes)])
