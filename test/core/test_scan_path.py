# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The compiled path alone, without the packages above it; test/model/contacts compares it with a reference."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from posfet_core.contact import Contact, ContactState, Motion
from posfet_core.scan_path import LAST_ID, ContactFinder, ContactTracker, DynamicChannel, ForceEstimate, Layout

LAYOUT = Layout(5, 5, 1.5e-3, 1.5e-3, 1e-6)
VARIANCE = np.full(25, 1e-7)


def tracker(first_id: int = 1) -> ContactTracker:
    return ContactTracker(
        gate=1.5,
        smoothing=0.02,
        start_speed=2e-3,
        stop_speed=1e-3,
        pitch=1.5e-3,
        threshold=0.02,
        noise=3e-4,
        first_id=first_id,
    )


def follow(scans: int) -> tuple[tuple[Contact, ...], dict[int, Motion]]:
    """Follow one held contact; return its last report."""
    finder, following, channel = ContactFinder(LAYOUT, 0.5e-3, 0.02, 0.01), tracker(), DynamicChannel(LAYOUT, 3e-4)
    force = np.zeros(25)
    force[[11, 12, 13]] = 0.1, 0.3, 0.1
    finder.update_thresholds(force, VARIANCE)
    estimate = ForceEstimate(force, VARIANCE)
    for _ in range(scans):
        assert finder.find(force) == 1
        channel.advance(np.zeros(25), 1e-3)
        contacts = following.follow(finder, estimate, 1e-3)
        motions = channel.update(following, force, 1e-3)
    return contacts, motions


def test_a_held_contact_is_reported_with_its_geometry_and_age() -> None:
    [contact], motions = follow(11)
    assert (contact.id, contact.state, contact.merged_ids) == (1, ContactState.HELD, ())
    assert contact.age == pytest.approx(10e-3, abs=1e-12)
    assert contact.region.taxels.tolist() == contact.region.touched.tolist() == [11, 12, 13]
    assert contact.region.force == pytest.approx(0.5, abs=1e-12)
    assert contact.region.centre_of_pressure == pytest.approx((0.0, 0.0), abs=1e-12)
    assert motions == {1: Motion(0.0, False, 0.0)}


def test_a_result_does_not_change_with_the_next_scan_and_can_be_pickled() -> None:
    [contact], motions = follow(1)
    copied, moved = pickle.loads(pickle.dumps((contact, motions)))
    assert copied._replace(region=None, velocity=None) == contact._replace(region=None, velocity=None)
    assert copied.region.taxels.tolist() == [11, 12, 13]
    assert moved == motions


@pytest.mark.parametrize(
    "arguments",
    [(0, 5, 1e-3, 1e-3, 1e-6), (5, -1, 1e-3, 1e-3, 1e-6), (5, 5, 0.0, 1e-3, 1e-6), (5, 5, 1e-3, math.nan, 1e-6)],
)
def test_a_layout_without_taxels_or_lengths_is_refused(arguments: tuple[int, int, float, float, float]) -> None:
    with pytest.raises(ValueError, match="must be"):
        ContactFinder(Layout(*arguments), 0.5e-3, 0.02, 0.01)


def test_a_force_estimate_keeps_its_arrays() -> None:
    """Nothing else holds them here: memory that was freed would be read."""
    finder, force = ContactFinder(LAYOUT, 0.5e-3, 0.02, 0.01), np.full(25, 0.1)
    finder.find(force)
    estimate = ForceEstimate(
        np.full(25, 0.1), np.full(25, 1e-7), np.zeros(25, bool), None, None, np.full((25, 3), 1e-3)
    )
    [region] = finder.measure(estimate)
    assert region.force == pytest.approx(2.5, abs=1e-12)
    assert region.force_variance == pytest.approx(25e-7 + 3 * 0.025**2, rel=1e-12)


def test_a_first_id_outside_of_the_range_is_refused() -> None:
    for first_id in (-1, LAST_ID + 1):
        with pytest.raises(TypeError):
            tracker(first_id)


SPECIAL = [0.0, -0.0, 0.02, 0.2, 0.2, 1.0, -1.0, math.nan, math.inf, -math.inf, 1e308, -1e308, 5e-324]


class Anything:
    """Numbers and flags of any kind."""

    def __init__(self, seed: int, special: float) -> None:
        self._random, self._special = np.random.default_rng(seed), special

    def values(self, *shape: int) -> np.ndarray:
        """Return numbers of which a share is special."""
        usual = self._random.normal(0.05, 0.1, shape)
        return np.where(self._random.random(shape) < self._special, self._random.choice(SPECIAL, shape), usual)

    def value(self) -> float:
        return float(self.values(1)[0])

    def flags(self) -> np.ndarray | None:
        return self._random.random(20) < self._random.random() if self._random.random() < 0.5 else None


@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.05, 0.3, 1.0]))
@settings(max_examples=300)
def test_any_numbers_give_contacts_of_taxels_that_exist_each_with_an_id_of_its_own(seed: int, special: float) -> None:
    """`make sanitize` runs it, too: no number leads to undefined behaviour."""
    anything, layout = Anything(seed, special), Layout(5, 4, 1.5e-3, 1.5e-3, 1e-6)
    finder, following = ContactFinder(layout, 0.5e-3, 0.02, 0.01), tracker()
    channel = DynamicChannel(layout, 3e-4)
    for scan in range(12):
        if scan % 3 == 0:
            finder.update_thresholds(anything.values(20), anything.values(20), anything.flags())
        force = anything.values(20)
        flags = [anything.flags() for _ in range(3)]
        finder.find(force)
        estimate = ForceEstimate(force, anything.values(20), *flags, anything.values(20, 2))
        contacts = following.follow(finder, estimate, 1e-3)
        channel.advance(anything.values(20), 1e-3)
        motions = channel.update(following, force, 1e-3)
        ids = [contact.id for contact in contacts]
        assert len(set(ids)) == len(ids)
        assert motions.keys() == {contact.id for contact in contacts if contact.state is not ContactState.RELEASED}
        for contact in contacts:
            taxels = contact.region.taxels.tolist()
            assert taxels == sorted(set(taxels))
            assert set(taxels) <= set(range(20))
