# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The design object: every figure by hand, arrays as elements, what a change changes, reasons, refusals, export."""

import dataclasses
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from posfet_model.amplifier.circuit_figures import NOT_SATURATED, circuit_figures
from posfet_model.amplifier.one_stage import one_stage_figures
from posfet_model.amplifier.step_test import step_test
from posfet_model.amplifier.two_stage import figures_of_merit
from posfet_model.design import report
from posfet_model.design.posfet_design import PosfetDesign
from posfet_model.design.ranges import (
    BEYOND_ADC,
    BEYOND_INPUT,
    LOW_MARGIN_IN_USE,
    NOT_POLED,
    OSCILLATES,
    REST_BEYOND_ADC,
    RINGS_IN_USE,
    TOO_STEEP,
)
from posfet_model.device.taxel_fields import FilmGeometry, plausible_fields
from posfet_model.device.transistor import Plane
from posfet_model.spice import ngspice
from posfet_model.spice.circuits import CIRCUITS
from posfet_model.spice.netlist import subcircuit
from support.each_row import each_row
from support.sweep import NOT_REAL_NUMBERS, assert_refused

EPS0, KT = 8.8541878188e-12, 1.380649e-23 * 300
COX = 3.9 * EPS0 / 45e-9
DESIGN = PosfetDesign()
AS_IN_PAPER = PosfetDesign(film_geometry=FilmGeometry.AS_IN_PAPER)
LARGE_OFFSET = replace(AS_IN_PAPER, stages=1, channel_length_modulation=0.2, load_resistance=1e3)


def test_the_film_on_a_square_millimetre_against_what_the_paper_does() -> None:
    """By hand formulas 5.1 MHz and 52.6 dB in place of 1.53 MHz and 42.4 dB; the circuit itself is a little below."""
    for design, gain, product in ((DESIGN, 52.64, 5.088e6), (AS_IN_PAPER, 42.43, 1.531e6)):
        circuit = design.circuit()
        hand = figures_of_merit(circuit.bias, circuit.design)
        assert 20 * math.log10(hand.open_loop_gain) == pytest.approx(gain, abs=5e-3)
        assert hand.gain_bandwidth == pytest.approx(product, rel=1e-3)
        assert design.amplifier.gain_db == pytest.approx(gain, abs=0.2)
        assert design.amplifier.gain_pole_product == pytest.approx(product, rel=0.05)
    # The same currents through a gain factor 11.14 times as high: gm1 rises by its root.
    real, printed = DESIGN.amplifier, AS_IN_PAPER.amplifier
    ratio = real.input_transconductance / printed.input_transconductance
    share = real.tail_current / printed.tail_current
    assert ratio == pytest.approx(math.sqrt(11.1449 * share), rel=0.02)  # and the pair's drain-source voltages differ


@pytest.mark.spice
@pytest.mark.skipif(not ngspice.available(), reason="needs ngspice")
def test_the_report_is_that_of_ngspice_for_the_exported_netlist() -> None:
    for design in (DESIGN, PosfetDesign(stages=1, load_capacitance=100e-12, load_resistance=1e12)):
        held = ngspice.run_open_loop_ac(design.netlist(), 1.0, 10.0, 1)
        assert design.amplifier.gain_db == pytest.approx(20 * math.log10(abs(held.transfer[0])), abs=0.01)
        response = ngspice.run_double_injection(design.netlist(), 1.0, 1e9, 20)
        gain = np.abs(response.transfer)
        crossing = math.exp(np.interp(0, -np.log(gain), np.log(response.frequency)))
        assert design.amplifier.gain_bandwidth == pytest.approx(crossing, rel=1e-3)
        phase = np.unwrap(np.angle(response.transfer))
        phase -= 2 * math.pi * round(phase[0] / (2 * math.pi))
        margin = 180 + math.degrees(np.interp(math.log(crossing), np.log(response.frequency), phase))
        assert design.amplifier.phase_margin == pytest.approx(margin, abs=0.1)


