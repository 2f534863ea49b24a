# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Responses of the force errors to a touch, against simulations of each cause in fine steps."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from posfet_core.scan_path import TouchResponse
from posfet_model.calibration.leaky_response import play_distance
from posfet_model.estimation.error_states import COUNT, ErrorPriors, Shared
from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.grid import compiled_layout
from reference.estimation.touch_response import TouchResponse as Reference

Array = NDArray[np.float64]
BLOCK = 0.02
LAYOUT = replace(load_sensor().layout, rows=3, cols=4)
TAXELS = LAYOUT.taxels
TAU = np.linspace(0.1, 2.0, TAXELS)
PER_KELVIN = -np.linspace(0.8, 1.2, TAXELS)
LOOP_WEIGHTS, LOOP_SLOPE = (-0.04, -0.05, -0.03), -0.06
PRIORS = ErrorPriors(
    warmth_time=0.4,
    warmth_force=0.03,
    warmth_certain=1.0,
    creep_times=(0.2, 1.5, 10.0),
    loop_weights=LOOP_WEIGHTS,
    loop_slope=LOOP_SLOPE,
)
WARMTH_TIME, WARMTH_FORCE = PRIORS.warmth_time, PRIORS.warmth_force
CREEP_TIMES = PRIORS.creep_times
FINE = 200
"""Steps of the simulation in a block."""


def response() -> TouchResponse:
    return TouchResponse(compiled_layout(LAYOUT), TAU, PER_KELVIN, PRIORS)


def touch(time: float) -> Array:
    """Return a press of some taxels, from 0.1 to 1.5 s, that is never constant."""
    force = np.zeros(TAXELS)
    if 0.1 <= time <= 1.5:
        force[[1, 2, 5]] = np.array([0.5, 1.0, 0.01]) * (1.0 + 0.3 * math.sin(5.0 * time))
    return force


def blocks(duration: float, force: Callable[[float], Array] = touch) -> list[Array]:
    return [force((number + 0.5) * BLOCK) for number in range(round(duration / BLOCK))]


def advance(each: TouchResponse, means: list[Array]) -> TouchResponse:
    for mean in means:
        each.advance(mean, mean, mean, BLOCK)
    return each


def follow(means: list[Array], time_constant: float) -> Array:
    """Return the output of a first-order lag whose input is constant within blocks, by the midpoint rule.

    Its error is below h^2/(24 tau^2) of the input.
    """
    level, step = np.zeros(TAXELS), BLOCK / FINE
    for mean in means:
        for _ in range(FINE):
            middle = level + 0.5 * step * (mean - level) / time_constant
            level = level + step * (mean - middle) / time_constant
    return level


@pytest.mark.parametrize("duration", [0.5, 1.0, 3.0])
def test_leaked_charge_is_that_of_a_force_that_changes_linearly_between_blocks(duration: float) -> None:
    means, step = blocks(duration), BLOCK / FINE
    charge, last = np.zeros(TAXELS), np.zeros(TAXELS)
    for mean in means:
        slope = (mean - last) / BLOCK
        for _ in range(FINE):
            middle = charge + 0.5 * step * (slope - charge / TAU)
            charge = charge + step * (slope - middle / TAU)
        last = mean
    # Midpoint rule: h^2/(24 tau^2) of 1 N with h = 0.1 ms and tau = 0.1 s.
    np.testing.assert_allclose(advance(response(), means).leaked, last - charge, rtol=0, atol=1e-7)


def test_a_leak_that_is_far_faster_than_the_nominal_one_is_followed() -> None:
    slow = response()
    fast = TouchResponse(compiled_layout(LAYOUT), 0.2 * TAU, PER_KELVIN, PRIORS)
    for mean in blocks(1.0):
        slow.advance(mean, mean, mean, BLOCK, leak=-0.8)
        fast.advance(mean, mean, mean, BLOCK)
    np.testing.assert_allclose(slow.leaked, fast.leaked, rtol=1e-12)


def test_creep_follows_the_force_with_each_time_constant() -> None:
    means = blocks(1.2)
    matrix = advance(response(), means).matrix()
    for index, time_constant in enumerate(CREEP_TIMES):
        expected = follow(means, time_constant)
        np.testing.assert_allclose(matrix[:, Shared.CREEP + index], expected, rtol=0, atol=1e-8)


