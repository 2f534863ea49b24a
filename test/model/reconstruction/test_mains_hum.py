# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Mains hum is detected, tracked and removed; other signals stay unchanged."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from posfet_model.reconstruction.mains_hum import MainsHum
from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.sensor.description import load_sensor
from posfet_sim.device.error_model import ErrorModel
from posfet_sim.emulation.offline import received_scans
from posfet_sim.scene import load_scene

TAXELS = 25
NOISE = 1.0
RATE = 1000.0
BLOCK = 20
CONTACT = [6, 7, 8, 11, 12, 13, 16, 17, 18]

Signal = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Maps times [s] to the signals of the taxels without noise, shape [scans, taxels]."""


def hum(frequency: float, amplitude: float = 1.5, drift: float = 0.0) -> Signal:
    """Return a hum whose amplitudes and phases differ between taxels; its frequency drifts at `drift` [Hz/s]."""
    random = np.random.default_rng(5)
    size, ahead = amplitude * random.uniform(0.5, 1.5, TAXELS), random.uniform(-0.6, 0.6, TAXELS)

    def show(times: NDArray[np.float64]) -> NDArray[np.float64]:
        turns = frequency * times + 0.5 * drift * times**2
        return size * np.cos(2.0 * math.pi * turns[:, None] + ahead)

    return show


def nothing(times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the signal without hum."""
    return np.zeros((len(times), TAXELS))


def run(
    mains: MainsHum,
    signal: Signal,
    seconds: float,
    touched: list[int] | None = None,
    rate: float = RATE,
    start: float = 0.0,
    noise: float = NOISE,
) -> NDArray[np.float64]:
    """Process from `start` [s] on; return the residual of `signal` without noise, shape [scans, taxels]."""
    times = start + (np.arange(round(seconds * rate)) + 1) / rate
    shown = signal(times)
    given = shown + noise * np.random.default_rng(1).standard_normal(shown.shape)
    mask, none = np.zeros(TAXELS, np.bool_), np.zeros(TAXELS, np.bool_)
    mask[touched or []] = True
    left = shown.copy()
    for index, row in enumerate(given):
        before = row.copy()
        if mains.sampling:
            mains.remove(row, 1.0 / rate)
        left[index] += row - before
        if index % BLOCK == BLOCK - 1:
            mains.close_block(mask, none, BLOCK / rate)
    return left


def rms(values: NDArray[np.float64]) -> float:
    return math.sqrt(float(np.mean(values**2)))


@pytest.mark.parametrize("frequency", [49.8, 50.0, 50.2, 59.8, 60.0, 60.2])
@pytest.mark.parametrize("rate", [500.0, 1000.0, 4000.0])
def test_hum_is_removed_at_any_mains_frequency(frequency: float, rate: float) -> None:
    mains, shown = MainsHum(TAXELS, rate, NOISE), hum(frequency)
    left = run(mains, shown, 4.0, rate=rate)
    assert rms(left[-round(rate) :]) < 0.15 * rms(shown(np.arange(1000) / 1000))
    assert mains.frequency == pytest.approx(frequency, abs=0.03)


@pytest.mark.parametrize("frequency", [49.8, 60.2])
@pytest.mark.parametrize(("rate", "left_of_fifth"), [(500.0, 1.0), (1000.0, 0.2)])
def test_third_and_fifth_harmonics_are_removed_where_the_rate_shows_them(
    frequency: float, rate: float, left_of_fifth: float
) -> None:
    fundamental, third, fifth = (
        hum(order * frequency, amplitude) for order, amplitude in ((1, 9.0), (3, 1.8), (5, 0.9))
    )
    mains = MainsHum(TAXELS, rate, NOISE)
    left = run(mains, lambda times: fundamental(times) + third(times) + fifth(times), 6.0, rate=rate)
    times = np.arange(1000) / 1000
    expected = math.hypot(0.02 * rms(fundamental(times)), 0.1 * rms(third(times)), left_of_fifth * rms(fifth(times)))
    assert rms(left[-round(rate) :]) < 1.2 * expected
    touched = run(mains, lambda times: fundamental(times) + third(times) + fifth(times), 2.0, CONTACT, rate, 6.0)
    assert rms(touched[-round(rate) :]) < 1.5 * expected