def test_the_operating_point_by_hand() -> None:
    """Square laws of the mirror M6 and of the pair, with the tail current of M5 as the model's."""
    amplifier = DESIGN.amplifier
    tail = float(amplifier.tail_current)
    mirror = 0.085 * COX * 80 / 12
    overdrive = 0.9
    for _ in range(9):
        overdrive = math.sqrt(2 * 200e-6 / (mirror * (1 + 0.1 * (0.7 + overdrive))))
    pair = 0.085 * COX * 273 * 0.58486
    pair_overdrive = math.sqrt(tail / (pair * (1 + 0.1 * (5 - 0.7 + 0.5))))
    assert amplifier.overdrive == pytest.approx(pair_overdrive, rel=0.02)
    tail_voltage = 5 - 0.7 - pair_overdrive
    assert tail == pytest.approx(0.5 * mirror * overdrive**2 * (1 + 0.1 * tail_voltage), rel=0.01)
    assert amplifier.input_transconductance == pytest.approx(tail / amplifier.overdrive, rel=5e-3)
    load_overdrive = math.sqrt(tail / (0.0283 * COX * 160 / 12 * (1 + 0.1 * 1.9)))
    assert amplifier.load_transconductance == pytest.approx(tail / load_overdrive, rel=0.02)
    drawn = 200e-6 + tail + float(amplifier.output_current)
    returned = drawn - float(amplifier.offset) / 11e3  # the rest flows through the load
    assert DESIGN.power == pytest.approx(5 * (drawn + returned), rel=1e-12)


def test_the_power_is_that_of_both_supplies() -> None:
    """M5, M6 and M8 give to the negative supply what M5, M6 and M7 take from the positive one, but for the load."""
    circuit = LARGE_OFFSET.op_amp
    currents = np.abs(circuit.transistors(circuit.operating_point(), np.zeros(()))[2].current)
    positive, negative = currents[[4, 5, 6]].sum(), currents[[4, 5, 7]].sum()
    assert positive / negative > 1.15
    assert LARGE_OFFSET.power == pytest.approx(5 * (positive + negative), rel=1e-9)


def test_every_noise_source_at_the_top_electrode_by_hand() -> None:
    amplifier, noise = DESIGN.amplifier, DESIGN.noise
    gm1, gm3 = float(amplifier.input_transconductance), float(amplifier.load_transconductance)
    film, gate = 12 * EPS0 * 1e-6 / 2.5e-6, COX * 3276e-6 * 12e-6
    coupling, tau = film / (film + gate), 1e10 * (film + gate)
    share = 2 / math.pi * (math.atan(2e3 * math.pi * tau) - math.atan(0.2 * math.pi * tau))
    below, load = 1e-24 / gate / coupling**2, 1e-24 / (COX * 160e-6 * 12e-6)
    gain = float(amplifier.follower_gain)
    assert gain == pytest.approx(amplifier.open_loop_gain / (1 + amplifier.open_loop_gain), abs=1e-3)
    by_hand = {
        "bias": math.sqrt(KT / (film + gate) * share) / coupling,
        "thermal": math.sqrt(16 / 3 * KT / gm1 * (1 + gm3 / gm1) * 999.9),
        "flicker": math.sqrt(2 * (below + load * (gm3 / gm1) ** 2) * math.log(1e4)),
        "sampling": math.sqrt(KT / 10e-12) / gain,
        "quantisation": 10 / 65535 / math.sqrt(12) / gain,
    }
    with each_row() as row:
        for name, value in by_hand.items():
            with row(name):
                assert noise.sources[name] == pytest.approx(value, rel=1e-9, abs=0)
    total = math.sqrt(sum(value**2 for value in by_hand.values()))
    sensitivity = 38e-12 / film
    assert DESIGN.smallest_force == pytest.approx(3 * total / sensitivity, rel=1e-9)
    assert DESIGN.signal_to_noise == pytest.approx(20 * math.log10(sensitivity / total), rel=1e-9)