def test_loops_are_those_of_the_play_operators_and_forgotten_with_the_touch() -> None:
    means = blocks(2.0)
    each = advance(response(), means)
    force = np.array([np.zeros(TAXELS), *means])
    plays = [play_distance(force, width)[-1] for width in PRIORS.loop_half_widths]
    expected = sum(weight * play for weight, play in zip(LOOP_WEIGHTS, plays, strict=True)) - LOOP_SLOPE * force[-1]
    np.testing.assert_allclose(each.loops, expected, rtol=0, atol=1e-12)
    assert each.loops[2] > 0.01  # 1 N was there: what is left is no force
    each.reset()
    assert not each.loops.any()


def test_warmth_follows_the_force_and_saturates_with_it() -> None:
    means = blocks(1.2)
    warm, most = (
        follow([-np.expm1(-mean / force) for mean in means], WARMTH_TIME)
        for force in (WARMTH_FORCE, WARMTH_FORCE / PRIORS.warmth_force_spread)
    )
    each = advance(response(), means)
    np.testing.assert_allclose(each.warm, warm, rtol=0, atol=1e-8)
    np.testing.assert_allclose(each.range, most - warm, rtol=0, atol=1e-8)
    np.testing.assert_allclose(each.matrix()[:, Shared.WARMTH], PER_KELVIN * warm, rtol=0, atol=1e-8)
    weakly = PER_KELVIN * (most - warm)
    np.testing.assert_allclose(each.matrix()[:, Shared.WEAK_WARMTH], weakly, rtol=0, atol=1e-8)
    assert each.warm[1] > each.warm[2] - 1e-3 > each.warm[5] > 0.0
    assert (each.warm <= 1.0).all()


def test_a_steep_thermal_contact_is_whole_from_its_force_on() -> None:
    steep = replace(PRIORS, warmth_steepness=8.0)
    compiled = TouchResponse(compiled_layout(LAYOUT), TAU, PER_KELVIN, steep)
    reference = Reference(LAYOUT, TAU, PER_KELVIN, steep)
    force = WARMTH_FORCE * np.resize([0.0, 0.5, 1.0, 2.0], TAXELS)
    means = blocks(20 * WARMTH_TIME, lambda _: force)
    for each in (compiled, reference):
        for mean in means:
            each.advance(mean, mean, mean, BLOCK)
        np.testing.assert_allclose(each.warm, np.resize([0.0, 0.0, 1.0 - math.exp(-1.0), 1.0], TAXELS), atol=4e-3)
    # Where it hides as much as that, a force that may be wrong by it is no measure of the contact.
    for each in (compiled, reference):
        each.reset()
        for mean in means:
            each.advance(mean, np.zeros(TAXELS), mean, BLOCK, 0.0, 10.0 * WARMTH_FORCE)
    hidden = 10.0 * WARMTH_FORCE * -PER_KELVIN
    np.testing.assert_allclose(compiled.warm, -np.expm1(-force / hidden), rtol=2.0 * math.exp(-20.0))
    np.testing.assert_allclose(compiled.warm, reference.warm, rtol=1e-12)
    np.testing.assert_allclose(compiled.range, reference.range, rtol=1e-12)


def test_a_strong_force_that_seems_to_fall_hardly_changes_its_warmth() -> None:
    # Otherwise a temperature rise that reads as less force would make a smaller rise, and so on.
    strong = np.zeros(TAXELS)
    strong[3] = 10.0 * WARMTH_FORCE
    falling, steady = (advance(response(), [strong] * 5) for _ in range(2))
    advance(falling, [0.8 * strong] * 20)
    advance(steady, [strong] * 20)
    assert falling.warm[3] == pytest.approx(steady.warm[3], rel=1e-3)


@pytest.mark.parametrize("share", [4.0, 0.9, 0.3])
def test_warmth_that_explains_a_whole_force_decays_with_it(share: float) -> None:
    # An object has left a warm taxel, and all that its force seems to be is the warmth that is still subtracted. No
    # force may keep itself up in this way, however warm the object and however weak the touch: measured in a scene
    # where a finger rolls to and fro, 30 mN stayed on every taxel that it had left.
    each, force = response(), np.zeros(TAXELS)
    force[2] = 1.2 * WARMTH_FORCE
    advance(each, [force] * 100)
    level = share * WARMTH_FORCE
    warmth = level / abs(PER_KELVIN[2])
    for _ in range(round(600.0 * WARMTH_TIME / BLOCK)):
        each.advance(level * each.warm, np.zeros(TAXELS), level * each.warm, BLOCK, warmth=warmth)
    assert each.warm[2] < 0.01


