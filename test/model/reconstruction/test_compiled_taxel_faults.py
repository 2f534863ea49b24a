# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The compiled tests of the taxels equal the plain reference in NumPy, block by block."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from posfet_core import scan_path
from posfet_model.reconstruction.taxel_faults import TaxelFaultDetector, TaxelStatus
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_model.sensor.signal_chain import force_noise_rms, volts_per_count
from posfet_model.sensor.skin_response import SkinResponse
from reference import skin_response, taxel_faults, telegraph_noise
from reference.neighbour_estimate import NeighbourInterpolation
from support.contact_comparison import TOLERANCE
from support.example_counts import each_of, examples

SENSOR = load_sensor()
FAULTS = ("none", "stuck", "dead", "noisy", "very noisy", "telegraph", "saturated", "held")
"""What a taxel does for a while."""


@dataclass(frozen=True)
class Story:
    """What happens to the taxels of an array, block by block."""

    sensor: Sensor
    seed: int
    force: float
    """Force of a touch [N]; 0: none."""
    faults: float
    """Share of the taxels that change their behaviour from time to time."""
    trouble: float
    """Share of scans that do not closely follow the one before, and of taxels whose offset is unknown."""
    untested: float
    """Probability that the tests are switched on or off at the end of a block."""
    scans: tuple[int, int]
    """Least and greatest number of scans of a block."""


def sensors(rows: st.SearchStrategy[int], cols: st.SearchStrategy[int]) -> st.SearchStrategy[Sensor]:
    def make(rows: int, cols: int, bits: int, noise: float, spread: float) -> Sensor:
        return replace(
            SENSOR,
            layout=replace(SENSOR.layout, rows=rows, cols=cols),
            adc=replace(SENSOR.adc, bits=bits, noise=noise * SENSOR.adc.noise),
            device=replace(SENSOR.device, contact_spread=spread * SENSOR.device.contact_spread),
        )

    bits, noises = st.sampled_from([SENSOR.adc.bits, SENSOR.adc.bits, 8]), st.sampled_from([1.0, 1.0, 0.0, 4.0])
    return st.builds(make, rows, cols, bits, noises, st.sampled_from([1.0, 1.0, 0.5]))


def stories(largest: int) -> st.SearchStrategy[Story]:
    return st.builds(
        Story,
        sensors(st.integers(1, largest), st.integers(1, largest)),
        st.integers(0, 2**32 - 1),
        st.sampled_from([0.0, 0.3, 1.0]),
        st.sampled_from([0.0, 0.05, 0.3]),
        st.sampled_from([0.0, 0.0, 0.1]),
        st.sampled_from([0.0, 0.0, 0.2]),
        st.sampled_from([(20, 20), (15, 25), (0, 70)]),
    )


class Source:
    """The counts of a story, and what an estimator would make of them."""

    def __init__(self, story: Story) -> None:
        self._story, self.random = story, np.random.default_rng(story.seed)
        layout, sensor = story.sensor.layout, story.sensor
        self._taxels = layout.taxels
        self._per_newton = sensor.volts_per_newton / volts_per_count(sensor)
        self._step = 2.0 ** (16 - sensor.adc.bits)
        self._noise = sensor.adc.noise / volts_per_count(sensor)
        self._positions = layout.positions
        self._kinds = np.zeros(self._taxels, int)
        self._level = np.zeros(self._taxels)
        self._held = np.zeros(self._taxels)
        self.force = np.zeros(self._taxels)

    def next_block(self) -> None:
        """Begin a block: touches come and go, and so do faults."""
        random, story = self.random, self._story
        change = random.random(self._taxels) < 0.1 * story.faults
        self._kinds = np.where(change, random.integers(0, len(FAULTS), self._taxels), self._kinds)
        self._level = np.where(random.random(self._taxels) < 0.15, 400.0 - self._level, self._level)
        if random.random() < 0.2:
            at = self._positions[random.integers(self._taxels)]
            square = ((self._positions - at) ** 2).sum(axis=1)
            self.force = random.integers(3) * story.force * np.exp(-0.5 * square / 1.2e-3**2)
        self._held = np.where(random.random(self._taxels) < 0.05, 0.4 * random.random(self._taxels), self._held)
        self.force = self.force.copy()
        self.force[self._kinds == FAULTS.index("dead")] *= 0.01
        held = self._kinds == FAULTS.index("held")
        self.force[held] = self._held[held]

    def next(self) -> NDArray[np.uint16]:
        """Return the counts of the next scan."""
        random, kinds = self.random, self._kinds
        loud = np.select([kinds == FAULTS.index("noisy"), kinds == FAULTS.index("very noisy")], [6.0, 40.0], 1.0)
        counts = 32768 + self.force * self._per_newton + loud * self._noise * random.normal(0.0, 1.0, self._taxels)
        counts = counts + np.where(kinds == FAULTS.index("telegraph"), self._level, 0.0)
        counts = np.where(kinds == FAULTS.index("stuck"), 32768 + 3 * self._level, counts)
        counts = np.where(kinds == FAULTS.index("saturated"), 65535, counts)
        rounded: NDArray[np.uint16] = np.clip(self._step * np.rint(counts / self._step), 0, 65535).astype(np.uint16)
        return rounded


