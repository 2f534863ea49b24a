# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Track ids, states, velocity and age of contacts from synthetic regions."""

from __future__ import annotations

import math
from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posfet_core.scan_path import minimum_cost_assignment
from posfet_model.contacts.detection import Region
from posfet_model.contacts.tracker import LAST_ID, Contact, ContactState, ContactTracker
from posfet_model.sensor.description import load_sensor
from reference.contacts.connected_components import BitMap

SENSOR = load_sensor()
STEP = 1e-3


def region(x: float, y: float = 0.0, force: float = 1.0) -> Region:
    return Region(
        touched=np.array([0]),
        taxels=np.array([0]),
        centre_of_pressure=(x, y),
        geometric_centre=(x, y),
        force=force,
        force_variance=1e-6,
        area=2.25e-6,
        peak_pressure=1e6,
        major_axis=(1e-3, 0.0),
        minor_axis=(0.0, 1e-3),
    )


def play(tracker: ContactTracker, speed: float, scans: int, x: float = 0.0) -> Contact:
    """Track one contact that moves along x at a speed [m/s]; return its last report."""
    for index in range(scans):
        [contact] = tracker.update([region(x + speed * STEP * index)], STEP)
    return contact


def test_a_contact_is_new_then_held_then_released_once() -> None:
    tracker = ContactTracker(SENSOR)
    [first] = tracker.update([region(0.0)], STEP)
    assert (first.state, first.age) == (ContactState.NEW, 0.0)
    assert all(math.isnan(value) for value in first.velocity)
    [second] = tracker.update([region(0.0)], STEP)
    assert (second.id, second.state, second.velocity) == (first.id, ContactState.HELD, (0.0, 0.0))
    [released] = tracker.update([], STEP)
    assert (released.id, released.state, released.region.force) == (first.id, ContactState.RELEASED, 0.0)
    assert released.region.centre_of_pressure == (0.0, 0.0)
    assert released.age == pytest.approx(2 * STEP, abs=1e-12)
    assert tracker.update([], STEP) == ()
    assert tracker.idle


def test_velocity_converges_to_the_truth_and_separates_moving_from_held() -> None:
    tracker = ContactTracker(SENSOR)
    moving = play(tracker, 5e-3, 200)
    assert moving.state is ContactState.MOVING
    assert moving.velocity == pytest.approx((5e-3, 0.0), rel=1e-3)
    resting = play(tracker, 0.0, 100, x=moving.region.centre_of_pressure[0])
    assert (resting.id, resting.state) == (moving.id, ContactState.HELD)


def test_motion_has_hysteresis() -> None:
    tracker = ContactTracker(SENSOR)
    assert play(tracker, 1.5e-3, 300).state is ContactState.HELD
    fast = play(tracker, 4e-3, 300, x=0.45e-3)
    assert fast.state is ContactState.MOVING
    assert play(tracker, 1.5e-3, 300, x=fast.region.centre_of_pressure[0]).state is ContactState.MOVING


def test_two_contacts_keep_their_ids_when_regions_are_listed_in_another_order() -> None:
    tracker = ContactTracker(SENSOR)
    first, second = tracker.update([region(-2e-3), region(2e-3)], STEP)
    for index in range(100):
        x = 2e-3 - 2e-5 * index
        pair = tracker.update([region(x, 1e-3), region(-x, -1e-3)], STEP)
        assert [contact.id for contact in pair] == [first.id, second.id]
        assert pair[0].region.centre_of_pressure == (-x, -1e-3)


@pytest.mark.parametrize("step", [(1.3, 0.0), (-1.3, 0.2), (0.5, 1.2)])
def test_crowded_contacts_keep_their_ids_in_any_direction_of_motion(step: tuple[float, float]) -> None:
    """Three within 2 mm of each other; each moves nearer to the previous position of another than to its own."""
    positions = np.array([(0.0, 0.0), (2.0, 0.0), (1.0, 1.75)])
    tracker = ContactTracker(SENSOR)
    for scan in range(6):
        moved = (positions + (0, 1, 2, 1, 0, 1)[scan] * np.array(step)) * 1e-3
        order = np.roll(np.arange(3), scan)
        contacts = tracker.update([region(*moved[index]) for index in order], 0.01)
        assert [contact.id for contact in contacts] == [1, 2, 3]
        for contact, place in zip(contacts, moved, strict=True):
            assert contact.region.centre_of_pressure == tuple(place)


