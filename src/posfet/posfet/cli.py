"""The command `posfet`: finds the subcommand and loads nothing else."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import import_module
from typing import Final

from posfet_model.command_line import ignoring_broken_pipe
from posfet_model.ros.start import interrupt_on_signal

COMMANDS: Final = {
    "bringup": ("posfet.bringup", "start the stack: board or simulated board, driver, model"),
    "sim": ("posfet_sim.commands.simulate", "run a scene on the simulated board, faster than real time, into a file"),
    "can": (
        "posfet.can",
        "adapters and boards at the bench: list, monitor, command, record, replay, test",
    ),
    "calibrate": (
        "posfet_sim.commands.calibrate",
        "press the simulated board taxel by taxel and write its calibration",
    ),
    "score": ("posfet_sim.commands.score", "score the reconstruction on a scene of the simulated board"),
    "view": ("posfet.view_node", "show the live force map and the contacts of a running stack"),
}
"""Subcommands: module whose `main` takes the remaining words and returns the exit code, and what it does."""
NODES: Final = {"bringup", "view"}
"""Subcommands that ROS ends in order."""
INTERRUPTED: Final = 130
"""Exit code after Ctrl-C or SIGTERM, as shells tell it."""


def usage() -> str:
    """Return the help text."""
    rows = [f"  {name:10}{purpose}" for name, (_, purpose) in COMMANDS.items()]
    return "\n".join(["usage: posfet COMMAND [...]", "", *rows, "", "posfet COMMAND --help tells more."])


def main(words: Sequence[str] | None = None) -> int:
    """Run one subcommand and return its exit code: 2, with one line, for no such command; 130 when interrupted."""
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
