# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The simulated board: cost of a scan, and what skipped computation saves and changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.outcome import Cell, Outcome, Table
from benchmarks.simulation.runs import CHUNK, DEFAULT, FULL_SCALE, NONE, SENSOR, run
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import Scan
from posfet_sim.device.error_model import ErrorModel
from posfet_sim.device.simulated_board import SimulatedBoard
from posfet_sim.scene import SceneLoads, load_scene

LARGE = replace(SENSOR, layout=replace(SENSOR.layout, rows=64, cols=64))
PARTS = {
    "sliding": ("press_slide_lift", range(1000, 2000)),
    "held": ("press_slide_lift", range(520, 900)),
    "at rest": ("idle", range(3000)),
}
SHORTCUT_SCENES = ("press_slide_lift", "two_fingers", "idle")
SHORTCUT_SCANS = 2000


def cost(sensor: Sensor, error_model: ErrorModel, scene: str, part: range, runs: int) -> float:
    """Return the minimum time per scan [us] over several runs; timed in chunks, as scans at rest are batched."""
    chunks = []
    for _ in range(runs):
        board = SimulatedBoard(sensor, SceneLoads(load_scene(scene, sensor), sensor), 0, error_model)
        run(board, range(part.start))
        pieces = [range(k, k + CHUNK) for k in range(part.start, part.stop - CHUNK + 1, CHUNK)]
        chunks.append(sum(run(board, piece) for piece in pieces) / (CHUNK * len(pieces)) * 1e6)
    return min(chunks)


def shortcut(scene: str) -> tuple[float, float, float, float]:
    """Return the time per scan [us] with skipped and full computation, maximum difference / full scale, and share."""
    boards = [
        SimulatedBoard(SENSOR, SceneLoads(load_scene(scene, SENSOR), SENSOR), 0, NONE.without_noise(), compute_all=full)
        for full in (0, 1)
    ]
    times = [run(board, range(SHORTCUT_SCANS)) / SHORTCUT_SCANS * 1e6 for board in boards]
    lazy, full = (
        SimulatedBoard(SENSOR, SceneLoads(load_scene(scene, SENSOR), SENSOR), 0, NONE.without_noise(), compute_all=full)
        for full in (False, True)
    )
    scan, worst = Scan.empty(1, SENSOR.layout.taxels), 0.0
    for index in range(SHORTCUT_SCANS):
        lazy.scan(index, scan)
        full.scan(index, scan)
        worst = max(worst, float(np.abs(lazy.volts() - full.volts()).max()))
    return times[0], times[1], worst / FULL_SCALE, lazy.taxel_updates / full.taxel_updates


def measure(full: bool) -> Outcome:
    """Time the boards."""
    runs = 5 if full else 3
    rows: list[tuple[Cell, ...]] = []
    found: dict[tuple[str, str], float] = {}
    for title, sensor in (("5 x 5", SENSOR), ("64 x 64", LARGE)):
        for state, (scene, part) in PARTS.items():
            times = [cost(sensor, error_model, scene, part, runs) for error_model in (NONE, DEFAULT)]
            found[title, state] = times[0]
            rows.append((title, state, *times, times[0] / 10, 1000 / times[0]))
    values = {
        "sim_5x5_cpu_pct": found["5 x 5", "sliding"] / 10,
        "sim_5x5_idle_cpu_pct": found["5 x 5", "at rest"] / 10,
        "sim_64x64_realtime_factor": 1000 / found["64 x 64", "sliding"],
    }
    columns = ("array", "state", "us per scan", "with error model", "% of a core at 1 kHz", "real-time factor")
    cuts = {scene: shortcut(scene) for scene in SHORTCUT_SCENES}
    tables = [
        Table("Simulated board", columns, rows),
        Table(
            "Simulated board, skipped computation against full computation",
            ("scene", "us per scan", "full computation", "maximum difference / full scale", "share of taxel updates"),
            [(scene, *found) for scene, found in cuts.items()],
        ),
    ]
    return Outcome(values, tables)
