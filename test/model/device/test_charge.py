# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Charge of the film: against 40-digit references, for independence of the step size, and over the whole range."""

import math

import numpy as np
import pytest
from hypothesis import given

from posfet_model.device import charge
from support.long_cases import long_cases
from support.sweep import (
    EPS,
    ErrorMap,
    assert_all_refused,
    assert_finite,
    assert_monotone,
    call_error,
    corners,
    decades,
    reference,
    refusals,
    signed_decades,
)

TAU = 0.27
STEP_GOOD = {"charge": 0.0, "source_start": 0.0, "source_end": 1e-5, "step": 1e-3, "time_constant": TAU}
FIRST_ORDER_HOLD_ARGUMENTS = ("charge", "source_start", "source_end", "step", "time_constant")


def step_error(charges, dtype=np.float64):
    """Return the largest rounding error of the charge after a step [C/m2]; exp and expm1 are called in float64.

    sigma0*exp(-r): one call, and the roundings of r (r*exp(-r) is below 1/2), decay, product and sum: 2 eps. (q1 -
    q0)*mean: one call, and the roundings of q1 - q0, r, quotient, mean, product and sum: 3 eps.
    """
    start, before, after = (np.abs(np.asarray(charge, np.float64)) for charge in charges)
    change = np.abs(np.asarray(charges[2], np.float64) - np.asarray(charges[1], np.float64))
    eps = float(np.finfo(dtype).eps)
    return (call_error() + 2 * eps) * start + (call_error() + 3 * eps) * change + eps * np.maximum(before, after) / 2


def test_source_charge_of_one_newton_and_one_kelvin() -> None:
    values = charge.source_charge([-1e6, 0.0, 5e5], [0.0, 1.0, -2.0], -38e-12, -40e-6)
    np.testing.assert_allclose(values, [3.8e-5, -4e-5, -1.9e-5 + 8e-5], rtol=0, atol=1e-19)


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_source_and_displacement_against_the_40_digit_table(dtype) -> None:
    table = reference("source")
    stress, change, field, piezo, pyro, permittivity = (table[name].astype(dtype) for name in list(table)[:6])
    for computed, column, second in (
        (charge.source_charge(stress, change, piezo, pyro), "charge", pyro * change),
        (
            charge.electric_displacement(stress, field, piezo, permittivity),
            "displacement",
            9e-12 * permittivity * field,
        ),
    ):
        assert computed.dtype == dtype
        scale = np.abs(piezo * stress) + np.abs(second)
        assert (np.abs(computed - table[column]) <= 4 * np.finfo(dtype).eps * scale).all()


@pytest.mark.parametrize(
    ("function", "column"),
    [(charge.propagate_first_order_hold, "first_order_hold"), (charge.propagate_step, "step_hold")],
)
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_a_step_against_the_40_digit_table(function, column, dtype) -> None:
    table = reference("charge_step")
    charges = [table[name].astype(dtype) for name in FIRST_ORDER_HOLD_ARGUMENTS[:3]]
    computed = function(*charges, table["step"], table["time_constant"])
    assert computed.dtype == dtype
    assert (np.abs(computed - table[column]) <= step_error(charges, dtype)).all()


def test_the_inverse_recovers_the_source_over_the_table() -> None:
    table = reference("charge_step")
    change = charge.invert_first_order_hold(
        table["charge"], table["first_order_hold"], table["step"], table["time_constant"]
    )
    ratio = table["step"] / table["time_constant"]
    remaining = np.abs(table["charge"]) * np.exp(-ratio)
    # exp(-x) has the error of one call and x roundings; the inverse amplifies every error of the end by
    # (h/tau)/(1 - exp(-h/tau)).
    end_error = 4 * EPS * np.abs(table["first_order_hold"]) + (call_error() + (2 + ratio) * EPS) * remaining
    atol = end_error * np.maximum(ratio, 1) + 4 * EPS * np.abs(table["source_end"] - table["source_start"])
    assert (np.abs(change - (table["source_end"] - table["source_start"])) <= atol).all()


@given(decades(1e-9, 1e3), decades(1e-9, 1e9), signed_decades(1e-9, 1e2), signed_decades(1e-9, 1e2))
def test_step_and_inverse_are_a_round_trip(step: float, time_constant: float, start: float, change: float) -> None:
    end = charge.propagate_first_order_hold(start, 0.0, change, step, time_constant)
    back = charge.invert_first_order_hold(start, end, step, time_constant)
    rest = abs(start) * math.exp(-min(step / time_constant, 745.0))  # lost in one rounding of `end`
    assert abs(back - change) <= 1e-12 * abs(change) + 4 * EPS * rest * max(1.0, step / time_constant)


