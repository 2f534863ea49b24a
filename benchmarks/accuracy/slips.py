# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Slip detection by speed and force: part of `make accuracy`, alone `python -m benchmarks.accuracy.slips`.

A ball is pressed on, slips in a straight line at a constant speed with a step onset, and is released, at random
positions and in random directions. In a control run the ball rests while its force varies randomly, which is no slip.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from dataclasses import replace
from functools import lru_cache
from typing import Final

import numpy as np

from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.contacts.slip import SLIP_SPEED
from posfet_model.sensor.description import load_sensor
from posfet_sim.calibration.simulated_bench import calibrate
from posfet_sim.commands.score import Run, run
from posfet_sim.contact.indenters import Sphere
from posfet_sim.device.error_model import ErrorModel
from posfet_sim.evaluation.scorer import Score
from posfet_sim.scene import Keyframes, Scene, SceneObject
from posfet_sim.scene.keyframes import Path
from posfet_sim.scene.trajectories import RandomMotion, Stroke

SPEEDS: Final = (5e-3, 12e-3, 20e-3, 50e-3)
"""Speeds of the slips [m/s]."""

FORCES: Final = (0.3, 1.0, 3.0)
"""Normal forces [N]."""

SLIPS: Final = 5
"""Number of slips in a run."""

LEAST_DURATION: Final = 0.06
"""Least duration of a slip [s]."""

LEAST_DISTANCE: Final = 0.6e-3
"""Least distance of a slip [m]."""

RISE: Final = 0.1
"""Duration of onset and release, and pause between two touches [s]."""

FIRST: Final = 0.4
"""Start of the first touch [s]."""

LARGEST_OFFSET: Final = 0.8e-3
"""Greatest distance of a slip's midpoint from the centre of the array, in x and in y [m]."""

MISMATCH: Final = 0.05
"""Standard deviation of the gain error after calibration [1]."""

TEXT: Final = f"""\
A ball of 4 mm radius slips {SLIPS} times on each board: in a straight line, at a constant speed from the first instant
on, at random positions and in random directions. From {SLIP_SPEED * 1e3:g} mm/s on that counts as a slip. It is
detected when it is reported within 50 ms. "False slips" are slips reported at any other time, also while the contact
begins or ends, within {RISE * 1e3:g} ms. In the last row a held ball rests, and its force varies at random at up to
5 Hz."""

BOARD: Final = replace(ErrorModel.default(), resets_per_hour=0.0)

Calibrated = Callable[[int], Calibration]
"""The calibration of the board with a seed."""


def _scene(paths: Sequence[Path], seconds: float) -> Scene:
    balls = tuple(SceneObject(f"ball {number}", Sphere(4e-3, 2e6), path) for number, path in enumerate(paths))
    return Scene("slips", "a ball slips", seconds, balls, Keyframes((0.0,), ((25.0,),)))


def slipping(speed: float, force: float, seed: int) -> Scene:
    """Return a scene of `SLIPS` slips at a speed [m/s] under a force [N]."""
    rng = np.random.default_rng(seed)
    distance = max(speed * LEAST_DURATION, LEAST_DISTANCE)
    paths, begin = [], FIRST
    for _ in range(SLIPS):
        x, y = rng.uniform(-LARGEST_OFFSET, LARGEST_OFFSET, 2).tolist()
        angle = rng.uniform(0.0, 2.0 * math.pi)
        across, up = 0.5 * distance * math.cos(angle), 0.5 * distance * math.sin(angle)
        end = begin + distance / speed + 2.0 * RISE
        paths.append(Stroke(begin, end, RISE, x - across, y - up, 0.0, force, x + across, y + up, 0.0, 1))
        begin = end + RISE
    return _scene(paths, begin)


def held_with_varying_force(seconds: float) -> Scene:
    """Return a scene of a held ball whose force varies randomly between 0.1 and 1.9 N at up to 5 Hz."""
    return _scene([RandomMotion(FIRST, seconds, RISE, 0.4e-3, -0.5e-3, 0.0, 1.0, 0.9, 0.0, 5.0, 3)], seconds)


def score(scene: Scene, seed: int, calibrated: Calibrated) -> Score:
    """Return the score of a scene on the board with that seed."""
    calibration = calibrated(seed).with_gain_error(MISMATCH, np.random.default_rng(seed))
    return run(Run(load_sensor(), scene, scene.period, seed, BOARD, calibration))


def rows(pool: Executor, seeds: Sequence[int], seconds: float, calibrated: Calibrated) -> list[str]:
    """Return a table over speed and force, and a row for `seconds` of each board without slip."""
    table = [
        "| speed mm/s | force N | slips | detected % | delay ms, mean | max | false slips |",
        "|---|---|---|---|---|---|---|",
    ]
    cases = {
        (speed, force): [
            pool.submit(score, slipping(speed, force, round(1e6 * speed) + seed), seed, calibrated) for seed in seeds
        ]
        for speed in SPEEDS
        for force in FORCES
    }
    still = [pool.submit(score, held_with_varying_force(seconds), seed, calibrated) for seed in seeds]
    for (speed, force), futures in cases.items():
        scores = [future.result() for future in futures]
        slips = SLIPS * len(seeds) if speed >= SLIP_SPEED else 0
        detected = "-" if not slips else f"{100 * float(np.mean([found.slip_recall or 0.0 for found in scores])):.0f}"
        delays = [found.slip_onset_delay_ms for found in scores]
        mean = [delay["mean"] for delay in delays if delay["mean"] is not None]
        longest = [delay["max"] for delay in delays if delay["max"] is not None]
        duration = slipping(speed, force, 0).period
        wrong = round(sum(found.false_slips_per_hour * duration / 3600 for found in scores))
        cells = [f"{1e3 * speed:g}", f"{force:g}", f"{slips}", detected]
        cells += [f"{np.mean(mean):.1f}" if mean else "-", f"{max(longest):.0f}" if longest else "-", f"{wrong}"]
        table.append(f"| {' | '.join(cells)} |")
        print(table[-1], flush=True)
    wrong = round(sum(future.result().false_slips_per_hour * seconds / 3600 for future in still))
    table.append(f"| 0 | 0.1-1.9, for {seconds * len(seeds):g} s | 0 | - | - | - | {wrong} |")
    print(table[-1], flush=True)
    return table


@lru_cache
def _calibrated(seed: int) -> Calibration:
    return calibrate(load_sensor(), seed, BOARD)


if __name__ == "__main__":
    with ProcessPoolExecutor(2) as workers:
        rows(workers, (1, 2), 15.0, _calibrated)
