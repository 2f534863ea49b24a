# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The op-amp circuits: node equations, transistors, operating point and figures, against ngspice and derivatives."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posfet_model.amplifier.circuit import AmplifierCircuit
from posfet_model.amplifier.circuit_figures import (
    NO_OPERATING_POINT,
    NOT_SATURATED,
    CircuitFigures,
    circuit_figures,
    unloaded_response,
)
from posfet_model.amplifier.circuit_topology import UNKNOWNS
from posfet_model.amplifier.one_stage import CIRCUIT_C, one_stage_figures
from posfet_model.amplifier.open_loop import LOW_MARGIN, RINGS, UNSTABLE
from posfet_model.amplifier.operating_point import CIRCUIT_B, operating_point
from posfet_model.amplifier.square_law import gate_capacitances, linearise
from posfet_model.amplifier.two_stage import TABLE_II, figures_of_merit
from posfet_model.design.posfet_design import PosfetDesign
from posfet_model.device.transistor import drain_current
from posfet_model.spice.circuits import CIRCUITS
from support.spice_data import recorded, small_signal
from support.sweep import assert_refused

ONE = np.array(1.0)
VOLTS = st.floats(-5, 5)


def figures_of(name: str) -> CircuitFigures:
    of = CIRCUITS[name]
    return circuit_figures(AmplifierCircuit.from_design(of.bias, of.design, of.stages))


@given(VOLTS, st.floats(0, 5))
def test_the_current_is_that_of_the_device(gate: float, drain: float) -> None:
    found = linearise(ONE, 1e-3 * ONE, 0.7 * ONE, 0.05 * ONE, np.array(gate), np.array(drain)).current
    assert found == pytest.approx(float(drain_current(gate, drain, 0.7, 1e-3, 0.05)), rel=1e-13, abs=1e-18)


@given(VOLTS, VOLTS, st.sampled_from([1.0, -1.0]))
def test_the_conductances_are_the_derivatives_of_the_current(gate: float, drain: float, polarity: float) -> None:
    def current(vgs: float, vds: float) -> float:
        parts = (np.array(x) for x in (polarity, 1e-3, 0.7, 0.05, vgs, vds))
        return float(linearise(*parts).current)

    at = linearise(*(np.array(x) for x in (polarity, 1e-3, 0.7, 0.05, gate, drain)))
    small = 1e-6
    for found, (dg, dd) in ((at.transconductance, (small, 0)), (at.output_conductance, (0, small))):
        slope = (current(gate + dg, drain + dd) - current(gate - dg, drain - dd)) / (2 * small)
        assert float(found) == pytest.approx(slope, abs=3e-9)


def test_the_junction_from_body_to_drain_conducts_as_in_spice() -> None:
    """1e-14 A at 27 degC: k*T/q is 25.865 mV; above 0.75 V a straight line, so that no current overflows."""

    def current(drain: float, polarity: float = 1.0) -> float:
        parts = (np.array(x) for x in (polarity, 1e-3, 0.7, 0.05, polarity * -9.0, polarity * drain))
        return float(linearise(*parts).current)

    for volts in (0.1, 0.4, 0.6, 0.74):
        wanted = 1e-14 * math.expm1(volts * 1.602176634e-19 / (1.380649e-23 * 300.15))
        assert current(-volts) == pytest.approx(-wanted, rel=1e-4)
        assert current(-volts, -1.0) == pytest.approx(wanted, rel=1e-4)
    assert current(5.0) == current(0.0) == 0
    assert 2 * current(-2.0) == pytest.approx(current(-1.0) + current(-3.0), rel=1e-12)


def test_the_gate_capacitance_is_meyers() -> None:
    def split(gate: float, drain: float) -> tuple[float, float]:
        source, far = gate_capacitances(ONE, 3 * ONE, 0.7 * ONE, np.array(gate), np.array(drain))
        return float(source), float(far)

    assert split(1.7, 5.0) == (pytest.approx(2), 0)
    assert split(1.7, 0.0) == (pytest.approx(1.5), pytest.approx(1.5))
    assert split(1.7, 0.5) == (pytest.approx(2 * (1 - 1 / 9)), pytest.approx(2 * (1 - 4 / 9)))
    assert split(-1.0, 3.0) == (pytest.approx(3), 0)
    assert split(1.2, -0.5) == split(1.7, 0.5)[::-1]  # drain and source exchanged