@given(decades(1e-9, 1e3), decades(1e-9, 1e9), signed_decades(1e-9, 1e2))
def test_two_half_steps_equal_one_step(step: float, time_constant: float, start: float) -> None:
    whole = charge.propagate_first_order_hold(start, 1.0, 3.0, step, time_constant)
    half = charge.propagate_first_order_hold(start, 1.0, 2.0, step / 2, time_constant)
    twice = charge.propagate_first_order_hold(half, 2.0, 3.0, step / 2, time_constant)
    error = 2 * step_error((start, 1.0, 3.0)) + step_error((half, 2.0, 3.0))
    assert abs(twice - whole) <= error


def test_responses_against_the_40_digit_table() -> None:
    table = reference("charge_leak")
    response = charge.frequency_response(table["variable"], table["time_constant"])
    # No elementary function: products and one complex quotient.
    np.testing.assert_allclose(response.real, table["response_real"], rtol=0, atol=4 * EPS)
    np.testing.assert_allclose(response.imag, table["response_imag"], rtol=0, atol=4 * EPS)
    left = charge.step_response(table["variable"], table["time_constant"])
    # One call, and x*exp(-x) < 1/2 times the rounding of x.
    np.testing.assert_allclose(left, table["step_response"], rtol=0, atol=call_error() + EPS)


def test_step_response_matches_single_steps() -> None:
    sigma = charge.propagate_step(0.0, 0.0, 1.0, 0.01, TAU)
    for _ in range(99):
        sigma = charge.propagate_first_order_hold(sigma, 1.0, 1.0, 0.01, TAU)
    assert sigma == pytest.approx(charge.step_response(1.0, TAU), rel=0, abs=100 * EPS)


def test_frequency_response_matches_single_steps() -> None:
    frequency, per_cycle, cycles = 1.0, 2000, 3  # three cycles are 11 time constants
    time = np.arange(cycles * per_cycle + 1) / (frequency * per_cycle)
    source = np.sin(2 * np.pi * frequency * time)
    sigma = np.zeros_like(source)
    for i in range(1, time.size):
        sigma[i] = charge.propagate_first_order_hold(sigma[i - 1], source[i - 1], source[i], time[1], TAU)
    last = slice(-per_cycle, None)
    seen = 2j * np.mean(sigma[last] * np.exp(-2j * np.pi * frequency * time[last]))
    # The remaining transient after two cycles, and the linear interpolation of the sine (error (w*dt)^2/12).
    assert abs(seen - charge.frequency_response(frequency, TAU)) <= 3 * math.exp(-2 / TAU)


class TestSweep:
    """The whole range of use, corners included."""

    ARGUMENTS = corners(
        charge=[0.0, 1e-5, -0.1],
        source_start=[0.0, -0.4, 0.4],
        source_end=[0.0, 3.8e-2, -0.4],
        step=[10.0**k for k in range(-9, 4)],
        time_constant=[10.0**k for k in range(-9, 10)],
    )

    @pytest.mark.parametrize("dtype", [np.float64, np.float32])
    def test_result_is_finite_and_bounded_by_the_input(self, dtype) -> None:
        charges = [self.ARGUMENTS[name].astype(dtype) for name in FIRST_ORDER_HOLD_ARGUMENTS[:3]]
        bound = (np.abs(charges[0]) + np.abs(charges[2] - charges[1])) * (1 + 4 * np.finfo(dtype).eps)
        for function in (charge.propagate_first_order_hold, charge.propagate_step):
            with np.errstate(over="raise", invalid="raise", divide="raise"):
                end = function(*charges, self.ARGUMENTS["step"], self.ARGUMENTS["time_constant"])
            assert end.dtype == dtype
            assert_finite(end)
            assert (np.abs(end) <= bound).all()

    def test_error_per_region_of_step_over_time_constant(self, record_property) -> None:
        table = reference("charge_step")
        computed = charge.propagate_first_order_hold(*(table[name] for name in FIRST_ORDER_HOLD_ARGUMENTS))
        most = step_error([table[name] for name in FIRST_ORDER_HOLD_ARGUMENTS[:3]])
        error = np.abs(computed - table["first_order_hold"]) / most
        decade = np.round(np.log10(table["step"] / table["time_constant"])).astype(int)
        found = ErrorMap(bound=1.0)
        for low in range(-18, 13, 6):
            found.add(f"step/tau 1e{low}..1e{low + 5}, share of the bound", error[(decade >= low) & (decade < low + 6)])
        found.check(record_property)

    @pytest.mark.parametrize("time_constant", [1e-9, TAU, 1e9])
    def test_charge_falls_with_the_step_and_rises_with_the_source(self, time_constant: float) -> None:
        steps = np.logspace(-9, 3, 1201)
        # Neighbours may be out of order by the errors of both.
        left = charge.propagate_first_order_hold(1.0, 0.0, 0.0, steps, time_constant)
        assert_monotone(left, rising=False, slack=2 * step_error((1.0, 0.0, 0.0)))
        gains = charge.propagate_first_order_hold(0.0, 0.0, 1.0, steps, time_constant)
        assert_monotone(gains, rising=False, slack=2 * step_error((0.0, 0.0, 1.0)))
        changes = np.concatenate([-np.logspace(2, -9, 500), [0.0], np.logspace(-9, 2, 500)])
        assert_monotone(charge.propagate_first_order_hold(0.3, 0.0, changes, 1e-3, time_constant), rising=True)

    @pytest.mark.parametrize("size", [0, 1, 25, 1_000_000])
    @pytest.mark.parametrize("dtype", [np.float64, np.float32])
    def test_any_number_of_taxels(self, size: int, dtype) -> None:
        sources = np.linspace(0, 0.4, size, dtype=dtype)
        end = charge.propagate_first_order_hold(np.zeros(size, dtype), np.zeros(size, dtype), sources, 1e-3, TAU)
        assert end.shape == (size,) and end.dtype == dtype
        assert_monotone(end, rising=True)


