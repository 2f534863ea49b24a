# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Hysteresis of the film: branches against 40-digit references, general properties of minor loops, poling memory."""

import dataclasses
import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from posfet_model.device import film
from posfet_model.device.constants import VACUUM_PERMITTIVITY
from posfet_model.device.film import VIRGIN, Film, History, TurningPoint
from support.sweep import (
    EPS,
    ErrorMap,
    assert_all_refused,
    assert_finite,
    assert_monotone,
    call_error,
    reference,
    refusals,
    signed_decades,
)

PAPER = Film(160e5, 0.02, 0.05, 12.0)
EC = PAPER.coercive_field
SPAN = 3 * PAPER.coercive_field
FIELDS = st.lists(st.floats(-SPAN, SPAN), min_size=1, max_size=30)


def _switched(fields, history=VIRGIN, material=PAPER):
    linear = material.relative_permittivity * VACUUM_PERMITTIVITY * np.asarray(fields)
    return film.polarise(fields, material, history).polarisation - linear


def _loop_bounds(fields):
    linear = PAPER.relative_permittivity * VACUUM_PERMITTIVITY * np.asarray(fields)
    return film.rising_branch(fields, PAPER) - linear, film.falling_branch(fields, PAPER) - linear


def steepness_error() -> float:
    """Return the largest error of the steepness Ec/log1p(2*Pr/(Ps - Pr)) [1]: a call, and three roundings around it.

    The condition of log1p is at most 1.
    """
    return call_error() + 3 * EPS / 2


def branch_error(material: Film, polarisation, dtype=np.float64):
    """Return the largest error of a saturated branch [C/m2].

    Ps*tanh(z): one call, the product and the sum; the error of z comes from the steepness, Ec, the difference and the
    quotient, times z*tanh'(z) < 1/2, or from the rounding of a field near Ec where z is nearly 0, times tanh' <= 1. The
    linear term is three products, and not larger than the sum of polarisation and Ps.
    """
    eps = float(np.finfo(dtype).eps)
    turned = call_error(dtype) + eps + (steepness_error() + 2 * eps) / 2
    turned += eps * material.coercive_field / (2 * material.steepness)
    return material.saturation_polarisation * turned + 2 * eps * (
        np.abs(polarisation) + material.saturation_polarisation
    )


def _of_row(table, row: int) -> Film:
    return Film(*(float(table[name][row]) for name in ("coercive_field", "remnant", "saturation", "permittivity")))


class TestSteepness:
    @pytest.mark.parametrize("share", [1e-9, 1e-3, 0.25, 0.4, 0.9, *(1 - 10.0**-n for n in (3, 6, 8, 8.9))])
    def test_it_is_accurate_to_rounding_up_to_saturation(self, share: float) -> None:
        """Of the quotient Pr/Ps it was 1e-9 off at the last of these."""
        mpmath = pytest.importorskip("mpmath")
        for saturation in (0.05, 0.3, 7.7e-3):
            remnant = share * saturation
            with mpmath.workdps(40):
                exact = 160e5 / mpmath.log((mpmath.mpf(saturation) + remnant) / (mpmath.mpf(saturation) - remnant))
                error = float(film.branch_steepness(160e5, remnant, saturation) / exact - 1)
            assert abs(error) <= steepness_error(), (saturation, error)


