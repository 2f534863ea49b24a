"""Starts the POSFET tactile stack: `ros2 launch posfet bringup.launch.py -s` lists the arguments."""

from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from posfet.arguments import ARGUMENTS, check
from posfet.bringup import default_params_file
from posfet.graph import graph


def start_nodes(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """Return one process with every node, or one for each with composed:=false."""
    arguments = check({argument.name: LaunchConfiguration(argument.name).perform(context) for argument in ARGUMENTS})
    params_file = arguments["params_file"] or default_params_file()
    specs = graph(arguments, params_file)
    if arguments["composed"] == "true":
        words = [f"{name}:={value}" for name, value in arguments.items()]
        return [Node(package="posfet", executable="bringup", arguments=words, output="screen", on_exit=Shutdown())]
    return [
        Node(
            package=spec.package,
            executable=spec.executable,
            name=spec.executable,
            namespace=spec.namespace,
            parameters=[spec.params_file, dict(spec.parameters)],
            ros_arguments=["--log-level", spec.log_level],
            output="screen",
            on_exit=Shutdown(),
        )
        for spec in specs
    ]


def generate_launch_description() -> LaunchDescription:
    """Declare every argument and start the graph."""
    declared = [
        DeclareLaunchArgument(
            argument.name,
            default_value=argument.default,
            description=argument.description,
            choices=argument.choices or None,
        )
        for argument in ARGUMENTS
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=start_nodes)])
