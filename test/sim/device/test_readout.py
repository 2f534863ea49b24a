# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""From charge to codes: the codes, crosstalk, pole, slew rate, rails, noise and hum of the readout, each on its own."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from posfet_model.sensor.description import Sensor, load_sensor
from posfet_sim.device.error_model import ErrorModel
from posfet_sim.device.readout import BLOCK, Readout
from posfet_sim.device.sample_clock import SampleClock
from posfet_sim.device.taxel_variation import TaxelParameters, TaxelStatus, draw_taxel_parameters

SENSOR = load_sensor()
ROWS, COLS, TAXELS = SENSOR.layout.rows, SENSOR.layout.cols, SENSOR.layout.taxels
ALL = np.arange(TAXELS)
STEP = 1.0 / SENSOR.can.scan_rate
FLAGS = {field.name: field.name == "quantisation" for field in fields(ErrorModel) if field.type == "bool"}
NOTHING = replace(ErrorModel.none(), **FLAGS)
"""A readout that only converts."""


def sensor(bits: int = 16, **amplifier: float) -> Sensor:
    """Return a sensor with an ADC from -5 V to 5 V, without its noise."""
    return replace(
        SENSOR,
        adc=replace(SENSOR.adc, bits=bits, low=-5.0, high=5.0, noise=0.0),
        amplifier=replace(SENSOR.amplifier, **amplifier),
    )


def parameters(described: Sensor, errors: ErrorModel, **changes: Any) -> TaxelParameters:
    """Return taxels of 1 V per charge, with offsets from -1 V to 1 V."""
    one = {"volts_per_charge": np.ones(TAXELS), "offset": np.linspace(-1.0, 1.0, TAXELS)}
    return replace(draw_taxel_parameters(described, errors, 0), **{**one, **changes})


def made(
    described: Sensor | None = None, seed: int = 0, taxels: dict[str, Any] | None = None, **errors: Any
) -> Readout:
    """Return a readout of active taxels with these errors alone."""
    described = described or sensor()
    model = replace(NOTHING, **errors)
    clock = SampleClock(SENSOR.can.scan_rate, 0.0, 0.0, 0)
    readout = Readout(described, model, parameters(described, model, **(taxels or {})), clock, seed)
    readout.activate(ALL)
    return readout


def respond(readout: Readout, charge: np.ndarray, lsb: float = 10.0 / 65535) -> np.ndarray:
    """Return the outputs [V] for charges [V], the first of which is that of the scan before."""
    return readout.outputs(charge, np.full(len(charge) - 1, STEP)) * lsb


def test_a_code_is_the_nearest_to_offset_and_charge() -> None:
    readout = made()
    charge = np.tile(np.linspace(-3.0, 3.0, TAXELS), (4, 1)) * np.array([[0.0], [1.0], [0.5], [-1.0]])
    outputs = readout.outputs(charge, np.full(3, STEP))
    volts = np.linspace(-1.0, 1.0, TAXELS) + charge[1:]
    codes = readout.counts(0, outputs)
    assert codes.dtype == np.uint16
    np.testing.assert_allclose(codes * (10.0 / 65535) - 5.0, volts, rtol=0, atol=0.5001 * 10.0 / 65535)
    np.testing.assert_allclose(readout.volts(ALL, outputs[0]), volts[0], rtol=0, atol=1e-9)


@pytest.mark.parametrize("bits", [8, 10, 12])
def test_fewer_bits_are_spread_over_the_scale_of_16(bits: int) -> None:
    described = sensor(bits)
    lsb = 10.0 / (2**bits - 1)
    ramp = np.linspace(-6.0, 6.0, TAXELS)
    readout = made(described, taxels={"offset": ramp})
    codes = readout.counts(0, np.zeros((1, TAXELS)))[0]
    expected = [round(min(max((volts + 5.0) / lsb, 0.0), 2**bits - 1)) for volts in ramp]
    assert (codes >> (16 - bits)).tolist() == expected
    assert (codes[0], codes[-1]) == (0, 65535)
    np.testing.assert_allclose(codes / 65535, np.array(expected) / (2**bits - 1), rtol=0, atol=2.0**-15)


def test_without_quantisation_the_codes_have_16_bits() -> None:
    fine, coarse = made(sensor(8), quantisation=False), made(sensor(8))
    shown = [len(set(readout.counts(0, np.zeros((1, TAXELS)))[0].tolist())) for readout in (fine, coarse)]
    assert shown[0] == TAXELS
    np.testing.assert_allclose(
        fine.counts(0, np.zeros((1, TAXELS)))[0] * (10.0 / 65535) - 5.0, np.linspace(-1, 1, TAXELS), rtol=0, atol=1e-4
    )