class TestManySteps:
    """1e8 steps: the accumulated rounding stays within the stated bound, 1.5 units in the last place per step."""

    @pytest.mark.parametrize("ratio", long_cases([1e-18, 1e-12, 1e-9, 1e-8], [1e-18, 1e-8]))
    def test_decay_over_1e8_steps(self, ratio: float) -> None:
        # Without a source a step is one rounded product, and cumprod computes the same products in sequence.
        decay = float(charge.propagate_first_order_hold(1.0, 0.0, 0.0, ratio, 1.0)) if ratio >= 1e-12 else 1.0
        block = np.empty(100_000)
        left = 1.0
        for _ in range(1000):
            block.fill(decay)
            block[0] *= left
            left = float(np.multiply.accumulate(block)[-1])
        assert abs(left - math.exp(-1e8 * ratio)) <= 1e8 * 1.5 * EPS

    @pytest.mark.parametrize("ratio", long_cases([3e-3, 1e-2, 0.5, 1.0, 1e3, 1e12], [1e-2, 0.5, 1.0, 1e3, 1e12]))
    def test_a_ramp_settles_at_its_steady_state_and_stays(self, ratio: float) -> None:
        # Rounding is monotonic, so each sequence converges monotonically to a fixed point, and 1e8 steps from any start
        # between two sequences end between their fixed points.
        sigma = np.array([-1.0, 0.0, 2.0 / ratio + 2.0])
        for _ in range(int(45 / ratio) + 2):
            sigma = charge.propagate_first_order_hold(sigma, 0.0, 1.0, 1e3, 1e3 / ratio)
        settled = sigma
        for _ in range(3):
            sigma = charge.propagate_first_order_hold(sigma, 0.0, 1.0, 1e3, 1e3 / ratio)
        np.testing.assert_array_equal(sigma, settled)
        atol = 4 * EPS / ratio * max(1.0, 1 / ratio)
        np.testing.assert_allclose(settled, 1 / ratio, rtol=0, atol=atol)


@pytest.mark.parametrize(
    ("function", "cases"),
    [
        refusals(
            charge.source_charge,
            {
                "stress": 0.0,
                "temperature_change": 0.0,
                "piezoelectric_coefficient": -38e-12,
                "pyroelectric_coefficient": -4e-5,
            },
            stress=[1.1e16, -1.1e16],
            temperature_change=[501, -501],
            piezoelectric_coefficient=[-38],
            pyroelectric_coefficient=[-40],
        ),
        *(
            refusals(
                function,
                STEP_GOOD,
                charge=[2e12],
                source_start=[-2e12],
                source_end=[[0.0, 2e12]],
                step=[0, -1e-3, 1e10],
                time_constant=[0, -1, 1e16],
            )
            for function in (charge.propagate_first_order_hold, charge.propagate_step)
        ),
        refusals(
            charge.electric_displacement,
            {"stress": 0.0, "field": 0.0, "piezoelectric_coefficient": -38e-12, "relative_permittivity": 12.0},
            stress=[1.1e16],
            field=[1.1e12],
            piezoelectric_coefficient=[-38],
            relative_permittivity=[0.5, -12],
        ),
        refusals(
            charge.invert_first_order_hold,
            {"charge_start": 0.0, "charge_end": 0.0, "step": 1e-3, "time_constant": TAU},
            charge_start=[2e12],
            charge_end=[2e12],
            step=[0, -1],
            time_constant=[0, -1],
        ),
        refusals(
            charge.frequency_response, {"frequency": 1.0, "time_constant": TAU}, frequency=[-1], time_constant=[0]
        ),
        refusals(charge.step_response, {"time": 1.0, "time_constant": TAU}, time=[-1e-9], time_constant=[0]),
    ],
)
def test_invalid_arguments_are_rejected_by_name(function, cases) -> None:
    assert_all_refused(function, cases)


def test_incompatible_shapes_are_rejected_by_name() -> None:
    with pytest.raises(ValueError, match=r"shapes must broadcast.*charge \(3,\).*source_end \(4,\)"):
        charge.propagate_first_order_hold(np.zeros(3), 0.0, np.zeros(4), 1e-3, TAU)
    with pytest.raises(ValueError, match=r"step \(2,\)"):
        charge.propagate_step(np.zeros(3), 0.0, 0.0, [1e-3, 2e-3], TAU)