def play(story: Story, blocks: int) -> set[int]:
    """Compare both detectors over some blocks; return every status that there was."""
    sensor, source = story.sensor, Source(story)
    random, taxels = source.random, sensor.layout.taxels
    known_dead = random.random(taxels) < 0.1 * story.faults
    compiled = TaxelFaultDetector(sensor, known_dead)
    plain = taxel_faults.TaxelFaultDetector(sensor, known_dead=known_dead)
    tested, found = True, set()
    for _ in range(blocks):
        source.next_block()
        scans = int(random.integers(story.scans[0], story.scans[1] + 1))
        for _ in range(scans):
            counts, close = source.next(), bool(random.random() >= story.trouble)
            for detector in (compiled, plain):
                detector.history.add(counts, close)
        duration, saturated = max(scans, 1) * 1e-3, source.next() >= 65000
        touched = source.force > 0.5 * sensor.contact.threshold
        tested ^= bool(random.random() < story.untested)
        if tested:
            noise = force_noise_rms(sensor)
            values = (
                source.force + random.normal(0.0, 0.3 * noise, taxels),
                noise**2 * random.uniform(0.5, 4.0, taxels),
                source.force * random.uniform(-1.0, 1.0, taxels),
            )
            masks = saturated, touched, random.random(taxels) >= story.trouble
            assert compiled.close_block(duration, *values, *masks) == plain.close_block(duration, *values, *masks)
        else:
            compiled.measure_noise(duration, saturated, touched)
            plain.measure_noise(duration, saturated, touched)
        np.testing.assert_array_equal(compiled.status, plain.status)
        np.testing.assert_array_equal(compiled.faulty, plain.faulty)
        assert compiled.any_faulty == plain.any_faulty
        np.testing.assert_allclose(compiled.usual_change, plain.usual_change, **TOLERANCE)
        np.testing.assert_allclose(compiled.noise_variance, plain.noise_variance, rtol=1e-12)
        deviation = force_noise_rms(sensor) * random.uniform(2.0, 50.0)
        np.testing.assert_array_equal(compiled.informative(deviation), plain.informative(deviation))
        assert compiled.history.filled == plain.history.filled
        found.update(compiled.status.tolist())
    return found


@examples(12, 150)
def test_small_arrays_are_tested_as_by_the_reference(count: int) -> None:
    each_of(count, stories(8), lambda story: play(story, 60))


@examples(5, 20)
def test_large_arrays_are_tested_as_by_the_reference(count: int) -> None:
    each_of(count, stories(16), lambda story: play(story, 30))


@pytest.mark.parametrize(("rows", "cols"), [(1, 1), (1, 16), (16, 1), (64, 64)])
def test_extreme_arrays_are_tested_as_by_the_reference(rows: int, cols: int) -> None:
    sensor = replace(SENSOR, layout=replace(SENSOR.layout, rows=rows, cols=cols))
    play(Story(sensor, 5, 0.5, 0.3, 0.05, 0.1, (15, 25)), 20)


def test_the_stories_bring_every_fault() -> None:
    sensor = replace(SENSOR, layout=replace(SENSOR.layout, rows=8, cols=8))
    found = play(Story(sensor, 1, 1.0, 0.3, 0.0, 0.0, (20, 20)), 120)
    assert found == {TaxelStatus.OK, TaxelStatus.DEAD, TaxelStatus.STUCK, TaxelStatus.NOISY}


@settings(max_examples=40)
@given(st.integers(1, 8), st.integers(1, 8), st.integers(0, 2**32 - 1), st.sampled_from([1.0, 0.2]))
def test_telegraph_noise_is_found_as_by_the_reference(rows: int, cols: int, seed: int, spread: float) -> None:
    """Levels on some taxels, with steps that are near to what is tolerated, touches on all, unsound taxels."""
    layout = replace(SENSOR.layout, rows=rows, cols=cols)
    device = replace(SENSOR.device, contact_spread=spread * SENSOR.device.contact_spread)
    sensor, random, taxels = replace(SENSOR, layout=layout, device=device), np.random.default_rng(seed), rows * cols
    compiled = scan_path.TelegraphDetector(SkinResponse(sensor), 0.27)
    plain = telegraph_noise.TelegraphDetector(
        taxels, 0.27, skin_response.SkinResponse(sensor), NeighbourInterpolation(layout)
    )
    high, size = np.zeros(taxels, np.bool_), random.uniform(0.0, 40.0, taxels)
    switching, touch = random.random(taxels) < 0.5, np.zeros(taxels)
    for _ in range(80):
        high ^= switching & (random.random(taxels) < 0.2)
        if random.random() < 0.1:
            touch = 30.0 * random.integers(2) * random.random(taxels)
        variance = random.uniform(0.2, 1.0, taxels)
        mean = touch + size * high * random.choice([1.0, 0.95, 0.85]) + 0.3 * random.normal(0.0, 1.0, taxels)
        sound, duration = random.random(taxels) < 0.98, random.choice([0.02, 0.02, 0.5])
        compiled.close_block(mean, variance, sound, duration, touch.any())
        plain.close_block(mean, variance, sound, duration, touch.any())
        np.testing.assert_array_equal(compiled.found, plain.found)
