"""From the start of the process to the first contacts message in another one."""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from pathlib import Path

from benchmarks.latency.rig import Process
from benchmarks.outcome import Outcome, Table

RUNS = 3
LISTENING = 2.0
"""For how long the other process has been there [s]: two that come up at once may find each other 3 s later only."""


def first_message(source: str) -> float:
    """Return the time [s] that `posfet bringup` takes."""
    with tempfile.TemporaryDirectory() as folder:
        listener = Process(["-m", "benchmarks.latency.processes.listener", str(Path(folder) / "received.npy")])
        try:
            listener.wait_for("ready")
            time.sleep(LISTENING)
            begin = time.monotonic()
            code = (
                f"import sys; from posfet.bringup import main; sys.exit(main(['source:={source}', 'log_level:=warn']))"
            )
            stack = Process(["-c", code])
            try:
                listener.wait_for("first")
                return time.monotonic() - begin
            finally:
                stack.end()
        finally:
            listener.end()


def imports(module: str) -> float:
    """Return the time [s] that a fresh interpreter takes to load a module, start included."""
    begin = time.monotonic()
    process = os.spawnlp(os.P_NOWAIT, "python3", "python3", "-c", f"import {module}")
    os.waitpid(process, 0)
    return time.monotonic() - begin


def measure(full: bool) -> Outcome:
    """Take the median of a few starts, and what loading takes of it."""
    runs = 3 * RUNS if full else RUNS
    first_message("emulator")  # leaves compiled modules behind
    taken = {source: [first_message(source) for _ in range(runs)] for source in ("sim", "emulator")}
    runs = runs if full else 1
    values = {
        "startup_s": statistics.median(taken["sim"]),
        "startup_emulator_s": statistics.median(taken["emulator"]),
    }
    rows: list[tuple[str | float, ...]] = [
        (f"bringup, source:={source}", statistics.median(seconds), min(seconds)) for source, seconds in taken.items()
    ]
    for module in ("sys", "numpy", "rclpy.node", "can", "posfet.composed_node, posfet_sim.ros.sim_board_node"):
        seconds = [imports(module) for _ in range(runs)]
        rows.append((f"python3 -c 'import {module}'", statistics.median(seconds), min(seconds)))
    return Outcome(values, [Table("Start", ("what", "median s", "least s"), rows)])