class TestSaturatedLoop:
    def test_branches_against_the_40_digit_table(self, record_property) -> None:
        table = reference("film_branches")
        found = ErrorMap(bound=1.0)
        for row, field in enumerate(table["field"]):
            material = _of_row(table, row)
            assert material.steepness == pytest.approx(table["steepness"][row], rel=steepness_error(), abs=0)
            region = f"field to 1e{3 * math.ceil(math.log10(max(abs(field), 1.0) * 0.9999) / 3)} V/m"
            for branch, exact in ((film.rising_branch, table["rising"]), (film.falling_branch, table["falling"])):
                error = branch(field, material) - exact[row]
                found.add(f"{region}, share of the bound", error / branch_error(material, exact[row]))
        found.check(record_property)

    def test_the_loop_passes_through_remnant_and_coercive_points(self) -> None:
        error = branch_error(PAPER, 0.02)
        assert film.falling_branch(0.0, PAPER) == pytest.approx(0.02, rel=0, abs=error)
        assert film.rising_branch(0.0, PAPER) == pytest.approx(-0.02, rel=0, abs=error)
        assert film.rising_branch(EC, PAPER) == pytest.approx(12 * VACUUM_PERMITTIVITY * EC, rel=0, abs=1e-17)
        assert PAPER.switched_polarisation == pytest.approx(0.07, rel=0, abs=1e-17)

    @pytest.mark.parametrize("dtype", [np.float64, np.float32])
    @pytest.mark.parametrize("size", [0, 1, 1_000_000])
    def test_branches_are_finite_and_rise_up_to_1e12_volts_per_metre(self, dtype, size: int) -> None:
        fields = np.linspace(-1e12, 1e12, size, dtype=dtype)
        with np.errstate(over="raise", invalid="raise"):
            rising, falling = film.rising_branch(fields, PAPER), film.falling_branch(fields, PAPER)
        assert rising.dtype == falling.dtype == dtype and rising.shape == (size,)
        assert_finite(rising)
        # Beyond saturation the branches coincide, and neighbours may be out of order by their errors.
        errors = branch_error(PAPER, np.abs(rising), dtype)
        assert_monotone(rising, rising=True, slack=errors[1:] + errors[:-1])
        assert (rising <= falling + 2 * errors).all()


class TestMinorLoops:
    def test_first_reversals_against_the_40_digit_table(self) -> None:
        table = reference("film_minor_loops")
        for row, path in enumerate(zip(table["up"], table["down"], table["end"], strict=True)):
            material = _of_row(table, row)
            expected = [table[name][row] for name in ("at_up", "at_down", "at_end")]
            # The distance to the target shrinks by a weight with the errors of three exponentials, of a quotient of two
            # with half the effect each, and of their arguments (steepness); the error of a reversal persists.
            turn = (4 * call_error() + 4 * EPS + steepness_error()) * (
                material.saturation_polarisation + np.max(np.abs(expected))
            )
            error = np.abs(film.polarise(path, material).polarisation - expected)
            assert (error <= turn * np.arange(1, 4)).all()

    @given(FIELDS)
    def test_every_loop_stays_within_the_saturated_loop(self, fields) -> None:
        low, high = _loop_bounds(fields)
        switched = _switched(fields)
        assert (switched >= low - 4 * EPS).all() and (switched <= high + 4 * EPS).all()

    @given(FIELDS, st.floats(-SPAN, SPAN), st.floats(-SPAN, SPAN))
    def test_a_minor_loop_closes_and_is_erased_from_the_history(self, fields, turn, back) -> None:
        before = film.polarise([*fields, turn], PAPER)
        low, high = sorted((turn, back))
        inside = [low + share * (high - low) for share in (0.3, 0.8, 0.4, 0.6)]
        around = film.polarise([back, *inside, back, turn], PAPER, before.history)
        straight = film.polarise([back, turn], PAPER, before.history)
        assert around.polarisation[-1] == straight.polarisation[-1]
        assert around.history == straight.history

    @given(st.floats(0.01, 1), st.floats(0.01, 0.99))
    def test_loops_are_nested(self, outer, share) -> None:
        high = outer * SPAN
        start = film.polarise([SPAN, -SPAN, high], PAPER).history
        path = np.linspace(-high, high, 41)
        rising_outer = _switched([-high, *path], start)[1:]
        falling_outer = _switched(path[::-1], start)[::-1]
        centre = film.polarise([-high, share * high], PAPER, start).history
        inner = np.linspace(-share * high, share * high, 41)
        falling_inner = _switched(inner[::-1], centre)[::-1]
        assert (falling_outer >= rising_outer - 4 * EPS).all()
        assert (falling_inner <= np.interp(inner, path, falling_outer) + 1e-3).all()
        assert_monotone(rising_outer, rising=True, slack=2 * EPS)
        assert_monotone(falling_outer, rising=True, slack=2 * EPS)

    @given(st.lists(st.floats(0.01, 1).map(lambda share: share * SPAN), min_size=1, max_size=8))
    def test_growing_cycles_of_a_virgin_film_are_symmetric_about_the_initial_poling_curve(self, amplitudes) -> None:
        growing = sorted(amplitudes)
        tips = _switched([sign * field for field in growing for sign in (1, -1)])
        np.testing.assert_allclose(tips[0::2], -tips[1::2], rtol=0, atol=4 * EPS)
        np.testing.assert_allclose(tips[0::2], _switched(growing), rtol=0, atol=4 * EPS)

    @given(FIELDS)
    def test_intermediate_fields_do_not_change_the_result(self, fields) -> None:
        dense = [0.0]
        for start, end in itertools.pairwise([0.0, *fields]):
            dense += [start + (end - start) * share for share in (0.25, 0.5, 0.75)] + [end]
        sparse = _switched(fields)
        assert np.abs(_switched(dense)[4::4] - sparse).max() <= 4 * EPS * len(dense) * 0.05

    @given(FIELDS)
    def test_mirrored_fields_give_mirrored_polarisation(self, fields) -> None:
        np.testing.assert_array_equal(_switched([-field for field in fields]), -_switched(fields))

    @given(FIELDS, st.integers(0, 30))
    def test_history_continues_a_sequence(self, fields, cut) -> None:
        first = film.polarise(fields[:cut], PAPER)
        second = film.polarise(fields[cut:], PAPER, first.history)
        whole = film.polarise(fields, PAPER)
        np.testing.assert_array_equal(np.concatenate([first.polarisation, second.polarisation]), whole.polarisation)
        assert second.history == whole.history

    def test_a_saturated_film_follows_the_saturated_branch(self) -> None:
        fields = np.linspace(0, 1e9, 501)
        np.testing.assert_allclose(
            film.polarise(fields, PAPER, film.saturated(PAPER, positive=False)).polarisation,
            film.rising_branch(fields, PAPER),
            rtol=0,
            atol=4 * EPS * 0.2,
        )

    def test_a_hundred_thousand_cycles_have_no_lasting_effect(self) -> None:
        start = film.polarise([2 * EC, -EC], PAPER)
        cycles = film.polarise(np.tile([0.5 * EC, -0.3 * EC, 0.2 * EC, -EC], 50_000), PAPER, start.history)
        assert cycles.history == start.history
        assert cycles.polarisation[-1] == start.polarisation[-1]

    @settings(max_examples=50)
    @given(st.lists(signed_decades(1e-3, 1e12), max_size=30))
    def test_any_field_gives_a_finite_and_bounded_polarisation(self, fields) -> None:
        poling = film.polarise(fields, PAPER)
        assert poling.polarisation.shape == (len(fields),) and poling.polarisation.dtype == np.float64
        assert_finite(poling.polarisation)
        assert abs(poling.history.switched) <= PAPER.saturation_polarisation


