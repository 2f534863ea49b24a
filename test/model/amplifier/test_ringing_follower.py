# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The exact follower of two poles and a zero: 40-digit matrix exponential, step splitting, limits, arrays."""

import math

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posfet_model.amplifier.closed_loop import FollowerLimits
from posfet_model.amplifier.follower import OnePoleFollower
from posfet_model.amplifier.input_findings import SLEW_RATE_NOT_GIVEN
from posfet_model.amplifier.open_loop import LOW_MARGIN, RINGS, UNSTABLE, OpenLoop
from posfet_model.amplifier.ringing_follower import SLEWS, RingingFollower
from posfet_model.amplifier.two_pole_chain import TwoPoleChain
from support.sweep import assert_refused

DIGITS = 40
CORNERS = {
    "real": OpenLoop(100.0, (1e3, 1e7)),
    "stiff": OpenLoop(1e4, (10.0, 1e14)),
    "complex": OpenLoop(100.0, (1e3, 5e4)),
    "hardly damped": OpenLoop(1e6, (1.0, 10.0)),
    "zero on the left": OpenLoop(100.0, (1e3, 5e4), 6e4),
    "zero on the right": OpenLoop(100.0, (1e3, 5e5), -8e5),
    "overshoot by a slow zero": OpenLoop(100.0, (1e3, 4e3), 2e3),
    "unstable": OpenLoop(1000.0, (1e3, 5e4), -4e5),
    "unstable, real": OpenLoop(1000.0, (1e3, 5e4), -1e3),
}


def time_scale(loop: OpenLoop) -> float:
    """Return a time [s] in which the follower moves: its lag, or if it is unstable that of its growth."""
    step = loop.step_response
    return float(step.a1 if loop.stable else min(abs(step.a2 / step.a1), math.sqrt(step.a2)))


def near_equal(relative: float) -> OpenLoop:
    """Return an op-amp whose follower has nearly equal poles."""
    # (t1 + t2)^2 = 4*(1 + A0)*t1*t2
    ratio = 2 * 101 - 1 - 2 * math.sqrt(101 * 100)
    return OpenLoop(100.0, (1e3, 1e3 / ratio * (1 + relative)))


CORNERS |= {f"poles {x:g} apart": near_equal(x) for x in (0.0, 1e-14, -1e-9, 1e-5)}


def exact_output(loop: OpenLoop, before: tuple[float, float], change: float, step: float) -> mpmath.mpf:
    """Return the lag of the output after a step, in units of volts, by a matrix exponential in 40 digits.

    The state is (y, y') of ``a2*y'' + a1*y' + y = u`` as distances from the input.
    """
    with mpmath.workdps(DIGITS + 20):
        gain = mpmath.mpf(float(loop.gain))
        times = [1 / (2 * mpmath.pi * mpmath.mpf(float(pole))) for pole in loop.poles]
        zero = 0 if math.isinf(loop.zero) else 1 / (2 * mpmath.pi * mpmath.mpf(float(loop.zero)))
        a1 = (sum(times) + gain * zero) / (1 + gain)
        a2 = times[0] * times[1] / (1 + gain)
        h, rate = mpmath.mpf(step), mpmath.mpf(change) / mpmath.mpf(step)
        # e = u - y, e' = rate - y': a2*y'' = e - a1*y'
        system = mpmath.matrix([[0, -1, rate], [1 / a2, -a1 / a2, 0], [0, 0, 0]]) * h
        e, speed, _ = mpmath.expm(system, method="pade") * mpmath.matrix([before[0], before[1], 1])
        return e - zero * speed


@pytest.mark.parametrize("name", CORNERS)
@pytest.mark.parametrize("steps", [0.01, 0.7, 6.0])
def test_a_step_from_rest_against_40_digits(name: str, steps: float) -> None:
    loop = CORNERS[name]
    step = steps * time_scale(loop)
    follower = RingingFollower(open_loop=loop)
    state = follower.advance(follower.start(0.0), 0.3, step)
    exact = exact_output(loop, (0.0, 0.0), 0.3, step)
    found = 0.3 - float(follower.output(state).v_out) / float(loop.closed_loop_gain)
    assert found == pytest.approx(float(exact), abs=1e-13 + 1e-11 * abs(float(exact)) * (not loop.stable))


