# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Quadrature rules against the closed moments of their pressures."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from posfet_sim.contact.quadrature import (
    DiscRule,
    Line,
    flat_disc,
    half_ellipse,
    hertz_disc,
    inverse_root,
    uniform,
    uniform_both,
    wedge,
)


def semifactorials(even: int) -> float:
    """Return (n - 1)!!/n!! of an even n: the mean of sin(angle)**n over a turn."""
    return math.prod((k - 1) / k for k in range(2, even + 1, 2))


MOMENTS: dict[Callable[[int], Line], Callable[[int], float]] = {
    # Of x**n, n even, under each pressure of total force 1.
    uniform: lambda n: 1 / (n + 1),
    half_ellipse: lambda n: semifactorials(n) * 2 / (n + 2),
    inverse_root: semifactorials,
    wedge: lambda n: semifactorials(n) / (n + 1),
}


@pytest.mark.parametrize("rule", MOMENTS)
@pytest.mark.parametrize("order", [2, 4, 6, 10])
def test_a_line_is_exact_to_its_degree(rule: Callable[[int], Line], order: int) -> None:
    points, weights = rule(order)
    degree = order - 1 if rule is wedge else 2 * order - 1  # half as many points of the scale
    for power in range(degree + 1):
        expected = 0.0 if power % 2 else MOMENTS[rule](power)
        assert weights @ points**power == pytest.approx(expected, abs=1e-13), power
    assert weights @ points ** (degree + 1) != pytest.approx(MOMENTS[rule](degree + 1), rel=1e-8)


@pytest.mark.parametrize("rule", MOMENTS)
def test_points_lie_within_the_contact_with_positive_weights(rule: Callable[[int], Line]) -> None:
    points, weights = rule(12)
    assert np.abs(points).max() < 1.0
    assert weights.min() > 0.0
    np.testing.assert_allclose(np.sort(points), -np.sort(points)[::-1], rtol=0, atol=1e-14)


@pytest.mark.parametrize(
    ("rule", "expected"),
    [
        (uniform, math.sin(2.0) / 2.0),
        (half_ellipse, 0.5767248077568734),  # J1(2), by its series below
        (inverse_root, 0.22389077914123567),  # J0(2)
    ],
)
def test_a_line_integrates_a_wave(rule: Callable[[int], Line], expected: float) -> None:
    points, weights = rule(12)
    assert weights @ np.cos(2.0 * points) == pytest.approx(expected, abs=1e-12)


def test_the_bessel_functions_above_are_those_of_their_series() -> None:
    j0 = sum((-1) ** k / math.factorial(k) ** 2 for k in range(20))
    j1 = sum((-1) ** k / (math.factorial(k) * math.factorial(k + 1)) for k in range(20))
    assert j0 == pytest.approx(0.22389077914123567, abs=1e-15)
    assert j1 == pytest.approx(0.5767248077568734, abs=1e-15)


def test_the_pressure_of_a_wedge_is_highest_in_its_middle() -> None:
    points, weights = wedge(16)
    # Force within |x| < 1/2: the integral of acosh(1/x)*2/pi, by parts: (x*acosh(1/x) + asin(x))*2/pi.
    inner = 2 / math.pi * (0.5 * math.acosh(2.0) + math.asin(0.5))
    assert weights[np.abs(points) < 0.5].sum() == pytest.approx(inner, abs=0.03)


def test_the_halved_line_is_the_same_rule() -> None:
    points, weights = uniform(8)
    both, half = uniform_both(8)
    assert (both[:4] > 0.0).all()
    np.testing.assert_array_equal(both[4:], -both[:4])
    assert np.concatenate([half, half]) @ both**6 == pytest.approx(weights @ points**6)
    assert np.concatenate([half, half]).sum() == pytest.approx(1.0)


def disc_moment(rule: DiscRule, of_x: int, of_y: int) -> float:
    """Return the moment x**of_x * y**of_y under a rule that stores only x > 0."""
    right = np.einsum("i,j,i,ij->", rule.x_weight, rule.y_weight, rule.x**of_x, rule.y**of_y)
    return float(right * (1 + (-1) ** of_x))


def radial_moment(power: int, exponent: float) -> float:
    """Return the mean of r**power under the pressure (1 - r^2)**exponent: a ratio of beta functions."""
    half = power / 2 + 1
    return math.gamma(half) * math.gamma(exponent + 2) / math.gamma(half + exponent + 1)


@pytest.mark.parametrize(("rule", "exponent"), [(hertz_disc, 0.5), (flat_disc, -0.5)])
@pytest.mark.parametrize("order", [2, 4, 8])
def test_a_disc_is_exact_to_its_degree(rule: Callable[[int], DiscRule], exponent: float, order: int) -> None:
    points = rule(order)
    for of_x in range(2 * order):
        for of_y in range(2 * order - of_x):
            if of_x % 2 or of_y % 2:
                expected = 0.0
            else:
                # Mean of cos**of_x * sin**of_y over a turn.
                turn = semifactorials(of_x) * semifactorials(of_y) / math.comb((of_x + of_y) // 2, of_x // 2)
                expected = turn * radial_moment(of_x + of_y, exponent)
            assert disc_moment(points, of_x, of_y) == pytest.approx(expected, abs=1e-13), (of_x, of_y)


@pytest.mark.parametrize("rule", [hertz_disc, flat_disc])
def test_a_disc_has_its_points_inside_and_half_of_them_stored(rule: Callable[[int], DiscRule]) -> None:
    points = rule(6)
    assert points.x.shape == (3,)
    assert points.y.shape == (3, 6)
    assert (points.x > 0.0).all()
    assert (points.x[:, None] ** 2 + points.y**2).max() < 1.0
    assert points.x_weight.sum() == pytest.approx(0.5)
    assert points.y_weight.sum() == pytest.approx(1.0)
    np.testing.assert_array_equal(points.both, np.concatenate([points.x, -points.x]))
