# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The differential pair: current and transconductance, and the exact transition from one overdrive to another."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posfet_model.amplifier.differential_pair import (
    EDGE,
    LARGEST_PRODUCT,
    NO_LEAD,
    Lead,
    lead_slope,
    pair_current,
    pair_transconductance,
)
from posfet_model.amplifier.pair_settling import settle, settle_series
from support.long_cases import crossed, long_cases
from support.sweep import (
    EPS,
    ErrorMap,
    assert_all_refused,
    assert_finite,
    assert_monotone,
    call_error,
    decades,
    reference,
    refusals,
)

STEEPEST = 1 / (1 - LARGEST_PRODUCT)
"""Largest change of x per change of y [1], with a lead at the end of its range."""

leads = st.one_of(st.just(Lead()), st.builds(Lead, linear=st.floats(0, 1), square=st.floats(-0.5, 0.5)))


def settling_error(
    start: np.ndarray, end: np.ndarray, slope: np.ndarray, duration: np.ndarray, lead: Lead = NO_LEAD
) -> np.ndarray:
    """Return the largest rounding error of x at the end of a step from `start`, from the condition of the result.

    With v = slope - f and y' = dy/dx, x changes at the rate v/y'. So the error of x at the end is v/y' times the error
    of the time, v/v(start)*y'(start)/y' times that of x at the start, and slope*duration/y' for a relative error 1 of
    the slope: dx/dslope = v/y'*(time average of 1/v)*duration, and v is smallest at the end. Each has the error of a
    call of an elementary function and of the adjacent roundings (3 EPS):

    - x at either end, 2*sin(angle), by its angle and that of the equilibrium, together at most 2, and the lead term
      in f;
    - the time: itself, and with a slope below 1 the logarithms ln|(p - a)/(p + a)|/(2a) and ln|(q + b)/(q - b)|/(2b) at
      either end, and ln|v| for the lead; with a slope above 1 its terms have one sign and are at most distance/v.
    """
    rho, sign = np.abs(slope), np.where(slope < 0, -1.0, 1.0)
    share = lead.linear + 2 * abs(lead.square)
    below = rho < 1
    a, b = np.sqrt(np.where(below, 1 - rho, 1)), np.sqrt(1 + rho)

    def at(x: np.ndarray) -> tuple[np.ndarray, ...]:
        x = np.clip(sign * x, -EDGE, EDGE)
        f = pair_current(x)
        v = np.abs(rho - f)
        p, q = x / 2 - np.sqrt(1 - x * x / 4), x / 2 + np.sqrt(1 - x * x / 4)
        with np.errstate(divide="ignore", invalid="ignore"):
            logarithms = np.abs(np.log(np.abs((p - a) / (p + a)))) / (2 * a) + share * np.abs(np.log(v))
            logarithms += np.abs(np.log(np.abs((q + b) / (q - b)))) / (2 * b)
        logarithms = np.where(below & np.isfinite(logarithms), logarithms, 0)  # at the equilibrium itself v is 0, too
        return v, logarithms, lead_slope(lead.linear, lead.square * sign, f, pair_transconductance(x))

    (v_start, logs_start, _), (v, logs, steepness) = at(start), at(end)
    time = v * (duration + logs_start + logs) + np.where(below, 0, np.abs(end - start) * (1 + share))
    kept = np.where(v_start > 0, v / np.where(v_start > 0, v_start, 1), 1)
    at_ends = np.maximum(2, np.abs(end)) + (share + (2 + share) * kept) / steepness
    return (call_error() + EPS) * (at_ends + (time + rho * duration) / steepness)


def test_current_and_transconductance_against_the_40_digit_table() -> None:
    table = reference("pair_current")
    np.testing.assert_allclose(pair_current(table["overdrive"]), table["current"], rtol=0, atol=2 * EPS)
    np.testing.assert_allclose(
        pair_transconductance(table["overdrive"]), table["transconductance"], rtol=0, atol=4 * EPS
    )


def test_the_pair_saturates_at_the_tail_current_without_a_kink() -> None:
    x = np.linspace(-3, 3, 6001)
    assert_monotone(pair_current(x), rising=True, slack=EPS)
    assert pair_current(EDGE) == pytest.approx(1, abs=EPS)
    assert pair_transconductance(EDGE) == pytest.approx(0, abs=4 * EPS)
    beyond = [-1e308, -2.0, -EDGE, EDGE, 1.5, 2.0, 1e308]
    np.testing.assert_array_equal(pair_transconductance(beyond), 0.0)
    np.testing.assert_array_equal(np.abs(pair_current(beyond)), 1.0)
    assert (pair_transconductance(x) >= 0).all()
    assert (np.abs(pair_current(x)) <= 1).all()
    numeric = (pair_current(x + 1e-6) - pair_current(x - 1e-6)) / 2e-6
    np.testing.assert_allclose(pair_transconductance(x), numeric, rtol=0, atol=1e-6)


