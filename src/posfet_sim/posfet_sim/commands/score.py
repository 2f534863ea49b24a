"""`posfet score`: a scene through simulated board, frames and reconstruction, held against the truth.

Unless told otherwise the board is calibrated first, as `posfet calibrate` does: so is a real one before it is used.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Final

import numpy as np

from posfet_model.calibration.calibration_file import load_calibration
from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.config import ConfigError
from posfet_model.parameters import SENSOR_FILE
from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_sim.calibration.simulated_bench import calibrate
from posfet_sim.device.imperfections import Imperfections, load_imperfections
from posfet_sim.emulation.offline import wire_scans
from posfet_sim.evaluation.scorer import Score, Scorer
from posfet_sim.parameters import IMPERFECTIONS, SCENE, SEED
from posfet_sim.scene import Scene, load_scene

BAD_INPUT = 1
UNCALIBRATED: Final = "none"
ENDLESS: Final = 10.0
"""How long a scene that never changes is scored [s], unless told otherwise."""

DIFFERENCES: Final = {
    "leak": "leak_time_constant",
    "d33": "piezoelectric_coefficient",
    "spread": "contact_spread",
    "lag": "thermal_time_constant",
    "pyroelectric": "pyroelectric_coefficient",
}
"""What of the simulated device can be told to differ from its description."""


@dataclass(frozen=True)
class Run:
    """What to score."""

    sensor: Sensor
    """As the reconstruction knows it."""
    scene: Scene
    duration: float
    """[s]"""
    seed: int = 1
    imperfections: Imperfections | None = None
    calibration: Calibration | None = None
    device: Sensor | None = None
    """As the board is; None: as described."""


def run(what: Run) -> Score:
    """Return the score of a run. Raises ConfigError when the layout does not fit the frames."""
    reconstructor = Reconstructor(what.sensor, what.calibration)
    scorer = Scorer(what.sensor)
    spent, scans = 0, 0
    for scan, truth in wire_scans(what.device or what.sensor, what.scene, what.duration, what.seed, what.imperfections):
        begin = time.perf_counter_ns()
        result = reconstructor.process(scan)
        image = reconstructor.image()
        spent += time.perf_counter_ns() - begin
        scans += 1
        if result.accepted:
            scorer.add(result, image, truth)
    return scorer.score(spent / max(scans, 1) * 1e-3)


def differing(sensor: Sensor, percent: dict[str, float]) -> Sensor:
    """Return a sensor whose device differs by `percent` in what DIFFERENCES names."""
    device = sensor.device
    changes = {DIFFERENCES[name]: getattr(device, DIFFERENCES[name]) * (1 + by / 100) for name, by in percent.items()}
    return replace(sensor, device=replace(device, **changes))


def main(words: Sequence[str] | None = None) -> int:
    """Print the score as JSON; return 0, or 1 with one line on stderr for bad input."""
    options = _parser().parse_args(words)
    try:
        sensor = load_sensor(options.sensor)
        device = differing(sensor, dict(options.device))
        scene = load_scene(options.scene, device)
        imperfections = load_imperfections(options.imperfections)
        calibration = _calibration(options.calibration, sensor, options.seed, imperfections)
        if options.mismatch:
            calibration = calibration.with_gain_error(options.mismatch / 100, np.random.default_rng(options.seed))
        score = run(
            Run(
                sensor=sensor,
                scene=scene,
                duration=options.seconds or scene.duration or ENDLESS,
                seed=options.seed,
                imperfections=imperfections,
                calibration=calibration,
                device=device,
            )
        )
    except ConfigError as error:
        print(error, file=sys.stderr)
        return BAD_INPUT
    print(json.dumps(asdict(score), indent=2))
    return 0


def _calibration(wanted: str | None, sensor: Sensor, seed: int, imperfections: Imperfections) -> Calibration:
    """Return the calibration of a file, that of the board by default, or what is known by the description alone."""
    if wanted == UNCALIBRATED:
        return Calibration.nominal(sensor)
    if wanted:
        return load_calibration(wanted, sensor)
    try:
        return calibrate(sensor, seed, replace(imperfections, resets_per_hour=0.0))
    except ValueError as error:
        raise ConfigError(f"calibration of the simulated board: {error}") from error


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="posfet score", description="Score the reconstruction on a scene of the simulated board; prints JSON."
    )
    parser.add_argument("scene", metavar="SCENE", help=SCENE.description)
    parser.add_argument(
        "--calibration",
        metavar="FILE",
        help="of this sensor, or none: the description is believed; without it, the board is calibrated first",
    )
    parser.add_argument(
        "--mismatch",
        type=lambda text: _number(text, 0, 30),
        default=0.0,
        metavar="P",
        help="spread of random errors of the taxels' gains, left after calibration [%%]",
    )
    parser.add_argument("--imperfections", default=IMPERFECTIONS.default, help=IMPERFECTIONS.help)
    parser.add_argument("--sensor", default=SENSOR_FILE.default, help=SENSOR_FILE.help)
    parser.add_argument(
        "--device",
        type=_difference,
        action="append",
        default=[],
        metavar="NAME=PERCENT",
        help=f"let the device differ from its description: {', '.join(DIFFERENCES)}; may be repeated",
    )
    parser.add_argument(
        "--seed",
        type=lambda text: int(_number(text, SEED.low, SEED.high)),
        default=1,
        help=f"{SEED.description} (default: 1)",
    )
    parser.add_argument(
        "--for",
        dest="seconds",
        type=lambda text: _number(text, 0.1, 1e6),
        help="seconds of the scene; without it, once through",
    )
    return parser


def _number(text: str, low: float, high: float) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not low <= value <= high:
        raise argparse.ArgumentTypeError(f"must be a number in [{low:g}, {high:g}], got '{text}'")
    return value


def _difference(text: str) -> tuple[str, float]:
    name, separator, percent = text.partition("=")
    if name not in DIFFERENCES or not separator:
        raise argparse.ArgumentTypeError(f"must be one of {', '.join(DIFFERENCES)} =PERCENT, got '{text}'")
    return name, _number(percent, -90, 1000)


if __name__ == "__main__":
    raise SystemExit(main())