def test_noise_depends_on_the_gate_as_1_over_area_seen_from_the_film() -> None:
    small, large = (PosfetDesign(gate_width=w, film_area=1e-4).noise.flicker for w in (1e-3, 4e-3))
    assert small / large == pytest.approx(2, rel=0.12)  # a film of 4.25 nF couples by 0.98 and more


def test_sensitivities_planes_and_ranges_by_hand() -> None:
    amplifier = DESIGN.amplifier
    film, gate = 12 * EPS0 * 1e-6 / 2.5e-6, COX * 3276e-6 * 12e-6
    sensitivity, gain = 38e-12 / film, float(amplifier.follower_gain)
    assert DESIGN.output_volts_per_newton == pytest.approx(sensitivity * gain, rel=1e-12)
    assert DESIGN.amperes_per_newton == pytest.approx(amplifier.input_transconductance * sensitivity, rel=1e-12)
    at_oxide = amplifier.input_transconductance * (film + gate) / film * DESIGN.volts_per_newton(Plane.OXIDE)
    assert DESIGN.amperes_per_newton == pytest.approx(at_oxide, rel=1e-12)
    assert DESIGN.low_corner == pytest.approx(1 / (2 * math.pi * 1e10 * (film + gate)), rel=1e-12)
    assert DESIGN.largest_force == pytest.approx(amplifier.highest_input / sensitivity, rel=1e-12)
    offset = float(amplifier.offset)
    narrow = PosfetDesign(adc_low=-1.0, adc_high=0.5)
    assert narrow.largest_force == pytest.approx((0.5 - offset) / gain / sensitivity, rel=1e-12)
    turned = PosfetDesign(piezoelectric_coefficient=38e-12, adc_low=-1.0)
    assert turned.largest_force == pytest.approx((1 + offset) / gain / sensitivity, rel=1e-12)
    gates = (2 * 160 + 80 + 80 + 240 + 60 + 3276) * 12e-12
    assert DESIGN.area == pytest.approx(1e-6 + gates, rel=1e-12)
    assert DESIGN.lsb == pytest.approx(10 / 65535, rel=1e-15)


def test_the_bandwidth_is_where_the_follower_has_fallen_by_3_db() -> None:
    for design in (DESIGN, PosfetDesign(load_capacitance=1e-10), PosfetDesign(stages=1, load_resistance=1e12)):
        follower, bandwidth = design.follower(), design.amplifier.bandwidth
        assert follower.response(bandwidth).gain / follower.static_gain == pytest.approx(math.sqrt(0.5), rel=1e-9)
        assert follower.response(0.9 * bandwidth).gain / follower.static_gain > math.sqrt(0.5)


def test_the_input_range_is_that_of_the_hand_formulas() -> None:
    for stages in (1, 2):
        design = PosfetDesign(stages=stages, load_resistance=11e3 if stages == 2 else 1e12)
        circuit = design.circuit()
        hand = (figures_of_merit if stages == 2 else one_stage_figures)(circuit.bias, circuit.design).known_limits()
        assert design.amplifier.lowest_saturated_input == pytest.approx(hand.v_low, abs=0.1)
        assert design.amplifier.highest_input == pytest.approx(hand.v_high, abs=0.1)


NOT_CHANGED_BY_THICKNESS = {"gate_capacitance_f", "area_m2", "newtons_per_kelvin", "overshoot_small_signal_pct"}


