"""How near the reconstruction comes to the truth: writes docs/accuracy.md and its figure. Run by `make accuracy`.

Scenes run on the simulated board with every imperfection at its default (but resets, which end what a scene is about),
by a calibration of that board whose gains are then made wrong by 5 % at random. Every number is of this run.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from dataclasses import dataclass, replace
from datetime import date
from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from benchmarks import ablation, held, slips, slow_press
from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.figures import style
from posfet_model.sensor.description import load_sensor
from posfet_sim.calibration.simulated_bench import calibrate
from posfet_sim.commands.score import perturbed
from posfet_sim.device.error_model import ErrorModel
from posfet_sim.emulation.offline import received_scans
from posfet_sim.evaluation.scorer import Score, Scorer
from posfet_sim.scene import load_scene

ROOT: Final = Path(__file__).resolve().parent.parent
DOCUMENT: Final = ROOT / "docs" / "accuracy.md"
FIGURE: Final = "accuracy_mismatch"

SCENES: Final = (
    ("press", 4.0, 4.0),
    ("press_slide_lift", 4.0, 8.0),
    ("slide", 4.0, 8.0),
    ("two_fingers", 4.0, 8.0),
    ("two_fingers_slide", 4.0, 8.0),
    ("tap", 4.0, 8.0),
    ("vibration", 3.0, 6.0),
    ("texture", 3.0, 6.0),
    ("grasp_lift_slip", 6.0, 12.0),
    ("warm_finger", 10.0, 10.0),
    ("hold", 63.0, 63.0),
    ("temperature_ramp", 20.0, 60.0),
    ("idle", 600.0, 600.0),
)
"""Name, and how much of it is run [s], in short and in full."""

MISMATCH: Final = 0.05
"""Random error of the gains that is left after calibration [1]."""

STILL: Final = (("press_slide_lift", 4.0), ("hold", 10.0))
WARM: Final = (("warm_finger", 10.0),)

DIFFERENCES: Final = (
    ("leak", 20.0, STILL),
    ("d33", 10.0, STILL),
    ("spread", 20.0, STILL),
    ("lag", 30.0, WARM),
    ("pyroelectric", 20.0, WARM),
)
"""By how much the device differs from what the model and the calibration take it for, either way [%]; and scenes where
that matters, with how much of them is run [s]."""

LONG: Final = 12.0
"""Scenes longer than this are run on few boards [s]."""

FEW: Final = 2

SLIPLESS: Final = 15.0
"""For how long a force wanders without a slip, on each board [s]."""

SLIPLESS_FULL: Final = 600.0

PROCESSES: Final = 2

PUBLISHED: Final = 10.68
"""Force error of a comparable PVDF array [%], PMC4934245."""

BOARD: Final = replace(ErrorModel.default(), resets_per_hour=0.0)

WHITE: Final = replace(ErrorModel.none(), thermal_noise=BOARD.thermal_noise)
"""White noise and quantisation alone."""


@dataclass(frozen=True)
class Job:
    """A scene on one board."""

    scene: str
    seconds: float
    seed: int
    sign: int
    """Which way the gains are wrong: each board is run with errors of both signs, so that their mean is no bias. 0 for
    right ones."""
    differences: tuple[tuple[str, float], ...] = ()
    board: ErrorModel = BOARD
    without: str = "nothing"
    """Piece of the reconstruction that is taken out, of `ablation.PIECES`."""


@lru_cache
def _calibration(seed: int, board: ErrorModel = BOARD) -> Calibration:
    return calibrate(load_sensor(), seed, board)


def score(job: Job) -> tuple[Score, float]:
    """Return the score of a job, and the error of the total force that the wrong gains alone leave [%]."""
    sensor, right = load_sensor(), _calibration(job.seed, job.board)
    wrong = 1.0 + job.sign * MISMATCH * np.random.default_rng(job.seed).standard_normal(sensor.layout.taxels)
    device = perturbed(sensor, dict(job.differences))
    scorer, calibration = Scorer(sensor), replace(right, gain=right.gain * wrong)
    errors, forces = [], []
    with ablation.PIECES[job.without].reconstructor(sensor, calibration) as reconstructor:
        for scan, truth in received_scans(device, load_scene(job.scene, device), job.seconds, job.seed, job.board):
            result = reconstructor.process(scan)
            image = reconstructor.image()
            if not result.accepted:
                continue
            scorer.add(result, image, truth)
            if result.valid and truth.force.any():
                force = np.where(np.isfinite(image.force), truth.force, 0.0)
                errors.append(abs(float((force / wrong - force).sum())))
                forces.append(float(force.sum()))
    return scorer.score(0.0), 100.0 * sum(errors) / sum(forces) if sum(forces) else math.nan


def both_ways(seeds: Sequence[int], scene: str, seconds: float, *differences: tuple[str, float]) -> list[Job]:
    """Return the jobs of a scene: every board, with its gains wrong one way and the other."""
    return [Job(scene, seconds, seed, sign, differences) for seed in seeds for sign in (1, -1)]


@dataclass(frozen=True)
class Column:
    """A figure of the score, over the boards their mean or the worst."""

    head: str
    of: Callable[[Score], float | None]
    digits: int
    worst: bool = False
    """The greatest of the boards counts, not their mean."""
    more_is_better: bool = False

    def over(self, scores: Sequence[Score]) -> float | None:
        """Return the figure of several boards; None: nothing to judge it by."""
        known = [value for score in scores if (value := self.of(score)) is not None]
        if not known:
            return None
        return max(known) if self.worst else float(np.mean(known))

    def text(self, *values: float | None) -> str:
        """Return the worst of several as text."""
        known = [value for value in values if value is not None]
        return f"{(min if self.more_is_better else max)(known):.{self.digits}f}" if known else "-"


TOTAL: Final = Column("total force %", lambda score: score.total_force_error_pct, 2)
COLUMNS: Final = (
    TOTAL,
    Column("force rmse % of full scale", lambda score: score.force_rmse_pct, 2),
    Column("drift of a held force %", lambda score: score.held_force_drift_pct, 2),
    Column("cop mm, mean", lambda score: score.cop_error_mm["mean"], 3),
    Column("p95", lambda score: score.cop_error_mm["p95"], 3),
    Column("precision", lambda score: score.contact_precision, 3, more_is_better=True),
    Column("recall", lambda score: score.contact_recall, 3, more_is_better=True),
    Column("id switches", lambda score: score.id_switches, 0, worst=True),
    Column("latency, scans", lambda score: score.detection_latency_scans, 0, worst=True),
    Column("false contacts per h", lambda score: score.false_contacts_per_hour, 1),
)
HEADS: Final = " | ".join(column.head for column in COLUMNS)
RULE: Final = "---|" * len(COLUMNS)


def scene_rows(pool: Executor, seeds: Sequence[int], full: bool) -> list[str]:
    """Return a table of every figure of the score, a row for each scene: means over the boards, or the worst."""
    rows = [f"| scene | s | {HEADS} | total force % by the gains alone |", f"|---|---|{RULE}---|"]
    runs = []
    for name, short, long in SCENES:
        seconds = long if full else short
        jobs = both_ways(seeds, name, seconds)
        if seconds > LONG:  # nothing is touched, or the same for long: the sign of the gains tells nothing new
            jobs = jobs[: 2 * FEW : 2]
        runs.append((f"`{name}`", seconds, [pool.submit(score, job) for job in jobs]))
    jobs = [Job("hold", 63.0, seed, 0, board=WHITE) for seed in seeds[:FEW]]
    runs.append(("`hold`, white noise and quantisation alone", 63.0, [pool.submit(score, job) for job in jobs]))
    for name, seconds, futures in runs:
        scores = [future.result()[0] for future in futures]
        gains = [value for future in futures if math.isfinite(value := future.result()[1])]
        cells = [column.text(column.over(scores)) for column in COLUMNS]
        cells.append(TOTAL.text(float(np.mean(gains)) if gains else None))
        rows.append(f"| {name} | {seconds:g} | {' | '.join(cells)} |")
        print(rows[-1], flush=True)
    return rows


def without_rows(pool: Executor, seeds: Sequence[int]) -> list[str]:
    """Return a table of scenes with one piece of the reconstruction taken out."""
    runs = {
        (piece, title): [
            pool.submit(score, Job(scene, seconds, seed, 0, differences, without=piece)) for seed in seeds[:FEW]
        ]
        for piece in ablation.PIECES
        for title, (scene, seconds, differences) in ablation.SCENES.items()
    }
    rows = ablation.rows({key: [future.result()[0] for future in futures] for key, futures in runs.items()})
    print(*rows, sep="\n", flush=True)
    return rows


@dataclass(frozen=True)
class Point:
    """Every figure under one difference, of the scene in which it is worst."""

    percent: float
    """By how much the device differs."""
    mean: float
    """Error of the total force over the boards [%]."""
    worst: float
    """Of the boards [%]."""
    cells: list[str]
    """Every figure as text, by `COLUMNS`."""


def mismatches(pool: Executor, seeds: Sequence[int], full: bool) -> dict[str, list[Point]]:
    """Return the figures of each difference."""
    runs = {
        (kind, percent): [
            [pool.submit(score, job) for job in both_ways(seeds, name, seconds, (kind, percent))]
            for name, seconds in scenes
        ]
        for kind, most, scenes in DIFFERENCES
        for percent in ((-most, -most / 2, 0.0, most / 2, most) if full else (-most, 0.0, most))
    }
    found: dict[str, list[Point]] = {}
    for (kind, percent), futures in runs.items():
        scenes = [[future.result()[0] for future in boards] for boards in futures]
        totals = [[score.total_force_error_pct or 0.0 for score in scores] for scores in scenes]
        cells = [column.text(*(column.over(scores) for scores in scenes)) for column in COLUMNS]
        point = Point(percent, max(float(np.mean(boards)) for boards in totals), max(map(max, totals)), cells)
        found.setdefault(kind, []).append(point)
        print(kind, point, flush=True)
    return found


def mismatch_rows(found: dict[str, list[Point]]) -> list[str]:
    """Return the table of `mismatches`."""
    rows = [f"| device differs in | by % | {HEADS} | total force % of the worst board |", f"|---|---|{RULE}---|"]
    for kind, points in found.items():
        for point in points:
            rows.append(f"| {kind} | {point.percent:+g} | {' | '.join(point.cells)} | {point.worst:.2f} |")
    return rows


def draw(found: dict[str, list[Point]]) -> Figure:
    """Return the plot of error against mismatch."""
    figure, (axes,) = style.new_figure(3.6)
    looks = zip(
        (style.BLUE, style.VERMILION, style.GREEN, style.PURPLE, style.GREY),
        (style.SOLID, style.DASHED, style.DOTTED, style.DASH_DOT, style.SOLID),
        "osv^d",
        strict=True,
    )
    for (kind, points), (colour, dash, mark) in zip(found.items(), looks, strict=True):
        places, errors = [point.percent for point in points], [point.mean for point in points]
        axes.plot(places, errors, color=colour, linestyle=dash, marker=mark, label=kind)
    axes.axhline(PUBLISHED, color=style.GREY, linewidth=1.0)
    axes.annotate("published array", (0.0, PUBLISHED), textcoords="offset points", xytext=(0, 3), ha="center")
    axes.set_xlabel("device differs from its description and calibration by / %")
    axes.set_ylabel("total force error / %")
    axes.set_ylim(0.0, 1.15 * max(PUBLISHED, *(point.mean for points in found.values() for point in points)))
    axes.legend(frameon=False)
    return figure


def main() -> None:
    """Measure, and write the document."""
    parser = argparse.ArgumentParser(prog="make accuracy")
    parser.add_argument("--full", action="store_true", help="more boards, longer scenes")
    full = parser.parse_args().full
    begin = time.monotonic()
    seeds = (1, 2, 3, 4) if full else (1, 2)
    with ProcessPoolExecutor(PROCESSES) as pool:
        scenes, held_table = scene_rows(pool, seeds, full), held.rows(pool, full)
        without, slow = without_rows(pool, seeds), slow_press.rows(pool, seeds[0], BOARD, _calibration)
        slipped = slips.rows(pool, seeds, SLIPLESS_FULL if full else SLIPLESS, _calibration)
        found = mismatches(pool, seeds, full)
    style.save(lambda: draw(found), DOCUMENT.parent / "figures" / FIGURE)
    command = "make accuracy FULL=1" if full else "make accuracy"
    tables = {"still": STILL, "warm": WARM}
    names = {kind: ", ".join(f"`{name}` ({seconds:g} s)" for name, seconds in of) for kind, of in tables.items()}
    document = f"""# Accuracy