def test_settling_against_the_40_digit_table(record_property) -> None:
    table = reference("pair_settling")
    end, bound = np.empty_like(table["end"]), np.empty_like(table["end"])
    for linear, square in {(0.0, 0.0), *zip(table["linear"], table["square"], strict=True)}:
        rows = (table["linear"] == linear) & (table["square"] == square)
        start, slope, duration = (table[name][rows] for name in ("start", "slope", "duration"))
        end[rows] = settle(start, slope * duration, duration, Lead(linear, square))
        bound[rows] = settling_error(start, table["end"][rows], slope, duration, Lead(linear, square))
    assert np.median(bound) < 25 * EPS  # the bound is informative
    share = (end - table["end"]) / bound
    plain = (table["linear"] == 0) & (table["square"] == 0)
    found = ErrorMap(bound=1.0)
    for region, rows in {
        "slope below 1": np.abs(table["slope"]) < 0.99,
        "slope near 1": np.abs(np.abs(table["slope"]) - 1) < 0.01,
        "slope above 1": np.abs(table["slope"]) > 1.01,
    }.items():
        found.add(f"{region}, share of the bound", share[rows & plain])
        found.add(f"{region}, with a lead, share of the bound", share[rows & ~plain])
    found.check(record_property)


@given(
    st.floats(-50, 50),
    st.one_of(st.floats(-3, 3), decades(1e-12, 1e6), st.sampled_from([1.0, -1.0, 1 - EPS, 1 + EPS, 0.0])),
    decades(1e-12, 1e12),
    st.floats(0, 1),
    leads,
)
def test_a_transition_equals_the_sum_of_its_parts(
    start: float, slope: float, duration: float, part: float, lead: Lead
) -> None:
    x, s = np.array([start]), np.array([duration])
    with np.errstate(over="raise", invalid="raise", divide="raise"):
        whole = settle(x, slope * s, s, lead)
        first = settle(x, slope * part * s, part * s, lead)
        both = settle(first, slope * (s - part * s), s - part * s, lead)
    assert_finite(whole)
    # The rounding of the time is proportional to its length, that of x to the change of the input, that of the slope is
    # that of a quotient: near 1 the equilibrium moves much more than the slope.
    way = abs(start) + (1 + abs(slope)) * duration
    room = 4.0 + (way if abs(slope) >= 1 or abs(start) > EDGE else 0.0)
    if abs(slope) < 1:
        room += 1 / math.sqrt(max(1 - slope**2, EPS))
    assert abs(both - whole) <= 8 * EPS * STEEPEST * room


@pytest.mark.parametrize("lead", [Lead(), Lead(linear=0.3), Lead(linear=0.3, square=-0.5)])
def test_transitions_that_start_at_the_edges_of_saturation_and_linearity(lead: Lead) -> None:
    """Starts and slopes a few roundings from +-EDGE and 1, and on both sides of the limit of f(x) = x."""
    beside = np.arange(-8, 9) * EPS
    under = np.array([1.4142135612040179, 1.4142135623702081, 1.4142135623727576])  # sin + cos round to EDGE there
    tiny = np.array([9.9e-6, 1.01e-5, 9.9e-5, 1.01e-4])
    starts = np.concatenate([EDGE * (1 + beside), -EDGE * (1 + beside), under, -under, tiny, -tiny, [0.0]])
    slopes = np.concatenate([1 + beside, -1 - beside, tiny, [0.0]])
    x, slope, s = (part.ravel() for part in np.meshgrid(starts, slopes, [1e-12, 1e-3, 1.0, 40.0]))
    with np.errstate(over="raise", invalid="raise", divide="raise"):
        whole = settle(x, slope * s, s, lead)
        both = settle(settle(x, slope * 0.5 * s, 0.5 * s, lead), slope * 0.5 * s, 0.5 * s, lead)
    # The whole transition, its halves, and the range where f(x) = x is used, with an error of 1.3e-16 per step
    # (LINEAR_BELOW).
    half = settle(x, slope * 0.5 * s, 0.5 * s, lead)
    bound = settling_error(x, whole, slope, s, lead) + settling_error(half, both, slope, 0.5 * s, lead)
    bound += settling_error(x, half, slope, 0.5 * s, lead) * STEEPEST + 3 * 1.3e-16
    assert np.max(np.abs(both - whole) / bound) <= 1


@pytest.mark.parametrize(("sine", "cosine"), [(2, 2), (2, -2), (-2, 2), (-2, -2)])
def test_a_sine_wrong_by_two_ulps_leaves_x_at_the_edge(sine: int, cosine: int, monkeypatch) -> None:
    """sin + cos may round beyond EDGE where saturation starts; the time to EDGE is 0 then."""

    def moved(function, units: int):
        return lambda x: function(x) + units * np.spacing(np.abs(function(x)))

    monkeypatch.setattr(np, "sin", moved(np.sin, sine))
    monkeypatch.setattr(np, "cos", moved(np.cos, cosine))
    start, slope = (axis.ravel() for axis in np.meshgrid(EDGE * (1 - np.arange(1, 100) * EPS), 1 + np.arange(4) * EPS))
    with np.errstate(over="raise", invalid="raise", divide="raise"):
        x = settle(start, slope, np.ones_like(start))
    assert (np.abs(x - EDGE) <= 200 * EPS).all()


