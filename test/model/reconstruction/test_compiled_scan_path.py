# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""One scan in one call of the compiled path equals the plain reference in NumPy, scan by scan."""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import strategies as st
from numpy.typing import NDArray

from posfet_core.scan_path import CountHistory, ForceIntegration, HumFilter, ScanPath
from posfet_model.contacts.detection import ContactFinder
from posfet_model.contacts.slip import DynamicChannel
from posfet_model.contacts.tracker import ContactTracker
from posfet_model.reconstruction.bursts import BurstDetector
from posfet_model.reconstruction.scan_clock import ScanClock
from posfet_model.sensor.crosstalk import CrosstalkCompensator
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_model.sensor.neighbour_estimate import most_over_neighbours
from posfet_model.sensor.scan import Scan, ScanStatus
from posfet_model.sensor.signal_chain import (
    InverseSignalChain,
    charge_per_newton,
    force_noise_rms,
    volts_per_count,
)
from reference import force_integration, hum_filter, scan_path
from support.contact_comparison import TOLERANCE, assert_same, assert_same_motions
from support.example_counts import each_of, examples

SENSOR = load_sensor()
BLOCK = 7
"""Scans of a block."""
HISTORY, WINDOW = 20, 12
STATUS = {
    5: ScanStatus.ADC_FAULT,
    6: ScanStatus.BOARD_RESET,
    7: ScanStatus.CHARGE_RESET,
    8: ScanStatus.TIME_ESTIMATED,
}
"""Status of a scan by the kind of trouble."""
START = 1_700_000_000_000_000_000
KEPT = ("raw", "change", "correction", "force", "sum", "raw_sum", "jumped", "lost", "clipped", "correlated_error")
NUMBERS = ("valid", "started", "scans", "elapsed", "square", "compensated", "age", "reading", "sensors")


@dataclass(frozen=True)
class Story:
    """What happens to an array, scan by scan."""

    sensor: Sensor
    seed: int
    fingers: int
    force: float
    """Greatest force of a finger [N]."""
    share: float
    """Share of crosstalk [1]."""
    faulty: float
    """Share of the taxels that are faulty; every second one of them is interpolated."""
    trouble: float
    """Probability that something is wrong with a scan."""
    jitter: float
    """Share by which steps vary [1]."""
    hum: float
    """Amplitude of the hum that is subtracted [N]."""
    vibration: bool


def stories(largest: int) -> st.SearchStrategy[Story]:
    sizes = st.integers(1, largest)
    sensors = st.builds(lambda r, c: replace(SENSOR, layout=replace(SENSOR.layout, rows=r, cols=c)), sizes, sizes)
    return st.builds(
        Story,
        sensors,
        st.integers(0, 2**32 - 1),
        st.integers(0, 4),
        st.sampled_from([0.5, 2.0, 100.0]),
        st.sampled_from([0.0, 0.0, 0.05, 0.2]),
        st.sampled_from([0.0, 0.0, 0.05, 0.3]),
        st.sampled_from([0.0, 0.1, 0.4]),
        st.sampled_from([0.0, 0.0, 0.3]),
        st.sampled_from([0.0, 0.0, 0.01]),
        st.booleans(),
    )


