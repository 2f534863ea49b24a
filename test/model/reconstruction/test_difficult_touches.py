# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Touches that are difficult to distinguish from drift: broad ones, and one whose release is missed."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.reconstruction.reconstructor import ForceImage, Reconstruction, Reconstructor
from posfet_model.sensor.description import load_sensor
from posfet_sim.contact.indenters import Sphere
from posfet_sim.device.error_model import ErrorModel
from posfet_sim.device.film_effects import FilmEffects
from posfet_sim.emulation.offline import received_scans
from posfet_sim.scene import Keyframes, Scene, SceneObject, load_scene
from reference.dense_pressure import sphere_forces
from support.long_cases import crossed, long_cases
from support.scan_player import press, scans

SENSOR = load_sensor()
LAYOUT = SENSOR.layout
FINGER = sphere_forces(0.6e-3, -0.4e-3, 1.0, 6e-3, 1e6, SENSOR.device.contact_spread, LAYOUT.pitch_x, LAYOUT.rows)


def shape(rows: str) -> NDArray[np.float64]:
    """Return the force on each taxel under 1 N, from relative forces in single digits, row by row."""
    force = np.array([float(digit) for digit in rows.replace(" ", "")])
    return force / force.sum()


PAD = shape("46664 69996 69996 69996 46664")
"""A flat pad over most of the array; its rim lies on the outermost taxels."""

RING = shape("13431 36563 45254 36563 13431")
"""The rim of a screw head, of 2.5 mm radius."""

CROSS = shape("01310 14641 36963 14641 01310")
"""The edges of a cross recess."""


def held(
    newton: float, rise: float, force: NDArray[np.float64], **options: Any
) -> list[tuple[Reconstruction, ForceImage]]:
    """Return the results with the force images, in the last second of two in which a force is held."""
    reconstructor, last = Reconstructor(SENSOR, **options), []
    for time, scan in scans(SENSOR, 3.0 + rise, force=press(newton, 1.0, 9.0, rise), shape=force):
        result = reconstructor.process(scan)
        if time >= 2.0 + rise:
            last.append((copy.copy(result), copy.deepcopy(reconstructor.image())))
    return last


INSEPARABLE = "the small forces beside the edge are taken for bending of the chip in part, within the deviation"


@pytest.fixture(scope="module")
def calibration(shared_calibrate: Callable[..., Calibration]) -> Calibration:
    """Calibration of an ideal board: it has neither bending nor warmth of touched taxels."""
    return shared_calibrate(SENSOR, 1, ErrorModel.none())


@pytest.mark.parametrize(
    ("force", "rise"),
    [
        *((PAD, rise) for rise in (0.1, 0.3)),
        (RING, 0.1),
        (CROSS, 0.3),
        pytest.param(CROSS, 0.1, marks=pytest.mark.xfail(strict=True, reason=INSEPARABLE)),
    ],
)
def test_a_broad_touch_of_2_newton_has_an_error_of_1_percent(
    force: NDArray[np.float64], rise: float, calibration: Calibration
) -> None:
    last = held(2.0, rise, force, calibration=calibration)
    assert max(abs(image.total - 2.0) for _, image in last) < 0.02


@pytest.mark.parametrize(
    ("force", "rise"),
    long_cases(
        crossed({"pad": PAD, "ring": RING, "cross": CROSS}, [0.1, 0.3, 1.0]),
        ["pad-0.1", "ring-0.3", "cross-1.0", "pad-1.0"],
    ),
)
def test_a_broad_touch_is_one_contact_and_valid_with_its_force_within_two_deviations(
    force: NDArray[np.float64], rise: float, calibration: Calibration
) -> None:
    last = held(2.0, rise, force, calibration=calibration)
    assert all(result.valid for result, _ in last)
    assert {len(result.contacts) for result, _ in last} == {1}
    assert all(abs(image.total - 2.0) < 2.0 * image.total_standard_deviation < 1.0 for _, image in last)


def test_a_pad_that_takes_a_second_to_press_the_whole_array_and_to_lift_is_right_in_all_valid_scans(
    shared_calibrate: Callable[..., Calibration],
) -> None:
    """Its first part is no warmer film, and what is left of it while it lifts is no error."""
    scene = replace(load_scene("flat_pad_slow", SENSOR), period=math.inf)
    board = replace(ErrorModel.default(), resets_per_hour=0.0)
    reconstructor, right, errors, valid = Reconstructor(SENSOR, shared_calibrate(SENSOR, 1, board)), [], [], 0
    for scan, truth in received_scans(SENSOR, scene, scene.duration, 1, board):
        true = float(truth.force.sum())
        if reconstructor.process(scan).valid:
            error = abs(reconstructor.image().total - true)
            right.append(error <= max(0.1 * true, 0.05))
            errors += [error] if 2.0 < truth.time < 5.0 else []
            valid += 1
    assert all(right)
    assert valid > 5000  # of 6000 scans
    assert max(errors) < 0.02 * 2.0


