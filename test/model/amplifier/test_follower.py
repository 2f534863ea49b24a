# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The follower models: against 40-digit references, for independence of the step size, and over the whole range."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posfet_model._lib.first_order import linear_recurrence, mean_decay
from posfet_model.amplifier.closed_loop import FollowerLimits, close_loop
from posfet_model.amplifier.differential_pair import Lead
from posfet_model.amplifier.follower import (
    IdealFollower,
    OnePoleFollower,
    SquareLawFollower,
    StaticFollower,
    TwoPoleFollower,
)
from posfet_model.amplifier.follower_base import Follower
from support.drift import Case, cases
from support.sweep import (
    EPS,
    ErrorMap,
    assert_all_refused,
    assert_finite,
    assert_monotone,
    assert_refused,
    call_error,
    decades,
    reference,
    refusals,
    signed_decades,
)

LOOP = close_loop(10 ** (42.3 / 20), 1.5e6)


def followers(time_constant: float = 1 / (2 * math.pi * LOOP.bandwidth), gain: float = LOOP.gain) -> list[Follower]:
    bandwidth = 1 / (2 * math.pi * time_constant)
    two_poles = [TwoPoleFollower(gain=gain, natural_frequency=bandwidth, quality=q) for q in (0.05, 0.5, 0.7, 50.0)]
    return [
        IdealFollower(),
        StaticFollower(gain=gain),
        OnePoleFollower(gain=gain, bandwidth=bandwidth),
        *two_poles,
        SquareLawFollower(gain=gain, bandwidth=bandwidth, overdrive=0.4),
        SquareLawFollower(gain=gain, bandwidth=bandwidth, overdrive=0.4, lead=Lead(linear=0.07, square=0.18)),
    ]


def name(follower: Follower) -> str:
    return f"{type(follower).__name__}{getattr(follower, 'quality', '')}{getattr(follower, 'lead', '')}"


MEAN_DECAY_ERROR = call_error() + EPS
"""Largest relative error of expm1(-x)/x: one function call and one quotient."""
ONE_POLE_ERROR = MEAN_DECAY_ERROR + 2.5 * EPS
"""The same with 4 roundings of x = step*2*pi*bandwidth, with a condition below 1, and those of product and sum."""
TWO_POLES_ERROR = 3 * (2 * call_error() + 2 * EPS)
"""The second weight is a mean of exp and a fraction of the difference of two: two calls each where they are complex."""
DRIFTS = cases()
FOLLOWERS = [pytest.param(follower, id=name(follower)) for follower in followers()]


def test_mean_decay_against_the_40_digit_table() -> None:
    table = reference("mean_decay")
    np.testing.assert_allclose(mean_decay(table["x"]) / table["mean_decay"], 1, rtol=0, atol=MEAN_DECAY_ERROR)
    assert mean_decay(np.array(0.0)) == 1
    assert abs(mean_decay(np.array([1e-300j]))[0] - 1) <= EPS


def test_the_published_amplifier_as_a_follower() -> None:
    assert pytest.approx(130.32 / 131.32, abs=1e-6) == LOOP.gain
    follower = OnePoleFollower(gain=LOOP.gain, bandwidth=LOOP.bandwidth)
    assert follower.time_constant == pytest.approx(105.3e-9, abs=5e-11)
    assert SquareLawFollower(gain=1.0, bandwidth=1.0, overdrive=2.0).slew_rate == pytest.approx(4 * math.pi, abs=1e-14)


@pytest.mark.parametrize("quality", [0.05, 0.4, 0.5, 0.7, 5.0, 50.0])
def test_two_poles_against_the_40_digit_table(quality: float) -> None:
    table = reference("two_pole_step")
    rows = np.isclose(table["quality"], quality, rtol=0, atol=0)
    follower = TwoPoleFollower(gain=1.0, natural_frequency=1 / (2 * math.pi), quality=quality)
    state = follower.advance(follower.start(np.zeros(rows.sum())), np.ones(rows.sum()), table["phase"][rows])
    np.testing.assert_allclose(1 - follower.output(state).v_out, table["lag"][rows], rtol=0, atol=TWO_POLES_ERROR)


