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
from typing import Final

from posfet_model.command_line import ignoring_broken_pipe
from posfet_model.ros.start import interrupt_on_signal

COMMANDS: Final = {
    "bringup": ("posfet.bringup", "start the stack: real or simulated board, driver, model"),
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
    "displays": ("posfet.displays", "write RViz and Foxglove files for the sensors of any namespaces"),
    "export": ("posfet_sim.commands.export", "write a recording as arrays or tables: NumPy, HDF5, Parquet"),
    "record": ("posfet.record", "record topics of a running stack to an MCAP file"),
    "replay": ("posfet.replay", "run the scans of a recording through the model again, live or into a file"),
    "score": ("posfet_sim.commands.score", "score the reconstruction against the ground truth of a simulated scene"),
    "view": (
        "posfet.view_node",
        "show the force map and the contacts of a running stack here, or in a browser (--web)",
    ),
}
"""Subcommands: the module whose `main` takes the remaining arguments and returns the exit code, and the purpose."""
NODES: Final = {"bringup", "record", "replay", "view"}
"""Subcommands with signal handling of their own."""
INTERRUPTED: Final = 130
"""Exit code after Ctrl-C or SIGTERM, by the convention of shells."""


def usage() -> str:
    """Return the help text."""
    rows = [f"  {name:10}{purpose}" for name, (_, purpose) in COMMANDS.items()]
    return "\n".join(["usage: posfet COMMAND [...]", "", *rows, "", "posfet COMMAND --help prints its options."])


def main(words: Sequence[str] | None = None) -> int:
    """Run one subcommand and return its exit code: 2, with one line, for an unknown command; 130 when interrupted."""
    words = sys.argv[1:] if words is None else words
    if not words or words[0] in {"-h", "--help"}:
        print(usage())
        return 0 if words else 2
    if words[0] not in COMMANDS:
        print(f"posfet: unknown command '{words[0]}', known are {', '.join(COMMANDS)}", file=sys.stderr)
        return 2
    module, _ = COMMANDS[words[0]]
    try:
        run = import_module(module).main
        if words[0] not in NODES:
            interrupt_on_signal()
        return ignoring_broken_pipe(lambda: int(run(words[1:])))
    except KeyboardInterrupt:
        return INTERRUPTED