def test_contacts_that_pass_each_other_closely_keep_their_ids() -> None:
    tracker = ContactTracker(SENSOR)
    for scan in range(41):
        shift = (scan - 20) * 0.4e-3
        contacts = tracker.update([region(shift, 0.95e-3), region(-shift, -0.95e-3), region(0.5 * shift, 2.9e-3)], 0.01)
        assert [math.copysign(1.0, contact.region.centre_of_pressure[1]) for contact in contacts] == [1.0, -1.0, 1.0]
    assert [contact.id for contact in contacts] == [1, 2, 3]


def test_simultaneous_release_and_onset_leave_neighbouring_contacts_unchanged() -> None:
    tracker = ContactTracker(SENSOR)
    tracker.update([region(0.0), region(2e-3)], STEP)
    contacts = tracker.update([region(2e-3), region(4e-3)], STEP)
    assert [(contact.id, contact.state) for contact in contacts] == [
        (1, ContactState.RELEASED),
        (2, ContactState.HELD),
        (3, ContactState.NEW),
    ]


@given(st.integers(1, 5), st.integers(1, 5), st.data())
def test_the_assignment_has_the_lowest_total_cost(rows: int, columns: int, data: st.DataObject) -> None:
    cost = st.floats(0.0, 2.0)
    costs = data.draw(st.lists(st.lists(cost, min_size=columns, max_size=columns), min_size=rows, max_size=rows))
    pairs = dict(minimum_cost_assignment(costs, 1.0))
    assert len(set(pairs.values())) == len(pairs)
    found = sum(costs[row][column] for row, column in pairs.items()) + rows - len(pairs)
    padded = [[*row, *([1.0] * rows)] for row in costs]
    assignments = permutations(range(columns + rows), rows)
    least = min(sum(padded[row][column] for row, column in enumerate(assignment)) for assignment in assignments)
    assert found == pytest.approx(least, abs=1e-12)


def test_a_contact_beside_another_is_released_and_a_new_one_there_reports_its_split_origin() -> None:
    tracker = ContactTracker(SENSOR)
    near, far = tracker.update([region(0.0), region(2e-3)], STEP)
    after_release = tracker.update([region(0.4e-3)], STEP)
    assert [contact.id for contact in after_release] == [near.id, far.id]
    assert [contact.state is ContactState.RELEASED for contact in after_release] == [False, True]
    assert after_release[0].merged_ids == ()
    split = tracker.update([region(0.4e-3), region(2e-3)], STEP)
    assert [contact.id for contact in split] == [near.id, far.id + 1]
    assert split[1].state is ContactState.NEW
    assert split[1].split_from == near.id


def test_a_contact_that_is_held_stores_no_more_than_the_last_contacts_that_merged_into_it() -> None:
    tracker, beside = ContactTracker(SENSOR), np.array([1])
    tracker.update([region(0.0)], STEP)
    for number in range(2, 60):
        held, young = tracker.update([region(0.0), region(2e-3)._replace(touched=beside)], STEP)
        assert (held.id, young.id) == (1, number)
        [held] = tracker.update([region(0.3e-3, force=2.0)._replace(touched=np.array([0, 1]))], STEP)
        assert held.merged_ids == tuple(range(max(2, number - 15), number + 1))
        [held] = tracker.update([region(0.0)], STEP)
    held, back = tracker.update([region(0.0), region(2e-3)], STEP)
    assert sorted((held.id, back.id, *held.merged_ids)) == [1, *range(44, 60)]


def test_merged_contacts_keep_their_ids_and_ages_when_they_split() -> None:
    tracker = ContactTracker(SENSOR)
    [old] = tracker.update([region(-1e-3)], STEP)
    for _ in range(10):
        _, young = tracker.update([region(-1e-3), region(1.2e-3)], STEP)
    [merged] = tracker.update([region(0.3e-3, force=2.0)], STEP)
    assert (merged.id, merged.merged_ids) == (old.id, (young.id,))
    assert (merged.state, merged.velocity) == (ContactState.HELD, (0.0, 0.0))
    for _ in range(50):
        [merged] = tracker.update([region(0.3e-3, force=2.0)], STEP)
    # Both have moved to the right: the left one is still the same contact.
    back, other = tracker.update([region(0.2e-3), region(2.4e-3)], STEP)
    assert (back.id, back.merged_ids, back.region.centre_of_pressure[0]) == (old.id, (), 0.2e-3)
    assert (other.id, other.region.centre_of_pressure[0]) == (young.id, 2.4e-3)
    assert other.age == pytest.approx(young.age + 52 * STEP, abs=1e-9)
    assert other.state is ContactState.HELD
    assert max(abs(value) for value in (*back.velocity, *other.velocity)) == 0.0


