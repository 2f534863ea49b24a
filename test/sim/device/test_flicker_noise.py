# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""1/f noise of unlimited length: its spectrum, and reproducible samples in any access order."""

import itertools

import numpy as np
import pytest

from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.scan import Scan
from posfet_sim.device.error_model import ErrorModel
from posfet_sim.device.flicker_noise import FACTOR, OCTAVES, FlickerNoise
from posfet_sim.device.random_streams import Stream, generator
from posfet_sim.device.simulated_board import SimulatedBoard
from posfet_sim.scene import SceneLoads, load_scene

RATE = 1000.0
BANDWIDTH = 1.5e6


def expected_spectrum(frequency: np.ndarray, folded: float) -> np.ndarray:
    """Return the one-sided density of the sum of octaves by definition [1/RATE], at frequencies over the rate."""
    total = np.full_like(frequency, 2 * folded)
    for octave in range(1, OCTAVES + 1):
        span = FACTOR**octave
        if span <= FACTOR**5:
            steps = np.arange(-span + 1, span)
            transform = np.cos(np.pi * steps / (2 * span)) @ np.cos(2 * np.pi * np.outer(steps, frequency))
        else:  # the sum is an integral to 1e-6
            turns = 4 * span * frequency
            transform = 4 * span / np.pi * np.cos(np.pi * turns / 2) / (1 - turns**2)
        total += 2 * np.log(FACTOR) * transform**2 / span
    return total


def test_the_theoretical_spectrum_is_within_1_db_of_the_specified_one() -> None:
    frequency = np.geomspace(1.001 * FACTOR**-9.0, 0.5, 700)  # clear of 0/0 at powers of 4
    spectrum = expected_spectrum(frequency, FlickerNoise.folded_variance(RATE, BANDWIDTH))
    stated = 1 / frequency + 2 * np.log(2 * BANDWIDTH / RATE)
    assert np.abs(10 * np.log10(spectrum / stated)).max() < 1.0


def block(noise: FlickerNoise, number: int) -> np.ndarray:
    """Return the scans of one block, shape [scans, taxels]."""
    return noise.weights @ noise.rows(number)


def test_the_samples_have_the_specified_spectrum() -> None:
    taxels, span, blocks = 64, 64, 256
    noise = FlickerNoise(3, taxels, span)
    record = np.concatenate([block(noise, number) for number in range(blocks)])
    length = 4096
    window = np.hanning(length)[:, None]
    parts = [record[start : start + length] * window for start in range(0, len(record), length)]
    power = np.mean([np.abs(np.fft.rfft(part, axis=0)) ** 2 for part in parts], axis=(0, 2)) * 2 / (window**2).sum()
    frequency = np.arange(power.size) / length
    bands = np.geomspace(8 / length, 0.1, 8)
    for low, high in itertools.pairwise(bands):
        inside = (frequency >= low) & (frequency < high)
        expected = expected_spectrum(frequency[inside], 0.0).mean()
        assert power[inside].mean() == pytest.approx(expected, rel=0.1)  # 256 records per bin; linear within a block


def test_blocks_do_not_depend_on_access_order_and_join_continuously() -> None:
    first, second = FlickerNoise(5, 3, 16), FlickerNoise(5, 3, 16)
    forwards = [block(first, number) for number in range(40)]
    for number in (39, 7, 38, 0, 7):
        np.testing.assert_array_equal(block(second, number), forwards[number])
    record = np.concatenate(forwards)
    at_joints = np.abs(np.diff(record, axis=0))[15::16].mean()
    assert at_joints < 1.5 * np.abs(np.diff(record, axis=0)).mean()
    block(second, 1_000_000)  # far ahead, at once
    assert len(second._pages) < 60


def test_streams_differ_by_seed_purpose_and_page() -> None:
    draws = [generator(*arguments).random(4) for arguments in ((1, 2, 3), (2, 2, 3), (1, 3, 3), (1, 2, 4))]
    for index, draw in enumerate(draws):
        assert not any(np.array_equal(draw, other) for other in draws[index + 1 :])
    np.testing.assert_array_equal(draws[0], generator(1, 2, 3).random(4))
    assert max(Stream) == Stream.FLICKER


def test_white_noise_sources_of_the_board_add_in_power() -> None:
    sensor = load_sensor()
    both = ErrorModel.none()
    for imperfections, expected in (
        (both, sensor.adc.noise),
        (both.without_noise(), 0.0),
    ):
        board = SimulatedBoard(sensor, SceneLoads(load_scene("idle", sensor), sensor), 9, imperfections)
        scan = Scan.empty(1, sensor.layout.taxels)
        counts = np.empty((4000, sensor.layout.taxels))
        for index in range(4000):
            board.scan(index, scan)
            counts[index] = scan.counts
        step = (sensor.adc.high - sensor.adc.low) / 65535
        rounding = step**2 / 12 if expected else 0.0
        assert np.var(counts * step) == pytest.approx(expected**2 + rounding, rel=0.02, abs=1e-15)
