"""How near the reconstruction comes to the truth: writes docs/accuracy.md and its figure. Run by `make accuracy`.

Scenes run on the simulated board with every imperfection at its default (but resets, which end what a scene is about),
by a calibration of that board whose gains are then made wrong by 5 % at random. Every number is of this run.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from posfet_driver.calibrate import calibrate
from posfet_driver.imperfections import Imperfections
from posfet_driver.scene import load_scene
from posfet_driver.score import Run, differing, run
from posfet_driver.scoring import Score
from posfet_model.calibration import Calibration
from posfet_model.figures import style
from posfet_model.sensor import Sensor, load_sensor

ROOT: Final = Path(__file__).resolve().parent.parent
DOCUMENT: Final = ROOT / "docs" / "accuracy.md"
FIGURE: Final = "accuracy_mismatch"

sys.path.insert(0, str(ROOT / "test"))

from held_force import Held, hold  # noqa: E402  the optimal estimator is a test's

SCENES: Final = (
    ("press", 4.0, 4.0),
    ("press_slide_lift", 4.0, 8.0),
    ("slide", 4.0, 8.0),
    ("two_fingers", 4.0, 8.0),
    ("two_fingers_slide", 4.0, 8.0),
    ("tap", 4.0, 8.0),
    ("grasp_lift_slip", 6.0, 12.0),
    ("hold", 12.0, 63.0),
    ("temperature_ramp", 15.0, 60.0),
    ("idle", 20.0, 600.0),
)
"""Name, and how much of it is run [s], in short and in full."""

MISMATCH: Final = 0.05
"""Random error of the gains that is left after calibration [1]."""

DIFFERENCES: Final = (("leak", 20.0), ("d33", 10.0), ("spread", 20.0), ("lag", 30.0))
"""By how much the device differs from what the model and the calibration take it for, either way [%]."""

MISMATCH_SCENES: Final = (("press_slide_lift", 4.0), ("hold", 5.0))

PUBLISHED: Final = 10.68
"""Force error of a comparable PVDF array [%], PMC4934245."""

BOARD: Final = replace(Imperfections.default(), resets_per_hour=0.0)


@dataclass(frozen=True)
class Boards:
    """A sensor's boards with their calibrations, each made once."""

    sensor: Sensor
    calibrations: dict[int, Calibration]

    @classmethod
    def of(cls, sensor: Sensor, seeds: Sequence[int]) -> Boards:
        """Calibrate the board of each seed, and make its gains wrong."""
        found = {
            seed: calibrate(sensor, seed, BOARD).with_gain_error(MISMATCH, np.random.default_rng(seed))
            for seed in seeds
        }
        return cls(sensor, found)

    def score(self, scene: str, seconds: float, seed: int, differences: dict[str, float] | None = None) -> Score:
        """Run a scene on a board that differs from the one calibrated by `differences` [%]."""
        device = differing(self.sensor, differences or {})
        what = load_scene(scene, device)
        return run(Run(self.sensor, what, seconds, seed, BOARD, self.calibrations[seed], device))


def _mean(values: Sequence[float | None], digits: int, worst: bool = False) -> str:
    known = [value for value in values if value is not None]
    if not known:
        return "-"
    return f"{max(known) if worst else float(np.mean(known)):.{digits}f}"