@pytest.mark.parametrize("name", CIRCUITS)
def test_no_current_is_left_over_at_rest(name: str) -> None:
    of = CIRCUITS[name]
    circuit = AmplifierCircuit.from_design(of.bias, of.design, of.stages)
    v_in = np.linspace(-1, 1, 5)
    nodes = circuit.operating_point(v_in)
    assert np.abs(circuit.currents(nodes, v_in)).max() < 1e-9 * of.bias.reference_current
    assert circuit.output(nodes) == pytest.approx(v_in, abs=0.08)
    assert nodes.shape == (5, len(UNKNOWNS[of.stages]))


def test_the_jacobian_is_the_derivative_of_the_currents() -> None:
    circuit = AmplifierCircuit.from_design()
    nodes, v_in = circuit.operating_point(0.3) + 0.01 * np.arange(5), np.array(0.3)
    _, linear = circuit.evaluate(nodes, v_in)
    for k in range(5):
        change = 1e-6 * (np.arange(5) == k)
        slope = (circuit.currents(nodes + change, v_in) - circuit.currents(nodes - change, v_in)) / 2e-6
        assert linear.conductance[:, k] == pytest.approx(slope, rel=1e-6, abs=1e-10)
    slope = (circuit.currents(nodes, v_in + 1e-6) - circuit.currents(nodes, v_in - 1e-6)) / 2e-6
    assert linear.input_conductance == pytest.approx(slope, rel=1e-6, abs=1e-10)


@pytest.mark.parametrize(("file", "circuit"), [("opamp_b", "two_stage"), ("opamp_c", "one_stage")])
def test_small_signals_are_those_of_ngspice(file: str, circuit: str) -> None:
    of = CIRCUITS[circuit]
    unloaded = unloaded_response(AmplifierCircuit.from_design(of.bias, of.design, of.stages))
    for analysis, response in (("ac", figures_of(circuit).closed_loop_response), ("open_loop", unloaded)):
        stored = small_signal(file, analysis)
        assert np.abs(response.at(stored.frequency) / stored.transfer - 1).max() < 2e-5


@pytest.mark.parametrize("name", CIRCUITS)
def test_crossing_and_margin_are_those_of_ngspice(name: str) -> None:
    found, measured = figures_of(name), recorded(name).exact_loop
    assert found.gain_bandwidth == pytest.approx(measured.unity_crossing, rel=2e-4)
    assert found.phase_margin == pytest.approx(measured.phase_margin, abs=0.01)
    # With a voltage alone in the loop, ngspice's is off by the ratio of the impedances of output and inverting input.
    record = recorded(name)
    assert np.abs(found.loop_gain.at(record.frequency[:10]) / record.loop_gain[:10] - 1).max() < 1e-2


def test_an_inverting_input_that_outweighs_the_load_is_in_crossing_and_margin() -> None:
    """The numbers are ngspice's, with a voltage and a current in the loop (`run_double_injection`)."""
    for width, film, wanted in ((3.276e-3, 2.5e-6, (7.06543e6, 100.642)), (10e-3, 1e-7, (7.23418e6, 61.155))):
        found = PosfetDesign(film_thickness=film, gate_width=width, load_capacitance=1e-12).amplifier
        assert (found.gain_bandwidth, found.phase_margin) == pytest.approx(wanted, rel=1e-5)


@pytest.mark.parametrize(
    ("name", "decibels"),
    [
        ("two_stage", 58.512),
        ("one_stage", 64.090),
        ("one_stage_36db", 52.237),
        ("one_stage_60db_1pf", 94.386),
        ("two_stage_59db_300khz", 69.403),
    ],
)
def test_the_systematic_common_mode_rejection_is_that_of_ngspice(name: str, decibels: float) -> None:
    """ngspice: gain from the input with the loop closed at 0 Hz only, the inverting input held, and moved with it."""
    assert 20 * math.log10(figures_of(name).common_mode_rejection) == pytest.approx(decibels, abs=1e-3)


def test_the_follower_is_the_closed_loop_of_its_loop_gain() -> None:
    found = circuit_figures(AmplifierCircuit.from_design(replace(CIRCUIT_B, load_capacitance=1e-13)))
    for response in (found.loop_gain.remainder, found.closed_loop_response):
        assert response.rates == pytest.approx(found.closed_loop_response.rates)
    slow = np.array([1.0])
    assert found.loop_gain.at(slow) == pytest.approx(found.gain, rel=5e-3)  # but for the common mode
    assert np.abs(found.loop_gain.at(1e5 * found.gain_bandwidth)) < 1e-3