def test_one_pole_against_the_40_digit_table() -> None:
    table = reference("mean_decay")
    follower = OnePoleFollower(gain=1.0, bandwidth=1 / (2 * math.pi))
    kept = table["x"] <= 1e9
    ratio = table["x"][kept]
    state = follower.advance(follower.start(np.zeros(ratio.size)), np.ones(ratio.size), ratio)
    np.testing.assert_allclose(state.lags[0], table["mean_decay"][kept], rtol=0, atol=ONE_POLE_ERROR)


def test_gain_and_phase_against_the_40_digit_table() -> None:
    table = reference("follower_response")
    for quality in np.unique(table["quality"]):
        rows = table["quality"] == quality
        one = OnePoleFollower(gain=1.0, bandwidth=1.5e6).response(table["frequency"][rows])
        two = TwoPoleFollower(gain=1.0, natural_frequency=1.5e6, quality=quality).response(table["frequency"][rows])
        for computed, column in (
            (one.gain, "one_gain"),
            (one.phase, "one_phase"),
            (two.gain / max(1, quality), "two_gain"),
            (two.phase, "two_phase"),
        ):
            expected = table[column][rows] / (max(1, quality) if column == "two_gain" else 1)
            # One call for modulus or angle (angle up to pi, 4 EPS); 3 roundings in f/f0 and in each of two squares or
            # quotients. At resonance 1 - (f/f0)^2 is a small difference, multiplied by the quality factor.
            np.testing.assert_allclose(computed, expected, rtol=0, atol=8 * EPS * max(1, quality))


@pytest.mark.parametrize("quality", [0.05, 0.4, 1 / math.sqrt(2), 3.0, 50.0])
def test_bandwidth_is_where_the_gain_has_fallen_by_3_db(quality: float) -> None:
    follower = TwoPoleFollower.from_bandwidth(0.99, 2e6, quality)
    assert follower.response(2e6).gain / 0.99 == pytest.approx(math.sqrt(0.5), abs=1e-13)
    assert OnePoleFollower(gain=0.99, bandwidth=2e6).response(2e6).gain == pytest.approx(0.99 / math.sqrt(2), abs=1e-14)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1.1e6, -1.1e6])
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_one_invalid_taxel_is_rejected_for_any_dtype(bad: float, dtype) -> None:
    frame = np.zeros(25, dtype)
    state = ONE_POLE.start(frame)
    frame[7] = bad
    for arguments in ({"v_in": frame}, {"v_in": frame[:, None]}):
        assert_refused(ONE_POLE.start, arguments, "v_in")
    assert_refused(ONE_POLE.advance, {"state": state, "v_in": frame, "step": 1e-6}, "v_in")


def test_a_frame_can_be_reused() -> None:
    for follower in followers():
        frame = np.ones(25)
        state = follower.advance(follower.start(frame), frame, 1e-6)
        output = follower.output(state)
        frame[:] = 7
        output.v_out[:] = 9
        np.testing.assert_array_equal(state.v_in, 1.0)


@pytest.mark.parametrize("follower", FOLLOWERS)
def test_a_split_step_equals_one_step(follower: Follower) -> None:
    generator = np.random.default_rng(3)
    size = 2000
    start, change = generator.normal(size=size), generator.normal(size=size)
    step = 105e-9 * 10 ** generator.uniform(-6, 4, size)
    part = generator.uniform(0, 1, size)
    state = follower.advance(follower.start(np.zeros(size)), start, 1e-8)
    whole = follower.advance(state, start + change, step)
    half = follower.advance(state, start + part * change, part * step)
    end = follower.advance(half, start + change, step - part * step)
    # The rounding of the time of a long slewing part adds to the error.
    atol = 1e-14
    np.testing.assert_allclose(follower.output(end).v_out, follower.output(whole).v_out, rtol=0, atol=atol)


@pytest.mark.parametrize("follower", FOLLOWERS)
def test_a_series_continues_where_it_ended(follower: Follower) -> None:
    generator = np.random.default_rng(15)
    step = 105e-9 * 10 ** generator.uniform(-4, 2, 300)
    v_in = generator.normal(size=(300, 2))
    state = follower.start([0.3, -0.3])
    whole = follower.advance_series(state, v_in, step)
    first = follower.advance_series(state, v_in[:120], step[:120])
    second = follower.advance_series(first.end, v_in[120:], step[120:])
    both = np.concatenate([first.output.v_out, second.output.v_out])
    np.testing.assert_allclose(both, whole.output.v_out, rtol=0, atol=1e-13)
    np.testing.assert_array_equal(follower.output(whole.end).v_out, whole.output.v_out[-1])
    even = follower.advance_series(state, v_in, 1e-7).output.v_out
    np.testing.assert_array_equal(even, follower.advance_series(state, v_in, np.full(300, 1e-7)).output.v_out)