def test_the_forces_beside_a_broad_touch_are_not_taken_for_bending() -> None:
    """Beside a pad they are other shares of the decline towards them than beside the contact as which it begins."""
    last = held(2.0, 0.3, CROSS)
    assert max(abs(image.total - 2.0) for _, image in last) < 0.04


@pytest.mark.parametrize(
    ("force", "rise"),
    long_cases(crossed({"pad": PAD, "ring": RING}, [0.1, 0.3, 1.0]), ["pad-0.1", "ring-0.3", "pad-1.0"]),
)
def test_a_pad_on_a_chip_whose_bending_was_calibrated_reads_no_more_than_it_is(
    force: NDArray[np.float64], rise: float, calibration: Calibration
) -> None:
    """Charge of 8 mN/N on 25 taxels: 20 % too much. Under a pad no untouched taxel shows it."""
    bending, deviation = np.array([8e-3, 0.0, 0.0, 0.0]), np.full(4, 2e-5)
    known = replace(calibration, bending=bending, bending_deviation=deviation)
    last = held(2.0, rise, force + bending[0], calibration=known)
    assert max(abs(image.total - 2.0) for _, image in last) < 0.03 * 2.0
    assert all(abs(image.total - 2.0) < 2.0 * image.total_standard_deviation for _, image in last)


@pytest.mark.parametrize(
    ("release", "onset"),
    long_cases(crossed([0.705, 0.85, 0.995], [0.5, 0.65]), ["0.705-0.65", "0.85-0.5", "0.995-0.65"]),
)
def test_a_force_whose_release_is_lost_with_300_ms_of_scans_is_gone_within_three_seconds(
    release: float, onset: float
) -> None:
    reconstructor = Reconstructor(SENSOR)
    for time, scan in scans(SENSOR, 4.0, force=press(1.5, onset, release, 0.005), shape=FINGER):
        if not 0.7 <= time < 1.0:
            result = reconstructor.process(scan)
    total = reconstructor.image().total
    assert not result.valid or abs(total) < 0.03
    assert reconstructor.tare(force=not result.valid).done
    assert abs(reconstructor.image().total) < 0.03


ACROSS = Keyframes(
    (0.5, 0.6, 1.0, 1.8, 2.0, 2.1),
    tuple(
        (x * 1e-3, 0.5 * x * 1e-3, 0.0, force)
        for x, force in ((-2, 0), (-2, 1.5), (-2, 1.5), (2, 1.5), (2, 1.5), (2, 0))
    ),
)
"""A fingertip that presses near one corner, slides across the array, and leaves."""


def test_a_chip_that_bends_around_the_place_that_is_pressed_is_followed() -> None:
    """Charge of 8 mN/N on every taxel, which changes as the finger moves: 0.3 N if it were not known."""
    board = replace(ErrorModel.none(), film=replace(FilmEffects.ideal(), bending=8e-3, bending_gradient=0.5))
    finger = SceneObject("fingertip", Sphere(4e-3, 2e6), ACROSS)
    scene = Scene("across", "a fingertip slides", math.inf, (finger,), Keyframes((0.0,), ((25.0,),)))
    reconstructor, errors = Reconstructor(SENSOR), []
    for scan, truth in received_scans(SENSOR, scene, 2.0, 1, board):
        reconstructor.process(scan)
        if truth.time > 1.0 and scan.sequence % 10 == 0:
            errors.append(abs(reconstructor.image().total - float(truth.force.sum())))
    assert max(errors) < 0.015


@pytest.mark.slow
def test_a_touch_soon_after_the_start_leaves_what_is_known_of_the_offsets_beside_it(
    shared_calibrate: Callable[..., Calibration],
) -> None:
    """Taxels around the first part of a touch that do not show it themselves keep the zeros from before it."""
    scene = replace(load_scene("grasp_lift_slip", SENSOR), period=math.inf)
    board = replace(ErrorModel.default(), resets_per_hour=0.0)
    reconstructor, error, force = Reconstructor(SENSOR, shared_calibrate(SENSOR, 2, board)), 0.0, 0.0
    for scan, truth in received_scans(SENSOR, scene, scene.duration, 2, board):
        if reconstructor.process(scan).valid and truth.force.any():
            error += abs(reconstructor.image().total - float(truth.force.sum()))
            force += float(truth.force.sum())
    assert error < 0.01 * force
