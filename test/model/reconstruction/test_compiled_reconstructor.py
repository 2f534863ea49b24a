# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The compiled reconstruction equals the plain reference in NumPy, scan by scan and block by block."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import strategies as st
from numpy.typing import NDArray

from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.reconstruction.settings import ReconstructionSettings
from posfet_model.sensor.description import ContactThresholds, Sensor, load_sensor
from posfet_model.sensor.scan import Scan
from posfet_model.sensor.signal_chain import ForwardSignalChain, volts_per_count
from reference import reconstructor as reference
from support.example_counts import each_of, examples
from support.long_cases import long_cases

SENSOR = load_sensor()
START = 1_700_000_000_000_000_000
TOLERANCE = {"rtol": 1e-9, "atol": 1e-9}
"""Sums of a window of hum and of the estimator are in another order, and what differs is in the next block."""
FAULTS = ("none", "stuck", "dead", "noisy", "telegraph", "saturated")
"""What a taxel does."""


@dataclass(frozen=True)
class Story:
    """What happens to an array."""

    sensor: Sensor
    seed: int
    force: float
    """Force of a touch [N]; 0: none."""
    faults: float
    """Probability that a taxel is faulty from some time on."""
    hum: float
    """Frequency of the mains hum [Hz]; 0: none."""
    trouble: float
    """Probability that a scan is lost, repeated or disturbed; a tenth of it, that there is an interruption."""
    changes: float
    """Probability that settings change, or the forces are set to zero, after a block."""
    known_dead: bool
    """Whether the calibration has a dead taxel."""


HUM, STRONG_HUM = 1.5e-3, 1e-2
"""Amplitudes of a hum of 50 and of 60.1 Hz [N]: the strong one lets the estimator start again."""


def stories(largest: int) -> st.SearchStrategy[Story]:
    sizes = st.integers(1, largest)
    return st.builds(
        Story,
        st.builds(lambda r, c: replace(SENSOR, layout=replace(SENSOR.layout, rows=r, cols=c)), sizes, sizes),
        st.integers(0, 2**32 - 1),
        st.sampled_from([0.0, 0.2, 0.6]),
        st.sampled_from([0.0, 0.0, 0.1, 0.3]),
        st.sampled_from([0.0, 0.0, 50.0, 60.1]),
        st.sampled_from([0.0, 0.0, 0.02]),
        st.sampled_from([0.0, 0.0, 0.2]),
        st.booleans(),
    )


