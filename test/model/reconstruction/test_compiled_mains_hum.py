# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The compiled estimation of mains hum equals the plain reference in NumPy, window by window."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import strategies as st

from posfet_model.reconstruction.mains_hum import MainsHum
from reference import mains_hum
from support.example_counts import each_of, examples

ROUNDING = 1e-9
"""Sums over a window are in another order, and what differs is in the next window [noise of a reading]."""


@dataclass(frozen=True)
class Story:
    """What an array shows, block by block."""

    taxels: int
    seed: int
    rate: float
    """Scans per second [Hz]."""
    frequency: float
    """Frequency of the hum [Hz]."""
    amplitude: float
    """Amplitude of the hum [noise of a reading]; it comes and goes."""
    touched: float
    """Share of the taxels that a touch covers."""
    faulty: float
    """Share of faulty taxels."""
    unit: float
    """Noise of a reading, in the unit of the signals."""


def stories(largest: int) -> st.SearchStrategy[Story]:
    return st.builds(
        Story,
        st.integers(1, largest),
        st.integers(0, 2**32 - 1),
        st.sampled_from([500.0, 1000.0, 151.0, 100.0]),
        st.sampled_from([50.0, 60.0, 49.8, 60.2, 55.0]),
        st.sampled_from([0.0, 0.1, 0.4, 1.5, 30.0]),
        st.sampled_from([0.0, 0.5, 1.0]),
        st.sampled_from([0.0, 0.1, 1.0]),
        st.sampled_from([1.0, 1e-8]),
    )


def play(story: Story, blocks: int) -> int:
    """Compare both over some blocks; return the number of blocks in which a hum was subtracted."""
    random, taxels, unit = np.random.default_rng(story.seed), story.taxels, story.unit
    compiled, plain = MainsHum(taxels, story.rate, unit), mains_hum.MainsHum(taxels, story.rate, unit)
    size, ahead = random.uniform(0.5, 1.5, taxels), random.uniform(-0.6, 0.6, taxels)
    touched, time, present, on = np.zeros(taxels, np.bool_), 0.0, 0, True
    assert compiled.searches == plain.searches
    for _ in range(blocks):
        scans = max(1, round(0.02 * story.rate))
        on ^= bool(random.random() < 0.01)
        if random.random() < 0.05:
            touched = (random.random(taxels) < story.touched) & (random.random() < 0.5)
        ignored = random.random(taxels) < story.faulty
        for _ in range(scans):
            time += 1.0 / story.rate
            angle = 2.0 * math.pi * story.frequency * time + ahead
            hum = (
                story.amplitude
                * on
                * size
                * (np.cos(angle) + 0.2 * np.cos(3.0 * angle + 1.0) + 0.1 * np.sin(5.0 * angle))
            )
            signal = unit * (hum + random.normal(0.0, 1.0, taxels) + 20.0 * touched * random.normal())
            mine, other = signal.copy(), signal.copy()
            assert compiled.sampling == plain.sampling
            if plain.sampling:
                compiled.remove(mine, 1.0 / story.rate)
                plain.remove(other, 1.0 / story.rate)
            np.testing.assert_allclose(mine / unit, other / unit, rtol=0.0, atol=ROUNDING)
        if random.random() < 0.005:
            for each in (compiled, plain):
                each.clear()
                each.start_window()
                each.forget()
        compiled.close_block(touched, ignored, scans / story.rate)
        plain.close_block(touched, ignored, scans / story.rate)
        assert (compiled.present, compiled.sampling, compiled.filled) == (plain.present, plain.sampling, plain.filled)
        assert compiled.frequency == pytest.approx(plain.frequency, abs=ROUNDING, nan_ok=True)
        assert compiled.amplitude / unit == pytest.approx(plain.amplitude / unit, abs=ROUNDING)
        turns = (compiled.phase - plain.phase) / (2.0 * math.pi)
        assert abs(turns - round(turns)) < ROUNDING
        np.testing.assert_allclose(compiled.parts / unit, plain.parts / unit, rtol=0.0, atol=ROUNDING)
        present += compiled.present
    return present


@examples(8, 100)
def test_hum_of_small_arrays_is_estimated_as_by_the_reference(count: int) -> None:
    each_of(count, stories(64), lambda story: play(story, 150))


@examples(3, 10)
def test_hum_of_large_arrays_is_estimated_as_by_the_reference(count: int) -> None:
    each_of(count, stories(256), lambda story: play(story, 80))


def test_hum_of_the_largest_array_is_estimated_as_by_the_reference() -> None:
    assert play(Story(64 * 64, 1, 1000.0, 50.0, 1.5, 0.5, 0.1, 1.0), 30) > 0


@pytest.mark.parametrize("frequency", [50.0, pytest.param(60.0, marks=pytest.mark.slow)])
def test_the_stories_have_hum_that_is_subtracted(frequency: float) -> None:
    assert play(Story(25, 2, 1000.0, frequency, 1.5, 0.5, 0.1, 1.0), 300) > 100
    assert play(Story(25, 2, 1000.0, frequency, 0.0, 0.5, 0.1, 1.0), 300) == 0
