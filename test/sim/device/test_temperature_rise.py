# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Forces while the chip warms or cools: at the start, during a touch, and with model mismatch."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from posfet_model.calibration.taxel_calibration import Calibration, Residuals
from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.sensor.description import load_sensor
from posfet_sim.commands.score import Run, perturbed, run
from posfet_sim.device.error_model import ErrorModel
from posfet_sim.emulation.offline import received_scans
from posfet_sim.scene import Scene, load_scene
from posfet_sim.scene.scene import Keyframes
from support.calibrations import with_rate
from support.long_cases import crossed, long_cases

SENSOR = load_sensor()
SLOWER = with_rate(SENSOR)
RECORDED = replace(Calibration.nominal(SENSOR), residuals=Residuals(0.0, 0.0, 1))


@pytest.mark.parametrize("kelvin_per_second", [0.1, -0.2])
def test_startup_during_warming_becomes_valid_without_false_contacts(kelvin_per_second: float) -> None:
    half = 20 * kelvin_per_second
    warm = Keyframes((-20.0, 20.0, 999.0), ((25.0 - half,), (25.0 + half,), (25.0,)))
    scene = Scene(name="warming", description="nothing touches", period=1e3, objects=(), temperature=warm)
    reconstructor = Reconstructor(SENSOR)
    results = [reconstructor.process(scan).valid for scan, _ in received_scans(SENSOR, scene, 6.0, 1)]
    assert results[-1] and reconstructor.tare().done
    assert np.abs(reconstructor.image().force).max() < 0.5 * SENSOR.contact.threshold


@pytest.mark.parametrize(
    "differences",
    [
        {},
        *(
            pytest.param(each, marks=pytest.mark.slow)
            for each in ({"lag": -30.0}, {"lag": 30.0}, {"pyroelectric": 10.0}, {"pyroelectric": -10.0})
        ),
    ],
)
def test_a_warm_finger_is_detected_and_measured_during_ambient_warming(differences: dict[str, float]) -> None:
    device = perturbed(SLOWER, differences)
    score = run(Run(SLOWER, load_scene("warm_finger", device), 9.0, 2, calibration=RECORDED, device=device))
    assert score.total_force_error_pct is not None and score.total_force_error_pct < 2.0
    assert (score.contact_precision, score.id_switches) == (1.0, 0)
    assert score.contact_recall is not None and score.contact_recall > 0.99
    assert score.detection_latency_scans is not None and score.detection_latency_scans <= 2


LOOKS = "a chip that cools by 70 mK/s from the start looks like a press for half a second"


@pytest.mark.parametrize(
    "board",
    [
        pytest.param(1, marks=pytest.mark.slow),
        pytest.param(2, marks=(pytest.mark.slow, pytest.mark.xfail(strict=True, reason=LOOKS))),
        *(pytest.param(board, marks=pytest.mark.slow) for board in (3, 4)),
    ],
)
def test_a_film_that_responds_less_to_its_temperature_leaves_forces_valid(
    board: int, shared_calibrate: Callable[..., Calibration]
) -> None:
    """What it seemed to be colder by was in the errors of all taxels, as if a slow press had been absorbed."""
    device, errors = perturbed(SENSOR, {"pyroelectric": -20.0}), ErrorModel.default()
    calibration = shared_calibrate(SENSOR, board, replace(errors, resets_per_hour=0.0))
    calibration = calibration.with_gain_error(0.05, np.random.default_rng(board))
    scene = load_scene("warm_finger", SENSOR)
    score = run(Run(SENSOR, scene, 9.0, board, errors, calibration=calibration, device=device))
    assert score.valid_pct is not None and score.valid_pct > 95.0
    assert score.misleading_pct is not None and score.misleading_pct < 2.0


@pytest.mark.parametrize("pyroelectric", long_cases([-20.0, 0.0, 20.0], [-20.0, 20.0]))
def test_a_release_is_not_absorbed_into_the_offset_after_its_contact_became_uncertain(pyroelectric: float) -> None:
    device = perturbed(SENSOR, {"pyroelectric": pyroelectric})
    reconstructor, ids = Reconstructor(SENSOR, RECORDED), set()
    for scan, truth in received_scans(device, load_scene("warm_finger", device), 10.0, 2):
        ids |= {contact.id for contact in reconstructor.process(scan).contacts}
        if truth.time > 8.5:
            assert np.abs(reconstructor.image().force).max() < 0.5 * SENSOR.contact.threshold
    assert len(ids) == 1


@pytest.mark.parametrize(("board", "pyroelectric"), long_cases([(2, 0.0), (1, 20.0)], [(1, 20.0)]))
def test_the_film_that_a_finger_no_longer_warms_as_it_leaves_is_no_contact(
    board: int, pyroelectric: float, shared_calibrate: Callable[..., Calibration]
) -> None:
    """What untouched taxels lost was explained by the tail of the contact: up to 1.6 N, for half a second."""
    device = perturbed(SLOWER, {"pyroelectric": pyroelectric})
    errors = replace(ErrorModel.default(), resets_per_hour=0.0)
    wrong = 1.0 - 0.05 * np.random.default_rng(board).standard_normal(SENSOR.layout.taxels)
    calibration = shared_calibrate(SENSOR, board, errors)
    reconstructor, ids = Reconstructor(SLOWER, replace(calibration, gain=calibration.gain * wrong)), set()
    for scan, _ in received_scans(device, load_scene("warm_finger", device), 10.0, board, errors):
        ids |= {contact.id for contact in reconstructor.process(scan).contacts}
    assert len(ids) == 1


@pytest.mark.parametrize(
    ("differences", "kelvin_per_second"),
    long_cases(
        crossed(
            {"slow": {"lag": 30.0, "pyroelectric": -20.0}, "fast": {"lag": -30.0, "pyroelectric": 20.0}},
            [-2.0, -0.5, 0.25, 2.0],
        ),
        ["slow--2.0", "slow-0.25", "fast--0.5", "fast-2.0"],
    ),
)
def test_warming_with_model_mismatch_causes_no_contact(differences: dict[str, float], kelvin_per_second: float) -> None:
    warmed = 2.5 * kelvin_per_second
    warm = Keyframes((1.0, 3.5, 4.5, 99.0), ((25.0,), (25.0 + warmed,), (25.0 + warmed,), (25.0,)))
    scene = Scene(name="warming", description="nothing touches", period=1e2, objects=(), temperature=warm)
    reconstructor, device = Reconstructor(SENSOR, RECORDED), perturbed(SENSOR, differences)
    for scan, _ in received_scans(device, scene, 4.5, 1):
        assert not reconstructor.process(scan).contacts


@pytest.mark.parametrize(
    ("rows", "cols", "kelvin_per_second"),
    [(*size, rate) for size in ((1, 1), (1, 2), (1, 7), (2, 2)) for rate in (-1.0, 1.0)],
)
def test_warming_of_a_small_array_causes_no_contact(rows: int, cols: int, kelvin_per_second: float) -> None:
    sensor = replace(SENSOR, layout=replace(SENSOR.layout, rows=rows, cols=cols))
    warmed = 25.0 + 2.0 * kelvin_per_second
    warm = Keyframes((1.0, 3.0, 99.0), ((25.0,), (warmed,), (25.0,)))
    scene = Scene(name="warming", description="nothing touches", period=1e2, objects=(), temperature=warm)
    device = perturbed(sensor, {"lag": 30.0, "pyroelectric": -10.0})
    reconstructor = Reconstructor(sensor)
    for scan, _ in received_scans(device, scene, 4.0, 1):
        assert not reconstructor.process(scan).contacts
    assert reconstructor.tare().done
