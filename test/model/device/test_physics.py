# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Laws that any correct model of the device obeys: units, conservation, causality, limiting cases."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from posfet_model.amplifier import follower, one_stage, two_stage
from posfet_model.device import as_printed, charge, film, mechanics, noise, paper, taxel, transistor
from posfet_model.device.noise import band, density
from posfet_model.device.transistor import Plane

M, KG, S, A, K = np.eye(5)
NONE = np.zeros(5)
N, HZ, C = M + KG - 2 * S, -S, A + S
V, F = N + M - C, 2 * C - N - M
OHM, PA, MOBILITY = V - A, N - 2 * M, 2 * M - V - S
FACTORS = np.array([1.7, 2.3, 0.6, 1.9, 1.2])
"""Number of new units of m, kg, s, A and K in one SI unit."""

Value = tuple[float, np.ndarray]


def in_new_units(value: float, unit: np.ndarray) -> float:
    return value * float(np.prod(FACTORS**unit))


def lengths(**values: float) -> dict[str, Value]:
    return {name: (value, M) for name, value in values.items()}


PLATE = {**lengths(thickness=5e-5), "young_modulus": (169e9, PA), "poisson_ratio": (0.3, NONE)}
BIAS = {
    "gate_voltage": (2.0, V),
    "drain_voltage": (0.9, V),
    "threshold_voltage": (0.7, V),
    "gain_factor": (1e-3, A - 2 * V),
    "channel_length_modulation": (0.1, -V),
}
STEP = {
    "charge": (3e-6, C - 2 * M),
    "source_start": (1e-6, C - 2 * M),
    "source_end": (1e-5, C - 2 * M),
    "step": (0.1, S),
    "time_constant": (0.27, S),
}
BAND = {"low": (0.1, HZ), "high": (1e3, HZ)}
CONDUCTANCES = {"input_transconductance": (5e-4, A - V), "load_transconductance": (3e-4, A - V)}
FILM = {
    "coercive_field": (160e5, V - M),
    "remnant_polarisation": (0.02, C - 2 * M),
    "saturation_polarisation": (0.05, C - 2 * M),
}
TAXEL = {
    **lengths(film_thickness=2.5e-6, gate_width=3e-3, gate_length=12e-6, oxide_thickness=45e-9),
    "film_area": (1e-6, 2 * M),
    "film_permittivity": (12.0, NONE),
    "piezoelectric_coefficient": (-38e-12, C - N),
    "pyroelectric_coefficient": (-4e-5, C - 2 * M - K),
    "electron_mobility": (0.085, MOBILITY),
    "bias_resistance": (1e10, OHM),
    **FILM,
}
OP_AMP_BIAS = {
    "reference_current": (200e-6, A),
    "supply": (5.0, V),
    "compensation": (46.2e-12, F),
    "zero_resistor": (2631.0, OHM),
    "load_capacitance": (1e-11, F),
    "load_resistance": (11e3, OHM),
    "modulation": (0.1, -V),
    "threshold": (0.5, V),
}
STACK = {"oxide": (7.7e-4, F - 2 * M), "film": (4.2e-5, F - 2 * M)}
MOBILITIES = {"electron_mobility": (0.085, MOBILITY), "hole_mobility": (0.0283, MOBILITY)}
OP_AMP_RESULTS = {
    "overdrive": V,
    "input_transconductance": A - V,
    "open_loop_gain": NONE,
    "dominant_pole": HZ,
    "second_pole": HZ,
    "slew_rate": V - S,
}


def branch(field: float, **properties: float) -> Any:
    return film.rising_branch(field, film.Film(relative_permittivity=12.0, **properties))


def op_amp(figures: Callable[..., Any], **values: float) -> Any:
    """Return the op-amp with the sizes of Table II in the new metre if the stack is given in it."""
    metre = values.pop("metre")
    sizes = tuple(
        dataclasses.replace(size, width=metre * size.width, length=metre * size.length)
        for size in paper.AMPLIFIER_SIZES
    )
    stack = transistor.Stack(**{name: values.pop(name) for name in STACK})
    design = two_stage.AmplifierDesign(sizes, stack, **{name: values.pop(name) for name in MOBILITIES})
    return figures(two_stage.AmplifierBias(**values), design)


