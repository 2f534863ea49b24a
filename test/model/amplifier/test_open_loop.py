# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Two poles and a zero: unity crossing, margin, stability, overshoot and settling against the definitions."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posfet_model.amplifier.open_loop import LOW_MARGIN, RINGS, UNSTABLE, OpenLoop
from support.sweep import assert_refused

DECADES = st.floats(-1.0, 6.0)
SIGNS = st.sampled_from([-1.0, 1.0])


def drawn(gain: float, second: float, zero: float, sign: float) -> OpenLoop:
    return OpenLoop(10 ** (0.5 + gain / 2), (1e3, 1e3 * 10**second), sign * 1e3 * 10**zero)


@given(DECADES, DECADES, DECADES, SIGNS)
def test_the_gain_is_1_at_the_unity_crossing_and_the_margin_is_its_phase(
    gain: float, second: float, zero: float, sign: float
) -> None:
    loop = drawn(gain, second, zero, sign)
    at_crossing = complex(loop.response(loop.gain_bandwidth))
    assert abs(at_crossing) == pytest.approx(1, rel=1e-9)
    turn = math.degrees(math.atan2(at_crossing.imag, at_crossing.real))
    assert math.remainder(float(loop.phase_margin) - 180 - turn, 360) == pytest.approx(0, abs=1e-6)


@given(DECADES, DECADES, DECADES, SIGNS)
def test_the_poles_of_the_follower_are_where_the_loop_gain_is_minus_1(
    gain: float, second: float, zero: float, sign: float
) -> None:
    loop = drawn(gain, second, zero, sign)
    (t1, t2), tz = loop.pole_times, loop.zero_time
    for pole in loop.closed_loop_poles:
        terms = np.array([(1 + pole * t1) * (1 + pole * t2), loop.gain * (1 + pole * tz)])
        scale = (1 + abs(pole * t1)) * (1 + abs(pole * t2)) + loop.gain * (1 + abs(pole * tz))
        assert abs(terms.sum()) <= 1e-12 * scale
    assert bool(loop.stable) == all(pole.real < 0 for pole in loop.closed_loop_poles)


@pytest.mark.parametrize("second", [3e3, 1e5, 1e6, 1.3e6, 1e8])
@pytest.mark.parametrize("zero", [math.inf, 5e4, 2e5, 3e6, -4e6, -1e5])
def test_overshoot_and_settling_time_are_those_of_the_step(second: float, zero: float) -> None:
    loop = OpenLoop(120.0, (5e3, second), zero)
    if not loop.stable:
        assert math.isnan(loop.overshoot) and loop.settling_time() == math.inf
        return
    step = loop.step_response
    end = 20 * max(float(step.a1), float(step.a2 / step.a1))
    time = np.r_[0.0, np.geomspace(1e-6 * end, end, 200_000)]
    found = step.at(time)
    assert loop.overshoot == pytest.approx(max(found.max() - 1, 0), abs=1e-7)
    settled = time[np.flatnonzero(np.abs(found - 1) > 0.01)[-1]]
    assert loop.settling_time(0.01) == pytest.approx(settled, rel=1e-3)


def test_the_overshoot_without_a_zero_is_the_textbooks() -> None:
    loop = OpenLoop(1000.0, (1e3, np.array([2e6, 1e6, 3e5])))
    damping = loop.damping
    assert loop.overshoot == pytest.approx(np.exp(-math.pi * damping / np.sqrt(1 - damping**2)), rel=1e-12)


@given(st.floats(2.0, 1e6), st.floats(1.0, 9.0), st.floats(15.0, 120.0))
def test_a_given_margin_is_the_margin_of_the_op_amp(gain: float, decade: float, margin: float) -> None:
    try:
        loop = OpenLoop.from_phase_margin(gain, 10**decade, margin)
    except ValueError as error:
        assert "real poles" in str(error)
        assert gain < 1.001 / math.sin(math.radians(margin) / 2) ** 2  # two equal poles have this gain
        return
    assert loop.gain_bandwidth == pytest.approx(10**decade, rel=1e-6)
    assert loop.phase_margin == pytest.approx(margin, abs=1e-5)


