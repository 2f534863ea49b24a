# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Start the whole stack and display it: `posfet bringup`, `ros2 run posfet bringup`, default of the launch file."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from typing import TYPE_CHECKING, Final

from ament_index_python.packages import get_package_share_directory

from posfet.arguments import check, defaults, describe, parse
from posfet.ros_arguments import split
from posfet.web.options import add_web_arguments, chosen_port
from posfet_model.command_line import positive
from posfet_model.ros.exit_codes import exit_code
from posfet_model.ros.on_demand import load_on_demand
from posfet_model.ros.start import loading

if TYPE_CHECKING:
    from rclpy.context import Context

    from posfet.composed_graph import Graph

RUNNERS: Final = {"true": "posfet.composed_node", "false": "posfet.separate_node"}
"""Module that runs the graph, by the argument `composed`; imported late, so that bad arguments are reported at once."""


def default_params_file() -> str:
    """Return the path of the shipped parameter file."""
    return f"{get_package_share_directory('posfet')}/config/parameters.yaml"


@contextmanager
def nodes(
    context: Context | None = None, ros_arguments: Sequence[str] = (), **arguments: str | float | bool
) -> Iterator[Graph]:
    """Make and start the nodes of a stack in this process, and destroy them at the end of the block.

    rclpy must be initialised. The data thread of the source calls the model directly; services, parameters and
    diagnostics need an executor, of any kind, to which the caller adds the nodes.

    Parameters
    ----------
    context : Context, optional
        Context of the nodes; None: the default one.
    ros_arguments : sequence of str, optional
        ROS arguments for these nodes, such as ``["-r", "contacts:=touch"]``; those of the process do not count.
    **arguments : str, float or bool
        Launch arguments by name; `namespace` is below ``-r __ns:=`` of `ros_arguments`.

    Yields
    ------
    Graph
        Iterates over the nodes. `failure` says why one of them cannot go on after internal errors, '' while all can.

    Raises
    ------
    ConfigError
        One line, if an argument, parameter or file cannot be used, or the source cannot be opened.
    """
    from posfet.composed_graph import Graph  # noqa: PLC0415  # bad arguments of the command are reported without it
    from posfet.graph import graph  # noqa: PLC0415  # nor this

    _, ros = split(["--ros-args", *ros_arguments])
    given = {name: str(value).lower() if isinstance(value, bool) else str(value) for name, value in arguments.items()}
    values = check({**defaults(), **given})
    graph_nodes = Graph(graph(values, values["params_file"] or default_params_file(), ros), context)
    try:
        graph_nodes.start()
        yield graph_nodes
    finally:
        graph_nodes.destroy()


def main(words: Sequence[str] | None = None) -> int:
    """Run the stack until Ctrl-C or for the time given, and return the exit code.

    Parameters
    ----------
    words : sequence of str, optional
        Command line without the program; that of the process by default.

    Returns
    -------
    int
        0 after a clean end; 1, with one line on stderr, for bad input, or if no scan arrived in the time given; 3, with
        one line, if a node ended on internal errors; 130 if the start was interrupted twice.
    """
    words = sys.argv[1:] if words is None else words
    parser = argparse.ArgumentParser(
        prog="posfet bringup",
        description="Start the POSFET tactile stack.",
        epilog="ROS arguments follow --ros-args: -r, -p, --params-file, --log-level, ...",
    )
    parser.add_argument("arguments", nargs="*", metavar="name:=value", help="see --show-args")
    parser.add_argument("--for", dest="seconds", type=positive, default=math.inf, help="stop after this many seconds")
    add_web_arguments(parser)
    parser.add_argument("-s", "--show-args", action="store_true", help="print every argument and exit")

    def run() -> int:
        rest, ros_arguments = split(words)
        options = parser.parse_intermixed_args(rest)
        if options.show_args:
            print(describe())
            return 0
        arguments = parse(options.arguments)
        arguments["params_file"] = arguments["params_file"] or default_params_file()
        load_on_demand()
        with loading():
            runner = import_module(RUNNERS[arguments["composed"]])
        return int(runner.run(arguments, ros_arguments, options.seconds, chosen_port(options)))

    return exit_code(run)
