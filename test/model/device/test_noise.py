# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Noise: closed forms against 40-digit references, a generator against its spectrum, and the smallest force."""

import math

import numpy as np
import pytest

from posfet_model.amplifier.two_stage import figures_of_merit
from posfet_model.device import noise, paper
from posfet_model.device.taxel import Taxel
from support.sweep import (
    EPS,
    assert_all_refused,
    assert_finite,
    assert_monotone,
    assert_refused,
    call_error,
    reference,
    refusals,
)


def test_closed_forms_against_the_40_digit_table() -> None:
    table = reference("noise")
    density = noise.pair_density(table["gm1"], table["gm3"], table["temperature"])
    np.testing.assert_allclose(density / table["pair_density"], 1, rtol=0, atol=8 * EPS)
    white = [noise.white_rms(1.0, low, high) for low, high in zip(table["low"], table["high"], strict=True)]
    np.testing.assert_allclose(np.array(white) / table["white_rms"], 1, rtol=0, atol=2 * EPS)
    flicker = [noise.flicker_rms(1.0, low, high) for low, high in zip(table["low"], table["high"], strict=True)]
    # The square root halves the error of the logarithm, of the two roundings of its argument and of the product.
    atol = (call_error() + 1.5 * EPS) / 2 + EPS
    np.testing.assert_allclose(np.array(flicker) / table["flicker_rms"], 1, rtol=0, atol=atol)


def test_bias_resistor_against_the_integral_to_40_digits() -> None:
    table = reference("bias_noise")
    arguments = [table[name] for name in ("resistance", "capacitance", "temperature", "low", "high")]
    computed = np.array([noise.bias_resistor_rms(*row) for row in zip(*arguments, strict=True)])
    # Under the root: the arctangent, 6 roundings of its first argument, 9 of its second, 5 of the factors before it.
    atol = (call_error() + 20 * EPS / 2) / 2 + EPS
    np.testing.assert_allclose(computed / table["bias_rms"], 1, rtol=0, atol=atol)


def test_bias_resistor_noise_over_all_frequencies_is_kt_over_c() -> None:
    for resistance in (1e3, 1e6, 1e10):
        whole = noise.bias_resistor_rms(resistance, 27e-12, 300.0, 0.0, 1e15)
        assert whole == pytest.approx(math.sqrt(1.380649e-23 * 300 / 27e-12), abs=1e-12)
    # Far above the corner the mean square falls as 1/R: a larger resistor is quieter.
    loud, quiet = (noise.bias_resistor_rms(resistance, 27e-12, 300.0, 10.0, 1000.0) for resistance in (1e10, 1e12))
    assert loud / quiet == pytest.approx(10, abs=0.02)


def test_the_bias_resistor_dominates_the_amplifiers_thermal_noise() -> None:
    capacitance = paper.LEAK_TIME_CONSTANT.value / paper.BIAS_RESISTANCE.value
    assert noise.bias_resistor_rms(10e9, 26.6e-12, 300.0, 0.1, 1000.0) == pytest.approx(11.8e-6, abs=5e-8)
    bias = noise.bias_resistor_rms(paper.BIAS_RESISTANCE.value, capacitance, 300.0, 0.1, 1000.0)
    assert bias > 40 * noise.white_rms(5.8e-17, 0.1, 1000.0)


def test_a_resistor_at_room_temperature() -> None:
    assert math.sqrt(noise.resistor_density(1e3, 300.0)) == pytest.approx(4.0704e-9, abs=1e-13)
    assert noise.quantisation_rms(math.sqrt(12)) == pytest.approx(1, abs=2 * EPS)


def test_rounding_of_a_moving_signal_has_the_quantisation_rms() -> None:
    volts = np.linspace(0, 1000.5, 1_000_001)
    assert np.std(np.rint(volts) - volts) == pytest.approx(noise.quantisation_rms(1.0), abs=1e-5)


