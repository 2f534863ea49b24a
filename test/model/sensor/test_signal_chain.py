# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The signal chain against plain formulas integrated at 100 kHz, the functions of the ADC, and its inverse."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posfet_model.device import adc
from posfet_model.device.charge import invert_first_order_hold, propagate_first_order_hold
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_model.sensor.signal_chain import ForwardSignalChain, InverseSignalChain, charge_per_newton, leakage_step

SENSOR = load_sensor()
TAXELS = SENSOR.layout.taxels


def with_adc(**changes: Any) -> Sensor:
    return replace(SENSOR, adc=replace(SENSOR.adc, **changes))


def force_at(time: float) -> float:
    """Return a press of 2 N within 50 ms, with 0.5 N at 7 Hz superimposed [N]."""
    return 2.0 * min(time / 0.05, 1.0) + 0.5 * math.sin(2 * math.pi * 7 * time)


def temperature_at(time: float) -> float:
    return 25.0 + 0.8 * time


def integrated_at_100_khz(duration: float, every: int) -> list[float]:
    """Return the follower output [V], every `every` steps: explicit formulas of one taxel, by Heun's method."""
    d33, area, pyro, tau = -38e-12, 1e-6, -40e-6, 0.27
    capacitance = 8.8541878188e-12 * 12 / 2.5e-6
    gain = 10 ** (42.3 / 20)
    step = 1e-5
    sigma, out = 0.0, []
    source_before = d33 * (-force_at(0.0) / area)
    for index in range(1, round(duration / step) + 1):
        time = index * step
        source = d33 * (-force_at(time) / area) + pyro * (temperature_at(time) - 25.0)
        slope = (source - source_before) / step
        first = slope - sigma / tau
        second = slope - (sigma + step * first) / tau
        sigma += step * (first + second) / 2
        source_before = source
        if index % every == 0:
            out.append(sigma / capacitance * gain / (1 + gain))
    return out


@pytest.mark.parametrize("every", [10, 100])
def test_chain_equals_plain_integration_at_100_khz(every: int) -> None:
    step = every * 1e-5
    chain = ForwardSignalChain(SENSOR)
    chain.advance(np.zeros(TAXELS), temperature_at(0.0), step)
    volts = []
    for index in range(1, round(0.5 / step) + 1):
        force = np.zeros(TAXELS)
        force[7] = force_at(index * step)
        chain.advance(force, temperature_at(index * step), step)
        volts.append(chain.volts()[7])
    # Linear interpolation between the samples is below a sine by (w*h)^2/12 of it on average; the leakage integrates
    # that over half a period, 2/w of it, with 1/tau. Heun's method itself has an error of 1e-8 V.
    frequency = 2 * math.pi * 7
    bound = 0.5 * (frequency * step) ** 2 / 12 * 2 / frequency / 0.27 * SENSOR.volts_per_newton + 1e-8
    np.testing.assert_allclose(volts, integrated_at_100_khz(0.5, every), rtol=0, atol=bound)


def test_one_long_step_equals_many_short_ones() -> None:
    target = np.linspace(0, 4, TAXELS)
    long, short = ForwardSignalChain(SENSOR), ForwardSignalChain(SENSOR)
    for chain in (long, short):
        chain.advance(np.zeros(TAXELS), 20.0, 1e-3)
    long.advance(target, 21.0, 0.8)
    for index in range(1, 1001):
        short.advance(target * index / 1000, 20.0 + index / 1000, 0.8e-3)
    np.testing.assert_allclose(long.charge, short.charge, rtol=0, atol=1e-13 * long.charge.max() * 1000)


@given(ratio=st.floats(1e-9, 1e3), start=st.floats(-1, 1), end=st.floats(-1, 1), rise=st.floats(-1, 1))
def test_step_coefficients_equal_the_charge_functions(ratio: float, start: float, end: float, rise: float) -> None:
    leakage = leakage_step(ratio * 0.27, 0.27)
    forward = leakage.decay * start + leakage.mean * rise
    backward = (end - start) / leakage.mean + leakage.ratio * start
    assert forward == pytest.approx(float(propagate_first_order_hold(start, 0, rise, ratio * 0.27, 0.27)), abs=1e-15)
    expected = float(invert_first_order_hold(start, end, ratio * 0.27, 0.27))
    assert backward == pytest.approx(expected, abs=4e-15 * max(1.0, ratio))


