# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Hand formulas of the amplifier: against 40-digit references, stored ngspice runs, and limiting cases."""

import dataclasses
import math

import numpy as np
import pytest

from posfet_model.amplifier.one_stage import CIRCUIT_C, one_stage_figures
from posfet_model.amplifier.operating_point import OpAmpFigures
from posfet_model.amplifier.slew_identification import one_stage_model, two_stage_model
from posfet_model.amplifier.two_stage import AmplifierBias, AmplifierDesign, figures_of_merit, mismatch_offset
from posfet_model.device.paper import AMPLIFIER_SIZES as SIZES
from posfet_model.device.paper import STACK
from posfet_model.device.transistor import drain_current, gate_voltage
from posfet_model.spice.ngspice import closed_loop
from support.spice_data import small_signal, transient
from support.sweep import NOT_REAL_NUMBERS, ErrorMap, assert_all_refused, assert_refused, reference, refusals

EPS = np.finfo(np.float64).eps
FIGURES = figures_of_merit()


@pytest.mark.parametrize(("name", "formulas"), [("amplifier", figures_of_merit), ("one_stage", one_stage_figures)])
def test_every_quantity_against_the_40_digit_table(record_property, name: str, formulas) -> None:
    table = reference(name)
    inputs, outputs = list(table)[:8], list(table)[8:]
    found = ErrorMap(bound=8 * EPS)
    for row in zip(*table.values(), strict=True):
        bias, exact = map(float, row[: len(inputs)]), dict(zip(outputs, row[len(inputs) :], strict=True))
        figures = formulas(AmplifierBias(*bias))
        # The offset is a difference of overdrives, divided by the first gain.
        scales = {**exact, "systematic_offset": exact["overdrive"] / exact["first_gain"]}
        for figure in outputs:
            found.add(figure, (getattr(figures, figure) - exact[figure]) / scales[figure])
    found.check(record_property)


def test_gain_and_pole_against_ngspice() -> None:
    open_loop = small_signal("opamp_b", "open_loop")
    gain = abs(open_loop.transfer[0])
    assert FIGURES.open_loop_gain / gain == pytest.approx(1, abs=0.02)
    assert FIGURES.dominant_pole / closed_loop(open_loop).bandwidth == pytest.approx(1, abs=0.03)
    unity = float(np.interp(0, -np.log(abs(open_loop.transfer)), open_loop.frequency))
    assert FIGURES.gain_bandwidth / unity == pytest.approx(1, abs=0.03)


def test_the_one_stage_op_amp_against_ngspice() -> None:
    open_loop = small_signal("opamp_c", "open_loop")
    figures = one_stage_figures()
    assert figures.open_loop_gain / abs(open_loop.transfer[0]) == pytest.approx(1, abs=0.04)
    assert figures.dominant_pole / closed_loop(open_loop).bandwidth == pytest.approx(1, abs=0.05)
    # The second pole adds 45 degrees to the 90 degrees of the first one. Above it, the gates of the pair feed the
    # input through to the output.
    below = open_loop.frequency < 2e7
    phase = -np.unwrap(np.angle(open_loop.transfer[below]))
    second = math.exp(float(np.interp(0.75 * math.pi, phase, np.log(open_loop.frequency[below]))))
    assert figures.second_pole / second == pytest.approx(1, abs=0.17)


@pytest.mark.parametrize(
    ("circuit", "formulas", "slack"), [("opamp_b", figures_of_merit, 0.15), ("opamp_c", one_stage_figures, 0.05)]
)
def test_slew_rates_against_ngspice(circuit: str, formulas, slack: float) -> None:
    """At half of the stored step of 1 V, where the pair is still saturated."""
    run = transient(circuit, "step")
    instants = np.interp([0.35, 0.5], run.v_out - run.v_out[0], run.time)
    assert formulas().slew_rate / (0.15 / np.diff(instants)[0]) == pytest.approx(1, abs=slack)


def assert_unknown(figures: OpAmpFigures, reason: str) -> None:
    numbers = dataclasses.asdict(dataclasses.replace(figures, limits=None))
    assert numbers.pop("limits") is None and numbers.pop("reasons") == (reason,)
    assert all(math.isnan(value) for value in numbers.values())
    assert math.isnan(figures.open_loop_gain) and math.isnan(figures.gain_bandwidth)


def test_a_one_stage_supply_too_low_gives_nan_and_the_reason() -> None:
    low = dataclasses.replace(CIRCUIT_C, supply=1.7)
    assert_unknown(one_stage_figures(low), "supply must keep every transistor saturated, got 1.7 V")
    assert_refused(one_stage_model, {"bias": low}, "supply")
    assert_refused(one_stage_figures, {"bias": None}, "bias")


def test_offset_against_ngspice() -> None:
    assert FIGURES.systematic_offset == pytest.approx(transient("opamp_b", "press").v_out[0], abs=5e-5)