def test_each_touch_warms_by_its_own_force() -> None:
    strong, weak = np.zeros((2, TAXELS))
    strong[3], weak[3] = WARMTH_FORCE, 0.1 * WARMTH_FORCE
    each = advance(response(), [strong] * 100 + [np.zeros(TAXELS)] * 1000 + [weak] * 1000)
    assert each.warm[3] == pytest.approx(-math.expm1(-0.1), rel=1e-12)


def test_what_a_force_is_at_least_warms_by_all_that_it_can() -> None:
    # 0.1 K hide more force than a weak touch has: by what it seems to be it may explain no more of itself than it is,
    # but what it certainly is has the thermal contact that it has.
    force, seems, certain = np.zeros(TAXELS), response(), response()
    force[2] = WARMTH_FORCE
    for _ in range(500):
        seems.advance(force, np.zeros(TAXELS), force, BLOCK, warmth=0.1)
        certain.advance(force, force, force, BLOCK, warmth=0.1)
    assert seems.warm[2] == pytest.approx(-math.expm1(-force[2] / (0.1 * abs(PER_KELVIN[2]))), rel=1e-6)
    assert certain.warm[2] == pytest.approx(-math.expm1(-1.0), rel=1e-6)


def test_what_is_left_of_a_released_force_is_the_warmth_of_that_force_alone() -> None:
    # An edge that has left long ago keeps a force up for a while. It tells nothing of the warmth of others.
    each, force, least = response(), np.zeros(TAXELS), np.zeros(TAXELS)
    force[2], least[2] = WARMTH_FORCE, 0.1 * WARMTH_FORCE
    for _ in range(500):
        each.advance(force, least, force, BLOCK, warmth=0.03)
    seems, certain = each.warm[2], -math.expm1(-0.1)
    each.reduce_warmth(2, -0.01, 0.03)  # below zero nothing is left
    each.reduce_warmth(2, 0.01, -0.03)  # a cold object adds to the signal
    assert each.warm[2] == seems
    each.reduce_warmth(2, 0.01, 0.03)
    assert each.warm[2] == pytest.approx(seems - 0.01 / (0.03 * abs(PER_KELVIN[2])), rel=1e-9)
    each.reduce_warmth(2, 1.0, 0.03)
    assert each.warm[2] == pytest.approx(certain, rel=1e-6)
    with pytest.raises(IndexError):
        each.reduce_warmth(TAXELS, 1.0, 0.03)


def test_without_a_calibration_no_more_warmth_is_expected_than_a_force_seems_to_cause() -> None:
    priors = replace(PRIORS, warmth_certain=0.0)
    each = TouchResponse(compiled_layout(LAYOUT), TAU, PER_KELVIN, priors)
    least = np.full(TAXELS, WARMTH_FORCE)
    each.advance(np.append(WARMTH_FORCE, np.zeros(TAXELS - 1)), least, least, BLOCK)
    assert (warm := each.warm[0]) > 0.0
    assert not each.warm[1:].any()
    each.reduce_warmth(0, 1.0, 0.03)
    assert each.warm[0] == warm, "what is left of its force tells its warmth"


def test_a_reset_forgets_all_touches() -> None:
    each = advance(response(), blocks(1.2))
    each.reset()
    np.testing.assert_array_equal(each.matrix(), response().matrix())
    np.testing.assert_array_equal(each.leaked, 0.0)
    again, first = (advance(which, blocks(1.2)) for which in (each, response()))
    np.testing.assert_array_equal(again.matrix(), first.matrix())


def test_bending_acts_on_every_taxel_in_proportion_to_the_total_force() -> None:
    each = response()
    force = touch(0.5)
    advance(each, [force])
    matrix = each.matrix()
    np.testing.assert_array_equal(matrix[:, Shared.BEND], force.sum())
    across = matrix[:, Shared.BEND_X].reshape(3, 4) / force.sum()
    along = matrix[:, Shared.BEND_Y].reshape(3, 4) / force.sum()
    np.testing.assert_allclose(across, np.tile(np.linspace(-1.0, 1.0, 4), (3, 1)), rtol=1e-12)
    np.testing.assert_allclose(along, np.tile(np.linspace(-1.0, 1.0, 3)[:, None], (1, 4)), rtol=1e-12, atol=1e-15)


