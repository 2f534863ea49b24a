# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The compiled path of contacts equals the plain reference in Python, scan by scan, to 1e-12."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from posfet_core.scan_path import minimum_cost_assignment
from posfet_model.contacts.detection import ContactFinder, ForceEstimate
from posfet_model.contacts.slip import DynamicChannel
from posfet_model.contacts.tracker import ContactTracker
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_model.sensor.signal_chain import force_noise_rms
from reference.contacts import assignment, detection, slip, tracker
from support.contact_comparison import TOLERANCE, assert_same, assert_same_motions
from support.example_counts import each_of, examples

SENSOR = load_sensor()
BLOCK = 5
"""Scans from one update of the thresholds to the next."""


@dataclass(frozen=True)
class Story:
    """Contacts that move on an array, and what is wrong with its taxels."""

    sensor: Sensor
    seed: int
    fingers: int
    scans: int
    faulty: float
    """Share of the taxels that are unlisted; every second one of them is interpolated."""
    saturated: float
    """Force from which a taxel is saturated [N]."""
    unknown: float
    """Probability that a scan has a taxel with an unknown force."""
    interrupted: bool
    """Whether the dynamic channel pauses now and then."""
    causes: int
    """Number of causes of errors that the forces have in common."""


def stories(largest: int) -> st.SearchStrategy[Story]:
    sizes = st.integers(1, largest)
    sensors = st.builds(
        lambda rows, cols, flat: replace(
            SENSOR,
            layout=replace(SENSOR.layout, rows=rows, cols=cols, pitch_y=SENSOR.layout.pitch_y * flat),
        ),
        sizes,
        sizes,
        st.sampled_from([1.0, 0.8]),
    )
    return st.builds(
        Story,
        sensors,
        st.integers(0, 2**32 - 1),
        st.integers(0, 4),
        st.just(30),
        st.sampled_from([0.0, 0.0, 0.05, 0.3]),
        st.sampled_from([math.inf, math.inf, 0.4]),
        st.sampled_from([0.0, 0.0, 0.2]),
        st.booleans(),
        st.integers(0, 3),
    )


class Player:
    """Plays a story scan by scan: the forces, and how long after the last ones."""

    def __init__(self, story: Story) -> None:
        self._story, self._random = story, np.random.default_rng(story.seed)
        layout, random = story.sensor.layout, self._random
        reach = 0.55 * np.array([layout.cols * layout.pitch_x, layout.rows * layout.pitch_y])
        self._at = random.uniform(-reach, reach, (story.fingers, 2))
        self._speed = random.normal(0.0, 0.4e-3, (story.fingers, 2))
        self._force = random.uniform(0.02, 1.5, story.fingers)
        self._width = random.uniform(0.5e-3, 2.5e-3, story.fingers)
        self.unlisted = random.random(layout.taxels) < story.faulty
        self.interpolated = self.unlisted & (random.random(layout.taxels) < 0.5)
        self.force = np.zeros(layout.taxels)
        self.variance = random.uniform(0.1e-6, 4e-6, layout.taxels)
        self.correlated_error = random.normal(0.0, 1e-3, (layout.taxels, story.causes))

    def advance(self) -> float:
        """Move the contacts and set the forces [N] anew; return the step [s]."""
        random, story = self._random, self._story
        self._at = self._at + self._speed + random.normal(0.0, 0.05e-3, self._at.shape)
        self._force = np.abs(self._force * random.normal(1.0, 0.1, story.fingers))
        presses = random.random(story.fingers) > 0.1
        square = ((story.sensor.layout.positions - self._at[:, None]) ** 2).sum(axis=2)
        shapes = np.exp(-0.5 * square / self._width[:, None] ** 2)
        self.force[:] = (self._force * presses) @ shapes + random.normal(0.0, 0.5e-3, len(self.force))
        if random.random() < story.unknown:
            self.force[random.integers(len(self.force))] = math.nan
        return float(random.choice([1e-3, 1e-3 * random.uniform(0.7, 1.3), 20e-3]))

    def saturated(self) -> NDArray[np.bool_] | None:
        """Return the taxels at the end of their range, None for none."""
        found = self.force > self._story.saturated
        return found if found.any() else None

    def usable(self) -> NDArray[np.bool_] | None:
        """Return the taxels that may be in a contact, None for all."""
        return self._random.random(len(self.force)) > 0.1 if self._random.random() < 0.2 else None

    @property
    def pauses(self) -> bool:
        """Whether the dynamic channel pauses in this scan."""
        return self._story.interrupted and self._random.random() < 0.1