def test_the_assumed_width_of_m8_gives_a_small_systematic_offset() -> None:
    ideal = figures_of_merit(AmplifierBias(modulation=1e-6))
    assert abs(ideal.systematic_offset) < 1e-7


def test_without_modulation_the_formulas_are_the_textbook_ones() -> None:
    bias = AmplifierBias(modulation=1e-6, load_resistance=1e15)
    ideal = figures_of_merit(bias)
    assert ideal.tail_current == pytest.approx(200e-6, abs=2e-9)
    assert ideal.output_current == pytest.approx(150e-6, abs=2e-9)
    assert ideal.overdrive == pytest.approx(math.sqrt(200e-6 / 9.3446e-4), abs=1e-5)
    assert ideal.input_transconductance == pytest.approx(math.sqrt(9.3446e-4 * 200e-6), abs=1e-8)
    textbook = ideal.input_transconductance / (2 * math.pi * bias.compensation)
    assert ideal.gain_bandwidth / textbook == pytest.approx(1, abs=1e-4)
    assert ideal.slew_rate == pytest.approx(ideal.tail_current / bias.compensation, abs=1e3)
    # W5*W7/(2*W3) gives M8 the current of M7, 3/4 of the tail's; Cc and the output's own capacitance are charged by it.
    sinking = bias.compensation + bias.load_capacitance + 3276e-6 * 12e-6 * 4.0270e-5 / 3
    assert ideal.falling_slew_rate == pytest.approx(ideal.output_current / sinking, abs=1e3)
    ratio = math.sqrt(ideal.output_current * 2 / (283e-4 * 7.6736e-4 * 20))
    pushed = math.sqrt((ideal.output_current + ideal.tail_current) * 2 / (283e-4 * 7.6736e-4 * 20))
    linear = ideal.tail_current * ratio / (2 * ideal.output_current)
    assert ideal.bend == pytest.approx(linear - (pushed - ratio), abs=1e-5)


def test_follower_from_the_op_amp_figures() -> None:
    loop = FIGURES.closed_loop
    assert loop.gain == pytest.approx(FIGURES.open_loop_gain / (1 + FIGURES.open_loop_gain), abs=1e-15)
    assert FIGURES.known_limits().v_low < -1 < 3 < FIGURES.known_limits().v_high
    assert FIGURES.known_limits().frequency == FIGURES.second_pole > 3 * FIGURES.gain_bandwidth


@pytest.mark.parametrize("load", [11e3, 5e3, 1e9])
@pytest.mark.parametrize("current", [50e-6, 200e-6])
def test_at_the_highest_input_the_last_transistor_is_at_the_edge_of_saturation(load: float, current: float) -> None:
    """With the transistor equations: M7 carries the current of M8 and the load, at the edge of pinch-off."""
    bias = AmplifierBias(reference_current=current, load_resistance=load)
    limits, oxide = figures_of_merit(bias).known_limits(), STACK.oxide
    aspect = {size.name: size.width / size.length for size in SIZES}
    lam, volts = bias.modulation, limits.v_high
    edge = bias.supply - volts
    most = drain_current(0.7 + edge, edge, 0.7, 283e-4 * oxide * aspect["M7"], lam)
    mirror = gate_voltage(current, 5.0, 0.7, 850e-4 * oxide * aspect["M6"], 0.0)
    for _ in range(50):  # M6 is diode-connected: its drain voltage equals its gate voltage
        mirror = gate_voltage(current, mirror, 0.7, 850e-4 * oxide * aspect["M6"], lam)
    sunk = drain_current(mirror, bias.supply + volts, 0.7, 850e-4 * oxide * aspect["M8"], lam)
    assert float(most) == pytest.approx(float(sunk) + volts / load, rel=1e-9, abs=0)
    assert limits.v_low < 0 < limits.v_high < bias.supply


def test_mismatch_contributions_add_up() -> None:
    parts = {"pair_threshold": 1e-3, "load_threshold": 2e-3, "pair_size": 0.01, "load_size": -0.02}
    single = [mismatch_offset(FIGURES, **{**dict.fromkeys(parts, 0.0), name: value}) for name, value in parts.items()]
    assert mismatch_offset(FIGURES, **parts) == pytest.approx(sum(single), abs=1e-16)
    assert single[0] == 1e-3
    assert single[2] == pytest.approx(0.005 * FIGURES.overdrive, abs=1e-16)


@pytest.mark.parametrize("current", [1e-9, 1e-7, 1e-5, 1e-4])
@pytest.mark.parametrize("modulation", [1e-6, 0.02, 1.0])
def test_all_figures_are_finite_over_the_bias(current: float, modulation: float) -> None:
    figures = figures_of_merit(AmplifierBias(reference_current=current, modulation=modulation))
    values = [v for v in dataclasses.asdict(figures).values() if isinstance(v, float)]
    assert np.isfinite(values).all()
    assert figures.open_loop_gain > 1