def test_merged_contacts_end_together() -> None:
    tracker = ContactTracker(SENSOR)
    first, second = tracker.update([region(-1e-3), region(1e-3)], STEP)
    tracker.update([region(0.0, force=2.0)], STEP)
    [ended] = tracker.update([], STEP)
    assert (ended.state, ended.id, ended.merged_ids) == (ContactState.RELEASED, first.id, (second.id,))
    [fresh] = tracker.update([region(0.0)], STEP)
    assert (fresh.id, fresh.split_from) == (second.id + 1, 0)


positions = st.tuples(st.integers(0, 4), st.integers(0, 4))


@given(st.lists(st.sets(positions, max_size=5), min_size=1, max_size=40))
def test_every_id_is_reported_once_per_scan_and_released_once(story: list[set[tuple[int, int]]]) -> None:
    """For any sequence of regions, an id belongs to one contact, alone or merged, until its release."""
    tracker, bitmap = ContactTracker(SENSOR), BitMap(5, 5)
    alive: set[int] = set()
    ended: set[int] = set()
    for scan in [*story, set()]:
        mask = np.zeros(25, np.bool_)
        mask[[5 * row + col for row, col in scan]] = True
        regions = [
            region(*where(bitmap.taxels(bits)), force=float(len(bitmap.taxels(bits))))._replace(
                touched=bitmap.taxels(bits)
            )
            for bits in bitmap.components(bitmap.pack(mask))
        ]
        contacts = tracker.update(regions, STEP)
        ids = [number for contact in contacts for number in (contact.id, *contact.merged_ids)]
        assert len(ids) == len(set(ids))
        assert len([c for c in contacts if c.state is not ContactState.RELEASED]) == len(regions)
        assert alive <= set(ids), "an id disappeared without a release"
        assert not ended & set(ids), "a released id was reported again"
        released = [c for c in contacts if c.state is ContactState.RELEASED]
        gone = {number for contact in released for number in (contact.id, *contact.merged_ids)}
        ended |= gone
        alive = set(ids) - gone
        assert all(contact.age >= 0.0 for contact in contacts)
    assert not alive


def where(taxels: np.ndarray) -> tuple[float, float]:
    x, y = SENSOR.layout.positions[taxels].mean(axis=0).tolist()
    return x, y


def test_a_contact_that_jumps_across_the_array_gets_a_new_id() -> None:
    tracker = ContactTracker(SENSOR)
    [first] = tracker.update([region(-3e-3)], STEP)
    ended, begun = tracker.update([region(3e-3)], STEP)
    assert (ended.id, ended.state) == (first.id, ContactState.RELEASED)
    assert (begun.id, begun.state) == (first.id + 1, ContactState.NEW)


def test_noise_of_a_weak_contact_is_not_motion() -> None:
    tracker = ContactTracker(SENSOR)
    noise = np.random.default_rng(1).normal(0, 30e-6, (2000, 2))
    states = {tracker.update([region(x, y, force=0.02)], STEP)[0].state for x, y in noise.tolist()}
    assert states == {ContactState.NEW, ContactState.HELD}


def test_ids_wrap_around_after_the_last() -> None:
    assert LAST_ID == 2**32 - 1
    tracker, ids = ContactTracker(SENSOR, first_id=LAST_ID - 2), []
    for _ in range(4):
        [contact] = tracker.update([region(0.0)], STEP)
        ids.append(contact.id)
        tracker.update([], STEP)
    assert ids == [LAST_ID - 2, LAST_ID - 1, LAST_ID, 1]


@pytest.mark.parametrize("step", [0.0, -1e-3, math.nan, math.inf])
def test_a_step_that_is_not_positive_is_refused(step: float) -> None:
    with pytest.raises(ValueError, match="step must be positive"):
        ContactTracker(SENSOR).update([], step)