@pytest.mark.parametrize("follower", FOLLOWERS)
def test_a_series_equals_its_single_steps(follower: Follower) -> None:
    generator = np.random.default_rng(4)
    step = 105e-9 * 10 ** generator.uniform(-4, 2, 399)
    step[::20] = 0
    time = np.append(0, np.cumsum(step))
    v_in = generator.normal(size=(time.size, 3))
    state = follower.start(v_in[0])
    rows = [follower.output(state).v_out]
    for k in range(1, time.size):
        state = follower.advance(state, v_in[k], time[k] - time[k - 1])
        rows.append(follower.output(state).v_out)
    np.testing.assert_allclose(follower.run(time, v_in).v_out, rows, rtol=0, atol=1e-13)
    np.testing.assert_allclose(follower.run(time, v_in[:, 1]).v_out, np.array(rows)[:, 1], rtol=0, atol=1e-13)


# With a quality factor of 50 the ringing is longer than the run.
@pytest.mark.parametrize("follower", [follower for follower in FOLLOWERS if "50.0" not in str(follower.id)])
def test_a_sine_gets_the_gain_and_phase_of_the_frequency_response(follower: Follower) -> None:
    frequency, per_cycle = 1e6, 4000
    time = np.arange(20 * per_cycle + 1) / (frequency * per_cycle)
    small = 1e-5
    v_out = follower.run(time, small * np.sin(2 * np.pi * frequency * time)).v_out
    last = slice(-per_cycle, None)
    seen = 2j * np.mean(v_out[last] * np.exp(-2j * np.pi * frequency * time[last])) / small
    response = follower.response(frequency)
    # Linear interpolation reduces the sine by (w*dt)^2/12 = 2e-7; two slow poles leave 1e-4 of their transient.
    assert abs(seen - response.gain * np.exp(1j * response.phase)) <= (
        1e-3 if getattr(follower, "quality", 1) < 0.1 else 1e-6
    )


def test_square_law_has_one_pole_for_small_signals_and_slews_for_large_ones() -> None:
    one = OnePoleFollower(gain=LOOP.gain, bandwidth=LOOP.bandwidth)
    slewing = SquareLawFollower(gain=LOOP.gain, bandwidth=LOOP.bandwidth, overdrive=0.4)
    time = np.linspace(0, 3e-6, 3001)
    small = 1e-3 * np.sin(2 * np.pi * 1e6 * time)
    np.testing.assert_allclose(slewing.run(time, small).v_out, one.run(time, small).v_out, rtol=0, atol=1e-9)
    large = np.where(time > 0, 5.0, 0.0)
    slope = np.diff(slewing.run(time, large).v_out)[10:1000] / np.diff(time)[10:1000]
    np.testing.assert_allclose(slope / slewing.slew_rate, 1, rtol=0, atol=1e-6)
    assert slewing.run([0, 1.0], [0.0, 5.0]).v_out[1] == pytest.approx(5 * LOOP.gain, abs=1e-5)


@pytest.mark.parametrize("linear", [0.0, 0.07, 0.5, 1.0])
def test_a_lead_is_a_zero_for_small_signals(linear: float) -> None:
    follower = SquareLawFollower(gain=0.99, bandwidth=1.5e6, overdrive=0.4, lead=Lead(linear=linear))
    corner = follower.bandwidth / math.sqrt(1 + 2 * linear - linear**2)
    assert follower.response(corner).gain == pytest.approx(0.99 / math.sqrt(2), abs=1e-14)
    assert follower.response(1e-3).phase / (2 * math.pi * 1e-3) == pytest.approx(-follower.time_constant, abs=1e-15)
    jumped = follower.run([0.0, 0.0], [0.0, 1e-6])
    assert jumped.v_out[1] == pytest.approx(0.99e-6 * linear / (1 + linear), abs=1e-16)