CASES: dict[str, tuple[Callable[..., Any], dict[str, Value], dict[str, np.ndarray]]] = {
    "capacitance": (
        transistor.capacitance_per_area,
        {"relative_permittivity": (12.0, NONE), "thickness": (2.5e-6, M)},
        {"": F - 2 * M},
    ),
    "gain factor": (
        transistor.gain_factor,
        {"mobility": (0.085, MOBILITY), "capacitance": (4e-5, F - 2 * M), **lengths(width=3e-3, length=12e-6)},
        {"": A - 2 * V},
    ),
    "drain current": (transistor.drain_current, BIAS, {"": A}),
    "saturated drain current": (transistor.drain_current, {**BIAS, "drain_voltage": (3.0, V)}, {"": A}),
    "transconductance": (transistor.transconductance, BIAS, {"": A - V}),
    "output conductance": (transistor.output_conductance, BIAS, {"": A - V}),
    "gate voltage": (
        transistor.gate_voltage,
        {**{name: value for name, value in BIAS.items() if name != "gate_voltage"}, "drain_current": (1e-3, A)},
        {"": V},
    ),
    "branch": (branch, {"field": (2e7, V - M), **FILM}, {"": C - 2 * M}),
    "source charge": (
        charge.source_charge,
        {
            "stress": (-1e6, PA),
            "temperature_change": (2.0, K),
            "piezoelectric_coefficient": (-38e-12, C - N),
            "pyroelectric_coefficient": (-4e-5, C - 2 * M - K),
        },
        {"": C - 2 * M},
    ),
    "displacement": (
        charge.electric_displacement,
        {
            "stress": (-1e6, PA),
            "field": (1e7, V - M),
            "piezoelectric_coefficient": (-38e-12, C - N),
            "relative_permittivity": (12.0, NONE),
        },
        {"": C - 2 * M},
    ),
    "displacement as printed": (
        as_printed.electric_displacement,
        {
            "stress": (-1e6, PA),
            "piezoelectric_coefficient": (-38e-12, C - N),
            "relative_permittivity": (12.0, NONE),
        },
        {"": C - 2 * M},
    ),
    "charge after a step": (charge.propagate_first_order_hold, STEP, {"": C - 2 * M}),
    "circular membrane": (
        mechanics.circular_deflection,
        {"pressure": (1e3, PA), **lengths(radius=5e-3), **PLATE},
        {"deflection": M},
    ),
    "square membrane": (
        mechanics.square_deflection,
        {"pressure": (1e3, PA), **lengths(side=1e-2), **PLATE},
        {"deflection": M},
    ),
    "pair noise": (noise.pair_density, {**CONDUCTANCES, "temperature": (300.0, K)}, {"": 2 * V - HZ}),
    "bias noise": (
        noise.bias_resistor_rms,
        {"resistance": (1e10, OHM), "capacitance": (42e-12, F), "temperature": (300.0, K), **BAND},
        {"": V},
    ),
    "flicker noise": (noise.flicker_rms, {"coefficient": (1e-10, 2 * V), **BAND}, {"": V}),
    "taxel": (
        taxel.Taxel,
        TAXEL,
        {
            "film_capacitance": F,
            "gate_capacitance": F,
            "coupling": NONE,
            "leak_time_constant": S,
            "newtons_per_kelvin": N - K,
            "poling_shift": V,
        },
    ),
    "taxel's sensitivity": (lambda **values: taxel.Taxel(**values).volts_per_newton(), TAXEL, {"": V - N}),
    "taxel's gain factor": (lambda **values: taxel.Taxel(**values).gain_factor(), TAXEL, {"": A - 2 * V}),
    "taxel's noise": (
        lambda low, high, temperature, **values: taxel.Taxel(**values).bias_noise(low, high, temperature),
        {**TAXEL, **BAND, "temperature": (300.0, K)},
        {"": V},
    ),
    "two stages": (
        lambda **values: op_amp(two_stage.figures_of_merit, **values),
        {**OP_AMP_BIAS, **STACK, **MOBILITIES, "metre": (1.0, M)},
        {**OP_AMP_RESULTS, "falling_slew_rate": V - S, "bend": V, "systematic_offset": V},
    ),
    "one stage": (
        lambda **values: op_amp(one_stage.one_stage_figures, **values),
        {**OP_AMP_BIAS, **STACK, **MOBILITIES, "metre": (1.0, M)},
        OP_AMP_RESULTS,
    ),
}


