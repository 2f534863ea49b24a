# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""`posfet score`: simulate a scene, reconstruct it from the CAN frames, and score it against the ground truth.

By default the simulated board is calibrated first, as by `posfet calibrate`. Several scenes, seeds or sensors make a
table, on several processes or machines.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np

from posfet_model.calibration.calibration_file import check_writable, load_calibration
from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.command_line import BAD_INPUT
from posfet_model.config import ConfigError
from posfet_model.parameters import SENSOR_FILE
from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_sim.calibration.simulated_bench import calibrate
from posfet_sim.commands.batch import FORMATS, LOCAL, as_csv, results, write_table
from posfet_sim.commands.options import add_duration, add_error_model, add_seed, number_in, seed
from posfet_sim.commands.progress import progress
from posfet_sim.device.error_model import ErrorModel, load_error_model
from posfet_sim.emulation.offline import received_scans
from posfet_sim.evaluation.scorer import Score, Scorer
from posfet_sim.parameters import SCENE
from posfet_sim.scene import Scene, load_scene

UNCALIBRATED: Final = "none"
"""Value of --calibration for nominal parameters."""
PROBLEM: Final = "problem"
"""Column that says why a run has no score."""
STATIC_DURATION: Final = 10.0
"""Default duration of a scene that never changes [s]."""
MAX_SEEDS: Final = 100_000
"""Maximum number of seeds in a range."""
MAX_JOBS: Final = 1024
"""Maximum number of processes."""

DEVICE_PROPERTIES: Final = {
    "leak": "leak_time_constant",
    "d33": "piezoelectric_coefficient",
    "spread": "contact_spread",
    "lag": "thermal_time_constant",
    "pyroelectric": "pyroelectric_coefficient",
}
"""Properties of the simulated device that --device scales: field of the device description by name."""


@dataclass(frozen=True)
class Run:
    """One run to score."""

    sensor: Sensor
    """Sensor description of the reconstruction."""
    scene: Scene
    """Scene to simulate."""
    duration: float
    """Duration [s]."""
    seed: int = 1
    """Seed of the board."""
    error_model: ErrorModel | None = None
    """Error model of the board; None: ideal."""
    calibration: Calibration | None = None
    """Calibration of the reconstruction; None: nominal parameters."""
    device: Sensor | None = None
    """True properties of the board; None: as in `sensor`."""


def run(what: Run) -> Score:
    """Simulate, reconstruct and score a run.

    Parameters
    ----------
    what : Run
        Scene, board and calibration.

    Returns
    -------
    Score
        Errors of the run.

    Raises
    ------
    ConfigError
        The layout does not fit the frames.
    """
    reconstructor = Reconstructor(what.sensor, what.calibration)
    scorer = Scorer(what.sensor)
    spent, scans = 0, 0
    for scan, truth in received_scans(
        what.device or what.sensor, what.scene, what.duration, what.seed, what.error_model
    ):
        begin = time.perf_counter_ns()
        result = reconstructor.process(scan)
        image = reconstructor.image()
        spent += time.perf_counter_ns() - begin
        scans += 1
        if result.accepted:
            scorer.add(result, image, truth)
    return scorer.score(spent / max(scans, 1) * 1e-3)


def perturbed(sensor: Sensor, percent: dict[str, float]) -> Sensor:
    """Return a sensor with scaled device properties, to simulate model mismatch.

    Parameters
    ----------
    sensor : Sensor
        Sensor description.
    percent : dict of str to float
        Change of each property in percent, by its name in `DEVICE_PROPERTIES`.
    """
    device = sensor.device
    changes = {
        DEVICE_PROPERTIES[name]: getattr(device, DEVICE_PROPERTIES[name]) * (1 + by / 100)
        for name, by in percent.items()
    }
    return replace(sensor, device=replace(device, **changes))