class TestFlickerSequence:
    COEFFICIENT, RATE, SAMPLES = 2e-9, 1000.0, 4096

    def _periodograms(self, count: int, samples: int) -> np.ndarray:
        generator = np.random.default_rng(7)
        records = [noise.flicker_sequence(self.COEFFICIENT, self.RATE, samples, generator) for _ in range(count)]
        return 2 * np.abs(np.fft.rfft(records)) ** 2 / (self.RATE * samples)

    @pytest.mark.parametrize("samples", [4096, 4095])
    def test_mean_periodogram_is_the_stated_spectrum(self, samples: int) -> None:
        count = 400
        power = self._periodograms(count, samples)[:, 1:]
        frequency = np.fft.rfftfreq(samples, 1 / self.RATE)[1:]
        ratio = power.mean(axis=0) * frequency / self.COEFFICIENT
        # Each bin has a standard deviation of 1/sqrt(count); 5.5 times that is exceeded once in 1e7. The mean over bins
        # is far more precise.
        assert np.abs(ratio - 1).max() <= 5.5 * math.sqrt(2 / count)
        assert np.mean(ratio[:-1]) == pytest.approx(1, abs=5 / math.sqrt(count * ratio.size))

    def test_rms_equals_that_of_the_band(self) -> None:
        generator = np.random.default_rng(8)
        records = [noise.flicker_sequence(1.0, self.RATE, self.SAMPLES, generator) for _ in range(200)]
        low = self.RATE / self.SAMPLES
        # The sum of 1/m over the bins is ln(n) + 0.577, the integral over the band ln(n): half a bin more at the
        # low end.
        expected = math.sqrt(np.sum(1 / np.arange(1, self.SAMPLES // 2 + 1)))
        assert np.sqrt(np.mean(np.square(records))) == pytest.approx(expected, abs=0.05 * expected)
        assert noise.flicker_rms(1.0, low / 2, self.RATE / 2) == pytest.approx(expected, abs=0.03 * expected)

    def test_the_seed_determines_the_record(self) -> None:
        records = [noise.flicker_sequence(1.0, 1.0, 64, np.random.default_rng(seed)) for seed in (1, 1, 2)]
        np.testing.assert_array_equal(records[0], records[1])
        assert not np.array_equal(records[0], records[2])

    @pytest.mark.parametrize("samples", [2, 3, 1000])
    def test_mean_is_zero(self, samples: int) -> None:
        record = noise.flicker_sequence(1.0, 1.0, samples, np.random.default_rng(9))
        assert record.shape == (samples,)
        assert abs(record.mean()) <= 1e-13


def test_smallest_force_of_the_published_device() -> None:
    per_newton = Taxel().volts_per_newton()
    assert per_newton == pytest.approx(0.8941, abs=1e-4)
    amplifier = figures_of_merit()
    density = noise.pair_density(amplifier.input_transconductance, amplifier.load_transconductance, 300.0)
    bias = noise.bias_resistor_rms(10e9, 27e-12, 300.0, 1.0, 500.0)
    budget = noise.noise_budget(bias, float(density), 1e-10, 5.0 / 65535, float(per_newton), 1.0, 500.0)
    assert budget.thermal == pytest.approx(math.sqrt(float(density) * 499), abs=1e-15)
    squares = budget.bias**2 + budget.thermal**2 + budget.flicker**2 + budget.quantisation**2
    assert budget.bias == bias > 0
    assert budget.total**2 == pytest.approx(squares, abs=1e-18)
    assert budget.minimum_force() == pytest.approx(3 * budget.total / 0.8941, abs=1e-7)
    deaf = noise.noise_budget(0.0, float(density), 0.0, 0.0, 0.0, 1.0, 500.0)
    assert deaf.minimum_force() == math.inf


def test_arrays_give_what_each_element_gives() -> None:
    ohms, farad, high = np.array([[1e8], [1e10]]), np.array([20e-12, 70e-12, 200e-12]), np.array([10.0, 1e3, 1e6])
    whole = noise.noise_budget(
        noise.bias_resistor_rms(ohms, farad, 300.0, 0.1, high), 1e-16 * ohms / 1e8, 1e-14, 1e-4, farad, 0.1, high
    )
    for i in range(2):
        for j in range(3):
            one = noise.noise_budget(
                noise.bias_resistor_rms(ohms[i, 0], farad[j], 300.0, 0.1, high[j]),
                1e-16 * ohms[i, 0] / 1e8,
                1e-14,
                1e-4,
                farad[j],
                0.1,
                high[j],
            )
            assert whole.total[i, j] == one.total
            assert whole.minimum_force()[i, j] == one.minimum_force()
            assert whole.signal_to_noise(2.0)[i, j] == one.signal_to_noise(2.0)


def test_every_source_of_the_budget_by_hand() -> None:
    kelvin, gain = 310.0, 0.98
    kt = 1.380649e-23 * kelvin
    flicker = float(noise.gate_flicker_coefficient(2e-24, 1e-3, 10e-6, 1e-3))
    assert flicker == pytest.approx(2e-24 / (1e-3 * 10e-6 * 1e-3), rel=1e-15, abs=0)
    sampled = noise.sampling_rms(5e-12, kelvin)
    assert sampled == pytest.approx(math.sqrt(kt / 5e-12), rel=1e-15, abs=0)
    budget = noise.noise_budget(3e-6, 4e-16, flicker, 10 / 4095, 0.5, 0.1, 100.0, gain=gain, sampled_rms=sampled)
    by_hand = {
        "bias": 3e-6,
        "thermal": math.sqrt(4e-16 * 99.9),
        "flicker": math.sqrt(2e-13 * math.log(1000)),
        "sampling": math.sqrt(kt / 5e-12) / gain,
        "quantisation": 10 / 4095 / math.sqrt(12) / gain,
    }
    assert {name: float(value) for name, value in budget.sources.items()} == pytest.approx(by_hand, rel=1e-14, abs=0)
    total = math.sqrt(sum(value**2 for value in by_hand.values()))
    assert budget.total == pytest.approx(total, rel=1e-14, abs=0)
    assert budget.signal_to_noise(0.2) == pytest.approx(20 * math.log10(0.2 * 0.5 / total), rel=1e-13, abs=0)
    np.testing.assert_array_equal(BUDGET.minimum_force()[1], math.inf)
    assert BUDGET.signal_to_noise(1.0)[1] == -math.inf


def test_sweep_of_temperature_and_band() -> None:
    kelvin = np.linspace(213.15, 423.15, 211)
    with np.errstate(over="raise", invalid="raise", divide="raise"):
        for gm in (1e-12, 1e-4, 1e3):
            density = noise.pair_density(gm, 1e-4, kelvin)
            assert_finite(density)
            assert_monotone(density, rising=True)
        for high in np.logspace(-11, 15, 27):
            assert_finite([noise.white_rms(1e6, 1e-12, high), noise.flicker_rms(1e6, 1e-12, high)])
    assert noise.resistor_density(np.zeros((0, 3), np.float32), 300.0).shape == (0, 3)


BUDGET = noise.NoiseBudget(
    bias=0.0, thermal=1e-6, flicker=1e-6, sampling=0.0, quantisation=1e-6, volts_per_newton=np.array([0.05, 0.0])
)
SEQUENCE = {"coefficient": 1.0, "rate": 1.0, "samples": 8, "generator": np.random.default_rng(1)}
GOOD_BIAS = {"resistance": 1e10, "capacitance": 27e-12, "temperature": 300.0, "low": 0.1, "high": 1e3}
GOOD_BUDGET = {
    "bias_rms": 1e-5,
    "thermal_density": 0.0,
    "flicker_coefficient": 0.0,
    "lsb": 1e-3,
    "volts_per_newton": 1.0,
    "low": 1.0,
    "high": 2.0,
}


@pytest.mark.parametrize(
    ("function", "cases"),
    [
        refusals(
            noise.resistor_density, {"resistance": 1.0, "temperature": 300.0}, resistance=[-1.0], temperature=[0.0, 2e3]
        ),
        refusals(
            noise.pair_density,
            {"input_transconductance": 1e-3, "load_transconductance": 0.0, "temperature": 300.0},
            input_transconductance=[0.0],
            load_transconductance=[-1.0],
            temperature=[0.0],
        ),
        refusals(
            noise.flicker_density, {"coefficient": 1.0, "frequency": 1.0}, coefficient=[-1.0], frequency=[0.0, -1.0]
        ),
        refusals(
            noise.white_rms, {"density": 1.0, "low": 1.0, "high": 2.0}, density=[-1.0], low=[-1.0], high=[1.0, 0.5]
        ),
        refusals(
            noise.flicker_rms, {"coefficient": 1.0, "low": 1.0, "high": 2.0}, coefficient=[-1.0], low=[0.0], high=[1.0]
        ),
        refusals(
            noise.bias_resistor_rms,
            GOOD_BIAS,
            resistance=[0.0, -1.0],
            capacitance=[0.0, -1.0],
            temperature=[0.0],
            low=[-1.0],
            high=[0.1, 0.05],
        ),
        refusals(noise.quantisation_rms, {"lsb": 1.0}, lsb=[-1.0]),
        refusals(
            noise.flicker_sequence, SEQUENCE, coefficient=[-1.0], rate=[0.0], samples=[1, 2**26 + 1, 8.0], generator=[7]
        ),
        refusals(
            noise.noise_budget, GOOD_BUDGET, bias_rms=[-1.0], volts_per_newton=[-1.0], gain=[0.0], sampled_rms=[-1.0]
        ),
        refusals(
            noise.sampling_rms, {"capacitance": 1e-12, "temperature": 300.0}, capacitance=[0.0], temperature=[0.0]
        ),
        refusals(
            noise.gate_flicker_coefficient,
            {"constant": 1e-24, "width": 1e-3, "length": 1e-5, "capacitance": 1e-3},
            constant=[-1.0],
            width=[0.0],
            length=[0.0],
            capacitance=[0.0],
        ),
        refusals(BUDGET.signal_to_noise, {"force": 1.0}, force=[0.0, -1.0]),
        refusals(BUDGET.minimum_force, {}, sigmas=[0.0, -1.0]),
    ],
)
def test_invalid_arguments_are_rejected_by_name(function, cases) -> None:
    assert_all_refused(function, cases)


TWO, THREE = np.ones(2), np.ones(3)


@pytest.mark.parametrize(
    ("function", "arguments", "names"),
    [
        (noise.resistor_density, {"resistance": TWO, "temperature": 300 * THREE}, ("resistance", "temperature")),
        (
            noise.pair_density,
            {"input_transconductance": TWO, "load_transconductance": THREE, "temperature": 300.0},
            ("input_transconductance", "load_transconductance"),
        ),
        (noise.flicker_density, {"coefficient": TWO, "frequency": THREE}, ("coefficient", "frequency")),
    ],
)
def test_incompatible_shapes_are_rejected_by_name(function, arguments, names) -> None:
    for name in names:
        assert_refused(function, arguments, name)