def test_taxels_without_charge_read_their_offset() -> None:
    readout = made()
    every = readout.counts(0, np.zeros((1, TAXELS)))
    readout.activate(np.array([3, 7]))
    outputs = respond(readout, np.array([[0.0, 0.0], [1.0, -1.0]]), 1.0)
    codes = readout.counts(1, outputs)[0].astype(int) - every[0]
    assert set(np.flatnonzero(codes).tolist()) == {3, 7}
    assert codes[[3, 7]] == pytest.approx([6553.5, -6553.5], abs=1.0)


def test_crosstalk_couples_to_the_four_neighbours_and_not_over_the_edge() -> None:
    charge = np.zeros((2, TAXELS))
    middle, corner = 2 * COLS + 2, COLS - 1
    charge[1, middle], charge[1, corner] = 1.0, 0.5
    expected = charge[1].copy()
    expected[[middle - COLS, middle + COLS, middle - 1, middle + 1]] += 0.03
    expected[[corner - 1, corner + COLS]] += 0.015
    np.testing.assert_allclose(respond(made(crosstalk=0.03), charge)[0], expected, rtol=0, atol=1e-12)


def test_crosstalk_between_active_taxels_alone_is_the_same() -> None:
    active = np.array([6, 7, 8, 11, 12])
    readout, every = made(crosstalk=0.05), made(crosstalk=0.05)
    readout.activate(active)
    charge = np.zeros((3, TAXELS))
    charge[1:, active] = np.random.default_rng(0).random((2, 5))
    np.testing.assert_allclose(respond(readout, charge[:, active]), respond(every, charge)[:, active], atol=1e-12)


def test_the_pole_of_the_follower_delays_a_ramp_by_its_time_constant() -> None:
    described = sensor(open_loop_gain=1e6, gain_bandwidth=1e4)
    delay = 1 / (2 * math.pi * 1e4)
    charge = np.linspace(0.0, 1.0, 101)[:, None] * np.ones(TAXELS)
    found = respond(made(described, amplifier_pole=True), charge)
    np.testing.assert_allclose(found[5:], charge[6:] - 0.01 / STEP * delay, rtol=0, atol=1e-6)
    held = respond(made(described, amplifier_pole=True), np.ones((5, TAXELS)))
    np.testing.assert_allclose(held, 1.0, rtol=0, atol=1e-12)


def test_an_output_moves_no_faster_than_the_slew_rate() -> None:
    readout = made(slew_rate=100.0)  # 0.1 V in a scan
    charge = np.zeros((9, TAXELS))
    charge[1:5], charge[5:] = 0.35, -0.05
    expected = [0.1, 0.2, 0.3, 0.35, 0.25, 0.15, 0.05, -0.05]
    found = respond(readout, charge)
    np.testing.assert_allclose(found, np.array(expected)[:, None] * np.ones(TAXELS), rtol=0, atol=1e-9)
    # The next call goes on from the last output.
    charge = np.full((3, TAXELS), 0.5)
    np.testing.assert_allclose(respond(readout, charge)[:, 0], [0.05, 0.15], rtol=0, atol=1e-9)


def test_an_output_leaves_a_rail_as_fast_as_it_may_however_far_the_charge_was_beyond() -> None:
    described = sensor(rail_low=-2.0, rail_high=2.0)
    readout = made(described, slew_rate=100.0, amplifier_rails=True, taxels={"offset": np.zeros(TAXELS)})
    respond(readout, np.full((60, TAXELS), 9.0))
    found = respond(readout, np.zeros((4, TAXELS)))
    np.testing.assert_allclose(found[:, 0], [1.9, 1.8, 1.7], rtol=0, atol=1e-9)


@pytest.mark.parametrize("rails", [True, False])
def test_voltages_end_at_the_rails_of_the_amplifier_or_of_the_adc(rails: bool) -> None:
    readout = made(sensor(rail_low=-4.5, rail_high=4.0), amplifier_rails=rails)
    outputs = readout.outputs(np.vstack([np.zeros(TAXELS), np.where(ALL % 2, 20.0, -20.0)]), np.full(1, STEP))
    codes = readout.counts(0, outputs)[0] * (10.0 / 65535) - 5.0
    expected = np.where(ALL % 2, 4.0, -4.5) if rails else np.where(ALL % 2, 5.0, -5.0)
    np.testing.assert_allclose(codes, expected, rtol=0, atol=1e-4)