class Source:
    """The scans of a story."""

    def __init__(self, story: Story) -> None:
        self._story, self._random = story, np.random.default_rng(story.seed)
        layout, random = story.sensor.layout, self._random
        reach = 0.55 * np.array([layout.cols * layout.pitch_x, layout.rows * layout.pitch_y])
        self._at = random.uniform(-reach, reach, (story.fingers, 2))
        self._speed = random.normal(0.0, 0.2e-3, (story.fingers, 2))
        self._force = random.uniform(0.0, story.force, story.fingers)
        self._per_newton = story.sensor.volts_per_newton / volts_per_count(story.sensor)
        self._scan = Scan.empty(layout.id, layout.taxels)
        self._scan.stamp = START

    def next(self) -> Scan:
        """Return the next scan, which the one after it overwrites."""
        random, scan, story = self._random, self._scan, self._story
        step = round(1000 * (1.0 + story.jitter * random.uniform(-1.0, 1.0)))
        kind = int(random.integers(1, 14)) if random.random() < story.trouble else 0
        if kind not in (1, 2):
            lost = int(random.choice([1, 3, 30, 300])) if kind == 3 else 1
            scan.sequence += lost
            scan.device_time += lost * step
            scan.stamp += lost * step * 1000
        if kind == 2:
            scan.sequence, scan.stamp = max(scan.sequence - 1, 0), scan.stamp - step * 1000  # never negative
        scan.layout_id = story.sensor.layout.id + (kind == 4)
        scan.status = int(STATUS.get(kind, ScanStatus.OK))
        if kind == 9:
            scan.device_time -= 10_000_000
        if kind == 10:
            scan.sequence, scan.device_time = 1, 0
        scan.counts[:] = self._counts(kind)
        scan.temperatures[:] = np.where(random.random(2) < 0.1, math.nan, 25.0 + round(random.random(), 1))
        return scan

    def _counts(self, kind: int) -> NDArray[np.float64]:
        random, story = self._random, self._story
        layout = story.sensor.layout
        self._at = self._at + self._speed
        self._force = np.abs(self._force * random.normal(1.0, 0.1, story.fingers))
        presses = random.random(story.fingers) > 0.05
        square = ((layout.positions - self._at[:, None]) ** 2).sum(axis=2)
        force = (self._force * presses) @ np.exp(-0.5 * square / 0.8e-3**2) + random.normal(0.0, 0.4e-3, layout.taxels)
        if kind == 11:
            force[random.integers(layout.taxels)] += 0.3
        elif kind == 12:
            force += 0.1
        counts = np.clip(np.rint(32768 + force * self._per_newton), 0, 65535)
        return np.full_like(counts, 65535.0) if kind == 13 else counts