class Source:
    """The scans of a story."""

    def __init__(self, story: Story) -> None:
        self._story, self.random = story, np.random.default_rng(story.seed)
        layout = story.sensor.layout
        self._chain = ForwardSignalChain(story.sensor, self.random)
        self._positions, self._taxels = layout.positions, layout.taxels
        ill, kinds = self.random.random(self._taxels) < story.faults, self.random.integers(1, 6, self._taxels)
        self._kinds, self._since = np.where(ill, kinds, 0), self.random.uniform(0.05, 0.3)
        self._ahead = self.random.uniform(-0.5, 0.5, self._taxels)
        self._per_newton = story.sensor.volts_per_newton / volts_per_count(story.sensor)
        self._scan = Scan.empty(layout.id, self._taxels)
        self._scan.stamp, self._scan.sequence, self._index = START, 1, 0
        self._at, self._wanted, self._force = np.zeros(2), 0.0, 0.0

    def next(self) -> Scan:
        """Return the next scan, which the one after it overwrites."""
        random, scan, story = self.random, self._scan, self._story
        kind = random.random() / max(story.trouble, 1e-9)
        steps = 1 if kind > 0.5 else 3 if kind > 0.1 else 3000
        if not 0.8 < kind <= 1.0:  # else it is the one before again
            scan.sequence += steps
            scan.device_time += 1000 * steps
            scan.stamp += 1_000_000 * steps
        self._index += 1
        if random.random() < 0.01:
            self._wanted = story.force * random.integers(2)
            place = random.choice([random.integers(self._taxels), self._taxels // 2])
            self._at = self._positions[place] if self._force < 1e-3 else self._at
        self._force += 0.1 * (self._wanted - self._force)
        square = ((self._positions - self._at) ** 2).sum(axis=1)
        self._chain.advance(self._force * np.exp(-0.5 * square / 1.1e-3**2), 25.0, 1e-3 * steps)
        scan.counts[:] = self._with_faults(self._chain.counts().astype(float))
        if 0.6 < kind <= 0.8:
            scan.counts[random.integers(self._taxels)] = 50_000
        scan.temperatures[:] = 25.0
        return scan

    def _with_faults(self, counts: NDArray[np.float64]) -> NDArray[np.float64]:
        random, time, story = self.random, 1e-3 * self._index, self._story
        if story.hum:
            size = STRONG_HUM if story.hum > 55.0 else HUM
            counts = counts + size * self._per_newton * np.cos(2.0 * math.pi * story.hum * time + self._ahead)
        if time > self._since:
            high = 300.0 * (math.sin(23.0 * time + 2.0 * math.sin(7.0 * time)) > 0.0)
            rest = 32768.0
            loud = counts + 200.0 * random.normal(0.0, 1.0, self._taxels)
            shown = [counts, 30_000.0, rest + 0.01 * (counts - rest), loud, counts + high, 65535.0]
            counts = np.choose(self._kinds, [np.broadcast_to(each, counts.shape) for each in shown])
        return np.clip(np.rint(counts), 0, 65535)


def numbers(contacts: tuple[Any, ...]) -> list[list[float]]:
    """Return what describes each contact."""
    return [
        [
            each.id, each.state, each.age, each.region.force, each.region.force_variance, each.region.peak_pressure,
            *(1e3 * np.array([*each.region.centre_of_pressure, *each.velocity])),
        ]
        for each in contacts
    ]  # fmt: skip


class Both:
    """The compiled reconstruction and the reference."""

    def __init__(self, story: Story) -> None:
        sensor, self._random = story.sensor, np.random.default_rng(story.seed + 1)
        calibration = Calibration.nominal(sensor)
        calibration.dead[self._random.integers(sensor.layout.taxels)] = story.known_dead
        self.settings = ReconstructionSettings()
        self.compiled = Reconstructor(sensor, calibration, self.settings)
        self.plain = reference.Reconstructor(sensor, calibration, self.settings)

    def process(self, scan: Scan) -> None:
        """Process a scan in both, and compare the results."""
        result = self.compiled.process(scan)
        shown = result.accepted, result.unusable, result.valid, int(result.reasons), result.saturated
        assert shown == self.plain.process(scan)
        contacts, expected = result.contacts, self.plain.path.contacts
        assert [each.region.taxels.tolist() for each in contacts] == [each.region.taxels.tolist() for each in expected]
        np.testing.assert_allclose(numbers(contacts), numbers(expected), **TOLERANCE)

    def change(self) -> None:
        """Change settings in both, or set their forces to zero."""
        before, high = self.settings, ContactThresholds(0.08, 0.02)
        if self._random.random() < 0.2:
            np.testing.assert_allclose(self.compiled.tare(force=True).force_change, self.plain.tare(), **TOLERANCE)
            return
        self.settings = replace(
            before,
            fault_detection=before.fault_detection ^ bool(self._random.random() < 0.3),
            hum_removal=before.hum_removal ^ bool(self._random.random() < 0.3),
            contact=high if self._random.random() < 0.3 else None,
        )
        self.compiled.change(self.settings)
        self.plain.change(self.settings)

    def compare_blocks(self) -> None:
        """Compare what the ends of blocks have estimated."""
        compiled, plain = self.compiled, self.plain
        image = compiled.image()
        np.testing.assert_array_equal(compiled._faults.status, plain.faults.status)
        np.testing.assert_array_equal(compiled._path.interpolated, plain.path.interpolated)
        assert compiled.hum_frequency == pytest.approx(plain.hum.frequency, abs=1e-9, nan_ok=True)
        assert compiled.counts == plain.path.clock.counts
        assert compiled.restarts == plain.estimator.restarts
        known = ~np.isnan(image.force)
        np.testing.assert_allclose(compiled._estimator.force[known], plain.estimator.force[known], **TOLERANCE)


def play(story: Story, scans: int) -> Reconstructor:
    source, both = Source(story), Both(story)
    for number in range(scans):
        both.process(source.next())
        if number % 20 == 19:
            both.compare_blocks()
            if source.random.random() < story.changes:
                both.change()
    return both.compiled


@examples(6, 40)
def test_small_arrays_are_reconstructed_as_by_the_reference(count: int) -> None:
    each_of(count, stories(8), lambda story: play(story, 500))


@examples(2, 5)
def test_large_arrays_are_reconstructed_as_by_the_reference(count: int) -> None:
    each_of(count, stories(16), lambda story: play(story, 200))


@pytest.mark.parametrize(("rows", "cols"), [(1, 1), (1, 16), (64, 64)])
def test_extreme_arrays_are_reconstructed_as_by_the_reference(rows: int, cols: int) -> None:
    sensor = replace(SENSOR, layout=replace(SENSOR.layout, rows=rows, cols=cols))
    play(Story(sensor, 3, 0.6, 0.02, 50.0, 0.02, 0.2, True), 60 if rows > 16 else 300)


@pytest.mark.parametrize("fault", long_cases(FAULTS[1:], ["noisy", "saturated"]))
def test_the_stories_bring_faults_contacts_and_hum(fault: str) -> None:
    story = Story(SENSOR, 14, 1.5, 0.0, 50.0, 0.0, 0.0, False)
    source, both = Source(story), Both(story)
    source._kinds[SENSOR.layout.taxels // 2] = FAULTS.index(fault)
    touched = faulty = 0
    for number in range(1600):
        both.process(source.next())
        touched += bool(both.plain.path.contacts)
        if number % 20 == 19:
            both.compare_blocks()
            faulty += both.compiled.faulty
    assert both.compiled.hum_frequency == pytest.approx(50.0, abs=0.1)
    assert touched > 500 and faulty > 10
