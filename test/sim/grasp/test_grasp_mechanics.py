# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Mechanics of a grasp: Coulomb's limit, acceleration of a slip, lag of the grip force, both ways of control."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from posfet_sim.grasp.mechanics import (
    GRAVITY,
    GROWTH_DURATION,
    LIFT_DURATION,
    Control,
    GraspedObject,
    GraspMechanics,
    Gripper,
)

OBJECT = GraspedObject(
    mass=0.1,
    static_friction=0.8,
    kinetic_friction=0.6,
    gap=1e-3,
    stiffness=2000.0,
    lift_time=0.0,
    growth=0.0,
    growth_time=10.0,
)
PERIOD = 1e-3


def grasp(force: float, grasped: GraspedObject = OBJECT, duration: float = 1.0) -> GraspMechanics:
    """Return the state after a time with a grip force that was there before the lift."""
    mechanics = GraspMechanics(grasped, Gripper())
    mechanics.force = mechanics.command = force
    for _ in range(round(duration / PERIOD)):
        mechanics.step(PERIOD)
    return mechanics


@pytest.mark.parametrize("mass", [0.05, 0.1, 0.2])
@pytest.mark.parametrize("friction", [0.5, 1.0])
def test_the_least_grip_force_is_where_slip_begins(mass: float, friction: float) -> None:
    grasped = replace(OBJECT, mass=mass, static_friction=friction, kinetic_friction=friction)
    least = mass * GRAVITY / (2 * friction)
    assert grasped.least_grip_force == pytest.approx(least)
    assert grasp(1.001 * least, grasped).slip == 0.0
    assert grasp(0.999 * least, grasped).slip > 0.0


def test_the_least_grip_force_counts_the_weight_that_is_added() -> None:
    grasped = replace(OBJECT, growth=0.4, growth_time=0.5)
    least = grasped.least_grip_force
    assert least == pytest.approx(1.4 * OBJECT.least_grip_force)
    duration = grasped.growth_time + GROWTH_DURATION + 0.1
    assert grasp(1.001 * least, grasped, duration).slip == 0.0
    slipping = grasp(0.999 * least, grasped, duration)
    assert slipping.slip > 0.0


def test_an_object_that_is_not_held_falls_freely() -> None:
    fallen = grasp(0.0, replace(OBJECT, lift_time=-LIFT_DURATION), duration=0.02)
    assert fallen.velocity == pytest.approx(GRAVITY * 0.02)
    assert fallen.slip == pytest.approx(0.5 * GRAVITY * 0.02**2, rel=0.06)


def test_a_slip_accelerates_with_kinetic_friction_and_ends_when_gripped() -> None:
    sliding = grasp(0.5, replace(OBJECT, lift_time=-LIFT_DURATION), duration=0.02)
    assert sliding.velocity == pytest.approx((GRAVITY - 2 * 0.6 * 0.5 / 0.1) * 0.02)
    sliding.force = sliding.command = 3.0
    for _ in range(100):
        sliding.step(PERIOD)
    assert sliding.velocity == 0.0
    held = sliding.slip
    sliding.step(PERIOD)
    assert sliding.slip == held


def test_the_grip_force_follows_with_its_lag() -> None:
    mechanics = GraspMechanics(OBJECT, Gripper())
    mechanics.command = 1.0
    for _ in range(round(Gripper().lag / PERIOD)):
        mechanics.step(PERIOD)
    assert mechanics.force == pytest.approx(1.0 - math.exp(-1.0))


def test_the_command_has_a_largest_rate_and_a_range() -> None:
    mechanics = GraspMechanics(OBJECT, Gripper())
    mechanics.move(1.0, 0.01)
    assert mechanics.command == pytest.approx(0.2)
    mechanics.move(1.0, 10.0)
    assert mechanics.command == mechanics.command_max == 4.0
    mechanics.move(-1.0, 10.0)
    assert mechanics.command == 0.0


def test_with_control_of_the_width_the_force_begins_at_the_object() -> None:
    mechanics = GraspMechanics(OBJECT, Gripper(Control.WIDTH))
    for command, force in ((OBJECT.gap, 0.0), (OBJECT.gap + 1e-3, 2.0), (mechanics.command_max, 4.0)):
        mechanics.command = command
        for _ in range(500):
            mechanics.step(PERIOD)
        assert mechanics.force == pytest.approx(force, abs=1e-6)


def test_the_support_is_withdrawn_and_the_texture_shows_only_while_sliding() -> None:
    mechanics = grasp(3.0, replace(OBJECT, lift_time=0.5), duration=0.5)
    assert mechanics.load == pytest.approx(0.0, abs=1e-9)
    assert mechanics.normal_force == mechanics.force
    for _ in range(round(LIFT_DURATION / PERIOD)):
        mechanics.step(PERIOD)
    assert mechanics.load == pytest.approx(0.1 * GRAVITY)


def test_what_is_added_later_does_not_slow_a_fall() -> None:
    grasped = replace(OBJECT, lift_time=-LIFT_DURATION, growth=0.4, growth_time=0.01)
    for duration in (0.01, 0.02, 0.6):  # before, while and after it grows
        assert grasp(0.0, grasped, duration).velocity == pytest.approx(GRAVITY * duration)