def test_a_changed_thickness_changes_everything_that_depends_on_it() -> None:
    two = {"poling_voltages": (100.0,), "film_thickness": np.array([2.5e-6, 4e-6])}
    figures = report.values(PosfetDesign(**two))
    kept = {key for key, value in figures.items() if abs(value[0] - value[1]) <= 1e-9 * abs(value[0])}
    assert kept == NOT_CHANGED_BY_THICKNESS
    unloaded = PosfetDesign(**two, load_resistance=1e12)  # here M5 is the limit
    shift = np.diff(unloaded.threshold + unloaded.amplifier.overdrive)
    assert np.diff(unloaded.amplifier.lowest_input) == pytest.approx(shift, abs=5e-3)


ARRAYS: dict[str, Any] = {
    "film_thickness": np.array([1e-6, 2.5e-6, 6e-6]),
    "load_capacitance": np.array([[1e-11], [3e-10]]),
    "supply": np.array([[5.0], [1.2]]),
}


@pytest.mark.parametrize("stages", [1, 2])
def test_arrays_give_what_each_element_gives(stages: int) -> None:
    whole = PosfetDesign(**ARRAYS, stages=stages, poling_voltages=(np.array([40.0, 100.0, 300.0]), 0.0))
    assert whole.shape == (2, 3)
    every = report.values(whole)
    with each_row() as row:
        for index in np.ndindex(2, 3):
            one = whole.at(*index)
            assert one.shape == ()
            assert whole.valid[index] == one.valid
            assert whole.validity.reasons_at(*index) == one.reasons
            for key, value in report.values(one).items():
                with row(f"{key} at {index}"):
                    np.testing.assert_allclose(every[key][index], value, rtol=1e-7, atol=0)
    assert not whole.valid[1].any()
    assert whole.valid[0, 1] or stages == 1


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"supply": 1.2}, NOT_SATURATED),
        ({"poling_voltages": ()}, NOT_POLED),
        ({"signal_force": 4.0}, BEYOND_INPUT),
        ({"adc_high": 0.5}, BEYOND_ADC),
        ({"high_frequency": 1e6, "compensation": 1e-9}, TOO_STEEP),
        ({"load_resistance": 1e5, "zero_resistor": 500.0, "film_thickness": 1e-6}, "unstable"),
        ({"load_capacitance": 300e-12, "zero_resistor": 1500.0}, "phase margin below 45"),
    ],
)
def test_reasons_say_why_a_design_is_not_valid(changes: dict[str, Any], reason: str) -> None:
    assert DESIGN.valid
    assert DESIGN.reasons == []
    design = PosfetDesign(**changes)
    assert not design.valid
    assert any(text.startswith(reason) for text in design.reasons), design.reasons


def test_the_adc_has_to_see_the_output_at_rest_and_what_the_offset_leaves_of_its_range() -> None:
    """The output is offset + gain*V/N*F; a range that leaves out 0 N has no largest force."""
    for low, high in ((1.0, 5.0), (-5.0, -1.0)):
        beyond = PosfetDesign(adc_low=low, adc_high=high)
        assert REST_BEYOND_ADC in beyond.reasons
        assert report.as_json(beyond)["largest_force_n"] is None
    assert LARGE_OFFSET.reasons == []
    offset, per_newton = float(LARGE_OFFSET.amplifier.offset), float(LARGE_OFFSET.output_volts_per_newton)
    assert offset > 0.1
    assert replace(LARGE_OFFSET, adc_low=offset - 1e-6).reasons == []
    assert replace(LARGE_OFFSET, adc_low=offset + 1e-6).reasons == [REST_BEYOND_ADC]
    top = offset + per_newton * LARGE_OFFSET.signal_force
    assert replace(LARGE_OFFSET, adc_high=top + 1e-6).reasons == []
    assert replace(LARGE_OFFSET, adc_high=top - 1e-6).reasons == [BEYOND_ADC]