@pytest.mark.parametrize("value", [0, "one", FIGURES])
def test_a_value_that_is_no_bias_is_rejected(value) -> None:
    assert_refused(figures_of_merit, {"bias": value}, "bias")


def test_a_supply_too_low_gives_nan_and_the_reason_so_that_a_sweep_goes_on() -> None:
    swept = [figures_of_merit(AmplifierBias(supply=supply)) for supply in (1.2, 5.0)]
    assert_unknown(swept[0], "supply must keep every transistor saturated, got 1.2 V")
    assert swept[1] == FIGURES and FIGURES.reasons == ()
    assert_refused(two_stage_model, {"bias": AmplifierBias(supply=1.2)}, "supply")


def test_an_invalid_bias_is_rejected_by_name() -> None:
    values = {field.name: (-1.0, *NOT_REAL_NUMBERS) for field in dataclasses.fields(AmplifierBias)}
    assert_all_refused(AmplifierBias, [(name, {name: value}) for name in values for value in values[name]])


def test_a_pair_four_times_as_wide_has_half_the_overdrive() -> None:
    ideal = AmplifierBias(modulation=1e-6)
    wide = AmplifierDesign(
        tuple(dataclasses.replace(size, width=4 * size.width) if size.name in {"M1", "M2"} else size for size in SIZES)
    )
    at_half, usual = figures_of_merit(ideal, wide), figures_of_merit(ideal)
    assert at_half.overdrive / usual.overdrive == pytest.approx(0.5, abs=1e-5)
    assert at_half.input_transconductance / usual.input_transconductance == pytest.approx(2, abs=1e-5)


@pytest.mark.parametrize(
    "sizes",
    [
        (),
        SIZES[:-1],
        (*SIZES, SIZES[0]),
        (dataclasses.replace(SIZES[0], width=1e-3), *SIZES[1:]),
        tuple(dataclasses.replace(s, width=2 * s.width, length=2 * s.length) if s.name == "M4" else s for s in SIZES),
    ],
)
def test_invalid_transistor_sizes_are_rejected_by_name(sizes) -> None:
    assert_refused(AmplifierDesign, {"sizes": sizes}, "sizes")


MISMATCH = {"figures": FIGURES, "pair_threshold": 0.0, "load_threshold": 0.0, "pair_size": 0.0, "load_size": 0.0}


def test_invalid_arguments_are_rejected_by_name() -> None:
    function, cases = refusals(
        mismatch_offset,
        MISMATCH,
        figures=[],
        pair_threshold=[2.0],
        load_threshold=[-2.0],
        pair_size=[0.6],
        load_size=[0.6],
    ).values
    assert_all_refused(function, cases)


@pytest.mark.parametrize(("formulas", "bias"), [(figures_of_merit, AmplifierBias()), (one_stage_figures, CIRCUIT_C)])
def test_a_poled_film_moves_the_input_range_by_the_shift_of_the_threshold(formulas, bias: AmplifierBias) -> None:
    """Without channel-length modulation the pair only needs another common mode; its gain and speed stay."""
    bias = dataclasses.replace(bias, modulation=1e-6, load_resistance=1e15)
    usual, poled, depleted = (
        formulas(bias, AmplifierDesign(pair_threshold_shift=shift)) for shift in (0.0, -0.3, -4.0)
    )
    assert poled.open_loop_gain == pytest.approx(usual.open_loop_gain, rel=1e-5, abs=0)
    assert poled.known_limits().v_low - usual.known_limits().v_low == pytest.approx(-0.3, abs=1e-5)
    # The pair leaves saturation where its gate is a threshold above the drain, the gate of M3 below the supply.
    load = math.sqrt(usual.tail_current / (0.0283 * STACK.oxide * 160 / 12))
    assert depleted.known_limits().v_high == pytest.approx(5.0 - 0.7 - load + 0.7 - 4.0, abs=1e-4)


def test_a_pair_that_cannot_saturate_gives_nan_and_the_reason() -> None:
    assert_unknown(
        figures_of_merit(design=AmplifierDesign(pair_threshold_shift=-6.0)),
        "supply must keep every transistor saturated, got 5 V",
    )
    sizes = tuple(dataclasses.replace(size, width=1e-6) if size.name == "M7" else size for size in SIZES)
    never = figures_of_merit(AmplifierBias(supply=2.5), AmplifierDesign(sizes=sizes))
    assert_unknown(never, never.reasons[0])
    assert never.reasons[0].startswith("design must keep every transistor saturated at some input, got none: ")
    for value in (*NOT_REAL_NUMBERS, 101.0):
        assert_refused(AmplifierDesign, {"pair_threshold_shift": value}, "pair_threshold_shift")