def test_a_stuck_taxel_keeps_its_code_with_charge_and_without() -> None:
    status, codes = np.zeros(TAXELS, np.uint8), np.zeros(TAXELS, np.uint16)
    status[[4, 9]], codes[[4, 9]] = TaxelStatus.STUCK, (12345, 65535)
    readout = made(taxels={"status": status, "stuck_counts": codes})
    outputs = respond(readout, np.vstack([np.zeros(TAXELS), np.ones(TAXELS)]), 1.0)
    assert readout.counts(0, outputs)[0, [4, 9]].tolist() == [12345, 65535]
    readout.activate(np.arange(0))
    assert readout.counts(1, np.zeros((1, 0)))[0, [4, 9]].tolist() == [12345, 65535]


def noisy(seed: int, blocks: int = 30, **errors: Any) -> np.ndarray:
    """Return the codes [V] of many scans without charge, in calls of one block."""
    described = replace(sensor(), adc=replace(sensor().adc, noise=2e-3))
    readout = made(described, seed, **errors)
    size = BLOCK
    codes = [readout.counts(number * size, np.zeros((size, TAXELS))).copy() for number in range(blocks)]
    return np.concatenate(codes) * (10.0 / 65535) - 5.0


def test_noise_of_the_adc_has_its_size_and_no_memory() -> None:
    found = noisy(1, adc_noise=True) - np.linspace(-1.0, 1.0, TAXELS)
    assert found.std() == pytest.approx(2e-3, rel=0.02)
    assert found.mean() == pytest.approx(0.0, abs=5e-5)
    assert abs((found[1:] * found[:-1]).mean()) < 0.03 * found.var()
    assert abs((found[:, 1:] * found[:, :-1]).mean()) < 0.03 * found.var()


def test_noise_is_that_of_the_seed_whatever_is_asked_first() -> None:
    described = replace(sensor(), adc=replace(sensor().adc, noise=2e-3))
    forward, backward, other = (made(described, seed, adc_noise=True) for seed in (1, 1, 2))
    none = np.zeros((2, TAXELS))
    first, second = forward.counts(0, none).copy(), forward.counts(640, none).copy()
    np.testing.assert_array_equal(backward.counts(640, none), second)
    np.testing.assert_array_equal(backward.counts(0, none), first)
    assert (other.counts(0, none) != first).any()


def test_thermal_noise_is_folded_from_the_whole_band_of_the_amplifier() -> None:
    described = sensor(open_loop_gain=1e6, gain_bandwidth=1e6)
    readout = made(described, 1, thermal_noise=1e-6)
    codes = np.concatenate([readout.counts(64 * number, np.zeros((64, TAXELS))) for number in range(30)])
    # A first-order low-pass passes as much white noise as a sharp one of pi/2 times its bandwidth.
    expected = math.hypot(1e-6 * math.sqrt(math.pi / 2 * 1e6), 10.0 / 65535 / math.sqrt(12))
    assert (codes * (10.0 / 65535)).std(axis=0).mean() == pytest.approx(expected, rel=0.02)


def test_hum_is_a_sine_of_each_taxels_amplitude_in_step_with_the_clock() -> None:
    amplitude = np.linspace(0.1, 0.3, TAXELS)
    readout = made(taxels={"hum": amplitude}, hum_amplitude=1.0, hum_frequency=50.0)
    codes = np.concatenate([readout.counts(64 * number, np.zeros((64, TAXELS))) for number in range(5)])
    times = STEP * np.arange(len(codes))
    expected = np.linspace(-1.0, 1.0, TAXELS) + np.sin(2 * math.pi * 50.0 * times)[:, None] * amplitude
    np.testing.assert_allclose(codes * (10.0 / 65535) - 5.0, expected, rtol=0, atol=1e-4)


def test_a_large_array_has_noise_of_the_same_size_from_a_table() -> None:
    described = replace(
        sensor(), adc=replace(sensor().adc, noise=2e-3), layout=replace(SENSOR.layout, rows=32, cols=32)
    )
    model = replace(NOTHING, adc_noise=True)
    taxels = replace(draw_taxel_parameters(described, model, 0), offset=np.zeros(1024))
    readout = Readout(described, model, taxels, SampleClock(SENSOR.can.scan_rate, 0.0, 0.0, 0), 1)
    codes = np.concatenate([readout.counts(BLOCK * number, np.zeros((BLOCK, 0))) for number in range(8)])
    found = codes * (10.0 / 65535) - 5.0
    assert found.std() == pytest.approx(2e-3, rel=0.01)
    assert found.mean() == pytest.approx(0.0, abs=1e-5)