def test_one_pole_has_its_closed_forms() -> None:
    loop = OpenLoop(130.0, (11.5e3, math.inf))
    assert loop.gain_pole_product == 130 * 11.5e3
    assert loop.gain_bandwidth == pytest.approx(11.5e3 * math.sqrt(130**2 - 1), rel=1e-14)
    assert loop.closed_loop_poles[0] == pytest.approx(-2 * math.pi * 11.5e3 * 131)
    assert loop.closed_loop_poles[1].real == -math.inf
    assert loop.overshoot == 0 and loop.stable and loop.damping == math.inf
    assert loop.closed_loop_gain == pytest.approx(130 / 131)
    assert loop.settling_time(0.01) == pytest.approx(math.log(100) / (2 * math.pi * 11.5e3 * 131), rel=1e-9)


def test_a_second_pole_towards_infinity_approaches_one_pole() -> None:
    one = OpenLoop(130.0, (11.5e3, math.inf))
    two = OpenLoop(130.0, (11.5e3, 10.0 ** np.arange(7, 15)))
    for name in ("gain_bandwidth", "phase_margin"):
        missing = np.abs(getattr(two, name) - getattr(one, name))
        assert (np.diff(missing) <= 0).all() and missing[-1] < 1e-6 * getattr(one, name)


def test_reasons_are_named_for_each_design() -> None:
    loops = OpenLoop(
        np.array([130.0, 130.0, 130.0, 1e4]),
        (1e4, np.array([math.inf, 1.2e6, 3e5, 1e5])),
        np.array([math.inf, math.inf, math.inf, -1e6]),
    )
    assert loops.validity.valid.tolist() == [True, False, False, False]
    assert [loops.validity.reasons_at(k) for k in range(4)] == [
        [],
        [RINGS],
        [LOW_MARGIN, RINGS],
        [UNSTABLE, LOW_MARGIN],
    ]
    assert loops.validity.reasons == [UNSTABLE, LOW_MARGIN, RINGS]
    joined = loops.validity.also({RINGS: np.array([True, False, False, False])})
    assert joined.reasons_at(0) == [RINGS] and not joined.valid.any()


def test_designs_broadcast() -> None:
    loops = OpenLoop(np.geomspace(10, 1e4, 5)[:, None], (1e3, np.geomspace(1e4, 1e8, 7)), -1e9)
    for name in ("gain_bandwidth", "phase_margin", "stable", "overshoot", "damping"):
        assert getattr(loops, name).shape == (5, 7)
    one = OpenLoop(loops.gain[2, 0], (1e3, loops.poles[1][3]), -1e9)
    assert loops.settling_time()[2, 3] == one.settling_time()
    assert loops.phase_margin[2, 3] == one.phase_margin


def test_bad_fields_are_refused() -> None:
    good = {"gain": 100.0, "poles": (1e3, 1e6), "zero": 1e7}
    for bad in (0.0, math.nan, -1.0, math.inf, "1"):
        assert_refused(OpenLoop, {**good, "gain": bad}, "gain")
    for bad in (1e3, (1e3,), (1e3, 0.0), (math.nan, 1e3), (-1e3, 1e6), (1e3, -1e6)):
        assert_refused(OpenLoop, {**good, "poles": bad}, "poles")
    masked = np.ma.masked_array([1e6, 2e6], mask=[False, True])
    assert_refused(OpenLoop, {**good, "poles": (1e3, masked)}, "poles")
    for bad in (0.0, math.nan, "left", masked):
        assert_refused(OpenLoop, {**good, "zero": bad}, "zero")
    assert_refused(OpenLoop, {**good, "gain": np.ones(3), "zero": np.ones(2)}, "broadcast")
