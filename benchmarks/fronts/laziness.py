# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Skipped computation of the simulated board, at rest by several tolerances, and its float width."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.fronts.front import Check, Choice, Effort, Front
from benchmarks.outcome import shown
from benchmarks.simulation.runs import FULL_SCALE, NONE, SENSOR, run
from posfet_model.sensor.scan import Scan
from posfet_sim.device.simulated_board import SimulatedBoard
from posfet_sim.device.taxel_charge import NEGLIGIBLE_CHARGE
from posfet_sim.scene import SceneLoads, load_scene

SCENES = {"idle": 4000, "tap": 4000, "slide": 4000, "texture": 3000}
"""Scans by scene."""

MOST_OF_EVERYTHING = 3
"""Repetitions of what takes longest."""

ROUNDING = 1e-15
"""Rounding of an output [full scale]."""


@dataclass(frozen=True)
class Way:
    """How a board computes."""

    everything: bool = False
    """Whether every taxel is computed in every scan."""
    single: bool = False
    """Whether in float32."""
    tolerance: float = NEGLIGIBLE_CHARGE
    """Charge that counts as none, relative to that of the full-scale force [1]."""


TOLERANCES = (NEGLIGIBLE_CHARGE, 1e-9, 1e-6, 1e-4, 1e-2)
LAZY, EXACT = "only what changes", "everything"
WAYS: dict[tuple[str, str], Way] = {
    **{(LAZY, f"tolerance {tolerance:g}"): Way(tolerance=tolerance) for tolerance in TOLERANCES},
    (f"{LAZY}, float32", f"tolerance {NEGLIGIBLE_CHARGE:g}"): Way(single=True),
    (EXACT, "float64"): Way(everything=True),
    (EXACT, "float32"): Way(everything=True, single=True),
}
SHIPPED = LAZY, f"tolerance {NEGLIGIBLE_CHARGE:g}"


def measure(effort: Effort) -> list[Front]:
    """Return a front for each scene."""
    scenes = {"tap": 600} if effort.short else SCENES
    return [_front(name, scans, effort) for name, scans in scenes.items()]


def _board(scene: str, way: Way) -> SimulatedBoard:
    loads = SceneLoads(load_scene(scene, SENSOR), SENSOR)
    board = SimulatedBoard(
        SENSOR, loads, 0, NONE.without_noise(), compute_all=way.everything, single_precision=way.single
    )
    board._charge._negligible *= way.tolerance / NEGLIGIBLE_CHARGE
    return board


def _front(scene: str, scans: int, effort: Effort) -> Front:
    seconds: dict[tuple[str, str], list[float]] = {key: [] for key in WAYS}
    for repetition in range(effort.repeats):
        for key, way in WAYS.items():
            if way.everything and repetition >= MOST_OF_EVERYTHING:
                continue
            seconds[key].append(run(_board(scene, way), range(scans)) / scans)
    boards = {key: _board(scene, way) for key, way in WAYS.items()}
    truth, worst = boards[EXACT, "float64"], dict.fromkeys(WAYS, 0.0)
    scan = Scan.empty(1, SENSOR.layout.taxels)
    for index in range(scans):
        for board in boards.values():
            board.scan(index, scan)
        for key, board in boards.items():
            worst[key] = max(worst[key], float(np.abs(board.volts() - truth.volts()).max()) / FULL_SCALE)
    choices = tuple(Choice(*key, worst[key], tuple(seconds[key])) for key in WAYS)
    found = dict(zip(WAYS, choices, strict=True))
    lazy, full, loose = found[SHIPPED], found[EXACT, "float64"], found[LAZY, f"tolerance {TOLERANCES[-1]:g}"]
    share = boards[SHIPPED].taxel_updates / truth.taxel_updates
    single = worst[EXACT, "float32"]
    checks = (
        Check("error of skipped computation [full scale]", lazy.error, 0.0, ROUNDING * 1e3),
        Check("updates of taxels, over those of everything [1]", share, 0.0, 1.0),
        Check("error of float32 in units of its rounding [1]", single / 2**-24, 0.0, 1e3),
        Check(f"error at {loose.parameter} over that tolerance [1]", loose.error / TOLERANCES[-1], 0.0, 1.5),
    )
    return Front(
        f"laziness_{scene}",
        f"Skipped computation of the simulated board, {scene}",
        f"one scan of 25 taxels, scene {scene}",
        "largest difference of an output [full scale]",
        "every taxel computed in every scan in float64",
        ROUNDING,
        choices,
        lazy.name,
        checks,
        f"{shown(100 * share)} % of the updates of taxels are computed, in {shown(lazy.median / full.median)} of the "
        "run time of computing everything, as scans are then computed in blocks, and an output changes by "
        f"{shown(lazy.error)} of full scale: nothing, to rounding. A tolerance of {TOLERANCES[-1]:g} would change it "
        f"by {shown(loose.error)} and take {shown(loose.median / lazy.median)} of the run time: choose the shipped "
        "one, as a larger one saves little.",
        why_not="A tolerance that ends no earlier in this scene, or another float width, changes nothing here but the "
        "noise of its run time, and outputs elsewhere.",
        question=f"a simulated board, {scene}" if scene in ("idle", "slide") else "",
        rival=f"{EXACT}, float64" if scene in ("idle", "slide") else "",
        swept=True,
    )