def results_of(function: Callable[..., Any], arguments: dict[str, float], names: Iterable[str]) -> dict[str, float]:
    answer = function(**arguments)
    return {name: float(getattr(answer, name) if name else answer) for name in names}


def in_other_units(name: str, patch: pytest.MonkeyPatch) -> list[tuple[float, float]]:
    """Return each result of a case computed in the new units, and the SI result converted to them."""
    function, arguments, results = CASES[name]
    before = results_of(function, {argument: value for argument, (value, _) in arguments.items()}, results)
    for module in (as_printed, film, transistor, charge):
        patch.setattr(module, "VACUUM_PERMITTIVITY", in_new_units(module.VACUUM_PERMITTIVITY, F - M))
    for module in (band, density):
        patch.setattr(module, "BOLTZMANN", in_new_units(module.BOLTZMANN, N + M - K))
    after = results_of(function, {argument: in_new_units(*value) for argument, value in arguments.items()}, results)
    return [(after[result], in_new_units(before[result], unit)) for result, unit in results.items()]


@pytest.mark.parametrize("name", [name for name in CASES if name != "displacement as printed"])
def test_results_are_independent_of_the_units(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A formula that adds different units, or hides a constant with a unit, fails when all units change."""
    for calculated, converted in in_other_units(name, monkeypatch):
        assert calculated == pytest.approx(converted, rel=1e-11, abs=0)


def test_the_misprint_of_eq_1_depends_on_the_units(monkeypatch: pytest.MonkeyPatch) -> None:
    [(calculated, converted)] = in_other_units("displacement as printed", monkeypatch)
    assert abs(calculated / converted - 1) > 0.1


fields = st.lists(st.floats(-8e7, 8e7), min_size=1, max_size=6)


@settings(max_examples=60, deadline=None)
@given(fields=fields)
def test_a_film_never_returns_more_energy_than_it_received(fields: list[float]) -> None:
    """Over a closed cycle the integral of E*dP is heat: positive or 0 by the second law."""
    cycle = np.array([0.0, *fields, 0.0])
    fine = np.concatenate([np.linspace(a, b, 100)[1:] for a, b in itertools.pairwise(cycle)])
    once = film.polarise(fine, paper.FILM)
    again = film.polarise(fine, paper.FILM, once.history)
    polarisation = np.array([once.polarisation[-1], *again.polarisation])
    assert polarisation[-1] == pytest.approx(polarisation[0], abs=1e-14)  # the second cycle closes
    field = np.array([0.0, *fine])
    work = 0.5 * (field[1:] + field[:-1]) * np.diff(polarisation)
    rounding = 1e-15 * np.abs(field).max() * paper.FILM.saturation_polarisation
    assert work.sum() >= -1e-9 * np.abs(work).sum() - rounding


def test_charge_is_conserved() -> None:
    """The charge of the source is on the gate or has leaked; the leakage current is sigma/tau."""
    tau, step = 0.27, 1e-3
    source = 4e-5 * np.sin(np.linspace(0, 9, 4001)) ** 2
    density = np.zeros(source.size)
    for k in range(1, source.size):
        density[k] = charge.propagate_first_order_hold(density[k - 1], source[k - 1], source[k], step, tau)
    leaked = np.sum(0.5 * (density[1:] + density[:-1])) * step / tau
    assert density[-1] + leaked == pytest.approx(source[-1] - source[0], abs=1e-10)


LINEAR = [
    follower.OnePoleFollower(gain=0.99, bandwidth=1e6),
    follower.TwoPoleFollower(gain=0.99, natural_frequency=1e6, quality=0.4),
    follower.TwoPoleFollower(gain=0.99, natural_frequency=1e6, quality=2.0),
]


@pytest.mark.parametrize("model", LINEAR)
def test_step_response_and_frequency_response_agree(model: follower.Follower) -> None:
    """H(f) is the transform of the impulse response, the slope of the step response."""
    time = np.linspace(0, 1e-5, 100001)
    answer = model.run(np.r_[0.0, time], np.r_[0.0, np.ones(time.size)]).v_out[1:]
    left = model.static_gain - answer  # H(s) = gain - s*integral of left*exp(-s*t)
    for frequency in (1e4, 3e5, 1e6, 3e6):
        s = 2j * math.pi * frequency
        wave = left * np.exp(-s * time)
        transform = model.static_gain - s * np.sum(0.5 * (wave[1:] + wave[:-1])) * time[1]
        response = model.response(frequency)
        exact = complex(response.gain) * np.exp(1j * float(response.phase))
        assert abs(transform - exact) < 2e-6


def test_leakage_in_time_and_frequency_domain_agrees() -> None:
    """The high pass is 1 minus the transform of the leakage current after a step of the source."""
    tau = 0.27
    time = np.linspace(0, 10, 200001)
    for frequency in (0.05, 0.59, 10.0):
        wave = charge.step_response(time, tau) / tau * np.exp(-2j * math.pi * frequency * time)
        transform = 1 - np.sum(0.5 * (wave[1:] + wave[:-1])) * time[1]
        assert abs(transform - charge.frequency_response(frequency, tau)) < 1e-6


@pytest.mark.parametrize("model", LINEAR)
def test_real_and_imaginary_part_obey_kramers_and_kronig(model: follower.Follower) -> None:
    """Causality: ``Re H(f) = 2/pi*P integral of x*Im H(x)/(f^2 - x^2)``, at points between x."""
    decades = np.linspace(-6, 6, 400001)
    x = 1e6 * 10.0 ** (0.5 * (decades[1:] + decades[:-1]))
    response = model.response(x)
    imaginary = response.gain * np.sin(response.phase)
    width = x * math.log(10) * (decades[1] - decades[0])
    for place in (150_000, 200_000, 230_000):
        frequency = 1e6 * 10.0 ** decades[place]  # half-way between two x, which gives the principal value
        real = 2 / math.pi * np.sum(x * imaginary / (frequency**2 - x**2) * width)
        exact = model.response(frequency)
        assert real == pytest.approx(float(exact.gain * np.cos(exact.phase)), abs=1e-4)


@pytest.mark.parametrize("modulation", [0.0, 0.1])
def test_currents_first_derivatives_are_continuous_at_the_edge_of_saturation(modulation: float) -> None:
    edge = (2.0, 1.3, 0.7, 1e-3, modulation)  # Vds = Vgs - Vth
    for conductance in (transistor.transconductance, transistor.output_conductance):
        at = float(conductance(*edge))
        for offset in (-1e-9, 1e-9):
            beside = conductance(2.0, 1.3 + offset, *edge[2:])
            assert beside == pytest.approx(at, abs=2e-12)  # the second derivative is about beta


@pytest.mark.parametrize("drain", [0.4, 3.0])
def test_mixed_derivatives_of_the_current_agree(drain: float) -> None:
    """The derivative of gm with respect to the drain voltage equals that of gds with respect to the gate voltage."""
    h, rest = 1e-5, (0.7, 1e-3, 0.1)
    gm = [float(transistor.transconductance(2.0, drain + d, *rest)) for d in (-h, h)]
    gds = [float(transistor.output_conductance(2.0 + d, drain, *rest)) for d in (-h, h)]
    assert gm[1] - gm[0] == pytest.approx(gds[1] - gds[0], abs=1e-15)


def test_the_planes_agree_for_a_thick_film() -> None:
    """With a film of no capacitance all charge is in the channel; 1 % of the oxide capacitance gives 1 % error."""
    for ratio in (1e-2, 1e-6):
        stack = transistor.Stack(oxide=7.7e-4, film=7.7e-4 * ratio)
        currents = [stack.drive(plane) * float(transistor.threshold_shift(1e-5, stack, plane, 1.0)) for plane in Plane]
        assert currents[1] / currents[0] - 1 == pytest.approx(ratio, rel=1e-9, abs=0)
    thin = transistor.Stack(oxide=1e-6, film=1e3)
    assert thin.series == pytest.approx(thin.oxide, rel=1e-8, abs=0)


def test_noise_powers_of_adjacent_bands_add_up() -> None:
    """White, 1/f and bias noise: the squares of adjacent bands add, for any boundary between them."""
    edges = [0.1, 0.37, 5.0, 88.0, 1e3]

    def budget(low: float, high: float) -> noise.NoiseBudget:
        bias = taxel.Taxel().bias_noise(low, high)
        return noise.noise_budget(bias, 1e-16, 1e-10, 0.0, 0.9, low, high)

    whole = budget(edges[0], edges[-1])
    parts = [budget(*ends) for ends in itertools.pairwise(edges)]
    for name in ("bias", "thermal", "flicker", "total"):
        squares = sum(getattr(part, name) ** 2 for part in parts)
        assert squares == pytest.approx(getattr(whole, name) ** 2, rel=1e-12, abs=0)