@dataclass(frozen=True)
class Case:
    """One row of a table: words of the command line, so that it can be sent to other processes."""

    scene: str
    """Scene: name or path."""
    sensor: str
    """Sensor description: name or path."""
    seed: int
    """Seed of the board."""
    imperfections: str
    """Error model: name or path."""
    calibration: str | None
    """Calibration file, `UNCALIBRATED`, or None: calibrate the board first."""
    mismatch: float
    """Standard deviation of gain errors after calibration [%]."""
    device: tuple[tuple[str, float], ...]
    """Changes of device properties [%]."""
    seconds: float | None
    """Duration [s]; None: once through the scene."""


def prepared(case: Case) -> Run:
    """Return the run of a case; ConfigError, one line, for bad input."""
    sensor = load_sensor(case.sensor)
    device = perturbed(sensor, dict(case.device))
    scene = load_scene(case.scene, device)
    return Run(
        sensor=sensor,
        scene=scene,
        duration=case.seconds or scene.duration or STATIC_DURATION,
        seed=case.seed,
        error_model=load_error_model(case.imperfections),
        device=device,
    )


def score_of(case: Case) -> Score:
    """Calibrate the board of a case if it asks for it, and return the score of its run."""
    what = prepared(case)
    calibration = _calibration(case.calibration, case.sensor, case.seed, case.imperfections)
    if case.mismatch:
        calibration = calibration.with_gain_error(case.mismatch / 100, np.random.default_rng(case.seed))
    return run(replace(what, calibration=calibration))


def main(words: Sequence[str] | None = None) -> int:
    """Print the score of a run as JSON, or a table of several; return 0, or 1 with one line on stderr for bad input."""
    options = make_parser().parse_args(words)
    cases = [
        Case(
            scene=scene,
            sensor=sensor,
            seed=seed,
            imperfections=options.imperfections,
            calibration=options.calibration,
            mismatch=options.mismatch,
            device=tuple(options.device),
            seconds=options.seconds,
        )
        for sensor in options.sensor or [SENSOR_FILE.default]
        for seed in options.seeds or [options.seed]
        for scene in options.scenes
    ]
    try:
        if len(cases) == 1 and options.out is None:
            print(json.dumps(asdict(score_of(cases[0])), indent=2))
        else:
            _table(cases, options)
    except ConfigError as error:
        print(error, file=sys.stderr)
        return BAD_INPUT
    return 0


def attempt(case: Case) -> Score | str:
    """Return the score of a case, or why it has none, in one line: one board among many must not end all runs."""
    try:
        return score_of(case)
    except ConfigError as error:
        return str(error)


def _table(cases: Sequence[Case], options: argparse.Namespace) -> None:
    """Score all cases; print the table as CSV, or write it. ConfigError, one line, if a case has no score."""
    out = options.out
    if out is not None and out.suffix not in FORMATS:
        raise ConfigError(f"{out}: must end in {', '.join(FORMATS)}")
    if out is not None:
        check_writable(out)
    for case in cases:  # bad input is reported before the work begins
        sensor = prepared(case).sensor
        if case.calibration not in {None, UNCALIBRATED}:
            load_calibration(case.calibration, sensor)
    begin = time.monotonic()
    with progress(f"{len(cases)} runs", len(cases)) as at:
        scores = results(attempt, cases, options.jobs, options.dask, at)
    rows = table_rows(cases, scores)
    if out is None:
        print(as_csv(rows), end="")
    else:
        write_table(out, rows)
        print(f"{out}: {len(rows)} runs in {time.monotonic() - begin:.1f} s")
    if failed := [row for row in rows if row[PROBLEM]]:
        raise ConfigError(f"{len(failed)} of {len(rows)} runs have no score, see column {PROBLEM}")


def table_rows(cases: Sequence[Case], scores: Sequence[Score | str]) -> list[dict[str, Any]]:
    """Return a row for each case, with the same names in all.

    Parameters
    ----------
    cases : sequence of Case
        What was run.
    scores : sequence of Score or str
        Its score, or why there is none.

    Raises
    ------
    ConfigError
        No case has a score; the first reason.
    """
    known = next((asdict(score) for score in scores if isinstance(score, Score)), None)
    if known is None:
        raise ConfigError(str(scores[0]))
    blank = {name: dict.fromkeys(value) if isinstance(value, dict) else None for name, value in known.items()}
    rows = []
    for case, score in zip(cases, scores, strict=True):
        problem, values = (score, blank) if isinstance(score, str) else ("", asdict(score))
        rows.append({"scene": case.scene, "sensor": case.sensor, "seed": case.seed, PROBLEM: problem, **values})
    return rows