@pytest.mark.parametrize("load", [1e-9, 3e-9])
def test_a_mode_that_is_slow_but_hardly_there_hides_neither_overshoot_nor_settling(load: float) -> None:
    """Behind 1 Gohm Cc takes no part, but adds a mode of 46 ms to a step that settles within a microsecond."""
    behind, none = (
        PosfetDesign(load_capacitance=load, **cc) for cc in ({"zero_resistor": 1e9}, {"compensation": 1e-15})
    )
    assert behind.amplifier.overshoot == pytest.approx(float(none.amplifier.overshoot), rel=2e-3)
    assert behind.amplifier.settling_time == pytest.approx(float(none.amplifier.settling_time), rel=0.03)
    assert behind.margins_in_use.overshoot == pytest.approx(float(none.margins_in_use.overshoot), rel=0.02)
    assert behind.reasons == none.reasons != []


def test_a_netlist_that_cannot_be_written_is_refused_by_the_names_of_the_design() -> None:
    depleted = PosfetDesign(uncompensated_fraction=1.0, film_thickness=10e-6)
    with pytest.raises(ValueError, match=r"^uncompensated_fraction must move .* by at most 100 V .* got -1411\.76 V$"):
        depleted.netlist()
    with pytest.raises(ValueError, match=r"^film_area must give .* got 4\.25\d*e\+09 F/m2$"):
        PosfetDesign(film_area=1e-2, gate_width=1e-8, gate_length=1e-8).netlist()


def test_a_design_that_cannot_work_has_a_report_all_the_same() -> None:
    cut_off = PosfetDesign(reference_current=0.1, supply=0.5)
    assert not cut_off.valid
    assert math.isnan(float(cut_off.smallest_force))
    assert report.as_json(cut_off)["smallest_force_n"] is None
    tiny = PosfetDesign(film_area=1e-12, film_thickness=1e-3, film_permittivity=1.0)
    assert not tiny.valid
    both = PosfetDesign(reference_current=np.array([0.1, 2e-4]), supply=np.array([0.5, 5.0]))
    assert both.valid.tolist() == [False, True]
    assert np.isfinite(both.smallest_force).tolist() == [False, True]


def test_random_designs_have_a_report_and_unstable_ones_are_never_valid() -> None:
    generator = np.random.default_rng(0)
    names = "reference_current compensation zero_resistor load_capacitance load_resistance load_width tail_width"
    names += " output_width sink_width gate_width film_thickness film_area"
    for stages in (1, 2):
        drawn = {n: getattr(DESIGN, n) * 10 ** generator.uniform(-1.3, 1.3, 30) for n in names.split()}
        designs = PosfetDesign(**drawn, supply=generator.uniform(0.6, 10, 30), stages=stages)
        figures = report.values(designs)
        assert all(value.shape == (30,) for value in figures.values())
        valid = designs.valid
        assert 0 < valid.sum() < 30
        assert designs.amplifier.stable[valid].all()
        assert (figures["phase_margin_deg"][valid] >= 45).all()
        assert (figures["overshoot_small_signal_pct"][valid] <= 10).all()
        assert np.isfinite(figures["smallest_force_n"][valid]).all()
        assert np.isfinite(figures["lowest_input_v"][valid]).all()


