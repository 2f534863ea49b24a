# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Time from process start to the first contacts message in another process."""

from __future__ import annotations

import os
import statistics
import tempfile
import time
from pathlib import Path

from benchmarks.latency.rig import Process
from benchmarks.outcome import Outcome, Table

RUNS = 3
LEAST = "rclpy.node, numpy"
"""What every node in Python loads."""
LISTENING = 2.0
"""Head start of the other process [s]: two that start together may discover each other only after 3 s."""


def first_message(source: str) -> float:
    """Return the time [s] from the start of `posfet bringup` to its first contacts message."""
    with tempfile.TemporaryDirectory() as folder:
        listener = Process(["-m", "benchmarks.latency.processes.listener", str(Path(folder) / "received.npy")])
        try:
            listener.wait_for("ready")
            time.sleep(LISTENING)
            begin = time.monotonic()
            words = ["bringup", f"source:={source}", "log_level:=warn"]
            code = f"import sys; from posfet.cli import main; sys.exit(main({words}))"
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
    """Measure the median of a few starts, and the share of imports."""
    runs = 3 * RUNS if full else RUNS
    first_message("emulator")  # creates the cached bytecode
    starts = {source: [first_message(source) for _ in range(runs)] for source in ("sim", "emulator")}
    least = [imports(LEAST) for _ in range(runs)]
    runs = runs if full else 1
    values = {
        "startup_s": statistics.median(starts["sim"]),
        "startup_emulator_s": statistics.median(starts["emulator"]),
        "startup_over_imports": min(starts["sim"]) / min(least),
    }
    rows: list[tuple[str | float, ...]] = [
        (f"bringup, source:={source}", statistics.median(seconds), min(seconds)) for source, seconds in starts.items()
    ]
    rows.append((f"python3 -c 'import {LEAST}'", statistics.median(least), min(least)))
    for module in ("sys", "numpy", "rclpy.node", "can", "posfet.composed_graph, posfet_sim.ros.sim_board_node"):
        seconds = [imports(module) for _ in range(runs)]
        rows.append((f"python3 -c 'import {module}'", statistics.median(seconds), min(seconds)))
    return Outcome(values, [Table("Start-up time", ("case", "median s", "minimum s"), rows)])