def _dipole_equation(start: float, end: float, switched: float, steps: int = 400) -> float:
    """Miller et al. (1991), dP/dE = (1 - tanh(sqrt((P - Psat)/(xi*Ps - P))))*dPsat/dE, by Runge-Kutta."""
    way = 1 if end > start else -1
    saturation, delta = PAPER.saturation_polarisation, PAPER.steepness

    def slope(field: float, now: float) -> float:
        angle = (field - way * EC) / (2 * delta)
        share = max((now - saturation * math.tanh(angle)) / (way * saturation - now), 0.0)
        return (1 - math.tanh(math.sqrt(share))) * saturation / (2 * delta * math.cosh(angle) ** 2)

    step = (end - start) / steps
    for i in range(steps):
        field = start + i * step
        first = slope(field, switched)
        second = slope(field + step / 2, switched + step / 2 * first)
        third = slope(field + step / 2, switched + step / 2 * second)
        last = slope(field + step, switched + step * third)
        switched += step / 6 * (first + 2 * second + 2 * third + last)
    return switched


def test_the_dipole_equation_creeps_where_loops_of_the_turning_point_model_close() -> None:
    state = _dipole_equation(0.0, 2 * EC, 0.0)
    upper = []
    for _ in range(6):
        state = _dipole_equation(EC / 2, 2 * EC, _dipole_equation(2 * EC, EC / 2, state))
        upper.append(state)
    assert upper[0] == pytest.approx(0.0266, rel=0, abs=5e-5)
    assert upper[-1] == pytest.approx(0.0294, rel=0, abs=5e-5)
    ours = _switched([2 * EC, *[EC / 2, 2 * EC] * 6])[::2]
    assert np.ptp(ours) == 0.0


