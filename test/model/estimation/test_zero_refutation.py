# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""When readings of the temperature sensors refute zeros of the whole array."""

import math

import pytest

from posfet_core.scan_path import ZeroRefutation

PER_KELVIN, RATE, BLOCK = -0.5, 0.01, 0.02


def resting(lag_known: bool = True, rate: float = RATE) -> ZeroRefutation:
    """Return what has seen a minute at rest while the chip warms."""
    policy = ZeroRefutation(PER_KELVIN, lag_known)
    for number in range(1, 3001):
        policy.end_block(BLOCK, number * BLOCK, rate, listed=False, rested=True)
    return policy


def test_a_press_hides_as_a_colder_film_where_that_makes_a_positive_charge() -> None:
    assert ZeroRefutation(PER_KELVIN, lag_known=True).may_hide(0.01)
    assert not ZeroRefutation(PER_KELVIN, lag_known=True).may_hide(-0.01)
    assert ZeroRefutation(-PER_KELVIN, lag_known=True).may_hide(-0.01)


@pytest.mark.parametrize(
    ("deviations", "rate", "lag_known", "lasts"),
    [
        ((3.1, 3.1), 0.5 * RATE, True, True),
        ((3.1, 0.0, 3.1), 0.5 * RATE, True, False),  # one in between fits
        ((2.9, 9.0), 0.5 * RATE, True, False),
        ((3.1, 3.1), 1.5 * RATE, True, False),  # the film warms faster, as no press makes it seem
        ((3.1, 3.1), 0.5 * RATE, False, False),  # it may be the lag of the sensors
    ],
)
def test_readings_in_turn_refute_zeros(
    deviations: tuple[float, ...], rate: float, lag_known: bool, lasts: bool
) -> None:
    policy = resting(lag_known)
    for each in deviations:
        policy.count(each, rate)
    assert policy.in_turn is lasts


def test_a_press_is_forgotten_slowly_and_once_a_contact_shows_it() -> None:
    policy = resting()
    policy.refute(0.04)
    for _ in range(500):
        policy.end_block(BLOCK, 99.0, RATE, listed=False, rested=True)
    assert policy.hidden == pytest.approx(0.04 * math.exp(-1.0))
    policy.end_block(BLOCK, 99.0, RATE, listed=True, rested=False)
    assert policy.hidden == 0.0
    policy.refute(0.04)
    policy.clear()
    assert policy.hidden == 0.0


def test_the_rate_at_rest_is_an_average_over_all_of_a_short_rest() -> None:
    policy = ZeroRefutation(PER_KELVIN, lag_known=True)
    for number in range(1, 51):
        policy.end_block(BLOCK, number * BLOCK, RATE, listed=False, rested=True)
    for _ in range(2):
        policy.count(9.0, 0.99 * RATE)
    assert policy.in_turn
