# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The complete reconstruction on the shipped scenes, through frames and codec, against the ground truth."""

from __future__ import annotations

import time
from copy import deepcopy

from benchmarks.outcome import Cell, Outcome, Table
from benchmarks.timing import scan_microseconds
from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.sensor.description import load_sensor
from posfet_sim.device.error_model import ErrorModel
from posfet_sim.emulation.offline import received_scans
from posfet_sim.evaluation.scorer import Scorer
from posfet_sim.scene import SCENE_FOLDER, load_scene

LONGEST = 3.0
LONGEST_FULL = 60.0


def measure(full: bool) -> Outcome:
    """Reconstruct each scene, 5 x 5 board with the default error model."""
    sensor = load_sensor()
    rows: list[tuple[Cell, ...]] = []
    for name in sorted(path.stem for path in SCENE_FOLDER.glob("*.yaml")):
        scene = load_scene(name, sensor)
        duration = min(scene.duration or LONGEST, LONGEST_FULL if full else LONGEST)
        reconstructor, scorer = Reconstructor(sensor), Scorer(sensor)
        recorded = []
        for scan, truth in received_scans(sensor, scene, duration, 1, ErrorModel.default()):
            recorded.append(deepcopy(scan))
            scorer.add(reconstructor.process(scan), reconstructor.image(), truth)
        reconstructor = Reconstructor(sensor)
        times: list[int] = []
        for scan in recorded:
            begin = time.perf_counter_ns()
            reconstructor.process(scan)
            times.append(time.perf_counter_ns() - begin)
        micro = scan_microseconds(times)
        score = scorer.score(micro)
        centre = score.cop_error_mm["mean"]
        found = (score.total_force_error_pct, centre, score.contact_precision, score.contact_recall)
        rows.append((name, duration, micro, *("-" if each is None else each for each in found)))
    columns = ("scene", "s", "us per scan", "force error %", "CoP error mm", "precision", "recall")
    cost = sum(row[2] for row in rows if isinstance(row[2], float)) / len(rows)
    return Outcome(
        {"reconstruction_5x5_us": cost, "offline_5x5_scans_per_s": 1e6 / cost}, [Table("Reconstruction", columns, rows)]
    )
