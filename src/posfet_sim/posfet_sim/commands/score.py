# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""`posfet score`: simulate a scene, reconstruct it from the CAN frames, and score it against the ground truth.

By default the simulated board is calibrated first, as by `posfet calibrate`.
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
from posfet_model.estimation.choice import DEFAULT_ESTIMATOR, Estimator
from posfet_model.parameters import ESTIMATOR
from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_sim.calibration.simulated_bench import calibrate
from posfet_sim.commands.options import add_duration, add_error_model, add_scene, add_seed, add_sensor, number_in
from posfet_sim.device.error_model import ErrorModel, load_error_model
from posfet_sim.emulation.offline import received_scans
from posfet_sim.evaluation.scorer import Score, Scorer
from posfet_sim.scene import Scene, load_scene

BAD_INPUT: Final = 1
"""Exit code for bad input."""
UNCALIBRATED: Final = "none"
"""Value of --calibration for nominal parameters."""
STATIC_DURATION: Final = 10.0
"""Default duration of a scene that never changes [s]."""

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
    estimator: Estimator = DEFAULT_ESTIMATOR
    """How forces are estimated."""


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
    reconstructor = Reconstructor(what.sensor, what.calibration, what.estimator)
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


def main(words: Sequence[str] | None = None) -> int:
    """Print the score as JSON; return 0, or 1 with one line on stderr for bad input."""
    options = make_parser().parse_args(words)
    try:
        sensor = load_sensor(options.sensor)
        device = perturbed(sensor, dict(options.device))
        scene = load_scene(options.scene, device)
        error_model = load_error_model(options.imperfections)
        calibration = _calibration(options.calibration, sensor, options.seed, error_model)
        if options.mismatch:
            calibration = calibration.with_gain_error(options.mismatch / 100, np.random.default_rng(options.seed))
        score = run(
            Run(
                sensor=sensor,
                scene=scene,
                duration=options.seconds or scene.duration or STATIC_DURATION,
                seed=options.seed,
                error_model=error_model,
                calibration=calibration,
                device=device,
                estimator=Estimator(options.estimator),
            )
        )
    except ConfigError as error:
        print(error, file=sys.stderr)
        return BAD_INPUT
    print(json.dumps(asdict(score), indent=2))
    return 0


def _calibration(name: str | None, sensor: Sensor, seed: int, error_model: ErrorModel) -> Calibration:
    """Return the calibration of a file, by default that of the simulated board, or nominal parameters."""
    if name == UNCALIBRATED:
        return Calibration.nominal(sensor)
    if name:
        return load_calibration(name, sensor)
    try:
        return calibrate(sensor, seed, replace(error_model, resets_per_hour=0.0))
    except ValueError as error:
        raise ConfigError(f"calibration of the simulated board: {error}") from error


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of `posfet score`."""
    parser = argparse.ArgumentParser(
        prog="posfet score",
        description="Score the reconstruction of a simulated scene against its ground truth; prints JSON.",
    )
    add_scene(parser)
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
    parser.add_argument("--estimator", choices=ESTIMATOR.choices, default=ESTIMATOR.default, help=ESTIMATOR.help)
    add_sensor(parser)
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


def _scaled_property(text: str) -> tuple[str, float]:
    name, separator, percent = text.partition("=")
    if name not in DEVICE_PROPERTIES or not separator:
        raise argparse.ArgumentTypeError(f"must be one of {', '.join(DEVICE_PROPERTIES)} =PERCENT, got '{text}'")
    return name, number_in(percent, -90, 1000)


if __name__ == "__main__":
    raise SystemExit(main())