class Both:
    """The compiled path and the reference, with what the end of a block sets in either."""

    def __init__(self, story: Story) -> None:
        sensor, random = story.sensor, np.random.default_rng(story.seed + 1)
        taxels, noise = sensor.layout.taxels, force_noise_rms(sensor)
        self._story, self._random, self._taxels = story, random, taxels
        offset = random.normal(0.0, 0.01, taxels) * charge_per_newton(sensor) * (random.random() < 0.5)
        values = (
            random.uniform(0.2, 1.0, taxels),
            1.0 / (charge_per_newton(sensor) * random.uniform(0.9, 1.1, taxels)),
            -random.uniform(0.5, 1.5, taxels),
        )
        limits = {"greatest_loss": 0.02, "noticeable": 0.005, "fastest": 3.0, "negligible": 1e-3, "causes": 3}
        self.hums = HumFilter(taxels, WINDOW), hum_filter.HumFilter(taxels, WINDOW)
        self.integrations = (
            ForceIntegration(*values, 0.005, **limits), force_integration.ForceIntegration(*values, 0.005, **limits),
        )  # fmt: skip
        inverse, self.history, self.clock = InverseSignalChain(sensor), CountHistory(HISTORY, taxels), ScanClock(sensor)
        self._bursts, self.finder = BurstDetector(sensor), ContactFinder(sensor)
        self.channel = DynamicChannel(sensor.layout, noise)
        most_x, most_y = most_over_neighbours(sensor)
        self.compiled = ScanPath(
            clock=self.clock,
            crosstalk=CrosstalkCompensator(sensor.layout, story.share),
            bursts=self._bursts,
            hum=self.hums[0],
            integration=self.integrations[0],
            history=self.history,
            finder=self.finder,
            tracker=ContactTracker(sensor),
            channel=self.channel,
            volts_of_zero=sensor.adc.low,
            volts_per_count=volts_per_count(sensor),
            gain=sensor.amplifier.follower_gain,
            amplifier_offset=sensor.amplifier.offset,
            capacitance=sensor.device.film_capacitance,
            saturated_low=inverse.saturated_counts[0],
            saturated_high=inverse.saturated_counts[1],
            offset=offset,
            informative=5.0 * noise,
            most_x=most_x,
            most_y=most_y,
        )
        self.plain = scan_path.ScanPath(
            sensor, story.share, offset, self.hums[1], self.integrations[1], HISTORY, 5.0 * noise
        )
        self.compiled.vibration_wanted = self.plain.vibration_wanted = story.vibration
        self.end_block()

    def end_block(self) -> None:
        """Set in both what is estimated at the end of a block."""
        random, taxels, story = self._random, self._taxels, self._story
        known, faulty = random.random(taxels) < 0.98, random.random(taxels) < story.faulty
        interpolated, variance = faulty & (random.random(taxels) < 0.5), random.uniform(0.1e-6, 2e-6, taxels)
        error, usual = random.normal(0.0, 1e-4, (taxels, 3)), np.abs(random.normal(0.0, 3e-4, taxels))
        correction, rate = random.normal(0.0, 1e-4, taxels), random.normal(0.0, 1e-3, taxels)
        watched = np.flatnonzero(random.random(taxels) < 0.5)
        watches, removes = random.random() < 0.3, random.random() < 0.5
        parts, frequency = charge_per_newton(story.sensor) * random.normal(0, 1, (3, 2, taxels)), 49.0
        parts *= story.hum * np.array([1.0, 0.2, 0.1]).reshape(3, 1, 1)  # of the fundamental and its harmonics
        for hum, integration in zip(self.hums, self.integrations, strict=True):
            integration.offset_known[:], integration.ignored[:] = known, faulty
            integration.correlated_error[:], integration.correction[:] = error, integration.correction + correction
            integration.rate[:], integration.valid = rate, True
            integration.watch(watched, correction[watched], 0.3) if watches else integration.watch_none()
            integration.start_block(removes)
            hum.parts[:], hum.present, hum.hum_frequency = parts, story.hum > 0.0, frequency
            if hum.filled == WINDOW:
                hum.start_window()
        self.history.keep(2)
        self.plain.history = self.plain.history[-2:]
        force = self.integrations[0].force.copy()
        for finder in (self.finder, self.plain.finder):
            finder.update_thresholds(force, variance, known | interpolated)
        self._bursts.set_usual_change(usual)
        self.plain.bursts.set_usual_change(usual)
        self.compiled.set_faulty(faulty, interpolated) if faulty.any() else self.compiled.set_faulty(None, None)
        self.plain.set_faulty(faulty, interpolated)
        self.compiled.set_variance(variance)
        self.plain.set_variance(variance)

    def process(self, scan: Scan) -> None:
        """Process a scan in both, and compare everything."""
        started: list[bool] = []

        def start(integration: Any) -> Any:
            def begin(charge: NDArray[np.float64], interrupted: bool) -> None:
                started.append(interrupted)
                integration.start(charge)
                integration.force[:] = 0.0
                integration.correction[:] = integration.raw
                integration.started = integration.valid = True
                integration.start_block(False)

            return begin

        compiled, plain = self.compiled, self.plain
        if compiled.receive(scan) and not compiled.begin(scan):
            start(self.integrations[0])(compiled.charge, self.clock.interrupted)
        compiled.finish()
        assert compiled.result[:5] == plain.process(scan, start(self.integrations[1]))
        assert started in ([], [True] * 2, [False] * 2)
        assert self.clock.counts == self.plain.clock.counts
        for name in ("step", "interrupted", "close", "suspect", "rate"):
            assert getattr(self.clock, name) == pytest.approx(getattr(plain.clock, name), rel=1e-12)
        assert compiled.blank == plain.blank
        np.testing.assert_array_equal(compiled.saturated, plain.saturated)
        for name in (*KEPT, *NUMBERS):
            mine, other = (getattr(each, name) for each in self.integrations)
            np.testing.assert_allclose(mine, other, err_msg=name, **TOLERANCE)
        kept = self.history.filled
        assert kept == len(plain.history)
        assert [close for _, close in plain.history] == self.history.close[:kept].tolist()
        assert [counts.tolist() for counts, _ in plain.history] == self.history.counts[:kept].tolist()
        self._compare_hum()
        assert_same(compiled.contacts, plain.contacts)
        assert_same_motions(compiled.motions, plain.motions)
        np.testing.assert_allclose(self.channel.power, plain.channel.power, **TOLERANCE)
        if compiled.interpolated.any():
            np.testing.assert_allclose(compiled.filled, plain.filled, **TOLERANCE)
            np.testing.assert_allclose(compiled.filled_deviation, plain.filled_deviation, **TOLERANCE)

    def _compare_hum(self) -> None:
        mine, other = self.hums
        assert (mine.present, mine.sampling, mine.filled) == (other.present, other.sampling, other.filled)
        np.testing.assert_allclose((mine.phase, mine.time), (other.phase, other.time), rtol=0, atol=1e-10)
        scale = charge_per_newton(self._story.sensor)
        filled = mine.filled
        np.testing.assert_allclose(mine.window[:filled] / scale, other.window[:filled] / scale, rtol=1e-12, atol=1e-11)


