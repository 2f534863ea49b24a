# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Online identification of the charge leakage; a varying force is not mistaken for leakage."""

from __future__ import annotations

import math

import numpy as np
import pytest

from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_sim.commands.score import perturbed
from support.long_cases import long_cases
from support.scan_player import press, scans

SENSOR = load_sensor()
SHAPE = np.exp(-0.5 * np.sum((SENSOR.layout.positions / 1.2e-3) ** 2, axis=1))
SHAPE /= SHAPE.sum()


def totals(device: Sensor, duration: float, force: object, first: int) -> np.ndarray:
    """Return the total force after each scan from the `first` on [N]."""
    reconstructor, found = Reconstructor(SENSOR), []
    for index, (_, scan) in enumerate(scans(device, duration, force=force, shape=SHAPE)):  # type: ignore[arg-type]
        reconstructor.process(scan)
        if index >= first:
            found.append(reconstructor.image().total)
    return np.array(found)


@pytest.mark.parametrize("percent", long_cases([-20.0, -8.0, 8.0, 20.0], [-20.0, 8.0]))
def test_a_leakage_error_is_identified_while_a_force_is_held(percent: float) -> None:
    device = perturbed(SENSOR, {"leak": percent})
    found = totals(device, 4.0, press(2.0, 0.3, 60.0), 2000)
    # Without identification the relative error of the force would equal that of the leakage.
    assert found == pytest.approx(2.0, abs=0.06)


def test_identified_leakage_is_used_for_the_next_touch() -> None:
    device = perturbed(SENSOR, {"leak": 20.0})
    found = totals(device, 4.0, lambda time: press(1.0, 0.3, 1.5)(time) + press(2.0, 3.0, 60.0)(time), 3200)
    assert found[0] == pytest.approx(2.0, abs=0.03)
    assert found[-1] == pytest.approx(2.0, abs=0.03)


@pytest.mark.parametrize("hertz", long_cases([0.3, 1.0, 2.0], [0.3, 2.0]))
def test_a_varying_force_is_not_mistaken_for_leakage(hertz: float) -> None:
    def force(time: float) -> float:
        return press(2.0, 0.3, 60.0)(time) * (1.0 - 0.3 * math.sin(2 * math.pi * hertz * max(time - 0.5, 0.0)))

    found = totals(SENSOR, 4.0, force, 400)
    true = np.array([force(index * 1e-3) for index in range(400, 4000)])
    assert np.abs(found - true).max() < 0.06


@pytest.mark.parametrize(
    ("percent", "hertz", "phase"),
    long_cases(
        {
            f"{phase}-{percent}-{hertz}": (percent, hertz, phase)
            for phase in (0.0, 0.5 * math.pi, math.pi, 1.5 * math.pi)
            for percent, hertz in ((0.3, 1.2), (1.0, 0.6))
        },
        [f"{0.0}-0.3-1.2", f"{0.5 * math.pi}-1.0-0.6", f"{1.5 * math.pi}-1.0-0.6"],
    ),
)
def test_a_tremor_is_not_mistaken_for_leakage(percent: float, hertz: float, phase: float) -> None:
    def force(time: float) -> float:
        return press(2.0, 0.3, 60.0)(time) * (1.0 + 0.01 * percent * math.sin(2 * math.pi * hertz * time + phase))

    found = totals(SENSOR, 3.0, force, 500)
    true = np.array([force(index * 1e-3) for index in range(500, 3000)])
    assert np.abs(found - true).max() < 0.07


def test_the_reported_uncertainty_covers_a_leakage_error_not_identified_yet() -> None:
    device = perturbed(SENSOR, {"leak": 15.0})
    reconstructor, outside = Reconstructor(SENSOR), 0
    for time, scan in scans(device, 3.0, force=press(2.0, 0.3, 60.0), shape=SHAPE):
        reconstructor.process(scan)
        if time > 0.4:
            image = reconstructor.image()
            outside += abs(image.total - 2.0) > 2.0 * image.total_standard_deviation
    assert outside == 0
