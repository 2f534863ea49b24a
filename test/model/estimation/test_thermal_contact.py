# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""What readings show of the thermal contact: taxels that something warms, and contacts that were left."""

import math

import numpy as np
from numpy.typing import NDArray

from posfet_core.scan_path import ThermalContact
from reference.estimation.thermal_contact import ThermalContact as Reference

TAXELS = 3
WARMTH_TIME, BLOCK, THRESHOLD = 0.5, 0.02, 5e-3
HIDDEN = 0.1
"""Force that a taxel must have to read nothing once its film is warm [N]."""
CONTACT = [np.arange(TAXELS)]


def readings(force: NDArray[np.float64], touched_for: float, left_for: float) -> list[NDArray[np.float64]]:
    """Return what taxels of a film read that is pressed with these forces, and then left; computed exactly."""
    found = []
    for time in np.arange(0.0, touched_for, BLOCK):
        found.append(force - HIDDEN * -math.expm1(-time / WARMTH_TIME) * (force > 0.0))
    warm = HIDDEN * -math.expm1(-touched_for / WARMTH_TIME) * (force > 0.0)
    for time in np.arange(0.0, left_for, BLOCK):
        found.append(-warm * math.exp(-time / WARMTH_TIME))
    return found


def after(course: list[NDArray[np.float64]]) -> tuple[ThermalContact, NDArray[np.bool_], bool]:
    """Return the policy after these readings, what it says of the contact then, and whether it ever called it left."""
    contact, ever, left = ThermalContact(TAXELS, WARMTH_TIME, THRESHOLD), False, np.zeros(TAXELS, np.bool_)
    for each in course:
        contact.update(each, BLOCK)
        left = contact.find_left(CONTACT)
        ever |= bool(left.any())
    return contact, left, ever


def test_what_stays_below_zero_is_warmed() -> None:
    contact, _, ever_left = after(readings(np.array([0.3, 0.02, 0.0]), 3.0, 0.0))
    assert contact.warmed.tolist() == [False, True, False]
    assert not ever_left


def test_what_cools_is_warmed_no_longer_and_left() -> None:
    force = np.array([0.3, 0.02, 0.0])
    contact, left, _ = after(readings(force, 3.0, 0.4))
    assert not contact.warmed.any()
    assert left.all()
    _, _, ever_left = after(readings(force, 3.0, 0.0))
    assert not ever_left


def test_a_time_constant_that_is_wrong_by_a_tenth_changes_nothing() -> None:
    force = np.array([0.3, 0.02, 0.05])
    for wrong in (0.9, 1.1):
        contact = ThermalContact(TAXELS, wrong * WARMTH_TIME, THRESHOLD)
        for each in readings(force, 3.0, 0.4):
            contact.update(each, BLOCK)
            left = contact.find_left(CONTACT)
        assert left.all() and not contact.warmed.any()


def test_a_force_that_warmth_comes_to_hide_wholly_is_not_left() -> None:
    for share in (0.9, 0.95, 1.0, 1.05):
        _, _, ever_left = after(readings(np.full(TAXELS, share * HIDDEN), 5.0, 0.0))
        assert not ever_left


def test_a_contact_is_not_left_while_one_of_its_taxels_is_pressed() -> None:
    course = [np.append(each[:2], 0.3 - HIDDEN) for each in readings(np.array([0.3, 0.02, 0.0]), 3.0, 0.4)]
    _, _, ever_left = after(course)
    assert not ever_left


def test_nothing_is_known_before_the_film_was_observed() -> None:
    contact, _, ever_left = after([np.full(TAXELS, -0.05)] * ThermalContact.BLOCKS)
    assert not contact.warmed.any() and not ever_left
    contact.update(np.full(TAXELS, -0.05), BLOCK)
    assert contact.warmed.all()
    contact.reset()
    assert not contact.warmed.any()


def test_compiled_thermal_contact_is_that_of_the_reference() -> None:
    random, taxels = np.random.default_rng(2), 8
    compiled, reference = (kind(taxels, WARMTH_TIME, THRESHOLD) for kind in (ThermalContact, Reference))
    contacts, reading, seen = [np.arange(3), np.array([4, 6])], np.zeros(taxels), np.zeros(2, np.bool_)
    for block in range(3000):
        pushed = np.where(random.random(taxels) < 0.03, 0.1 * random.standard_normal(taxels), 0.0)
        reading = reading * math.exp(-BLOCK / WARMTH_TIME) * (random.random(taxels) < 0.995) + pushed
        if block % 700 == 699:
            compiled.reset()
            reference.reset()
        for each in (compiled, reference):
            each.update(reading.copy(), BLOCK)
        np.testing.assert_array_equal(compiled.warmed, reference.warmed)
        left = compiled.find_left(contacts)
        np.testing.assert_array_equal(left, reference.find_left(contacts))
        seen |= [bool(compiled.warmed.any()), bool(left.any())]
    assert seen.all()