@pytest.mark.parametrize("bits", [8, 10, 12, 14, 16])
def test_counts_equal_adc_codes_on_the_16_bit_scale(bits: int) -> None:
    sensor = with_adc(bits=bits)
    chain = ForwardSignalChain(sensor)
    chain.advance(np.zeros(TAXELS), 25.0, 1e-3)
    chain.advance(np.linspace(-6, 6, TAXELS), 25.0, 1e-3)
    codes = adc.volts_to_counts(chain.volts(), bits, sensor.adc.low, sensor.adc.high).counts.astype(int)
    counts = chain.counts()
    assert counts.dtype == np.uint16
    np.testing.assert_array_equal(counts >> (16 - bits), codes)
    np.testing.assert_allclose(counts / 65535, codes / (2**bits - 1), rtol=0, atol=1 / 65535)


def test_last_code_of_a_low_resolution_adc_is_full_scale() -> None:
    amplifier = replace(SENSOR.amplifier, rail_low=-20.0, rail_high=20.0)
    chain = ForwardSignalChain(replace(with_adc(bits=12), amplifier=amplifier))
    chain.advance(np.full(TAXELS, 9.0), 25.0, 1e-3)
    assert (chain.counts() == 0xFFFF).all()
    chain.advance(np.full(TAXELS, -9.0), 25.0, 1e-3)
    assert (chain.counts() == 0).all()


def test_output_stays_between_the_rails_and_offset_passes_through_the_follower() -> None:
    chain = ForwardSignalChain(replace(SENSOR, amplifier=replace(SENSOR.amplifier, offset=0.1)))
    chain.advance(np.zeros(TAXELS), 25.0, 1e-3)
    np.testing.assert_allclose(chain.volts(), 0.1 * SENSOR.amplifier.follower_gain, rtol=0, atol=1e-15)
    chain.advance(np.full(TAXELS, 50.0), 25.0, 1e-3)
    np.testing.assert_array_equal(chain.volts(), SENSOR.amplifier.rail_high)


def test_inverse_recovers_the_charge_to_half_an_adc_step() -> None:
    chain, inverse = ForwardSignalChain(SENSOR), InverseSignalChain(SENSOR)
    chain.advance(np.zeros(TAXELS), 25.0, 1e-3)
    chain.advance(np.linspace(-4, 5, TAXELS), 25.0, 1e-3)
    charge = inverse.charge(chain.counts(), np.empty(TAXELS))
    half_step = 10 / 65535 / 2 / SENSOR.amplifier.follower_gain * SENSOR.device.film_capacitance
    np.testing.assert_allclose(charge, chain.charge, rtol=0, atol=half_step * (1 + 1e-9))
    assert not inverse.saturated(chain.counts(), np.empty(TAXELS, np.bool_)).any()


def test_saturation_is_flagged_at_both_ends_under_noise() -> None:
    chain, inverse = ForwardSignalChain(SENSOR, np.random.default_rng(4)), InverseSignalChain(SENSOR)
    force = np.zeros(TAXELS)
    force[:5], force[5:10] = 8.0, -8.0
    chain.advance(force, 25.0, 1e-3)
    for _ in range(200):
        saturated = inverse.saturated(chain.counts(), np.empty(TAXELS, np.bool_))
        np.testing.assert_array_equal(saturated, np.arange(TAXELS) < 10)
    low, high = (limit / charge_per_newton(SENSOR) for limit in inverse.charge_range)
    assert high > SENSOR.device.force_max
    assert low < -SENSOR.device.force_max


def test_noise_has_the_stated_standard_deviation_and_is_reproducible_by_seed() -> None:
    chain, again = (ForwardSignalChain(SENSOR, np.random.default_rng(9)) for _ in range(2))
    draws = np.array([chain.counts() for _ in range(400)], float)
    np.testing.assert_array_equal(draws, [again.counts() for _ in range(400)])
    step = 10 / 65535
    expected = math.sqrt(SENSOR.adc.noise**2 + step**2 / 12)
    # 10000 draws: the standard deviation has a standard error of 0.7 %.
    assert draws.std() * step == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize(
    ("force", "temperature", "step", "named"),
    [
        (np.full(TAXELS, math.nan), 25.0, 1e-3, "force"),
        (np.zeros(TAXELS), math.inf, 1e-3, "film_temperature"),
        (np.zeros(TAXELS + 1), 25.0, 1e-3, "force"),
        (np.zeros(TAXELS), 25.0, 0.0, "step"),
        (np.zeros(TAXELS), 25.0, math.nan, "step"),
    ],
)
def test_invalid_arguments_are_rejected_by_name(force: Any, temperature: float, step: float, named: str) -> None:
    chain = ForwardSignalChain(SENSOR)
    with pytest.raises(ValueError, match=named):
        chain.advance(force, temperature, step)


def test_an_adc_with_excessive_noise_is_rejected() -> None:
    with pytest.raises(ValueError, match=r"adc\.noise"):
        InverseSignalChain(with_adc(noise=2.0))