def test_figures_at_rest_are_those_of_the_hand_formulas() -> None:
    for found, hand in ((figures_of("two_stage"), figures_of_merit()), (figures_of("one_stage"), one_stage_figures())):
        assert found.tail_current == pytest.approx(hand.tail_current, rel=0.02)
        assert found.gain == pytest.approx(hand.open_loop_gain, rel=0.04)
        assert found.gain_bandwidth == pytest.approx(hand.gain_bandwidth, rel=0.1)
        assert found.slew_rate == pytest.approx(hand.slew_rate, rel=0.02)
    assert figures_of("two_stage").falling_slew_rate == pytest.approx(figures_of_merit().falling_slew_rate, rel=0.02)


@pytest.mark.parametrize(
    ("name", "reasons"),
    [
        ("two_stage", []),
        ("two_stage_100pf", [RINGS]),
        ("two_stage_300pf", [LOW_MARGIN, RINGS]),
        ("two_stage_no_zero_resistor", [LOW_MARGIN, RINGS]),
        ("two_stage_thin_film_unstable", [UNSTABLE, LOW_MARGIN]),
        ("two_stage_no_rz_unstable", [UNSTABLE, LOW_MARGIN]),
        ("one_stage", []),
        ("one_stage_100pf", [LOW_MARGIN, RINGS]),
    ],
)
def test_reasons(name: str, reasons: list[str]) -> None:
    found = figures_of(name)
    assert found.validity.reasons == reasons
    assert bool(found.validity.valid) is not bool(reasons)
    assert found.open_loop.phase_margin == pytest.approx(found.phase_margin, abs=1e-6)
    assert found.open_loop.gain_bandwidth == pytest.approx(found.gain_bandwidth, rel=1e-6)
    assert found.open_loop.stable == found.stable


def test_many_circuits_at_once_are_the_same_as_one_by_one() -> None:
    chosen = [of for of in CIRCUITS.values() if of.stages == 2]
    each = [AmplifierCircuit.from_design(of.bias, of.design) for of in chosen]
    together = circuit_figures(AmplifierCircuit.stack(each))
    for k, circuit in enumerate(each):
        alone = circuit_figures(circuit)
        for name in ("gain", "gain_bandwidth", "phase_margin", "overshoot", "offset", "slew_rate"):
            assert getattr(together, name)[k] == pytest.approx(float(getattr(alone, name)), rel=1e-6, nan_ok=True)
        assert together.validity.reasons_at(k) == alone.validity.reasons


def test_a_supply_that_is_too_low_is_named() -> None:
    found = circuit_figures(AmplifierCircuit.from_design(replace(CIRCUIT_B, supply=1.2)))
    assert found.validity.reasons[0] in (NO_OPERATING_POINT, NOT_SATURATED)
    assert not found.validity.valid


def test_the_operating_point_is_that_of_the_hand_formulas() -> None:
    hand = operating_point(CIRCUIT_B, TABLE_II)
    nodes = dict(zip(UNKNOWNS[2], AmplifierCircuit.from_design().operating_point(0.0), strict=True))
    assert nodes["mirror"] == pytest.approx(5 - hand.load_voltage, abs=3e-3)
    assert nodes["tail"] == pytest.approx(-0.7 - hand.pair_overdrive, abs=5e-3)


def test_the_step_of_the_transfer_function_is_its_inverse_transform() -> None:
    found = figures_of("one_stage_100pf")
    time = np.linspace(0, 4e-6, 400)
    pair = found.closed_loop_response.rates[:2]
    ringing = found.closed_loop_response.step(time) / found.closed_loop_response.gain - 1
    peak = np.argmax(ringing)
    assert time[peak] == pytest.approx(math.pi / abs(pair[0].imag), rel=0.02)
    assert ringing.max() == pytest.approx(float(found.overshoot), abs=2e-3)


def test_stages_are_one_or_two() -> None:
    good = {"bias": CIRCUIT_C, "design": TABLE_II, "stages": 1}
    for bad in (0, 3, 1.5, "two"):
        assert_refused(AmplifierCircuit.from_design, {**good, "stages": bad}, "stages")
    assert_refused(AmplifierCircuit.from_design, {**good, "bias": None}, "bias")
    assert_refused(circuit_figures, {"circuit": None}, "circuit")