Made by `{command}` on {date.today().isoformat()}; every number is of that run, none is typed.

Simulated boards with every imperfection at its default (docs/simulation.md; resets are off), calibrated
(`posfet calibrate`), and with {MISMATCH * 100:g} % random error of the gains left after that.
Means over {len(seeds)} boards, each run twice, with its gains wrong one way and the other;
of runs longer than {LONG:g} s, {FEW} boards one way. Id switches and latency are the worst.
"By the gains alone" is the error of the total when everything else is right: nothing but a
better calibration takes it away.

## Scenes

{chr(10).join(scenes)}

A taxel that does not work is left out of the true force, too. The latency counts from the first scan in which a taxel
truly carries the threshold of contacts (20 mN), whether that taxel works or not.

## A held force against the optimal estimator

{held.TEXT}

{chr(10).join(held_table)}

## What each piece is worth

{ablation.TEXT}

{chr(10).join(without)}

## Slow presses

{slow_press.TEXT}

{chr(10).join(slow)}

## Slips

{slips.TEXT}

{chr(10).join(slipped)}

## A device unlike its description

The device differs from what the model and the calibration take it for. For each figure the worst of the scenes counts:
{names["still"]};
for lag and pyroelectric coefficient {names["warm"]}, whose error at +0 is the scene's own.
The force error published for a comparable PVDF array is {PUBLISHED:g} % (PMC4934245), a mean, too.
An error of d33 scales every force, and nothing but a reference force can tell it:
a device of -10 % reads 0.9 of every force, which is 10 % before anything else.

{chr(10).join(mismatch_rows(found))}

![Total force error against mismatch](figures/{FIGURE}.svg)
"""
    DOCUMENT.write_text(document, encoding="utf-8")
    print(f"{DOCUMENT}: {time.monotonic() - begin:.0f} s")


if __name__ == "__main__":
    main()
