# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The grip controller of the grasp example, without physics: phases, creep and slip, and what it does then."""

from __future__ import annotations

import math

import numpy as np
import pytest

from examples.grasp_mujoco.controller import CreepWatch, GripController, GripSettings, Phase, Touch

STEP = 1e-3
SETTINGS = GripSettings()
HELD = Touch(0.6, (0.0, 0.0), False, True)
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
    slipping = Touch(0.6, (0.0, 0.0), True, True)
    first = controller.update(time + STEP, (HELD, slipping))
    assert first == pytest.approx(max(before * SETTINGS.rise, before + SETTINGS.least_rise))
    assert controller.update(time + 2 * STEP, (HELD, slipping)) == first
    assert controller.update(time + STEP + SETTINGS.pause + 1e-9, (HELD, slipping)) > first


def test_without_slip_the_grip_sinks_but_not_below_the_margin_over_the_last_slip() -> None:
    controller, time = holding()
    slip_grip = controller.grip
    controller.update(time + STEP, (HELD, Touch(0.6, (0.0, 0.0), True, True)))
    raised = controller.grip
    for index in range(2, 2500):
        controller.update(time + index * STEP, (HELD, HELD))
    assert controller.grip == pytest.approx(SETTINGS.margin * slip_grip, rel=1e-3)
    assert controller.grip < raised


def test_without_feedback_the_grip_stays() -> None:
    controller, time = holding(feedback=False)
    for index in range(1, 100):
        assert (
            controller.update(time + index * STEP, (Touch(0.6, (1e-5 * index, 0.0), True, True), HELD))
            == SETTINGS.first
        )


def test_the_grip_has_an_upper_limit() -> None:
    controller, time = holding()
    for index in range(1, 200):
        controller.update(time + index * 0.01, (Touch(0.6, (0.0, 0.0), True, True), HELD))
    assert controller.grip == SETTINGS.greatest


@pytest.mark.parametrize("noise", [3e-6, 10e-6])
def test_a_held_object_does_not_creep_whatever_the_noise_and_one_that_slides_slowly_does(noise: float) -> None:
    random = np.random.default_rng(3)
    watch = CreepWatch()

    def touches(displacement: float) -> tuple[Touch, Touch]:
        centres = random.normal((0.0, displacement), noise, (2, 2))
        return tuple(Touch(0.6, (x, y), False, True) for x, y in centres)  # type: ignore[return-value]

    assert not any(watch.update(touches(0.0)) for _ in range(3000))
    found = [watch.update(touches(4e-3 * STEP * index)) for index in range(20)]  # 4 mm/s: half of what `slipping` needs
    assert found.index(True) <= 4 + 12e-6 / 4e-6 + noise / 1e-6


def test_what_is_not_held_on_both_sides_does_not_creep() -> None:
    watch = CreepWatch()
    for index in range(50):
        moved = Touch(0.6, (0.0, 1e-5 * index), False, True)
        assert not watch.update((moved, Touch(valid=True)))
        assert not watch.update((moved, Touch(0.6, (0.0, 0.0), False, False)))
    assert math.isnan(Touch().centre[0])