def test_a_drifting_mains_frequency_is_tracked() -> None:
    mains, shown = MainsHum(TAXELS, RATE, NOISE), hum(50.0, drift=0.02)
    left = run(mains, shown, 12.0)
    assert rms(left[-1000:]) < 0.15 * rms(shown(np.arange(1000) / 1000))


def test_nearly_all_hum_is_removed_from_the_sum_of_all_taxels() -> None:
    mains, shown = MainsHum(TAXELS, RATE, NOISE), hum(50.0)
    total = run(mains, shown, 4.0).sum(axis=1)
    assert rms(total[-1000:]) < 0.03 * rms(shown(np.arange(1000) / 1000).sum(axis=1))


def test_without_hum_signals_stay_bit_identical_and_not_all_are_analysed() -> None:
    mains = MainsHum(TAXELS, RATE, NOISE)
    assert not run(mains, nothing, 10.0).any()
    assert not mains.present and math.isnan(mains.frequency) and mains.amplitude == 0.0
    looked, none = 0, np.zeros(TAXELS, np.bool_)
    for index in range(2000):
        if mains.sampling:
            looked += 1
            mains.remove(np.zeros(TAXELS), 1.0 / RATE)
        if index % BLOCK == BLOCK - 1:
            mains.close_block(none, none, BLOCK / RATE)
    assert 0 < looked < 600


@pytest.mark.parametrize("end", [0.0, 3.0])
def test_a_burst_at_mains_frequency_leaves_no_residual(end: float) -> None:
    mains, shown = MainsHum(TAXELS, RATE, NOISE), hum(50.0)
    run(mains, shown, 0.15 + end)
    left = run(mains, nothing, 4.0, start=0.15 + end)
    assert not left[-1000:].any()
    assert not mains.present


@pytest.mark.parametrize(
    "signal", [lambda t: np.outer(t, np.full(TAXELS, 50.0)), lambda t: np.outer(t > 1.0, np.ones(TAXELS)) * 80.0]
)
def test_ramps_and_steps_are_not_mistaken_for_hum(signal: Signal) -> None:
    mains = MainsHum(TAXELS, RATE, NOISE)
    left = run(mains, signal, 4.0)
    assert rms((left - signal((np.arange(4000) + 1) / RATE))[-1000:]) == 0.0


def test_contact_vibration_at_mains_frequency_is_preserved() -> None:
    mains, shown = MainsHum(TAXELS, RATE, NOISE), hum(50.0)
    run(mains, shown, 3.0)

    def vibrating(times: NDArray[np.float64]) -> NDArray[np.float64]:
        signal = shown(times)
        signal[:, CONTACT] += 20.0 * np.sin(2.0 * math.pi * 50.0 * times)[:, None]
        return signal

    left = run(mains, vibrating, 5.0, CONTACT, start=3.0)
    force = vibrating(3.0 + (np.arange(5000) + 1) / RATE) - shown(3.0 + (np.arange(5000) + 1) / RATE)
    assert rms((left - force)[-1000:]) < 0.15 * rms(shown(np.arange(1000) / 1000))


def test_during_a_long_touch_untouched_taxels_keep_the_phase_locked() -> None:
    mains, shown = MainsHum(TAXELS, RATE, NOISE), hum(50.0, drift=0.01)
    run(mains, shown, 3.0)
    left = run(mains, shown, 20.0, CONTACT, start=3.0)
    assert rms(left[-1000:, CONTACT]) < 0.15 * rms(shown(np.arange(1000) / 1000)[:, CONTACT])