def test_each_taxels_offset_is_added_at_the_input() -> None:
    offset = np.array([1e-3, -2e-3])
    follower = OnePoleFollower(gain=0.9, bandwidth=1e6, offset=offset)
    np.testing.assert_allclose(follower.run([0.0, 1.0], np.zeros((2, 2))).v_out, [0.9 * offset] * 2, rtol=0, atol=1e-18)
    assert_refused(follower.start, {"v_in": np.zeros(3)}, "offset")


@pytest.mark.parametrize("follower", followers(), ids=name)
def test_time_may_be_unix_time(follower: Follower) -> None:
    time = np.cumsum([0, 1, 1, 3, 0, 8]) * 2.0**-22  # what float64 resolves at 1.7e9 s
    v_in = [0.0, 1.0, 1.0, -0.5, 0.5, 0.5]
    shifted = follower.run(1763836800.0 + time, v_in)
    np.testing.assert_array_equal(shifted.v_out, follower.run(time, v_in).v_out)
    with pytest.raises(ValueError, match=r"steps of time must be in \[0, 1e\+09\] s, got 1.7e\+09"):
        follower.run([0.0, 1.7e9], [0.0, 1.0])


class TestLimits:
    def test_input_beyond_the_rails_is_clipped_and_flagged(self) -> None:
        follower = StaticFollower(gain=0.5, limits=FollowerLimits(v_low=-1, v_high=2))
        output = follower.run([0, 1, 2, 3], [0.0, 3.0, 2.0, -1.1])
        np.testing.assert_array_equal(output.valid, [True, False, True, False])
        np.testing.assert_allclose(output.v_out, [0, 1, 1, -0.5], rtol=0, atol=0)

    @pytest.mark.parametrize("follower", FOLLOWERS)
    def test_faster_than_the_slew_rate_is_flagged(self, follower: Follower) -> None:
        arguments = {k: getattr(follower, k) for k in follower.__dataclass_fields__ if k != "limits"}
        limited = type(follower)(**arguments, limits=FollowerLimits(slew_rate=1e6))
        time = np.linspace(0, 1e-5, 101)
        assert limited.run(time, 0.4e6 * time).valid.all()
        assert not limited.run(time, 4e6 * time).valid[-1]
        state = limited.advance(limited.start(0.0), 40.0, 1e-5)
        assert not limited.output(state).valid

    def test_response_is_flagged_beyond_its_frequency(self) -> None:
        follower = OnePoleFollower(gain=1.0, bandwidth=1e6, limits=FollowerLimits(frequency=5e6))
        np.testing.assert_array_equal(follower.response([1e3, 5e6, 6e6]).valid, [True, True, False])

    def test_invalid_limits_are_rejected(self) -> None:
        bad = [
            ({"v_low": 1.0, "v_high": 1.0}, "v_high"),
            ({"slew_rate": 0.0}, "slew_rate"),
            ({"frequency": -1.0}, "frequency"),
        ]
        bad += [
            ({name: value}, name)
            for name in ("v_low", "v_high", "slew_rate", "frequency")
            for value in (math.nan, 1 + 1j, "one", None, True)
        ]
        assert_all_refused(FollowerLimits, [(argument, arguments) for arguments, argument in bad])


