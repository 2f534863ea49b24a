# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The grip controller of the grasp example, without physics: phases, creep and slip, and what it does then."""

from __future__ import annotations

import numpy as np
import pytest

from examples.grasp_mujoco.controller import GripController, GripSettings, Phase, Touch
from examples.grasp_mujoco.creep import CreepWatch, FloatArray

STEP = 1e-3
SETTINGS = GripSettings()
PITCH = 1.5e-3


def pressed(x: float = 0.0, y: float = 0.0, force: float = 0.6) -> FloatArray:
    """Return the image of a round contact with its centre at x, y [m], whose forces add up to about `force` [N]."""
    places = (np.arange(5) - 2) * PITCH
    squared = (places[None, :] - x) ** 2 + (places[:, None] - y) ** 2
    bell: FloatArray = np.exp(-squared / (2 * PITCH**2)) / (2 * np.pi)
    return force * bell


HELD = Touch(0.6, pressed(), False, True)
SLIPPING = Touch(0.6, pressed(), True, True)
FREE = Touch(valid=True)


def holding(feedback: bool = True) -> tuple[GripController, float]:
    """Return a controller that holds a lifted object, and the time of its last scan [s]."""
    controller = GripController(feedback=feedback)
    time = 0.0
    while controller.phase is not Phase.HOLD:
        time += STEP
        controller.update(time, (HELD, HELD))
        assert time < 2.0
    return controller, time


def test_it_waits_for_valid_forces_closes_until_both_touch_and_lifts() -> None:
    controller = GripController()
    assert controller.update(0.0, (Touch(), Touch())) == 0.0
    assert controller.update(0.1, (FREE, FREE)) == SETTINGS.closing
    assert controller.update(0.2, (HELD, FREE)) == SETTINGS.closing
    assert controller.update(0.3, (HELD, HELD)) == SETTINGS.first
    assert controller.lift == 0.0
    controller, _ = holding()
    assert controller.lift == SETTINGS.lift


def test_reported_slip_raises_the_grip_in_the_same_scan_and_then_after_a_pause() -> None:
    controller, time = holding()
    before = controller.grip
    slipping = SLIPPING
    first = controller.update(time + STEP, (HELD, slipping))
    assert first == pytest.approx(max(before * SETTINGS.rise, before + SETTINGS.least_rise))
    assert controller.update(time + 2 * STEP, (HELD, slipping)) == first
    assert controller.update(time + STEP + SETTINGS.pause + 1e-9, (HELD, slipping)) > first


def test_without_slip_the_grip_sinks_but_not_below_the_margin_over_the_last_slip() -> None:
    controller, time = holding()
    slip_grip = controller.grip
    controller.update(time + STEP, (HELD, SLIPPING))
    raised = controller.grip
    for index in range(2, 2500):
        controller.update(time + index * STEP, (HELD, HELD))
    assert controller.grip == pytest.approx(SETTINGS.margin * slip_grip, rel=1e-3)
    assert controller.grip < raised


def test_without_feedback_the_grip_stays() -> None:
    controller, time = holding(feedback=False)
    for index in range(1, 100):
        moved = Touch(0.6, pressed(y=-1e-5 * index), True, True)
        assert controller.update(time + index * STEP, (moved, moved)) == SETTINGS.first


def test_the_grip_has_an_upper_limit() -> None:
    controller, time = holding()
    for index in range(1, 200):
        controller.update(time + index * 0.01, (SLIPPING, HELD))
    assert controller.grip == SETTINGS.greatest


def images(random: np.random.Generator, noise: float, x: float, y: float, force: float = 0.6) -> list[FloatArray]:
    """Return the images of both fingertips, past which an object has moved by x and y [m]; they face each other."""
    return [pressed(side * x, y, force) + random.normal(0.0, noise, (5, 5)) for side in (-1, 1)]


@pytest.mark.parametrize("noise", [0.2e-3, 0.6e-3])
def test_a_held_object_does_not_creep_whatever_the_noise_and_one_that_slides_slowly_does(noise: float) -> None:
    random = np.random.default_rng(3)
    watch = CreepWatch()
    for index in range(3000):  # the grip sinks meanwhile
        assert watch.update(*images(random, noise, 0.0, 0.0, 0.6 - 0.1e-3 * index)) < SETTINGS.creep
    deviation = np.sqrt(watch.shift()[1][1, 1])
    slow = 4e-3  # half of what `slipping` needs [m/s]
    moved = [watch.update(*images(random, noise, 0.0, -slow * STEP * index, 0.3)) for index in range(30)]
    needed = SETTINGS.creep + (CreepWatch.DEVIATIONS + 2) * deviation
    assert [each > SETTINGS.creep for each in moved].index(True) <= CreepWatch.NEW + needed / (slow * STEP)


def test_the_shift_is_that_of_the_object_within_its_deviation() -> None:
    """A fingertip has an unknown taxel; the force changes meanwhile, which is no shift."""
    random = np.random.default_rng(7)
    errors, deviations = [], []
    for _ in range(300):
        watch = CreepWatch()
        shift = random.uniform(-15e-6, 15e-6, 2)
        for index in range(20):
            x, y = shift if index >= CreepWatch.REFERENCE else (0.0, 0.0)
            left, right = images(random, 0.5e-3, x, y, 0.6 if index < 10 else 0.63)
            left[1, 3] = np.nan
            watch.update(left, right)
        found, covariance = watch.shift()
        errors.append(found - shift)
        deviations.append(np.sqrt(np.diag(covariance)))
    consistency = np.mean((np.array(errors) / deviations) ** 2)
    assert 0.7 < consistency < 1.4
    assert np.abs(np.mean(errors, 0)).max() < 0.3e-6
    assert np.mean(deviations) < 3e-6


def test_a_pressure_that_is_the_same_everywhere_says_nothing_of_a_shift() -> None:
    random = np.random.default_rng(1)
    watch = CreepWatch()
    even = np.full((5, 5), 0.02)
    for _ in range(500):
        assert watch.update(*(even + random.normal(0.0, 0.3e-3, (5, 5)) for _ in range(2))) == 0.0
    assert np.sqrt(watch.shift()[1][1, 1]) > 20e-6


def test_what_is_not_held_on_both_sides_does_not_creep() -> None:
    watch = CreepWatch()
    for index in range(50):
        assert watch.update(pressed(y=1e-5 * index), None) == 0.0
        assert watch.update(pressed(y=1e-5 * index), pressed()) == 0.0