@pytest.mark.parametrize("touched", [[], CONTACT, list(range(TAXELS))])
@pytest.mark.parametrize("strength", [1.5, 30.0])
def test_a_mains_frequency_that_swings_is_tracked_whatever_is_touched(touched: list[int], strength: float) -> None:
    mains = MainsHum(TAXELS, RATE, NOISE)
    steady = hum(50.0, strength)

    def shown(times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return a hum whose frequency swings by 0.2 Hz in seven seconds."""
        return steady(times + 0.2 / 50.0 * 7.0 / (2.0 * math.pi) * (1.0 - np.cos(2.0 * math.pi * times / 7.0)))

    run(mains, shown, 6.0)
    left = run(mains, shown, 20.0, touched, start=6.0)
    expected = math.hypot(0.02 * strength, 0.1)  # of the phase, and of each taxel's own parts
    assert rms(left) < expected


def test_a_press_on_all_taxels_leaves_the_hum_subtracted() -> None:
    mains, shown, every = MainsHum(TAXELS, RATE, NOISE), hum(50.1, 10.0), list(range(TAXELS))
    run(mains, shown, 3.0)

    def pressed(times: NDArray[np.float64]) -> NDArray[np.float64]:
        force = np.interp(times, [3.0, 3.2, 5.0, 5.1], [0.0, 300.0, 310.0, 0.0])
        return shown(times) + force[:, None] * np.linspace(0.5, 1.5, TAXELS)

    left = run(mains, pressed, 4.0, every, start=3.0)
    times = 3.0 + (np.arange(4000) + 1) / RATE
    assert rms(left - pressed(times) + shown(times)) < 0.05 * rms(shown(times))


def test_a_hum_that_ends_while_all_taxels_are_touched_is_forgotten() -> None:
    mains, shown, every = MainsHum(TAXELS, RATE, NOISE), hum(50.0), list(range(TAXELS))
    run(mains, shown, 3.0)
    left = run(mains, nothing, 4.0, every, start=3.0)
    assert not mains.present
    assert not left[-1000:].any()


def test_hum_is_identified_again_after_an_interruption() -> None:
    mains, shown = MainsHum(TAXELS, RATE, NOISE), hum(50.0)
    run(mains, shown, 2.0)
    mains.clear()  # as the scan path and the reconstruction do
    mains.start_window()
    mains.forget()
    assert not mains.present
    left = run(mains, shown, 2.0, start=2.0123)
    assert rms(left[-500:]) < 0.15 * rms(shown(np.arange(1000) / 1000))


def test_faulty_taxels_are_ignored() -> None:
    mains, shown = MainsHum(TAXELS, RATE, NOISE), hum(50.0)
    broken = np.zeros(TAXELS, np.bool_)
    broken[3] = True
    times = (np.arange(3000) + 1) / RATE
    given = shown(times)
    given[:, 3] = 1e4 * np.sin(2.0 * math.pi * 50.0 * times + 1.0)
    for index, row in enumerate(given):
        mains.remove(row, 1.0 / RATE)
        if index % BLOCK == BLOCK - 1:
            mains.close_block(np.zeros(TAXELS, np.bool_), broken, BLOCK / RATE)
    assert rms(np.delete(given[-500:], 3, axis=1)) < 0.05 * rms(shown(times))


def test_too_few_scans_per_period_leave_the_signals_unchanged() -> None:
    mains = MainsHum(TAXELS, 100.0, NOISE)
    assert not mains.sampling
    run(mains, hum(50.0), 3.0, rate=100.0)
    assert not mains.present


def test_an_offset_of_a_board_that_is_slower_than_described_is_no_hum() -> None:
    """At 50 scans per second a hum of 50 Hz would look the same."""
    mains = MainsHum(TAXELS, RATE, NOISE)
    left = run(mains, lambda times: np.full((len(times), TAXELS), 1.5), 30.0, rate=50.0)
    assert not mains.present
    assert rms(left) == 1.5


def test_a_board_with_hum_is_as_quiet_as_one_without() -> None:
    sensor = load_sensor()
    scene = load_scene("idle", sensor)
    spread = {}
    for amplitude in (0.0, 0.5e-3, 5e-3):
        model = Reconstructor(sensor)
        board = replace(ErrorModel.default(), resets_per_hour=0.0, hum_amplitude=amplitude, hum_frequency=50.07)
        totals = []
        for scan, truth in received_scans(sensor, scene, 3.0, 2, board):
            result = model.process(scan)
            if truth.time >= 2.0:
                totals.append(model.image().total)
            assert not result.contacts
        spread[amplitude] = float(np.std(totals))
    assert spread[0.5e-3] < 1.2 * spread[0.0]
    assert spread[5e-3] < 1.5 * spread[0.0]