@pytest.mark.parametrize("duration", [1e2, 1112.0, 1153.0, 1e4])
@pytest.mark.parametrize("slope", [1 - EPS, 1.0, 1 + EPS])
def test_a_slope_that_all_but_saturates_is_approached_slowly(slope: float, duration: float) -> None:
    with np.errstate(over="raise", invalid="raise", divide="raise"):
        x = settle(np.zeros(1), np.array([slope * duration]), np.array([duration]))
    # Near the edge dz/ds = -z^2 for z = EDGE - x; to next order 1/z is s plus a fraction of log(s).
    assert abs(1 / (EDGE - x[0]) - duration) <= math.log(duration)


def test_at_equilibrium_the_current_equals_the_slope() -> None:
    slope = np.array([0.0, 1e-9, 0.1, 0.5, 0.9, 0.999, -0.7])
    x = settle(np.full(7, 40.0), slope * 1e6, np.full(7, 1e6))
    np.testing.assert_allclose(pair_current(x), slope, rtol=0, atol=4 * EPS)
    np.testing.assert_allclose(settle(x, slope, np.ones(7)), x, rtol=0, atol=4 * EPS / math.sqrt(1e-3))


@pytest.mark.parametrize("lead", [Lead(), Lead(0.07, 0.17), Lead(1.0, -0.5), Lead(0.0, 0.5)])
def test_settling_is_odd_except_for_the_square_and_preserves_order(lead: Lead) -> None:
    start = np.linspace(-4, 4, 801)
    other = Lead(lead.linear, -lead.square)
    for slope in (0.0, 0.3, 1.0, 2.5):
        for duration in (0.0, 1e-3, 1.0, 30.0):
            x = settle(start, np.full_like(start, slope * duration), np.full_like(start, duration), lead)
            back = settle(-start, np.full_like(start, -slope * duration), np.full_like(start, duration), other)
            error = settling_error(start, x, np.full_like(start, slope), np.full_like(start, duration), lead)
            assert (np.abs(x + back) <= 2 * error).all()
            assert_monotone(x, rising=True, slack=error[1:] + error[:-1])


@pytest.mark.parametrize("lead", [Lead(), Lead(0.07, 0.17), Lead(1.0, -0.5), Lead(0.0, 0.5)])
def test_a_jump_does_not_change_the_capacitor_voltage(lead: Lead) -> None:
    def lag(x: np.ndarray) -> np.ndarray:
        return x + lead.linear * pair_current(x) + lead.square * pair_current(x) ** 2

    start, change = (axis.ravel() for axis in np.meshgrid(np.linspace(-3, 3, 61), np.linspace(-5, 5, 41)))
    x = settle(start, change, np.zeros_like(start), lead)
    np.testing.assert_allclose(lag(x), lag(start) + change, rtol=0, atol=8 * EPS * 5)
    np.testing.assert_allclose(settle(start, 0 * change, np.zeros_like(start), lead), start, rtol=0, atol=1e-14)


def test_the_square_contributes_no_more_than_stated() -> None:
    x = np.linspace(0, EDGE, 100_001)
    product = pair_current(x) * pair_transconductance(x)
    assert LARGEST_PRODUCT - 0.001 < product.max() < LARGEST_PRODUCT


@pytest.mark.parametrize(
    ("scale", "lead"),
    long_cases(
        crossed([1e-6, 0.5, 20.0], {"lead0": Lead(), "lead1": Lead(0.07, 0.17), "lead2": Lead(1.0, -0.5)}),
        ["1e-06-lead0", "0.5-lead1", "20.0-lead2"],
    ),
)
def test_a_series_equals_its_single_steps(scale: float, lead: Lead) -> None:
    generator = np.random.default_rng(6)
    change = scale * generator.normal(size=2000)
    duration = 10 ** generator.uniform(-3, 1, 2000)
    duration[::50] = 0
    x = np.array(0.0)
    looped = []
    for c, d in zip(change, duration, strict=True):
        x = settle(x, c, d, lead)
        looped.append(float(x))
    np.testing.assert_allclose(
        settle_series(np.array(0.0), change, duration, lead), looped, rtol=0, atol=1e-12 * max(1, scale)
    )


@pytest.mark.parametrize(
    ("function", "cases"),
    [
        refusals(pair_current, {"overdrive": 0.0}, overdrive=[]),
        refusals(Lead, {}, linear=[-1e-9, 1.1], square=[-0.6, 0.6]),
        refusals(pair_transconductance, {"overdrive": 0.0}, overdrive=[]),
    ],
)
def test_invalid_arguments_are_rejected_by_name(function, cases) -> None:
    assert_all_refused(function, cases)