class TestSweep:
    """Steps from 1e-9 to 1e3 s, time constants from 1e-9 to 1e9 s, voltages to 1e6 V."""

    STEP, TAU = (axis.ravel() for axis in np.meshgrid(10.0 ** np.arange(-9, 4), 10.0 ** np.arange(-9, 10)))

    @pytest.mark.parametrize("change", [1e-9, 1.0, -1e6])
    def test_output_is_finite_and_within_the_input(self, change: float) -> None:
        for tau in np.unique(self.TAU):
            for follower in followers(tau, gain=1.0):
                ringing = getattr(follower, "quality", 0) > 0.5
                with np.errstate(over="raise", invalid="raise", divide="raise"):
                    state = follower.advance(follower.start(np.zeros(13)), np.full(13, change), np.unique(self.STEP))
                    for _ in range(3):
                        state = follower.advance(state, np.full(13, change), np.unique(self.STEP))
                v_out = follower.output(state).v_out / change
                assert_finite(v_out)
                slack = ringing + 1e-12 + 4e-16 / abs(change)  # last term: rounding of the overdrive
                # The square of the lead raises the output in both directions of drive.
                lead = getattr(follower, "lead", Lead())
                raised = 0.4 * (lead.square - lead.linear) / -change if change < 0 and not lead.absent else 0.0
                assert (v_out >= -slack - raised).all()
                assert (v_out <= 1 + slack).all()

    @pytest.mark.parametrize("overdrive", [1e-6, 1e-3, 0.4, 1e3])
    def test_any_overdrive_stays_finite_within_the_input_and_matches_the_series(self, overdrive: float) -> None:
        generator = np.random.default_rng(13)
        for bandwidth in (1e-12, 1e-3, 1.5e6, 1e15):
            follower = SquareLawFollower(gain=1.0, bandwidth=bandwidth, overdrive=overdrive)
            for largest in (1e-9, 1.0, 1e6):
                step = 10 ** generator.uniform(-12, 8, 40)
                step[::10] = 0
                time = np.append(0, np.cumsum(step))
                v_in = largest * generator.choice([-1.0, 0.0, 1e-3, 1.0], time.size)
                with np.errstate(over="raise", invalid="raise", divide="raise"):
                    series = follower.run(time, v_in).v_out
                    state = follower.start(v_in[0])
                    rows = [float(follower.output(state).v_out)]
                    for k in range(1, time.size):
                        state = follower.advance(state, v_in[k], time[k] - time[k - 1])
                        rows.append(float(follower.output(state).v_out))
                assert_finite(series)
                rounding = 1e-12 * (largest + overdrive)
                assert np.abs(series).max() <= largest + rounding
                np.testing.assert_allclose(series, rows, rtol=0, atol=rounding)

    def test_a_very_long_slew_at_the_ends_of_the_ranges(self) -> None:
        follower = SquareLawFollower(gain=1.0, bandwidth=1e15, overdrive=1e-6)
        with np.errstate(over="raise", invalid="raise", divide="raise"):
            v_out = follower.run([0, 1e-9, 1e9], [0, 1e6, -1e6]).v_out
        # 1e-9 s at the slew rate, then long enough to settle.
        np.testing.assert_allclose(v_out, [0, follower.slew_rate * 1e-9, -1e6], rtol=0, atol=1e-9)

    @pytest.mark.parametrize("tau", [1e-9, 105e-9, 1.0, 1e9])
    def test_output_approaches_the_input_as_the_step_gets_longer(self, tau: float) -> None:
        step = np.logspace(-9, 3, 1201)
        for follower in followers(tau, gain=1.0):
            if getattr(follower, "quality", 0) > 0.5:
                continue
            state = follower.advance(follower.start(np.zeros(step.size)), np.ones(step.size), step)
            assert_monotone(follower.output(state).v_out, rising=True, slack=1e-13)

    @given(decades(1e-9, 1e3), decades(1e-9, 1e9), signed_decades(1e-9, 1e6), st.floats(0.0, 1.0))
    def test_two_parts_of_a_step_equal_the_step(self, step: float, tau: float, change: float, part: float) -> None:
        for follower in followers(tau):
            start = follower.start(0.0)
            whole = follower.output(follower.advance(start, change, step)).v_out
            first = follower.advance(start, part * change, part * step)
            both = follower.output(follower.advance(first, change, step - part * step)).v_out
            # The times of the parts are rounded too, times the slew rate; 4e-16 V is a rounding of the overdrive.
            assert abs(both - whole) <= 4e-13 * (abs(change) + 1e-3 * step / tau) + 4e-16

    def test_error_per_region_of_step_over_time_constant(self, record_property) -> None:
        table = reference("mean_decay")
        follower = OnePoleFollower(gain=1.0, bandwidth=1 / (2 * math.pi))
        found = ErrorMap(bound=ONE_POLE_ERROR)
        for low in range(-18, 9, 3):
            rows = (table["x"] >= 0.99 * 10.0**low) & (table["x"] < 0.99 * 10.0 ** (low + 3))
            state = follower.advance(follower.start(np.zeros(rows.sum())), np.ones(rows.sum()), table["x"][rows])
            found.add(f"step/tau 1e{low}..1e{low + 3}", state.lags[0] - table["mean_decay"][rows])
        found.check(record_property)

    @pytest.mark.parametrize("size", [0, 1, 25, 100_000])
    @pytest.mark.parametrize("dtype", [np.float32, np.float64])
    def test_any_number_of_taxels(self, size: int, dtype) -> None:
        v_in = np.linspace(-1, 1, size, dtype=dtype)
        for follower in (followers()[2], followers()[-1]):
            state = follower.advance(follower.start(np.zeros(size, dtype)), v_in, 1e-3)
            output = follower.output(state)
            assert output.v_out.shape == output.valid.shape == (size,)
            np.testing.assert_allclose(output.v_out, LOOP.gain * v_in, rtol=0, atol=2e-4)
            assert follower.run([0.0, 1.0], np.zeros((2, size))).v_out.shape == (2, size)

    @pytest.mark.parametrize("case", DRIFTS, ids=lambda case: case.name)
    def test_a_million_steps_do_not_drift(self, case: Case) -> None:
        """`make stability` runs 1e8; a million steps of the pair would take too long here."""
        steps = 10_000 if case.name.startswith("SquareLaw") else 1_000_000
        found = case.run(steps)
        print(f"{case.name}: largest {found.largest:.1e}, last {found.last:.1e}, bound {found.bound:.1e}")
        assert found.last <= found.largest <= found.bound