def scene_rows(boards: Boards, full: bool) -> list[str]:
    """Return a table of every figure of the score, a row for each scene: means over the boards, or the worst."""
    rows = [
        "| scene | s | force rmse % of full scale | total force % | drift of a held force % | cop mm, mean | p95 |"
        " precision | recall | id switches | latency, scans | false contacts per h |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for name, short, long in SCENES:
        seconds = long if full else short
        scores = [boards.score(name, seconds, seed) for seed in boards.calibrations]
        cells = [
            _mean([score.force_rmse_pct for score in scores], 2),
            _mean([score.total_force_error_pct for score in scores], 2),
            _mean([score.held_force_drift_pct for score in scores], 2),
            _mean([score.cop_error_mm["mean"] for score in scores], 3),
            _mean([score.cop_error_mm["p95"] for score in scores], 3),
            _mean([score.contact_precision for score in scores], 3),
            _mean([score.contact_recall for score in scores], 3),
            _mean([score.id_switches for score in scores], 0, worst=True),
            _mean([score.detection_latency_scans for score in scores], 0, worst=True),
            _mean([score.false_contacts_per_hour for score in scores], 1),
        ]
        rows.append(f"| `{name}` | {seconds:g} | {' | '.join(cells)} |")
        print(rows[-1], flush=True)
    return rows


def held_rows(full: bool) -> list[str]:
    """Return a table of the error of a held force against the optimal estimator's."""
    rows = [
        "| 1/f noise, uV/sqrt(Hz) at 1 Hz | held for s | error mN | optimal mN | ratio | reported mN |"
        " within two reported % |",
        "|---|---|---|---|---|---|---|",
    ]
    times = (1.0, 5.0, 20.0, 60.0)
    for flicker in (0.0, 10e-6):
        runs = [list(hold(seed, times, flicker=flicker)) for seed in range(20 if full else 3)]
        for at in range(len(times)):
            held: list[Held] = [found[at] for found in runs]
            error, optimal = (
                np.sqrt(np.mean([getattr(one, name) ** 2 for one in held])) for name in ("error", "optimal")
            )
            reported, inside = (np.mean([getattr(one, name) for one in held]) for name in ("deviation", "inside"))
            cells = [f"{flicker * 1e6:g}", f"{times[at]:g}", f"{error * 1e3:.2f}", f"{optimal * 1e3:.2f}"]
            cells += [f"{error / optimal:.2f}", f"{reported * 1e3:.2f}", f"{inside * 100:.1f}"]
            rows.append(f"| {' | '.join(cells)} |")
            print(rows[-1], flush=True)
    return rows


def mismatches(boards: Boards, full: bool) -> dict[str, list[tuple[float, float]]]:
    """Return, for each difference, (percent, worst total force error of the scenes and boards [%])."""
    found: dict[str, list[tuple[float, float]]] = {}
    plain = max(_total(boards, name, seconds, {}) for name, seconds in MISMATCH_SCENES)
    for kind, most in DIFFERENCES:
        found[kind] = []
        for percent in (-most, -most / 2, most / 2, most) if full else (-most, most):
            error = max(_total(boards, name, seconds, {kind: percent}) for name, seconds in MISMATCH_SCENES)
            found[kind].append((percent, error))
            print(f"{kind} {percent:+g} %: {error:.2f} %", flush=True)
        found[kind].insert(len(found[kind]) // 2, (0.0, plain))
    return found


def _total(boards: Boards, scene: str, seconds: float, differences: dict[str, float]) -> float:
    errors = [
        boards.score(scene, seconds, seed, differences).total_force_error_pct or 0.0 for seed in boards.calibrations
    ]
    return float(np.mean(errors))


def mismatch_rows(found: dict[str, list[tuple[float, float]]]) -> list[str]:
    """Return the table of `mismatches`."""
    rows = ["| device differs in | by % | total force error % |", "|---|---|---|"]
    for kind, points in found.items():
        rows += [f"| {kind} | {percent:+g} | {error:.2f} |" for percent, error in points]
    return rows


def draw(found: dict[str, list[tuple[float, float]]]) -> Figure:
    """Return the plot of error against mismatch."""
    figure, (axes,) = style.new_figure(3.6)
    looks = zip(
        (style.BLUE, style.VERMILION, style.GREEN, style.PURPLE),
        (style.SOLID, style.DASHED, style.DOTTED, style.DASH_DOT),
        "osv^",
        strict=True,
    )
    for (kind, points), (colour, dash, mark) in zip(found.items(), looks, strict=True):
        axes.plot(*zip(*points, strict=True), color=colour, linestyle=dash, marker=mark, label=kind)
    axes.axhline(PUBLISHED, color=style.GREY, linewidth=1.0)
    axes.annotate("published array", (0.0, PUBLISHED), textcoords="offset points", xytext=(0, 3), ha="center")
    axes.set_xlabel("device differs from its description and calibration by / %")
    axes.set_ylabel("total force error / %")
    axes.set_ylim(0.0, 1.15 * max(PUBLISHED, *(error for points in found.values() for _, error in points)))
    axes.legend(frameon=False)
    return figure


def main() -> None:
    """Measure, and write the document."""
    parser = argparse.ArgumentParser(prog="make accuracy")
    parser.add_argument("--full", action="store_true", help="more boards, longer scenes: 10 min of idle, 60 s of hold")
    full = parser.parse_args().full
    begin = time.monotonic()
    boards = Boards.of(load_sensor(), range(1, 6) if full else (1, 2))
    scenes, held, found = scene_rows(boards, full), held_rows(full), mismatches(boards, full)
    style.save(lambda: draw(found), DOCUMENT.parent / "figures" / FIGURE)
    command = "make accuracy FULL=1" if full else "make accuracy"
    mismatch_scenes = ", ".join(f"`{name}` ({seconds:g} s)" for name, seconds in MISMATCH_SCENES)
    document = f"""# Accuracy

Made by `{command}` on {date.today().isoformat()}; every number is of that run, none is typed.

Simulated boards with every imperfection at its default (docs/simulation.md; resets are off), calibrated
(`posfet calibrate`), and with {MISMATCH * 100:g} % random error of the gains left after that. Means over boards, of
which there are {len(boards.calibrations)}; id switches and latency are the worst.

## Scenes

{chr(10).join(scenes)}

A taxel that does not work is left out of the true force, too. The latency counts from the first scan in which a taxel
truly carries the threshold of contacts (20 mN), whether that taxel works or not.

## A held force against the optimal estimator

2 N held by 256 taxels at once, after 2 s at rest, with white noise and with 1/f noise besides. The optimal estimator is
a Kalman filter that knows the noise and when something touches (test/held_force.py); both know the leak. Errors are
root mean squares over the taxels.

{chr(10).join(held)}

## A device unlike its description

The device differs from what the model and the calibration take it for. Scenes: {mismatch_scenes}; the
worst of them counts, each the mean over the boards. The force error published for a comparable PVDF array is
{PUBLISHED:g} % (PMC4934245). An error of d33 scales every force, and nothing but a reference force can tell it.
Neither scene changes the temperature, so the lag of the film's temperature makes no difference here: how the observer
takes a wrong lag is not measured by this table.

{chr(10).join(mismatch_rows(found))}

![Total force error against mismatch](figures/{FIGURE}.svg)
"""
    DOCUMENT.write_text(document, encoding="utf-8")
    print(f"{DOCUMENT}: {time.monotonic() - begin:.0f} s")


if __name__ == "__main__":
    main()