class Compiled:
    """The compiled path."""

    def __init__(self, sensor: Sensor) -> None:
        self.finder, self._tracker = ContactFinder(sensor), ContactTracker(sensor)
        self.channel = DynamicChannel(sensor.layout, force_noise_rms(sensor))

    def follow(self, player: Player, step: float) -> tuple[Any, Any]:
        """Return contacts and motions of a scan."""
        self.finder.find(player.force)
        any_faulty = bool(player.unlisted.any())
        taxels = ForceEstimate(
            player.force,
            player.variance,
            player.saturated(),
            player.unlisted if any_faulty else None,
            player.interpolated if player.interpolated.any() else None,
            player.correlated_error,
        )
        contacts = self._tracker.follow(self.finder, taxels, step)
        return contacts, self.channel.update(self._tracker, player.force, step)


class Plain:
    """The reference."""

    def __init__(self, sensor: Sensor) -> None:
        self.finder, self._tracker = detection.ContactFinder(sensor), tracker.ContactTracker(sensor)
        self.channel = slip.DynamicChannel(sensor.layout, force_noise_rms(sensor))

    def follow(self, player: Player, step: float) -> tuple[Any, Any]:
        """Return contacts and motions of a scan."""
        regions = self.finder.find(player.force)
        taxels = detection.ForceEstimate(
            player.force,
            player.variance,
            player.saturated(),
            self.finder.bits(player.unlisted),
            player.interpolated if player.interpolated.any() else None,
            player.correlated_error,
        )
        found = self.finder.measure(regions, taxels, self._tracker.regions)
        contacts = self._tracker.update(found, step)
        return contacts, self.channel.update(contacts, player.force, step)


def play(story: Story) -> None:
    player, compiled, plain = Player(story), Compiled(story.sensor), Plain(story.sensor)
    before = player.force.copy()
    for scan in range(story.scans):
        step = player.advance()
        if scan % BLOCK == 0:
            usable = player.usable()
            for each in (compiled, plain):
                each.finder.update_thresholds(player.force, player.variance, usable)
        change = np.nan_to_num(player.force - before)
        pauses = player.pauses
        for each in (compiled, plain):
            if pauses:
                each.channel.pause()
            else:
                each.channel.advance(change, step)
                each.channel.update_power(step)
        contacts, motions = compiled.follow(player, step)
        expected, expected_motions = plain.follow(player, step)
        assert_same(contacts, expected)
        assert_same_motions(motions, expected_motions)
        np.testing.assert_allclose(compiled.channel.high_passed, plain.channel.high_passed, **TOLERANCE)
        np.testing.assert_allclose(compiled.channel.power, plain.channel.power, **TOLERANCE)
        np.testing.assert_array_equal(compiled.finder.touched, plain.finder.touched)
        assert [each.tolist() for each in compiled.finder.patches] == [each.tolist() for each in plain.finder.patches]
        before = player.force.copy()


@examples(20, 150)
def test_contacts_on_small_arrays_equal_those_of_the_reference(count: int) -> None:
    each_of(count, stories(8), play)


@examples(6, 20)
def test_contacts_on_large_arrays_equal_those_of_the_reference(count: int) -> None:
    each_of(count, stories(64), lambda story: play(replace(story, scans=12)))


@pytest.mark.parametrize(("rows", "cols"), [(1, 1), (1, 64), (64, 1), (64, 64)])
def test_contacts_on_extreme_arrays_equal_those_of_the_reference(rows: int, cols: int) -> None:
    sensor = replace(SENSOR, layout=replace(SENSOR.layout, rows=rows, cols=cols))
    for seed in range(3):
        play(Story(sensor, seed, 4, 10, 0.02, 0.4, 0.1, True, 2))


@given(st.integers(1, 6), st.integers(0, 6), st.data())
def test_assignments_equal_those_of_the_reference(rows: int, columns: int, data: st.DataObject) -> None:
    cost = st.floats(0.0, 2.0)
    costs = data.draw(st.lists(st.lists(cost, min_size=columns, max_size=columns), min_size=rows, max_size=rows))
    compiled = dict(minimum_cost_assignment(costs, 1.0))
    plain = assignment.minimum_cost_assignment(costs, 1.0)

    def total(pairs: dict[int, int]) -> float:
        return sum(costs[row][column] for row, column in pairs.items()) + rows - len(pairs)

    assert total(compiled) == pytest.approx(total(plain), abs=1e-12)
    assert list(compiled) == sorted(compiled)