def test_a_recurrence_equals_a_loop() -> None:
    generator = np.random.default_rng(5)
    for shape in ((1,), (40_000,), (300, 7), (5, 0), (3, 20_000)):
        factor, addend = generator.uniform(0, 1, shape), generator.normal(size=shape)
        row = start = generator.normal(size=shape[1:])
        looped = []
        for f, a in zip(factor, addend, strict=True):
            row = f * row + a
            looped.append(row)
        solved = linear_recurrence(factor, addend, np.asarray(start))
        np.testing.assert_allclose(solved, looped, rtol=0, atol=1e-12)
        assert solved is addend


ONE_POLE = OnePoleFollower(gain=1.0, bandwidth=1e6)
GOOD_ONE_POLE = {"gain": 0.99, "bandwidth": 1e6}
GOOD_TWO_POLES = {"gain": 0.99, "natural_frequency": 1e6, "quality": 0.5}


@pytest.mark.parametrize(
    ("function", "cases"),
    [
        refusals(
            close_loop,
            {"open_loop_gain": 130.0, "gain_bandwidth": 1e6},
            open_loop_gain=[0.0, -1.0, 1e10],
            gain_bandwidth=[0.0, -1.0, 1e15],
        ),
        refusals(
            StaticFollower, {"gain": 1.0}, gain=[0.0, -1.0, 1e4], offset=[1e7, [[1.0], [1.0, 2.0]]], limits=[(0.0, 1.0)]
        ),
        refusals(OnePoleFollower, GOOD_ONE_POLE, gain=[0.0], bandwidth=[0.0, -1.0, 1e16]),
        refusals(TwoPoleFollower, GOOD_TWO_POLES, natural_frequency=[0.0, 1e16], quality=[0.0, 51.0]),
        refusals(
            TwoPoleFollower.from_bandwidth,
            {"gain": 0.99, "bandwidth": 1e6, "quality": 0.5},
            bandwidth=[0.0],
            quality=[0.0],
        ),
        refusals(
            SquareLawFollower, {**GOOD_ONE_POLE, "overdrive": 0.4}, overdrive=[0.0, -1.0, 1e4], lead=[0.07, (0.07, 0.2)]
        ),
        refusals(ONE_POLE.response, {"frequency": 1.0}, frequency=[-1.0, 1e19]),
        refusals(ONE_POLE.start, {"v_in": 0.0}, v_in=[2e6, -2e6]),
        refusals(
            ONE_POLE.advance,
            {"state": ONE_POLE.start(0.0), "v_in": 0.0, "step": 1.0},
            v_in=[2e6, [0.0, 1.0]],
            step=[-1.0, 1e10, [1.0, 2.0]],
        ),
        refusals(
            ONE_POLE.advance_series,
            {"state": ONE_POLE.start(0.0), "v_in": [0.0, 0.0], "step": 1.0},
            v_in=[0.0, [2e6], [], [[0.0, 1.0]]],
            step=[-1.0, 1e10, [1.0], [[1.0, 2.0]]],
        ),
        refusals(
            ONE_POLE.run,
            {"time": [0.0, 1.0], "v_in": [0.0, 1.0]},
            time=[[0.0, -1.0], [0.0, 2e9], [0.0], [[0.0, 1.0]], []],
            v_in=[[0.0, 2e6], [0.0]],
        ),
    ],
)
def test_invalid_arguments_are_rejected_by_name(function, cases) -> None:
    assert_all_refused(function, cases)
