# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Integrated followers: against ngspice, stored and live; independence of the steps; limits; what they refuse."""

import math
import shutil
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from posfet_model.amplifier import transient as transient_module
from posfet_model.amplifier import transient_follower
from posfet_model.amplifier.circuit import AmplifierCircuit
from posfet_model.amplifier.follower import OnePoleFollower, SquareLawFollower
from posfet_model.amplifier.input_findings import (
    CUT_OFF,
    INPUT_RANGE,
    LOW_MARGIN_HERE,
    OUTPUT_RANGE,
    RINGS_HERE,
    UNSTABLE_HERE,
    input_findings,
)
from posfet_model.amplifier.one_stage import CIRCUIT_C
from posfet_model.amplifier.open_loop import RINGS, UNSTABLE, OpenLoop
from posfet_model.amplifier.operating_point import CIRCUIT_B
from posfet_model.amplifier.parallel_in_time import advance_stretches
from posfet_model.amplifier.transient import TOLERANCE, SystemState, advance, advance_through
from posfet_model.amplifier.transient_follower import CircuitFollower, SlewingFollower, TransientFollower, _straight
from posfet_model.spice import ngspice
from posfet_model.spice.circuits import CIRCUITS
from posfet_model.spice.netlist import subcircuit
from support.long_cases import crossed, long_cases
from support.spice_data import transient
from support.sweep import assert_refused

FOLLOWERS = {"opamp_b": CircuitFollower.from_design(), "opamp_c": CircuitFollower.from_design(CIRCUIT_C, stages=1)}
LOOP = OpenLoop(130.0, (11.5e3, 3e6))
SLEWING = SlewingFollower(open_loop=LOOP, slew_rate=4e6)


def of_circuit(name: str) -> CircuitFollower:
    of = CIRCUITS[name]
    return CircuitFollower.from_design(of.bias, of.design, of.stages)


@pytest.mark.parametrize("circuit", FOLLOWERS)
@pytest.mark.parametrize(("stimulus", "bound"), [("press", 1e-4), ("tap", 1e-3), ("sine", 2e-3), ("step", 0.05)])
def test_from_sizes_and_bias_the_follower_is_that_of_ngspice(circuit: str, stimulus: str, bound: float) -> None:
    run = transient(circuit, stimulus)
    found = FOLLOWERS[circuit].run(run.time, run.v_in)
    assert 100 * np.abs(found.v_out - run.v_out).max() / np.ptp(run.v_in) <= bound  # offset included
    assert found.valid.all()


LIVE = ("two_stage_100pf", "two_stage_narrow_pair_50pf", "one_stage_half_cc_30pf", "one_stage_300khz_300pf")


@pytest.mark.spice
@pytest.mark.skipif(shutil.which("ngspice") is None, reason="ngspice is not on PATH")
@pytest.mark.parametrize(
    ("volts", "name"),
    long_cases(
        crossed([0.05, 1.0, -1.0], LIVE),
        [
            "0.05-two_stage_100pf",
            "1.0-two_stage_narrow_pair_50pf",
            "-1.0-one_stage_half_cc_30pf",
            "1.0-one_stage_300khz_300pf",
        ],
    ),
)
def test_steps_of_ringing_circuits_are_those_of_ngspice(volts: float, name: str) -> None:
    points = [0, 3e-7, 3.1e-7, 4e-6]
    source = ngspice.piecewise_linear(points, [0, 0, volts, volts])
    run = ngspice.run_follower(subcircuit(CIRCUITS[name]), source, points[-1], 5e-9)
    even = np.linspace(0, points[-1], 401)
    found = of_circuit(name).run(even, np.interp(even, points, [0, 0, volts, volts])).v_out
    error = 100 * (found - np.interp(even, run.time, run.v_out)) / abs(volts)  # offset included
    assert np.sqrt(np.mean(error**2)) <= 0.05


def step_of(follower: CircuitFollower | SlewingFollower, volts: float, samples: int, end: float = 3e-6) -> np.ndarray:
    time = np.r_[0.0, 1e-7, np.linspace(1.1e-7, end, samples)]
    return follower.run(time, np.where(time > 1e-7, volts, 0.0)).v_out