def test_the_input_range_ends_where_the_follower_oscillates() -> None:
    """ngspice's phase margin 5 mV further out is negative, 5 mV further in positive (docs/design.md)."""
    loads = PosfetDesign(load_resistance=np.array([11e3, 1e6]))
    figures = report.values(loads)
    assert figures["lowest_input_v"] == pytest.approx([-1.246, figures["lowest_saturated_input_v"][1]], abs=2e-3)
    assert figures["lowest_saturated_input_v"][0] == pytest.approx(-1.792, abs=1e-3)
    assert (figures["highest_input_v"] == figures["highest_saturated_input_v"]).all()
    low = figures["lowest_input_v"][0]
    circuit = DESIGN.op_amp
    for volts, quiet in ((low, True), (low - 5e-3, False)):
        v_in = np.array(volts)
        assert circuit.stable(circuit.operating_point(v_in), v_in) == quiet
    # The largest force, and validity, are those of the tighter range.
    pull = PosfetDesign(piezoelectric_coefficient=38e-12, signal_force=1.6)
    assert pull.largest_force == pytest.approx(-low / float(-pull.volts_per_newton()), rel=1e-6)
    assert pull.reasons[:2] == [OSCILLATES, LOW_MARGIN_IN_USE]
    # 66 degrees at -0.5 V, 32 at -1 V: what the force reaches is judged, not only 0 V.
    assert replace(pull, signal_force=1.1).reasons == [LOW_MARGIN_IN_USE, RINGS_IN_USE]
    assert replace(pull, signal_force=0.5).reasons == []
    least = report.values(replace(pull, signal_force=np.array([0.01, 0.5, 1.0 / float(-pull.volts_per_newton())])))
    assert least["least_phase_margin_deg"] == pytest.approx([82.0, 68.7, 32.2], abs=0.5)
    assert least["phase_margin_deg"] == pytest.approx(82.1, abs=0.1)
    assert BEYOND_INPUT in replace(pull, signal_force=2.2).reasons
    limits = pull.linear_follower().limits
    assert limits.v_low == pytest.approx(-0.70, abs=0.03) and limits.v_high == figures["highest_input_v"][0]
    margins = circuit_figures(circuit, np.array([limits.v_low, limits.v_low - 0.05]))
    assert margins.overshoot[0] <= 0.1 < margins.overshoot[1]


def test_every_stated_input_range_is_stable() -> None:
    generator = np.random.default_rng(4)
    names = "reference_current compensation zero_resistor load_capacitance load_resistance output_width film_thickness"
    drawn = {n: getattr(DESIGN, n) * 10 ** generator.uniform(-0.7, 0.7, 40) for n in names.split()}
    designs = PosfetDesign(**drawn)
    low, high = designs.amplifier.lowest_input, designs.amplifier.highest_input
    known = np.isfinite(low)
    assert known.sum() > 10 and (low > designs.amplifier.lowest_saturated_input)[known].sum() > 5
    assert np.isnan(low[~designs.amplifier.stable]).all() and designs.amplifier.stable[known].all()
    for share in np.linspace(0, 1, 9):
        v_in = np.where(known, low + share * (high - low), 0.0)
        assert designs.op_amp.stable(designs.op_amp.operating_point(v_in), v_in)[known].all()


def test_the_overshoot_of_50_mv_is_not_that_of_a_small_step() -> None:
    design = PosfetDesign(film_geometry=FilmGeometry.AS_IN_PAPER, load_capacitance=300e-12)
    numbers = report.as_json(design)
    follower = design.follower()
    assert numbers["overshoot_small_signal_pct"] == pytest.approx(100 * float(follower.figures.overshoot))
    assert numbers["overshoot_pct"] == pytest.approx(100 * step_test(follower, 0.05).overshoot)
    assert 1 < numbers["overshoot_small_signal_pct"] - numbers["overshoot_pct"] < 10
    assert "overshoot_pct" not in report.values(design)


def test_an_output_without_load_is_that_with_a_tiny_one() -> None:
    none, tiny = (PosfetDesign(load_capacitance=farad).amplifier for farad in (0.0, 1e-15))
    assert none.gain_bandwidth == pytest.approx(tiny.gain_bandwidth, rel=1e-3)
    assert none.phase_margin == pytest.approx(tiny.phase_margin, abs=0.1)


def test_an_unstable_design_has_no_overshoot_and_never_settles() -> None:
    design = PosfetDesign(load_resistance=1e5, zero_resistor=500.0, film_thickness=1e-6)
    numbers = report.as_json(design)
    assert numbers["stable"] is numbers["valid"] is False
    assert numbers["phase_margin_deg"] < 0
    assert numbers["overshoot_pct"] is numbers["settling_time_s"] is None


