"""Ids, states, velocity and age of contacts from made-up regions."""

from __future__ import annotations

import math

import numpy as np
import pytest

from posfet_model.contacts import Region
from posfet_model.sensor import load_sensor
from posfet_model.tracker import LAST_ID, Contact, ContactState, ContactTracker

SENSOR = load_sensor()
STEP = 1e-3


def region(x: float, y: float = 0.0, force: float = 1.0) -> Region:
    return Region(
        bits=1,
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
    """One contact that moves along x with a speed [m/s]; return its last report."""
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


def test_velocity_comes_to_the_truth_and_tells_moving_from_held() -> None:
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


def test_two_contacts_keep_their_ids_when_they_pass_in_another_order() -> None:
    tracker = ContactTracker(SENSOR)
    first, second = tracker.update([region(-2e-3), region(2e-3)], STEP)
    for index in range(100):
        x = 2e-3 - 2e-5 * index
        pair = tracker.update([region(x, 1e-3), region(-x, -1e-3)], STEP)
        assert [contact.id for contact in pair] == [first.id, second.id]
        assert pair[0].region.centre_of_pressure == (-x, -1e-3)


def test_a_merge_keeps_the_nearer_id_and_a_split_gives_a_new_one() -> None:
    tracker = ContactTracker(SENSOR)
    near, far = tracker.update([region(0.0), region(2e-3)], STEP)
    merged = tracker.update([region(0.4e-3)], STEP)
    assert [contact.id for contact in merged] == [near.id, far.id]
    assert [contact.state is ContactState.RELEASED for contact in merged] == [False, True]
    split = tracker.update([region(0.4e-3), region(2e-3)], STEP)
    assert [contact.id for contact in split] == [near.id, far.id + 1]
    assert split[1].state is ContactState.NEW


def test_a_contact_that_jumps_across_the_array_is_another_one() -> None:
    tracker = ContactTracker(SENSOR)
    [first] = tracker.update([region(-3e-3)], STEP)
    ended, begun = tracker.update([region(3e-3)], STEP)
    assert (ended.id, ended.state) == (first.id, ContactState.RELEASED)
    assert (begun.id, begun.state) == (first.id + 1, ContactState.NEW)


def test_noise_of_a_weak_contact_is_no_motion() -> None:
    tracker = ContactTracker(SENSOR)
    noise = np.random.default_rng(1).normal(0, 30e-6, (2000, 2))
    states = {tracker.update([region(x, y, force=0.02)], STEP)[0].state for x, y in noise.tolist()}
    assert states == {ContactState.NEW, ContactState.HELD}


def test_ids_begin_anew_after_the_last() -> None:
    tracker = ContactTracker(SENSOR)
    tracker._next_id = LAST_ID
    [last] = tracker.update([region(0.0)], STEP)
    tracker.update([], STEP)
    [first] = tracker.update([region(0.0)], STEP)
    assert (last.id, first.id) == (LAST_ID, 1)
