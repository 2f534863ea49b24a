"""Start the whole stack and display it: `posfet bringup`, `ros2 run posfet bringup`, default of the launch file."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import Final

from ament_index_python.packages import get_package_share_directory

from posfet.arguments import describe, parse
from posfet.graph import graph
from posfet_model.command_line import positive
from posfet_model.ros.exit_codes import exit_code

RUNNERS: Final = {"true": "posfet.composed_node", "false": "posfet.separate_node"}
"""Module that runs the graph, by the argument `composed`; imported late, so that bad arguments are reported at once."""


def default_params_file() -> str:
    """Return the path of the shipped parameter file."""
    return f"{get_package_share_directory('posfet')}/config/parameters.yaml"


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
    words = list(sys.argv[1:] if words is None else words)
    if words[-1:] == ["--ros-args"]:  # added by launch
        words.pop()
    parser = argparse.ArgumentParser(prog="posfet bringup", description="Start the POSFET tactile stack.")
    parser.add_argument("arguments", nargs="*", metavar="name:=value", help="see --show-args")
    parser.add_argument("--for", dest="seconds", type=positive, default=math.inf, help="stop after this many seconds")
    parser.add_argument("-s", "--show-args", action="store_true", help="print every argument and exit")
    if "--ros-args" in words:
        place = words.index("--ros-args")
        parser.error(f"ROS arguments are not supported, got '{' '.join(words[place:])}': use name:=value (--show-args)")
    options = parser.parse_intermixed_args(words)
    if options.show_args:
        print(describe())
        return 0

    def run() -> int:
        arguments = parse(options.arguments)
        specs = graph(arguments, arguments["params_file"] or default_params_file())
        return int(import_module(RUNNERS[arguments["composed"]]).run(specs, options.seconds))

    return exit_code(run)
