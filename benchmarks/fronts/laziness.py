# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Laziness of the simulated board: computation that is left out at rest, and float width, for four scenes."""

from __future__ import annotations

import numpy as np

from benchmarks.fronts.front import Check, Choice, Effort, Front
from benchmarks.outcome import shown
from benchmarks.simulation.runs import FULL_SCALE, NONE, SENSOR, run
from posfet_model.sensor.scan import Scan
from posfet_sim.device.simulated_board import SimulatedBoard
from posfet_sim.scene import SceneLoads, load_scene

SCENES = {"idle": 2000, "tap": 2000, "slide": 2000, "texture": 1500}
"""Scans by scene."""

ROUNDING = 1e-15
"""Rounding of an output [full scale]."""

WAYS = {
    ("only what changes", "float64"): (False, False),
    ("only what changes", "float32"): (False, True),
    ("everything", "float64"): (True, False),
    ("everything", "float32"): (True, True),
}
"""Whether to compute everything, and whether in float32."""


def measure(effort: Effort) -> list[Front]:
    """Return a front for each scene."""
    scenes = {"tap": 600} if effort.short else SCENES
    return [_front(name, scans, effort) for name, scans in scenes.items()]


def _board(scene: str, way: tuple[bool, bool]) -> SimulatedBoard:
    loads = SceneLoads(load_scene(scene, SENSOR), SENSOR)
    return SimulatedBoard(SENSOR, loads, 0, NONE.without_noise(), compute_all=way[0], single_precision=way[1])


def _front(scene: str, scans: int, effort: Effort) -> Front:
    seconds: dict[tuple[str, str], list[float]] = {key: [] for key in WAYS}
    for _ in range(effort.repeats):
        for key, way in WAYS.items():
            seconds[key].append(run(_board(scene, way), range(scans)) / scans)
    boards = {key: _board(scene, way) for key, way in WAYS.items()}
    truth, worst = boards["everything", "float64"], dict.fromkeys(WAYS, 0.0)
    scan = Scan.empty(1, SENSOR.layout.taxels)
    for index in range(scans):
        for board in boards.values():
            board.scan(index, scan)
        for key, board in boards.items():
            worst[key] = max(worst[key], float(np.abs(board.volts() - truth.volts()).max()) / FULL_SCALE)
    choices = tuple(Choice(*key, worst[key], tuple(seconds[key])) for key in WAYS)
    lazy, full = choices[0], choices[2]
    share = boards["only what changes", "float64"].taxel_updates / truth.taxel_updates
    single = worst["everything", "float32"]
    checks = (
        Check("error of what is left out [full scale]", lazy.error, 0.0, ROUNDING * 1e3),
        Check("updates of taxels, over those of everything [1]", share, 0.0, 1.0),
        Check("error of float32 in units of its rounding [1]", single / 2**-24, 0.0, 1e3),
    )
    return Front(
        f"laziness_{scene}",
        f"Laziness of the simulated board, {scene}",
        f"one scan of 25 taxels, scene {scene}",
        "largest difference of an output [full scale]",
        "every taxel computed in every scan in float64",
        ROUNDING,
        choices,
        "only what changes, float64",
        checks,
        f"{shown(100 * share)} % of the updates of taxels are computed; that takes "
        f"{shown(lazy.median / full.median)} of "
        f"the run time of computing everything, and changes an output by {shown(lazy.error)} of full scale: "
        "nothing, to "
        "rounding. There is no tolerance to choose: what is left out is known to be zero or a closed form.",
        why_not="Single precision is not shipped, as it is the only one of the four that changes an output.",
        swept=False,
    )
