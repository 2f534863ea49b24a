"""Hand formulas of the amplifier: against 40 digits, against ngspice (stored) and against their limits."""

import dataclasses
import math

import numpy as np
import pytest
from model.spice_data import small_signal, transient
from model.sweep import NOT_REAL_NUMBERS, ErrorMap, assert_refused, reference, refusals

from posfet_model.amplifier import AmplifierBias, figures_of_merit, mismatch_offset
from posfet_model.spice import closed_loop

EPS = np.finfo(np.float64).eps
FIGURES = figures_of_merit()


def test_every_figure_against_the_40_digit_table(record_property) -> None:
    table = reference("amplifier")
    inputs, outputs = list(table)[:8], list(table)[8:]
    found = ErrorMap(bound=8 * EPS)
    for row in zip(*table.values(), strict=True):
        bias, exact = map(float, row[: len(inputs)]), dict(zip(outputs, row[len(inputs) :], strict=True))
        figures = figures_of_merit(AmplifierBias(*bias))
        # The offset is a difference of overdrives, divided by the first gain.
        scales = {**exact, "systematic_offset": exact["overdrive"] / exact["first_gain"]}
        for name in outputs:
            found.add(name, (getattr(figures, name) - exact[name]) / scales[name])
    found.check(record_property)


def test_gain_and_pole_against_ngspice() -> None:
    open_loop = small_signal("opamp_b", "open_loop")
    gain = abs(open_loop.transfer[0])
    assert FIGURES.open_loop_gain / gain == pytest.approx(1, abs=0.02)
    assert FIGURES.dominant_pole / closed_loop(open_loop).bandwidth == pytest.approx(1, abs=0.03)
    unity = float(np.interp(0, -np.log(abs(open_loop.transfer)), open_loop.frequency))
    assert FIGURES.gain_bandwidth / unity == pytest.approx(1, abs=0.03)


def test_offset_against_ngspice() -> None:
    assert FIGURES.systematic_offset == pytest.approx(transient("opamp_b", "press").v_out[0], abs=5e-5)


def test_the_missing_width_of_m8_leaves_little_systematic_offset() -> None:
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


def test_follower_of_the_figures() -> None:
    loop = FIGURES.closed_loop
    assert loop.gain == pytest.approx(FIGURES.open_loop_gain / (1 + FIGURES.open_loop_gain), abs=1e-15)
    assert FIGURES.limits.v_low < -1 < 3 < FIGURES.limits.v_high
    assert FIGURES.limits.frequency == FIGURES.second_pole > 3 * FIGURES.gain_bandwidth


def test_mismatch_adds_up() -> None:
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
def test_a_bias_that_is_none_is_named(value) -> None:
    assert_refused(figures_of_merit, {"bias": value}, "bias")


def test_a_supply_too_low_is_refused() -> None:
    assert_refused(figures_of_merit, {"bias": AmplifierBias(supply=1.2)}, "supply")


@pytest.mark.parametrize("argument", [field.name for field in dataclasses.fields(AmplifierBias)])
@pytest.mark.parametrize("value", [-1.0, *NOT_REAL_NUMBERS])
def test_bad_bias_is_named(argument: str, value) -> None:
    assert_refused(AmplifierBias, {argument: value}, argument)


MISMATCH = {"figures": FIGURES, "pair_threshold": 0.0, "load_threshold": 0.0, "pair_size": 0.0, "load_size": 0.0}


@pytest.mark.parametrize(
    ("function", "arguments", "argument"),
    [
        *refusals(
            mismatch_offset,
            MISMATCH,
            figures=[],
            pair_threshold=[2.0],
            load_threshold=[-2.0],
            pair_size=[0.6],
            load_size=[0.6],
        )
    ],
)
def test_bad_arguments_are_named(function, arguments, argument) -> None:
    assert_refused(function, arguments, argument)
