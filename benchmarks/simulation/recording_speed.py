# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""`posfet sim SCENE --out FILE`: how much faster than real time a 5 x 5 board is written to a file."""

from __future__ import annotations

import contextlib
import importlib.util
import io
import tempfile
import time
from pathlib import Path

from benchmarks.outcome import Cell, Outcome, Table
from posfet_sim.commands.simulate import main

SCENES = ("press_slide_lift", "two_fingers", "idle")
FORMATS = ("mcap", "csv")
SECONDS = 4.0
RUNS = 3
MISSING = "the Python package mcap is missing. Install with: pip install mcap"


def factor(scene: str, path: Path, seconds: float) -> float:
    """Return the simulated time over the processor time of a run; a file of the run before is removed."""
    path.unlink(missing_ok=True)
    begin = time.process_time()
    with contextlib.redirect_stdout(io.StringIO()):
        code = main([scene, "--out", str(path), "--for", f"{seconds:g}"])
    if code:
        raise RuntimeError(f"posfet sim {scene}: exit code {code}")
    return seconds / (time.process_time() - begin)


def measure(full: bool) -> Outcome:
    """Write each scene to each format; the best of some runs, as other load only adds."""
    if importlib.util.find_spec("mcap") is None:
        return Outcome(skipped=MISSING)
    seconds = SECONDS * (5 if full else 1)
    rows: list[tuple[Cell, ...]] = []
    with tempfile.TemporaryDirectory() as folder:
        for scene in SCENES:
            path = Path(folder) / scene
            best = [
                max(factor(scene, path.with_suffix(f".{suffix}"), seconds) for _ in range(RUNS)) for suffix in FORMATS
            ]
            rows.append((scene, *best))
    note = (
        f"Simulated time over processor time, default error model, {seconds:g} s, best of {RUNS}; the start of the "
        "process does not count."
    )
    columns = ("scene", *(f"times real time, .{suffix}" for suffix in FORMATS))
    values = {"mcap_5x5_realtime_factor": float(rows[0][1])}
    return Outcome(values, [Table("Simulated board into a file", columns, rows, note)])