@given(
    st.floats(0.5, 5),
    st.floats(0, 8),
    st.floats(-2, 6),
    st.sampled_from([-1.0, 0.0, 1.0]),
    st.floats(-3, 2),
    st.floats(0.05, 0.95),
)
def test_a_step_in_two_is_the_step(
    gain: float, second: float, zero: float, sign: float, length: float, share: float
) -> None:
    loop = OpenLoop(10**gain, (1e3, 1e3 * 10**second), sign * 1e5 * 10**zero if sign else math.inf)
    if not loop.stable:
        return
    follower = RingingFollower(open_loop=loop)
    step = 10**length * float(loop.step_response.a1)
    start = follower.advance(follower.start(0.0), 1.0, 0.3 * step)
    whole = follower.advance(start, 2.0, step)
    half = follower.advance(follower.advance(start, 1.0 + share, share * step), 2.0, step - share * step)
    scale = 1 + float(abs(loop.step_response.zero_time / loop.step_response.a1))
    assert float(follower.output(half).v_out) == pytest.approx(float(follower.output(whole).v_out), abs=1e-12 * scale)


@pytest.mark.parametrize("name", CORNERS)
def test_a_series_is_its_steps(name: str) -> None:
    loop = CORNERS[name]
    follower = RingingFollower(open_loop=loop)
    time = np.cumsum(np.r_[0.0, np.geomspace(0.01, 3, 40)]) * time_scale(loop)
    v_in = np.sin(np.arange(41.0))
    whole = follower.run(time, v_in)
    state = follower.start(v_in[0])
    for k in range(1, 41):
        state = follower.advance(state, v_in[k], float(time[k] - time[k - 1]))
        assert whole.v_out[k] == pytest.approx(float(follower.output(state).v_out), rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("name", CORNERS)
def test_a_jump_is_the_step_response(name: str) -> None:
    loop = CORNERS[name]
    step = loop.step_response
    time = np.r_[0.0, np.linspace(0, 5, 30) * time_scale(loop)]
    found = RingingFollower(open_loop=loop).run(time, np.where(np.arange(31) > 0, 1.0, 0.0)).v_out[1:]
    wanted = float(loop.closed_loop_gain) * step.at(time[1:])
    assert found == pytest.approx(wanted, abs=3e-7, rel=1e-6)  # that of `at` near equal poles


def test_without_a_second_pole_it_is_the_one_pole_follower() -> None:
    loop = OpenLoop(130.0, (11.5e3, math.inf))
    one = OnePoleFollower(gain=float(loop.closed_loop_gain), bandwidth=131 * 11.5e3)
    time = np.cumsum(np.r_[0.0, np.geomspace(1e-9, 1e-6, 50)])
    v_in = np.cos(np.arange(51.0))
    assert RingingFollower(open_loop=loop).run(time, v_in).v_out == pytest.approx(one.run(time, v_in).v_out, abs=1e-14)
    missing = [
        np.abs(
            RingingFollower(open_loop=OpenLoop(130.0, (11.5e3, pole))).run(time, v_in).v_out - one.run(time, v_in).v_out
        )
        for pole in (1e8, 1e10, 1e12)
    ]
    assert missing[0].max() > 10 * missing[1].max() > 100 * missing[2].max()


@pytest.mark.parametrize("name", ["unstable", "unstable, real"])
def test_an_unstable_follower_grows_to_the_limit_and_is_never_valid(name: str) -> None:
    follower = RingingFollower(open_loop=CORNERS[name])
    with np.errstate(all="raise", under="ignore"):
        found = follower.run(np.r_[0.0, 1e-9, np.geomspace(1e-6, 1e9, 60)], np.r_[0.0, np.full(61, 0.1)])
    assert np.isfinite(found.v_out).all() and np.abs(found.v_out).max() < 1e8
    assert not found.valid.any() and found.reasons[0] == UNSTABLE
    assert not follower.start(0.0).valid


def test_arrays_of_designs_run_together() -> None:
    seconds = np.array([1e7, 1e5, 5e4])
    many = RingingFollower(open_loop=OpenLoop(100.0, (1e3, seconds)))
    time = np.linspace(0, 1e-4, 30)
    v_in = 0.05 * np.tile(np.sin(time * 1e5)[:, None], 3)
    found = many.run(time, v_in)
    for k, second in enumerate(seconds):
        alone = RingingFollower(open_loop=OpenLoop(100.0, (1e3, float(second)))).run(time, v_in[:, k])
        assert found.v_out[:, k] == pytest.approx(alone.v_out, abs=1e-14)
        assert found.valid[:, k].tolist() == alone.valid.tolist()
    assert found.valid[0].tolist() == [True, False, False]
    assert found.reasons == [LOW_MARGIN, RINGS]
    assert many.advance(many.start(np.zeros(3)), np.ones(3), np.full(3, 1e-6)).v_in.shape == (3,)


def test_the_slew_rate_is_a_reason() -> None:
    follower = RingingFollower(open_loop=CORNERS["real"], limits=FollowerLimits(slew_rate=1e4))
    found = follower.run([0.0, 1e-3, 1.001e-3], [0.0, 1.0, 3.0])
    assert found.valid.tolist() == [True, True, False] and found.reasons == [SLEWS]


def test_the_response_is_that_of_the_step() -> None:
    loop = CORNERS["zero on the left"]
    follower = RingingFollower(open_loop=loop)
    found = follower.response([0.0, 1e4, 1e6])
    assert found.gain == pytest.approx(np.abs(loop.closed_loop_response([0.0, 1e4, 1e6])))
    assert found.gain[0] == pytest.approx(follower.static_gain)
    time = np.linspace(0, 2e-3, 40_001)
    wave = follower.run(time, np.sin(2 * math.pi * 1e4 * time)).v_out[-4000:]
    assert wave.max() == pytest.approx(found.gain[1], rel=1e-5)


def test_float32_input_is_taken() -> None:
    follower = RingingFollower(open_loop=CORNERS["complex"])
    v_in = np.array([0.0, 0.5, 0.25], np.float32)
    found = follower.run(np.array([0.0, 1e-6, 2e-6]), v_in)
    assert found.v_out.dtype == np.float64
    assert found.v_out.tolist() == follower.run([0.0, 1e-6, 2e-6], v_in.astype(float)).v_out.tolist()


def test_what_is_refused() -> None:
    assert_refused(RingingFollower, {"open_loop": 100.0}, "open_loop")
    many = RingingFollower(open_loop=OpenLoop(np.array([100.0, 200.0]), (1e3, 1e7)))
    assert_refused(many.start, {"v_in": np.zeros(3)}, "v_in")
    assert_refused(many.run, {"time": [0.0, 1.0], "v_in": [0.0, 1.0]}, "v_in")


def test_the_chain_of_equal_poles_has_the_closed_form() -> None:
    chain = TwoPoleChain(np.array(2.0), np.array(2.0), np.array(0.0))
    decay, weight, same, coupling, both = chain.coefficients(np.array(1.0))
    assert decay == same == pytest.approx(math.exp(-0.5))
    assert coupling == pytest.approx(0.5 * math.exp(-0.5))
    assert weight == pytest.approx(2 * (1 - math.exp(-0.5)))
    assert both == pytest.approx(4 * (1 - math.exp(-0.5)) - math.exp(-0.5))


def test_without_a_slew_rate_what_may_slew_is_not_valid() -> None:
    """A step of 50 mV is linear, one of 1 V is not; a slow ramp of 1 V is. A slew rate that is given decides itself."""
    loop = OpenLoop.from_phase_margin(130.0, 1.5e6, 65.0)
    numbers = RingingFollower(open_loop=loop)
    time = np.linspace(0, 2e-6, 201)
    small, large = (numbers.run(time, np.where(time > 1e-7, volts, 0.0)) for volts in (0.05, 1.0))
    assert small.valid.all() and small.reasons == []
    assert not large.valid.all() and large.valid[[0, -1]].all() and large.reasons == [SLEW_RATE_NOT_GIVEN]
    assert numbers.run(1e3 * time, time / time[-1]).valid.all()
    series = numbers.advance_series(numbers.start(0.0), np.full(3, 1.0), np.full(3, 1e-8))
    assert not series.output.valid.any() and series.output.reasons == [SLEW_RATE_NOT_GIVEN]
    assert not numbers.advance(numbers.start(0.0), 1.0, 1e-8).valid
    fast = RingingFollower(open_loop=loop, limits=FollowerLimits(slew_rate=1e9))
    assert fast.run(time, np.where(time > 1e-7, 1.0, 0.0)).valid.all()