def play(story: Story, scans: int) -> ScanPath:
    source, both = Source(story), Both(story)
    for number in range(scans):
        if number % BLOCK == BLOCK - 1:
            both.end_block()
        both.process(source.next())
    return both.compiled


@examples(12, 150)
def test_scans_of_small_arrays_equal_those_of_the_reference(count: int) -> None:
    each_of(count, stories(8), lambda story: play(story, 40))


@examples(3, 15)
def test_scans_of_large_arrays_equal_those_of_the_reference(count: int) -> None:
    each_of(count, stories(64), lambda story: play(story, 15))


@pytest.mark.parametrize(("rows", "cols"), [(1, 1), (1, 64), (64, 1), (64, 64)])
def test_scans_of_extreme_arrays_equal_those_of_the_reference(rows: int, cols: int) -> None:
    sensor = replace(SENSOR, layout=replace(SENSOR.layout, rows=rows, cols=cols))
    play(Story(sensor, 3, 3, 2.0, 0.05, 0.05, 0.3, 0.3, 0.01, True), 10 if rows == cols == 64 else 20)


def test_parts_of_different_arrays_are_refused() -> None:
    both = Both(Story(SENSOR, 1, 0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, False))
    with pytest.raises(ValueError, match="hum must be of the same array"):
        both.compiled.set_hum(HumFilter(24, 5))
    with pytest.raises(ValueError, match="unlisted must have one value for each of 25 taxels"):
        both.compiled.set_faulty(np.zeros(24, np.bool_), np.zeros(25, np.bool_))


@pytest.mark.parametrize("counts", [np.full(25, 70_000), np.full(25, 1000.7), np.array(["1000"] * 25)])
def test_counts_that_a_conversion_could_change_are_refused(counts: NDArray[Any]) -> None:
    both = Both(Story(SENSOR, 1, 0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, False))
    scan = replace(Scan.empty(SENSOR.layout.id, SENSOR.layout.taxels), counts=counts, stamp=START)
    with pytest.raises(TypeError, match="counts must be an array of uint16"):
        both.compiled.receive(scan)
    with pytest.raises(TypeError, match="uint16"):
        both.history.add(counts, True)
    assert both.clock.counts.accepted == both.history.filled == 0


def test_numbers_beyond_those_of_a_message_count_as_the_nearest_ones() -> None:
    both = Both(Story(SENSOR, 1, 0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, False))
    scan = Scan.empty(SENSOR.layout.id, SENSOR.layout.taxels)
    scan.counts[:] = 32768
    for sequence, stamp, device_time in [
        (5, START, 0),
        (2**64 - 1, 2**63, -(2**70)),
        (2**80, -(2**80), 2**80),
        (-3, 0, 0),
    ]:
        scan.sequence, scan.stamp, scan.device_time = sequence, stamp, device_time
        if both.compiled.receive(scan):
            both.compiled.begin(scan)
        both.compiled.finish()
    assert sum(astuple(both.clock.counts)) > 0
    assert math.isfinite(both.clock.step)
    assert both.clock.step > 0.0