@pytest.mark.parametrize("follower", [FOLLOWERS["opamp_b"], FOLLOWERS["opamp_c"], SLEWING], ids=["b", "c", "slewing"])
def test_the_samples_asked_for_do_not_change_the_result(follower: CircuitFollower | SlewingFollower) -> None:
    few, many = step_of(follower, 1.0, 11), step_of(follower, 1.0, 101)
    assert np.abs(few[2:] - many[2::10]).max() < 2e-4


def test_a_tighter_tolerance_converges() -> None:
    circuit = AmplifierCircuit.from_design(CIRCUITS["two_stage_100pf"].bias)
    loose, tight, tightest = (
        step_of(CircuitFollower(circuit=circuit, tolerance=tolerance), 0.5, 10, 1e-6)
        for tolerance in (1e-3, 1e-5, 1e-7)
    )
    assert np.abs(tight - tightest).max() < 0.1 * np.abs(loose - tightest).max() < 1e-2


def test_series_advance_and_run_agree() -> None:
    for follower in (FOLLOWERS["opamp_c"], SLEWING):
        time = np.linspace(0, 2e-6, 21)
        v_in = np.where(time > 2e-7, 0.4, 0.0)
        whole = follower.run(time, v_in)
        state, out = follower.start(v_in[0]), []
        for k in range(1, 21):
            state = follower.advance(state, v_in[k], float(time[k] - time[k - 1]))
            out.append(float(follower.output(state).v_out))
        assert whole.v_out[1:] == pytest.approx(out, abs=1e-4)
        series = follower.advance_series(follower.start(v_in[0]), v_in[1:], np.diff(time))
        assert series.output.v_out == pytest.approx(whole.v_out[1:], abs=1e-12)
        assert series.end.lags[0] == pytest.approx(v_in[-1] - whole.v_out[-1], abs=1e-12)


def test_a_100_pf_cable_is_not_plainly_valid() -> None:
    follower = of_circuit("two_stage_100pf")
    time = np.linspace(0, 3e-6, 301)
    found = follower.run(time, np.where(time > 2e-7, 0.05, 0.0))
    assert not found.valid.any() and found.reasons == [RINGS]
    rise = found.v_out - found.v_out[0]
    assert rise.max() / rise[-1] - 1 == pytest.approx(0.14, abs=0.01)  # ngspice: 13.98 %


@pytest.mark.parametrize("name", ["two_stage_thin_film_unstable", "two_stage_no_rz_unstable"])
def test_an_unstable_circuit_oscillates_between_its_rails_and_is_never_valid(name: str) -> None:
    follower = of_circuit(name)
    found = step_of(follower, 0.05, 60, 4e-6)
    assert np.abs(found).max() < 5 and np.ptp(found[-30:]) > 0.1
    result = follower.run([0.0, 1e-6], [0.0, 0.0])
    assert not result.valid.any() and UNSTABLE in result.reasons


def swing_and_frequency(time: np.ndarray, out: np.ndarray) -> tuple[float, float]:
    """Return peak to peak [V], and mean frequency of the rising crossings of the middle [Hz]."""
    middle = 0.5 * (out.max() + out.min())
    rising = np.flatnonzero((out[:-1] < middle) & (out[1:] >= middle))
    at = time[rising] + (middle - out[rising]) / np.diff(out)[rising] * np.diff(time)[rising]
    return float(np.ptp(out)), float(1 / np.diff(at).mean())


