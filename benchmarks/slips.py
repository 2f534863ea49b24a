"""How soon a slip is told, by its speed and the force: a part of `make accuracy`, alone `python -m benchmarks.slips`.

A ball is pressed on, slips straight at a constant speed from one moment to the next, and lifts, at random places and in
random directions. Beside it one that stays where it is while its force wanders, which is no slip.
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
from posfet_sim.scene.trajectories import Path, RandomMotion, Stroke

SPEEDS: Final = (5e-3, 12e-3, 20e-3, 50e-3)
"""[m/s]."""

FORCES: Final = (0.3, 1.0, 3.0)
"""[N]."""

SLIPS: Final = 5
"""Slips in a run."""

LASTS: Final = 0.06
"""How long each lasts at least [s]."""

LEAST_WAY: Final = 0.6e-3
"""[m]."""

RISE: Final = 0.1
"""Time of a press, of a lift, and between two touches [s]."""

FIRST: Final = 0.4
"""When the first touch begins [s]."""

AROUND: Final = 0.8e-3
"""Greatest distance of a slip's middle from that of the array, in x and in y [m]."""

MISMATCH: Final = 0.05
"""Random error of the gains that is left after calibration [1]."""

TEXT: Final = f"""\
A ball of 4 mm radius slips {SLIPS} times on each board, straight at a constant speed from one moment to the next, at
random places and in random directions. From {SLIP_SPEED * 1e3:g} mm/s on that is a slip. It counts as told within 50
ms. "Told though none" are slips told at any other time, landing and lifting within {RISE * 1e3:g} ms among them. In the
last row a held ball stays where it is while its force wanders at up to 5 Hz."""

BOARD: Final = replace(ErrorModel.default(), resets_per_hour=0.0)

Calibrated = Callable[[int], Calibration]
"""The calibration of the board with a seed."""


def _scene(paths: Sequence[Path], seconds: float) -> Scene:
    balls = tuple(SceneObject(f"ball {number}", Sphere(4e-3, 2e6), path) for number, path in enumerate(paths))
    return Scene("slips", "a ball slips", seconds, balls, Keyframes((0.0,), ((25.0,),)))


def slipping(speed: float, force: float, seed: int) -> Scene:
    """Return a scene of `SLIPS` slips at a speed [m/s] under a force [N]."""
    rng = np.random.default_rng(seed)
    way = max(speed * LASTS, LEAST_WAY)
    paths, begin = [], FIRST
    for _ in range(SLIPS):
        x, y = rng.uniform(-AROUND, AROUND, 2).tolist()
        angle = rng.uniform(0.0, 2.0 * math.pi)
        across, up = 0.5 * way * math.cos(angle), 0.5 * way * math.sin(angle)
        end = begin + way / speed + 2.0 * RISE
        paths.append(Stroke(begin, end, RISE, x - across, y - up, 0.0, force, x + across, y + up, 0.0, 1))
        begin = end + RISE
    return _scene(paths, begin)


def wandering(seconds: float) -> Scene:
    """Return a scene of a held ball whose force wanders between 0.1 and 1.9 N at up to 5 Hz."""
    return _scene([RandomMotion(FIRST, seconds, RISE, 0.4e-3, -0.5e-3, 0.0, 1.0, 0.9, 0.0, 5.0, 3)], seconds)


def score(scene: Scene, seed: int, calibrated: Calibrated) -> Score:
    """Return the score of a scene on the board with that seed."""
    calibration = calibrated(seed).with_gain_error(MISMATCH, np.random.default_rng(seed))
    return run(Run(load_sensor(), scene, scene.period, seed, BOARD, calibration))


def rows(pool: Executor, seeds: Sequence[int], seconds: float, calibrated: Calibrated) -> list[str]:
    """Return a table over speed and force, and a row for `seconds` of each board without slip."""
    table = [
        "| mm/s | N | slips | told % | after ms, mean | longest | told though none |",
        "|---|---|---|---|---|---|---|",
    ]
    cases = {
        (speed, force): [
            pool.submit(score, slipping(speed, force, round(1e6 * speed) + seed), seed, calibrated) for seed in seeds
        ]
        for speed in SPEEDS
        for force in FORCES
    }
    still = [pool.submit(score, wandering(seconds), seed, calibrated) for seed in seeds]
    for (speed, force), futures in cases.items():
        scores = [future.result() for future in futures]
        slips = SLIPS * len(seeds) if speed >= SLIP_SPEED else 0
        told = "-" if not slips else f"{100 * float(np.mean([found.slip_recall or 0.0 for found in scores])):.0f}"
        delays = [found.slip_onset_delay_ms for found in scores]
        mean = [delay["mean"] for delay in delays if delay["mean"] is not None]
        longest = [delay["max"] for delay in delays if delay["max"] is not None]
        lasted = slipping(speed, force, 0).period
        wrong = round(sum(found.false_slips_per_hour * lasted / 3600 for found in scores))
        cells = [f"{1e3 * speed:g}", f"{force:g}", f"{slips}", told]
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