class TestPoling:
    def test_the_remnant_state_grows_with_the_poling_field_to_the_remnant_polarisation(self) -> None:
        states = [film.remnant_after([field], PAPER) for field in np.linspace(0, 1e9, 201)]
        assert states[0] == 0.0
        assert_monotone(states, rising=True, slack=2 * EPS)
        assert states[-1] == pytest.approx(PAPER.remnant_polarisation, rel=0, abs=4 * EPS)
        assert film.remnant_after([1e9, -1e9], PAPER) == pytest.approx(-0.02, rel=0, abs=4 * EPS)

    def test_shrinking_cycles_depole_the_film(self) -> None:
        left = []
        for count in (100, 1000, 10_000):  # the finer the steps down, the smaller the remainder
            fields = 3e8 * np.linspace(1, 0, count) * (-1) ** np.arange(count)
            left.append(abs(film.remnant_after(fields, PAPER)) / PAPER.remnant_polarisation)
        assert left[0] > left[1] > left[2]
        assert left[2] < 1e-6

    def test_piezoelectric_coefficient_follows_the_remnant_state(self) -> None:
        values = film.piezoelectric_coefficient([0.02, 0.005, 0.0, -0.02], PAPER, -38e-12)
        np.testing.assert_allclose(values, [-38e-12, -9.5e-12, 0.0, 38e-12], rtol=0, atol=1e-26)
        once_poled = film.remnant_after([1e12], PAPER)
        assert film.piezoelectric_coefficient(once_poled, PAPER, -38e-12) == pytest.approx(-38e-12, rel=1e-12, abs=0)


@pytest.mark.parametrize(
    ("function", "cases"),
    [
        refusals(
            Film,
            dataclasses.asdict(PAPER),
            coercive_field=[0, -1, 1e13],
            remnant_polarisation=[0, -0.02, 0.05, 0.06, [0.02]],
            saturation_polarisation=[0, -0.05, 11],
            relative_permittivity=[0, 0.9, 1e6],
        ),
        refusals(
            film.branch_steepness,
            {"coercive_field": EC, "remnant_polarisation": 0.02, "saturation_polarisation": 0.05},
            coercive_field=[0],
            remnant_polarisation=[0.05, 0.0],
            saturation_polarisation=[0],
        ),
        refusals(film.rising_branch, {"field": 0.0, "film": PAPER}, field=[1.1e12, [-2e12]], film=[VIRGIN]),
        refusals(film.falling_branch, {"field": 0.0, "film": PAPER}, field=[1.1e12], film=[]),
        refusals(film.saturated, {"film": PAPER, "positive": True}, film=[]),
        refusals(
            film.polarise, {"fields": [], "film": PAPER}, fields=[[1.1e12], 0.0, [[1.0]]], film=[], history=[PAPER]
        ),
        refusals(film.remnant_after, {"fields": [], "film": PAPER}, fields=[[1.1e12], 0.0], film=[], history=[]),
        refusals(
            film.piezoelectric_coefficient,
            {"remnant_polarisation": 0.02, "film": PAPER, "saturated_coefficient": -38e-12},
            remnant_polarisation=[0.021, -0.021],
            film=[],
            saturated_coefficient=[-38],
        ),
        refusals(
            History,
            {"field": 0.0, "switched": 0.0, "direction": 0, "turning_points": ()},
            field=[2e12],
            switched=[11],
            direction=[2, -2, 0.5],
            turning_points=[[], (1.0,)],
        ),
    ],
)
def test_invalid_arguments_are_rejected_by_name(function, cases) -> None:
    assert_all_refused(function, cases)


@pytest.mark.parametrize("direction", [0, 1])
def test_impossible_turning_points_are_rejected(direction: int) -> None:
    with pytest.raises(ValueError, match="turning_points must alternate"):
        History(0.0, 0.0, direction, (TurningPoint(1.0, 0.0),))


def test_the_history_of_a_film_with_larger_polarisation_is_rejected() -> None:
    with pytest.raises(ValueError, match=r"history.switched must be in \[-0.05, 0.05\], got 0.06"):
        film.polarise([1.0], PAPER, History(0.0, 0.06, 0, ()))