def test_a_chip_bends_by_the_profile_that_a_calibration_found() -> None:
    profile = np.linspace(0.6, 1.4, TAXELS)
    each = TouchResponse(compiled_layout(LAYOUT), TAU, PER_KELVIN, replace(PRIORS, bend_profile=tuple(profile)))
    advance(each, [touch(0.5)])
    np.testing.assert_allclose(each.matrix()[:, Shared.BEND], profile * touch(0.5).sum(), rtol=1e-12)
    with pytest.raises(ValueError, match="bend_profile must have one value for each taxel"):
        TouchResponse(compiled_layout(LAYOUT), TAU, PER_KELVIN, replace(PRIORS, bend_profile=(1.0,)))


def test_a_chip_bends_around_the_place_that_is_pressed() -> None:
    """As of a plate: what a force at one taxel does to another, the same force there does to the first."""

    def moment(taxel: int) -> np.ndarray:
        each = response()
        advance(each, [np.eye(TAXELS)[taxel]])
        column: np.ndarray = each.matrix()[:, Shared.BEND_MOMENT]
        return column

    between = np.array([moment(taxel) for taxel in range(TAXELS)])
    np.testing.assert_allclose(between, between.T, rtol=0, atol=1e-15)
    assert between[0, 0] == pytest.approx(2.0)  # a corner, at -1 in x and y
    assert between[0, TAXELS - 1] == pytest.approx(-2.0)
    each = response()
    advance(each, [np.ones(TAXELS)])
    np.testing.assert_allclose(each.matrix()[:, Shared.BEND_MOMENT], 0.0, rtol=0, atol=1e-12)


@pytest.mark.parametrize(("rows", "cols"), [(1, 1), (1, 6), (2, 1)])
def test_an_array_of_one_row_does_not_bend_across_it(rows: int, cols: int) -> None:
    layout = replace(LAYOUT, rows=rows, cols=cols)
    each = TouchResponse(compiled_layout(layout), np.ones(rows * cols), np.ones(rows * cols), PRIORS)
    advance(each, [np.ones(rows * cols)])
    matrix = each.matrix()
    assert np.isfinite(matrix).all()
    if rows == 1:
        assert not matrix[:, Shared.BEND_Y].any()
    if cols == 1:
        assert not matrix[:, Shared.BEND_X].any()


def test_before_the_first_touch_only_the_temperature_of_the_film_acts() -> None:
    each = advance(response(), [np.zeros(TAXELS)] * 50)
    expected = np.zeros((TAXELS, COUNT))
    expected[:, Shared.FILM] = PER_KELVIN
    np.testing.assert_array_equal(each.matrix(), expected)
    np.testing.assert_array_equal(each.leaked, 0.0)


def test_long_after_a_touch_nothing_is_left_of_it() -> None:
    each = advance(response(), blocks(1.6))
    long = 40.0 * max(CREEP_TIMES)  # e^-40 = 4e-18
    for _ in range(10):
        each.advance(np.zeros(TAXELS), np.zeros(TAXELS), np.zeros(TAXELS), long / 10)
    matrix = each.matrix()
    matrix[:, Shared.FILM] = 0.0
    np.testing.assert_allclose(matrix, 0.0, rtol=0, atol=1e-15)


def test_a_block_of_any_duration_gives_the_same_response_to_a_constant_force() -> None:
    force = touch(0.5)
    one, many = response(), response()
    for each in (one, many):
        each.advance(force, force, force, BLOCK)
    one.advance(force, force, force, 0.6)
    for _ in range(30):
        many.advance(force, force, force, BLOCK)
    np.testing.assert_allclose(one.matrix(), many.matrix(), rtol=0, atol=1e-14)


def test_a_taxel_responds_to_its_own_force_only_but_for_bending() -> None:
    force = np.zeros(TAXELS)
    force[4] = 1.0
    matrix = advance(response(), [force] * 30).matrix()
    matrix[:, [Shared.FILM, Shared.BEND, Shared.BEND_X, Shared.BEND_Y, Shared.BEND_MOMENT]] = 0.0
    assert np.flatnonzero(matrix.any(axis=1)).tolist() == [4]
    # The small force of a taxel beside a contact is not a response to its own.
    assert not matrix[:, Shared.TAIL].any()
