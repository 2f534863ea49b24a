"""Start the POSFET tactile stack: `ros2 launch posfet bringup.launch.py -s` lists the arguments."""

from typing import Any

from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.events.process import ProcessExited
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from posfet.arguments import ARGUMENTS, check, choices, description
from posfet.bringup import default_params_file
from posfet.graph import graph
from posfet_model.ros.exit_codes import PROCESS_FAILED


def stop(event: ProcessExited, context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """Shut down when a process has ended; raise for a process that failed, so that `ros2 launch` returns 1."""
    if event.returncode > 0 and not context.is_shutdown:
        raise RuntimeError(f"{event.process_name} failed with exit code {event.returncode}")
    return [Shutdown()]


def process(**arguments: Any) -> Node:
    """Return a process that ends the launch when it ends, but is started again when it gave up on internal errors."""

    def ended(event: ProcessExited, context: LaunchContext) -> list[LaunchDescriptionEntity]:
        if event.returncode == PROCESS_FAILED and not context.is_shutdown:
            return [process(**arguments)]
        return stop(event, context)

    return Node(**arguments, output="screen", on_exit=ended)


def start_nodes(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """Return one process with all nodes, which computes the graph itself, or one for each with composed:=false."""
    arguments = check({argument.name: LaunchConfiguration(argument.name).perform(context) for argument in ARGUMENTS})
    if arguments["composed"] == "true":
        words = [f"{name}:={value}" for name, value in arguments.items()]
        return [process(package="posfet", executable="bringup", arguments=words)]
    return [
        process(
            package=spec.package,
            executable=spec.executable,
            name=spec.executable,
            namespace=spec.namespace,
            parameters=[spec.params_file, dict(spec.parameters)],
            ros_arguments=["--log-level", spec.log_level],
        )
        for spec in graph(arguments, arguments["params_file"] or default_params_file())
    ]


def generate_launch_description() -> LaunchDescription:
    """Return the arguments and the action that starts the nodes."""
    declared = [
        DeclareLaunchArgument(
            argument.name,
            default_value=argument.default_text,
            description=description(argument),
            choices=choices(argument) or None,
        )
        for argument in ARGUMENTS
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=start_nodes)])