def test_every_circuit_of_the_comparison_with_spice_is_a_design() -> None:
    """Its netlist is that of the circuit's own data."""
    for name in ("two_stage_narrow_pair_50pf", "one_stage_10mhz"):
        circuit = CIRCUITS[name]
        bias = circuit.bias
        design = PosfetDesign(
            film_geometry=FilmGeometry.AS_IN_PAPER,
            stages=circuit.stages,
            gate_width=circuit.design.size("M1").width,
            reference_current=bias.reference_current,
            compensation=bias.compensation,
            zero_resistor=bias.zero_resistor,
            load_capacitance=bias.load_capacitance,
            load_resistance=bias.load_resistance,
            channel_length_modulation=bias.modulation,
        )
        assert design.netlist(name).splitlines()[6:] == subcircuit(circuit).splitlines()[6:]


def test_a_netlist_is_of_one_design_only() -> None:
    with pytest.raises(ValueError, match=r"must be a single one, got arrays of shape \(2,\)"):
        PosfetDesign(supply=np.array([5.0, 4.0])).netlist()
    text = DESIGN.netlist("finger")
    assert text.startswith("* Two-stage Miller op-amp with POSFET inputs: finger\n")
    assert "iref vdd bias 0.0002" in text
    # Film and oxide in series as one oxide: 45 nm over the coupling.
    thickness = float(text.split("tox=")[1].split()[0])
    assert thickness == pytest.approx(45e-9 / 0.58486, rel=1e-4)


def test_a_poled_film_moves_the_threshold_in_the_netlist() -> None:
    virgin = PosfetDesign(poling_voltages=())
    assert "posfet nmos (level=1 vto=0.985714286 " in virgin.netlist()
    assert "nfet nmos (level=1 vto=0.7 " in virgin.netlist()


WRONG_UNITS = {
    "reference_current": (200.0, "uA"),
    "compensation": (46.2, "pF"),
    "load_capacitance": (10.0, "pF"),
    "sampling_capacitance": (10.0, "pF"),
    "hole_mobility": (283.0, "cm2/(V s)"),
    "load_width": (160.0, "um"),
    "sink_length": (12.0, "um"),
}


@pytest.mark.parametrize("name", WRONG_UNITS)
def test_a_number_in_another_unit_is_refused_with_both_units(name: str) -> None:
    number, unit = WRONG_UNITS[name]
    with pytest.raises(ValueError, match=rf"^{name} must be in .* got {number:g}; meant in ") as caught:
        PosfetDesign(**{name: number})
    assert f"{number:g} {unit} is" in str(caught.value)


def test_a_temperature_in_degrees_celsius_is_refused() -> None:
    with pytest.raises(ValueError, match=r"temperature must be in .* K, got 25; in degC it is 298.15 K"):
        PosfetDesign(temperature=25.0)


def test_invalid_values_are_rejected_by_name() -> None:
    with each_row() as row:
        for name in plausible_fields(PosfetDesign):
            for value in (*NOT_REAL_NUMBERS, 1e30):
                with row(f"{name} {value!r}"):
                    assert_refused(PosfetDesign, {name: value}, name)
    for stages in (0, 3, 2.0, "two"):
        assert_refused(PosfetDesign, {"stages": stages}, "stages")
    assert_refused(PosfetDesign, {"adc_low": 5.0}, "adc_high")
    assert_refused(PosfetDesign, {"low_frequency": 1e3}, "high_frequency")


def test_every_default_that_is_not_the_papers_is_called_assumed() -> None:
    quantities = [item.metadata["quantity"] for item in dataclasses.fields(PosfetDesign) if item.metadata]
    assert len(quantities) >= 44
    known = {q.name for q in quantities if not q.assumed}
    assert {"film thickness", "electron mobility", "channel width of the POSFET"} <= known
    assert all(q.source and q.unit for q in quantities)
    for q in quantities:
        assert q.assumed or "Table" in q.source or "text" in q.source or "Manual" in q.source, q.name
