# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Detection delay of slow presses, and force absorbed as drift: part of `make accuracy`."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from functools import partial
from typing import Final

import numpy as np

from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.sensor.description import load_sensor
from posfet_sim.contact.indenters import Sphere
from posfet_sim.device.error_model import ErrorModel
from posfet_sim.emulation.offline import received_scans
from posfet_sim.scene import Keyframes, Scene, SceneObject

FORCES: Final = (1.0, 0.1)
"""Forces [N]."""

RISES: Final = (2.0, 5.0, 8.0, 15.0, 30.0)
"""Rise times [s]."""

BEGINS: Final = 1.0
"""Start of the press [s]."""

HELD: Final = 1.0
"""Time for which the force is held [s]."""

TEXT: Final = f"""\
A ball of 4 mm radius presses slowly on a calibrated board without gain error. The detection delay counts from the scan
in which the true force of a taxel reaches the contact threshold. Until it is detected, the press looks like drift,
which is absorbed; on the surrounding taxels that goes on for longer. "Missing" is the share of the total force that is
missing after {HELD:g} s of hold."""


def press(
    force: float, rise: float, seed: int, board: ErrorModel, calibration: Callable[[int], Calibration]
) -> tuple[float, float]:
    """Return the detection delay [s], infinite without detection, and the share of the force that is missing [1]."""
    sensor = load_sensor()
    end = BEGINS + rise + HELD
    times = (BEGINS, BEGINS + rise, end, end + 1.0)
    values = tuple((0.2e-3, -0.1e-3, 0.0, load) for load in (0.0, force, force, 0.0))
    ball = SceneObject("ball", Sphere(4e-3, 2e6), Keyframes(times, values))
    steady = Keyframes((0.0,), ((25.0,),))
    scene = Scene(name="slow", description="a slow press", period=end + 1.0, objects=(ball,), temperature=steady)
    model = Reconstructor(sensor, calibration(seed))
    carried = found = np.inf
    for scan, truth in received_scans(sensor, scene, end, seed, board):
        result = model.process(scan)
        if truth.force.max() >= sensor.contact.threshold:
            carried = min(carried, truth.time)
        if result.contacts:
            found = min(found, truth.time)
    image = model.image()
    known = np.isfinite(image.force)
    missing = 1.0 - float(image.force[known].sum() / truth.force[known].sum())
    return max(found - carried, 0.0), missing


def rows(pool: Executor, seed: int, board: ErrorModel, calibration: Callable[[int], Calibration]) -> list[str]:
    """Return a table, a row for each force and rise time."""
    cases = [(force, rise) for force in FORCES for rise in RISES]
    run = partial(press, seed=seed, board=board, calibration=calibration)
    futures = [pool.submit(run, force, rise) for force, rise in cases]
    table = ["| force N | rise time s | detection delay s | missing % |", "|---|---|---|---|"]
    for (force, rise), future in zip(cases, futures, strict=True):
        delay, missing = future.result()
        table.append(
            f"| {force:g} | {rise:g} | {f'{delay:.2f}' if np.isfinite(delay) else 'never'} | {100 * missing:.0f} |"
        )
        print(table[-1], flush=True)
    return table