@lru_cache(maxsize=1)
def _calibration(name: str | None, sensor_name: str, seed: int, imperfections: str) -> Calibration:
    """Return the calibration of a file, by default that of the simulated board, or nominal parameters.

    The newest is kept: the scenes of one board follow each other.
    """
    sensor = load_sensor(sensor_name)
    if name == UNCALIBRATED:
        return Calibration.nominal(sensor)
    if name:
        return load_calibration(name, sensor)
    try:
        return calibrate(sensor, seed, replace(load_error_model(imperfections), resets_per_hour=0.0))
    except ValueError as error:
        raise ConfigError(f"calibration of the simulated board: {error}") from error


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of `posfet score`."""
    parser = argparse.ArgumentParser(
        prog="posfet score",
        description="Score the reconstruction of simulated scenes against their ground truth: one run as JSON, several "
        "(scenes, seeds or sensors) as a table.",
    )
    parser.add_argument("scenes", metavar="SCENE", nargs="+", help=SCENE.description)
    parser.add_argument(
        "--seeds",
        type=_seeds,
        metavar="LIST",
        help="a board for each of these seeds, such as 1-20 or 1,4,7-9, in place of --seed",
    )
    parser.add_argument("--out", type=Path, metavar="FILE", help=f"file for the table: {', '.join(FORMATS)}")
    parser.add_argument(
        "--jobs", type=_jobs, default=1, metavar="N", help="processes; 0: one for each processor (needs joblib)"
    )
    parser.add_argument(
        "--dask",
        default="",
        metavar="ADDRESS",
        help=f"scheduler that distributes the runs, or {LOCAL} (needs distributed)",
    )
    parser.add_argument(
        "--calibration",
        metavar="FILE",
        help="calibration file of this sensor, or none: nominal parameters (default: calibrate the board first)",
    )
    parser.add_argument(
        "--mismatch",
        type=lambda text: number_in(text, 0, 30),
        default=0.0,
        metavar="P",
        help="random gain errors of the taxels after calibration, standard deviation [%%] (default: 0)",
    )
    parser.add_argument(
        "--sensor", metavar="SENSOR", action="append", help=f"{SENSOR_FILE.help}; may be given several times"
    )
    add_error_model(parser)
    parser.add_argument(
        "--device",
        type=_scaled_property,
        action="append",
        default=[],
        metavar="NAME=PERCENT",
        help=f"scale a device property by PERCENT to simulate model mismatch ({', '.join(DEVICE_PROPERTIES)})",
    )
    add_seed(parser, default=1)
    add_duration(parser)
    return parser


def _seeds(text: str) -> list[int]:
    """Return the seeds of a list such as 1,4,7-9, each once."""
    found: dict[int, None] = {}
    for part in text.split(","):
        first, _, last = part.partition("-")
        low, high = seed(first), seed(last or first)
        if high < low or high - low >= MAX_SEEDS:
            raise argparse.ArgumentTypeError(f"must be seeds such as 1-20 or 1,4,7-9, got '{text}'")
        found.update(dict.fromkeys(range(low, high + 1)))
    return list(found)


def _jobs(text: str) -> int:
    if not text.isdecimal() or int(text) > MAX_JOBS:
        raise argparse.ArgumentTypeError(f"must be a whole number in [0, {MAX_JOBS}], got '{text}'")
    return int(text)


def _scaled_property(text: str) -> tuple[str, float]:
    name, separator, percent = text.partition("=")
    if name not in DEVICE_PROPERTIES or not separator:
        raise argparse.ArgumentTypeError(f"must be one of {', '.join(DEVICE_PROPERTIES)} =PERCENT, got '{text}'")
    return name, number_in(percent, -90, 1000)


if __name__ == "__main__":
    raise SystemExit(main())
