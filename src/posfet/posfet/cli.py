# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The command `posfet`: imports and runs one subcommand."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.util import find_spec
from typing import Final

import posfet_model
from posfet_model.command_line import ignoring_broken_pipe
from posfet_model.config import did_you_mean
from posfet_model.ros.start import interrupt_on_signal, limit_blas_threads, loading

COMMANDS: Final = {
    "bringup": ("posfet.bringup", "start the stack: real or simulated board, driver, model"),
    "bandwidth": ("posfet.bandwidth", "count messages and bytes of each topic of running stacks"),
    "sim": ("posfet_sim.commands.simulate", "simulate a scene faster than real time and write it to a file"),
    "can": (
        "posfet.can",
        "adapters and boards without a driver: list, monitor, command, record, replay, selftest, conform",
    ),
    "calibrate": (
        "posfet_sim.commands.calibrate",
        "fit a calibration from a recording, or for the simulated board, and write it to a file",
    ),
    "design": (
        "posfet_model.design_command",
        "design a sensor element: report, netlist, simulation of the follower, sweep, tolerances",
    ),
    "diagnostics": ("posfet.stack_commands:diagnostics", "show the state of running stacks, with what to do"),
    "displays": ("posfet.displays", "write RViz and Foxglove files for the sensors of any namespaces"),
    "doctor": ("posfet.doctor", "check this machine: versions, adapters, permissions, ROS, and say what to do"),
    "export": ("posfet_sim.commands.export", "write a recording as arrays or tables: NumPy, HDF5, Parquet"),
    "record": ("posfet.record", "record topics of a running stack to an MCAP file"),
    "replay": ("posfet.replay_command", "run the scans of a recording through the model again, live or into a file"),
    "scene": ("posfet.stack_commands:scene", "load a scene into the running simulated board, or list the scenes"),
    "score": ("posfet_sim.commands.score", "score the reconstruction against the ground truth of a simulated scene"),
    "tare": ("posfet.stack_commands:tare", "set the forces of a running stack to zero"),
    "view": (
        "posfet.view_node",
        "show the force map and the contacts of a running stack here, or in a browser (--web)",
    ),
}
"""Subcommands: the module whose `main`, or another function after a colon, takes the remaining arguments and returns
the exit code, and the purpose."""
NODES: Final = {"bandwidth", "bringup", "diagnostics", "doctor", "record", "replay", "scene", "tare", "view"}
"""Subcommands with signal handling of their own."""
NEED_ROS: Final = {"bandwidth", "bringup", "diagnostics", "displays", "record", "scene", "tare", "view"}
"""Subcommands that need ROS; `replay` needs it, too, but with --out."""
LEFT_OUT: Final = frozenset(COMMANDS[name][0].partition(":")[0] for name in NEED_ROS)
"""Modules that the Python package without ROS leaves out."""
OWN: Final = {"posfet", "posfet_model", "posfet_driver", "posfet_sim"}
"""Packages that are here if this one is."""
WITHOUT_ROS: Final = "needs ROS 2, and this is the Python package without it: build the workspace, see its README"
"""Message of a subcommand whose module is left out."""
INTERRUPTED: Final = 130
"""Exit code after Ctrl-C or SIGTERM, by the convention of shells."""


def usage() -> str:
    """Return the help text."""
    rows = [f"  {name:13}{purpose}" for name, (_, purpose) in COMMANDS.items()]
    last = "posfet COMMAND --help prints its options; posfet --version the version."
    need = [] if find_spec("rclpy") else [f"Here is no ROS 2, which {', '.join(sorted(NEED_ROS))} need."]
    return "\n".join(["usage: posfet COMMAND [...]", "", *rows, "", *need, last])


def main(words: Sequence[str] | None = None) -> int:
    """Run one subcommand and return its exit code: 2, with one line, for an unknown command; 130 when interrupted."""
    words = sys.argv[1:] if words is None else words
    if not words or words[0] in {"-h", "--help"}:
        print(usage())
        return 0 if words else 2
    if words[0] == "--version":
        print(f"posfet {posfet_model.__version__}")
        return 0
    if words[0] not in COMMANDS:
        meant = did_you_mean(words[0], COMMANDS)
        print(f"posfet: unknown command '{words[0]}', {meant}known are {', '.join(COMMANDS)}", file=sys.stderr)
        return 2
    module, _, function = COMMANDS[words[0]][0].partition(":")
    limit_blas_threads()
    try:
        with loading():
            run = getattr(import_module(module), function or "main")
        if words[0] not in NODES:
            interrupt_on_signal()
        return ignoring_broken_pipe(lambda: int(run(words[1:])))
    except ModuleNotFoundError as error:
        print(f"posfet {words[0]}: {_remedy(words[0], error)}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return INTERRUPTED


def _remedy(command: str, error: ModuleNotFoundError) -> str:
    """Return what to do about a missing package in one line; raise the error if it is one of this repository."""
    missing = error.name or ""
    if missing in LEFT_OUT:
        return WITHOUT_ROS + "; with --out FILE it needs none" * (command == "replay")
    if missing.partition(".")[0] in OWN:
        raise error
    return (
        f"needs the package {missing}: source tools/environment.sh, or install/setup.bash of your workspace; posfet "
        "doctor says what else is missing"
    )