@pytest.mark.parametrize(
    "name",
    long_cases(["two_stage_thin_film_unstable", "two_stage_no_rz_unstable"], ["two_stage_thin_film_unstable"]),
)
def test_a_period_of_an_oscillation_takes_few_sub_steps_and_is_right(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    follower = of_circuit(name)
    period = 1 / float(follower.figures.gain_bandwidth)
    time = np.linspace(0, 15 * period, 481)[1:]
    start = SystemState(np.zeros(()), follower.circuit.operating_point(0.0), np.inf)
    jumped = advance(follower.circuit, start, np.asarray(0.05), 0.0, TOLERANCE)
    wanted = follower.circuit.output(advance_through(follower.circuit, jumped, jumped.v_in, time, TOLERANCE)[1])
    steps, one = [], transient_module._step
    monkeypatch.setattr(transient_module, "_step", lambda *of: steps.append(1) or one(*of))
    found = follower.run(np.r_[0.0, 0.0, time], np.r_[0.0, np.full(481, 0.05)]).v_out[2:]
    assert len(steps) <= 40 * 15
    late = time > 10 * period
    swings, frequencies = zip(*(swing_and_frequency(time[late], out[late]) for out in (found, wanted)), strict=True)
    assert swings[0] == pytest.approx(swings[1], abs=5e-3) and swings[1] > 0.5
    assert frequencies[0] == pytest.approx(frequencies[1], rel=2e-3)


def test_what_is_lost_stays_so_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    follower = FOLLOWERS["opamp_b"]
    monkeypatch.setattr(transient_module, "_step", lambda *of: pytest.fail("integrated"))
    lost = SystemState(np.zeros(()), np.full(5, np.nan), 1e-9)
    state, nodes = advance_through(follower.circuit, lost, np.asarray(1.0), np.array([1e-7, 2e-7]), TOLERANCE)
    assert np.isnan(nodes).all() and np.isnan(state.nodes).all() and state.v_in == 1.0


def test_an_input_at_which_the_output_stage_carries_too_little_is_named_where_it_oscillates() -> None:
    """57 degrees at 0 V, 52 at -0.5 V; at -2.5 V the load supplies most of M8's current, and M7 is too weak for it."""
    bias = replace(CIRCUIT_B, reference_current=100e-6, load_resistance=40e3, modulation=0.02)
    follower = CircuitFollower.from_design(bias)
    assert follower.validity.valid
    result = follower.run([0.0, 1e-3, 2e-3, 3e-3], [0.0, 0.5, -0.5, -2.5])
    assert result.valid.tolist() == [True, True, False, False]
    assert set(result.reasons) == {RINGS_HERE, UNSTABLE_HERE}
    time = np.linspace(0, 6e-6, 61)
    swing = follower.run(time, np.where(time > 1e-6, -2.49, -2.5))
    assert not swing.valid.any() and np.ptp(swing.v_out[-30:]) > 0.1


def test_inputs_out_of_range_and_steep_falls_are_named() -> None:
    b, c = FOLLOWERS["opamp_b"], FOLLOWERS["opamp_c"]
    slow = np.linspace(0, 1, 9)
    assert b.run(slow, 3.4 * slow).valid.all() and c.run(slow, 2.5 * slow).valid.all()
    rough = slow[::2]  # at -1.7 V, between two of these, it oscillates, and every period is integrated
    high, low = b.run(slow, 4.5 * slow), b.run(rough, -4.5 * rough)
    assert not high.valid[-1] and OUTPUT_RANGE in high.reasons and high.valid[0]
    assert not low.valid[-1] and INPUT_RANGE in low.reasons and low.valid[0]
    time = np.linspace(0, 1e-6, 101)
    fall = b.run(time, np.where(time > 1e-7, -1.0, 0.0))
    assert fall.reasons == [CUT_OFF] and fall.valid[-1] and not fall.valid.all()
    assert b.run(time, np.where(time > 1e-7, 1.0, 0.0)).valid.all()


def test_small_signals_of_the_slewing_follower_are_those_of_its_poles() -> None:
    time = np.linspace(0, 2e-6, 201)
    follower = SlewingFollower(open_loop=LOOP, slew_rate=1e9, tolerance=1e-8)
    found = follower.run(np.r_[0.0, time], np.r_[0.0, np.full(201, 1e-2)]).v_out[1:]
    assert found == pytest.approx(1e-2 * float(LOOP.closed_loop_gain) * LOOP.step_response.at(time), abs=2e-7)


def test_a_second_pole_at_infinity_gives_the_exact_square_law() -> None:
    loop = OpenLoop(1e6, (1.5, math.inf))
    exact = SquareLawFollower(gain=float(loop.closed_loop_gain), bandwidth=1.5e6 * (1 + 1e-6), overdrive=0.4)
    follower = SlewingFollower(open_loop=loop, slew_rate=exact.slew_rate, tolerance=1e-7)
    time = np.linspace(0, 1e-6, 101)
    v_in = np.clip(time / 1e-7, 0, 1)
    assert np.abs(follower.run(time, v_in).v_out - exact.run(time, v_in).v_out).max() < 5e-4


def test_the_slew_rate_is_the_steepest_slope() -> None:
    time = np.linspace(0, 2e-6, 400)
    for rate in (1e6, 4e6):
        found = SlewingFollower(open_loop=LOOP, slew_rate=rate).run(time, np.where(time > 1e-7, 3.0, 0.0)).v_out
        assert np.diff(found).max() / time[1] == pytest.approx(rate, rel=0.03)


def test_arrays_of_followers_run_together() -> None:
    chosen = [CIRCUITS[name] for name in ("two_stage", "two_stage_100pf")]
    circuit = AmplifierCircuit.stack([AmplifierCircuit.from_design(of.bias, of.design) for of in chosen])
    time = np.linspace(0, 1e-6, 21)
    v_in = np.where(time > 1e-7, 0.05, 0.0)
    together = CircuitFollower(circuit=circuit).run(time, np.stack([v_in, v_in], axis=1))
    for k, of in enumerate(chosen):
        alone = CircuitFollower.from_design(of.bias, of.design).run(time, v_in)
        assert together.v_out[:, k] == pytest.approx(alone.v_out, abs=2e-5)
        assert together.valid[:, k].tolist() == alone.valid.tolist()


def test_a_long_step_and_a_jump() -> None:
    for follower in (FOLLOWERS["opamp_b"], FOLLOWERS["opamp_c"], SLEWING):
        found = follower.run([0.0, 0.0, 1.0], [0.0, 0.5, 0.5]).v_out
        assert found[0] == pytest.approx(0, abs=0.03)
        assert abs(found[1] - found[0]) < 0.05  # capacitances divide the jump
        assert found[2] == pytest.approx(follower.run([0.0], [0.5]).v_out[0], abs=2e-5)


def test_the_response_is_that_of_the_figures() -> None:
    follower = FOLLOWERS["opamp_b"]
    found = follower.response([0.0, 1e6])
    assert found.gain[0] == pytest.approx(follower.static_gain) == pytest.approx(0.99355, abs=1e-5)
    assert found.valid.all() and not of_circuit("two_stage_300pf").response(1e3).valid
    assert SLEWING.response(0.0).gain == pytest.approx(SLEWING.static_gain) == pytest.approx(130 / 131)


def test_what_is_refused() -> None:
    good = {"open_loop": LOOP, "slew_rate": 1e6}
    assert_refused(SlewingFollower, {**good, "slew_rate": 0.0}, "slew_rate")
    assert_refused(SlewingFollower, {**good, "open_loop": 130.0}, "open_loop")
    assert_refused(SlewingFollower, {**good, "tolerance": 0.0}, "tolerance")
    assert_refused(CircuitFollower, {"circuit": 7}, "circuit")
    other = OnePoleFollower(gain=1.0, bandwidth=1e6)
    assert_refused(SLEWING.advance, {"state": other.start(0.0), "v_in": 0.0, "step": 1e-6}, "state")
    state = SLEWING.start(np.zeros(3))
    assert_refused(SLEWING.advance, {"state": state, "v_in": np.zeros(2), "step": 1e-6}, "v_in")
    assert_refused(SLEWING.advance, {"state": state, "v_in": np.zeros(3), "step": np.full(3, 1e-6)}, "step")
    many = SlewingFollower(open_loop=OpenLoop(np.array([100.0, 200.0]), (1e4, 1e7)), slew_rate=1e6)
    assert_refused(many.start, {"v_in": np.zeros(3)}, "v_in")


@pytest.mark.parametrize("name", long_cases(["two_stage", "one_stage_100pf"], ["one_stage_100pf"]))
def test_a_straight_run_of_samples_is_integrated_as_one(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The output at each sample is that of the samples one by one, in far fewer steps."""
    follower, time = of_circuit(name), np.arange(160) * 12.5e-9
    inputs = {
        "ramp": np.interp(time, [0, 2e-7, 8e-7, 1.2e-6, 2e-6], [0, 0, 0.2, 0.2, 0]),
        "step": np.where((time > 3e-7) & (time < 1.2e-6), 0.05, 0.0),
        "sine": 1e-5 * np.sin(2 * np.pi * time / 2e-6),
        "jumps": np.repeat([0.0, 0.02, 0.01, 0.04], 40),
    }
    calls: list[int] = []

    def counted(*words: Any) -> Any:
        calls.append(1)
        return advance_through(*words)

    monkeypatch.setattr(transient_follower, "advance_through", counted)
    for shape, v_in in inputs.items():
        calls.clear()
        merged = follower.run(time, v_in)
        assert 3 <= len(calls) < 60, shape
        with monkeypatch.context() as one_by_one:
            one_by_one.setattr(transient_follower, "_straight", lambda start, held, step, begin, deviation: begin + 1)
            apart = follower.run(time, v_in)
        assert np.abs(merged.v_out - apart.v_out).max() < TOLERANCE, shape
        assert (merged.valid == apart.valid).all()


def test_straight_runs_end_at_corners_and_jumps() -> None:
    def runs(time: list[float], *v_in: list[float]) -> list[int]:
        held, step = np.array(v_in).T.squeeze(), np.diff(time)
        ends = [0]
        while ends[-1] < step.size:
            ends.append(_straight(held[ends[-1]], held[1:], step, ends[-1], 1e-6))
        return ends

    even = list(range(7))
    assert runs(even, [0, 1, 2, 3, 3, 3, 3]) == [0, 3, 6]
    assert runs(even, [0, 1, 2, 3, 4, 5, 6.00001]) == [0, 5, 6]
    assert runs([0, 1, 2, 2, 3, 4, 5], [0, 1, 2, 2, 3, 4, 5]) == [0, 2, 3, 6]  # a jump, even if of 0 V
    assert runs([0, 0.1, 0.5, 2, 2.5, 4, 6], [0, 0.1, 0.5, 2, 2.5, 4, 6]) == [0, 6]
    assert runs(even, [0, 1, 2, 3, 4, 5, 6], [0, 0, 0, 0, 1, 2, 3]) == [0, 3, 6]  # of both columns


@pytest.mark.parametrize("name", long_cases(["two_stage", "one_stage_100pf"], ["two_stage"]))
def test_behind_a_slow_input_the_output_is_known_without_integration(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A noisy sine of half a volt, sampled far more slowly than the follower settles."""
    follower, time = of_circuit(name), np.arange(60) * 1e-4
    v_in = 0.5 * np.sin(300 * time) + np.random.default_rng(1).normal(0, 0.01, time.size)
    calls: list[int] = []
    monkeypatch.setattr(transient_follower, "advance_through", lambda *words: calls.append(1))
    found = follower.run(time, v_in)
    assert not calls
    monkeypatch.undo()
    monkeypatch.setattr(CircuitFollower, "_following", TransientFollower._following)
    integrated = follower.run(time, v_in)
    assert np.abs(found.v_out - integrated.v_out).max() < 1e-7
    assert (found.valid == integrated.valid).all()


@pytest.mark.parametrize("samples", [9, 400])
def test_a_run_that_reaches_a_low_phase_margin_is_not_valid_there(samples: int) -> None:
    """Circuit B with Cc halved: 81 degrees at 0 V, 60 at -1 V, 30 at -1.5 V; ngspice says the same."""
    follower = of_circuit("two_stage_half_cc")
    assert follower.validity.valid
    v_in = np.linspace(0.0, -1.5, samples)
    result = follower.run(np.linspace(0.0, 1.0, samples), v_in)
    low = v_in < -1.3225  # 45 degrees
    assert result.reasons == [LOW_MARGIN_HERE, RINGS_HERE]
    assert result.findings is not None and np.all(low == result.findings[LOW_MARGIN_HERE])
    assert not result.valid[low].any() and result.valid[v_in > -1].all()


def test_many_inputs_are_judged_as_each_of_them_is() -> None:
    """Margins between the examined inputs are interpolated: wrong within some mV of where a finding begins."""
    circuit = AmplifierCircuit.stack(
        [AmplifierCircuit.from_design(CIRCUITS[name].bias) for name in ("two_stage", "two_stage_100pf")]
    )
    for one, v_in in (
        (circuit, np.linspace([-4, -2], [4, 5], 301)),
        (FOLLOWERS["opamp_b"].circuit, np.linspace(-4, 5, 301)),
    ):
        nodes = one.operating_point(v_in)
        together = input_findings(one, nodes, v_in)
        rows = [input_findings(one, nodes[i : i + 1], v_in[i : i + 1]) for i in range(0, 301, 10)]
        for reason, mask in together.items():
            alone = np.concatenate([row[reason] for row in rows])
            near = np.abs(np.diff(np.pad(mask, [(1, 1)] + [(0, 0)] * (mask.ndim - 1), mode="edge").astype(int), axis=0))
            edge = (near[1:] | near[:-1])[::10].astype(bool)
            assert np.all((mask[::10] == alone) | edge), reason


def test_a_curved_input_is_integrated_in_stretches_of_time_as_in_sequence(monkeypatch: pytest.MonkeyPatch) -> None:
    time = np.arange(620) * 1e-8
    v_in = 0.1 * np.sin(2e6 * np.pi * time) + 0.2 * np.sin(0.34e6 * np.pi * time)
    v_in[280:] += 0.3  # and a step within a stretch
    follower, steps = FOLLOWERS["opamp_b"], []
    real = advance_through
    monkeypatch.setattr(transient_follower, "advance_through", lambda *given: steps.append(1) or real(*given))
    found = follower.run(time, v_in)
    assert len(steps) < 100
    monkeypatch.setattr(transient_follower, "advance_stretches", lambda *given: None)
    expected = follower.run(time, v_in)
    assert len(steps) > 400
    assert np.abs(found.v_out - expected.v_out).max() < follower.tolerance
    assert found.valid.tolist() == expected.valid.tolist()


@pytest.mark.slow
def test_stretches_of_time_take_jumps_and_uneven_steps() -> None:
    rng = np.random.default_rng(3)
    steps = np.where(rng.random(1200) < 0.1, 0.0, rng.uniform(0.5e-8, 2e-8, 1200))
    v_in = 0.1 * np.sin(2e6 * np.pi * np.cumsum(steps)) + 0.02 * (rng.random(1200) < 0.5)
    follower = FOLLOWERS["opamp_c"]
    together = follower.advance_series(follower.start(0.0), v_in, steps)
    state = follower.start(0.0)
    for volts, step in zip(v_in[:300], steps[:300], strict=True):
        state = follower.advance(state, volts, step)
    assert np.abs(together.output.v_out[299] - follower.output(state).v_out) < 10 * follower.tolerance


def test_a_follower_that_does_not_forget_is_integrated_in_sequence() -> None:
    """16 degrees of margin: it rings for longer than a stretch of time lasts, so that none meets its first result."""
    follower = of_circuit("two_stage_no_zero_resistor")
    time = np.arange(600) * 1e-9
    v_in = 0.01 * np.sin(2e7 * np.pi * time)
    rest = follower.start(0.0)
    state = SystemState(rest.v_in, rest.nodes, rest.step)
    assert advance_stretches(follower.system, state, v_in, np.full(600, 1e-9), follower.tolerance) is None
    assert np.isfinite(follower.run(time, v_in).v_out).all()
