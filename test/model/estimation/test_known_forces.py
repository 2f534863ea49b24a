# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""When a force is known: each policy alone, with residuals made for its situation."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from posfet_core.scan_path import (
    FASTEST_WARMING,
    FEWEST_FOR_UNIFORM,
    ReleaseDetector,
    UnexplainedResiduals,
    UniformChange,
)

Array = NDArray[np.float64]
NEGATIVE_TIME = UnexplainedResiduals.NEGATIVE_TIME
PERSISTENT_BLOCKS = UnexplainedResiduals.PERSISTENT_BLOCKS
SMALL = UnexplainedResiduals.SMALL
UNEXPLAINED_TIME = UnexplainedResiduals.UNEXPLAINED_TIME
RELEASED_BLOCKS = ReleaseDetector.RELEASED_BLOCKS
RELEASED_SHARE = ReleaseDetector.RELEASED_SHARE
STILL_BLOCKS = ReleaseDetector.STILL_BLOCKS
BLOCK = 0.02
GATE = 5.0
NOISE = 1e-4
THRESHOLD = 0.02
TAXELS = 12
EVERYWHERE = np.ones(TAXELS, np.bool_)
NOWHERE = np.zeros(TAXELS, np.bool_)
NOTHING = np.zeros(TAXELS)


def at(value: float, *taxels: int) -> Array:
    result = np.zeros(TAXELS)
    result[list(taxels)] = value
    return result


class Unexplained:
    """The policy with constant noise; returns what each block declares an error."""

    def __init__(self) -> None:
        self.policy = UnexplainedResiduals(TAXELS, THRESHOLD)

    def run(self, residual: Array, blocks: int, steps: float = 0.0) -> list[list[int]]:
        """Process blocks whose mean alternates by `steps` times the noise."""
        found = []
        for number in range(blocks):
            mean = residual + steps * NOISE * (-1) ** number
            errors = self.policy.update(np.abs(residual) > 0.0, residual, mean, np.full(TAXELS, NOISE), BLOCK)
            found.append(np.flatnonzero(errors).tolist())
        return found


def blocks_in(time: float) -> int:
    """Return the number of blocks after which a time has passed, tolerating rounding of its sum."""
    return math.ceil(time / BLOCK - 1e-6)


def first(found: Sequence[Sequence[int]]) -> int | None:
    """Return the number of blocks until anything was found."""
    return next((number for number, taxels in enumerate(found, 1) if taxels), None)


def test_a_negative_force_is_an_error_of_the_baseline_once_it_lasts() -> None:
    unexplained = Unexplained()
    found = unexplained.run(at(-0.1, 3), 30)
    assert blocks_in(NEGATIVE_TIME) <= (first(found) or 0) <= blocks_in(NEGATIVE_TIME) + 1
    assert {3} == {taxel for taxels in found for taxel in taxels}


def test_a_negative_force_that_ends_earlier_is_none() -> None:
    unexplained = Unexplained()
    for _ in range(5):
        assert first(unexplained.run(at(-0.1, 3), blocks_in(NEGATIVE_TIME) - 2)) is None
        assert unexplained.policy.below[3] > 0.0
        assert unexplained.run(np.zeros(TAXELS), 1) == [[]]
        assert not unexplained.policy.below.any()


def test_a_small_steady_force_without_a_contact_is_an_error_of_the_baseline() -> None:
    found = Unexplained().run(at(0.9 * SMALL * THRESHOLD, 5), 150)
    # The first block sets the level that the others are compared with.
    expected = blocks_in(UNEXPLAINED_TIME) + 1
    assert expected <= (first(found) or 0) <= expected + 1
    assert {5} == {taxel for taxels in found for taxel in taxels}


@pytest.mark.parametrize("force", [1.1 * SMALL * THRESHOLD, 0.9 * THRESHOLD, 1.0])
def test_a_force_that_is_not_small_never_becomes_an_error(force: float) -> None:
    assert first(Unexplained().run(at(force, 5), 500)) is None


def test_a_force_that_moves_never_becomes_an_error() -> None:
    assert first(Unexplained().run(at(0.5 * SMALL * THRESHOLD, 5), 500, steps=10.0)) is None


def test_only_positive_residuals_look_like_a_touch() -> None:
    unexplained = Unexplained()
    unexplained.run(at(0.01, 1) + at(-0.01, 2), 1)
    assert np.flatnonzero(unexplained.policy.rising).tolist() == [1]
    unexplained.run(np.zeros(TAXELS), 1)
    assert not unexplained.policy.rising.any()


def test_a_reset_forgets_what_was_unexplained() -> None:
    unexplained = Unexplained()
    unexplained.run(at(0.004, 1) + at(-0.01, 2), 9)
    unexplained.policy.reset()
    assert not unexplained.policy.rising.any()
    assert first(unexplained.run(at(-0.01, 2), blocks_in(NEGATIVE_TIME) - 1)) is None


CONTACT = np.array([4, 5, 6])
OTHER = np.array([9, 10])
DEVIATION = 0.01


class Release:
    """The detector with contacts that stay listed."""

    def __init__(self, block: float = BLOCK) -> None:
        self.detector, self.block = ReleaseDetector(TAXELS), block
        self.variance, self.noise = np.full(TAXELS, DEVIATION**2), np.full(TAXELS, NOISE**2)
        self.last = deque([np.zeros(TAXELS)] * STILL_BLOCKS, maxlen=STILL_BLOCKS)

    def run(self, forces: Sequence[Array], contacts: Sequence[NDArray[np.intp]] = (CONTACT,)) -> list[list[int]]:
        touched = NOWHERE.copy()
        for contact in contacts:
            touched[contact] = True
        found = []
        for force in forces:
            rise = force - self.last[0]
            self.last.append(force)
            released = self.detector.update(
                contacts, force, force, rise, touched, self.variance, self.noise, self.block
            )
            found.append(np.flatnonzero(released).tolist())
        return found


def hold(force: float, blocks: int, taxels: NDArray[np.intp] = CONTACT) -> list[Array]:
    return [at(force, *taxels.tolist())] * blocks


def test_a_contact_whose_forces_are_within_their_uncertainty_was_released() -> None:
    found = Release().run(hold(1.0, 20) + hold(DEVIATION, 20))
    number = (first(found) or 0) - 20
    assert STILL_BLOCKS + RELEASED_BLOCKS - 1 <= number <= STILL_BLOCKS + RELEASED_BLOCKS
    assert found[-1] == CONTACT.tolist()


def test_a_single_taxel_was_released_although_its_force_is_three_deviations() -> None:
    """As after one of some hundred releases."""
    one = CONTACT[:1]
    assert first(Release().run(hold(1.0, 20, one) + hold(3.0 * DEVIATION, 20, one), [one])) is not None
    assert first(Release().run(hold(1.0, 20, one) + hold(3.5 * DEVIATION, 20, one), [one])) is None


def test_a_contact_is_not_released_while_its_force_is_significant() -> None:
    assert first(Release().run(hold(1.0, 20) + hold(2.5 * DEVIATION, 100))) is None


@pytest.mark.parametrize("block", [0.02, 0.05, 0.1])
def test_a_peak_is_no_longer_recent_after_the_same_time_at_any_scan_rate(block: float) -> None:
    """After 30 s a fifth of it is left: 0.4 of 2 N, which has become uncertain since, is no rest of it then."""
    release = Release(block)
    release.variance[:] = (0.01 * DEVIATION) ** 2
    assert first(release.run(hold(2.0, 20) + hold(0.4, round(30.0 / block)))) is None
    release.variance[:] = 1.0
    assert first(release.run(hold(0.4, 20))) is None


def test_a_contact_is_not_released_while_it_has_a_good_part_of_its_peak_left() -> None:
    # Within its uncertainty, but no less than before: a light touch that has been measured badly is not over.
    assert first(Release().run(hold(DEVIATION, 200))) is None
    assert first(Release().run(hold(2.5 * DEVIATION, 20) + hold(1.2 * RELEASED_SHARE * 2.5 * DEVIATION, 50))) is None


def test_a_taxel_whose_force_is_hardly_known_does_not_keep_the_contact_of_an_object_that_left() -> None:
    """As after minutes with another offset of its signal than was known; its contact shrinks to it."""
    release, taxel = Release(), int(CONTACT[0])
    release.variance[taxel] = 1.0
    release.run(hold(1.0, 20))
    assert first(release.run([at(0.8, taxel)] * 20, [CONTACT[:1]])) is not None
    release.run(hold(1.0, 20))
    release.variance[:] = 1.0
    assert first(release.run(hold(0.4, 50))) is None, "most of the object may have stayed"


def test_a_light_touch_where_a_strong_one_was_released_is_not_released_itself() -> None:
    """It comes at once, where what the strong one has left comes slowly: it was judged by the peak of the other."""
    grown = np.concatenate((CONTACT, OTHER))
    release = Release()
    release.run(hold(1.0, 20, grown), [grown])
    release.run(hold(0.0, 20), ())
    assert first(release.run(hold(DEVIATION, 100))) is None
    assert first(release.run(hold(DEVIATION, 100, grown), [grown])) is None, "it has grown to where the strong one was"
    release = Release()
    release.run(hold(1.0, 20))
    release.run(hold(0.0, 20), ())
    slowly = [at(force, *CONTACT.tolist()) for force in np.linspace(0.0, DEVIATION, 60)]
    release.run(slowly[:30], ())
    assert first(release.run(slowly[30:])) is not None


def test_a_contact_is_not_released_while_it_moves() -> None:
    falling = [at(0.015 - 0.0008 * number, *CONTACT.tolist()) for number in range(30)]
    assert first(Release().run(hold(0.1, 20) + falling)) is None


def test_a_noisy_taxel_elsewhere_does_not_make_a_contact_that_moves_still() -> None:
    release = Release()
    release.noise[OTHER] = (100.0 * NOISE) ** 2
    falling = [at(0.015 - 0.0008 * number, *CONTACT.tolist()) for number in range(30)]
    assert first(release.run(hold(0.1, 20) + falling)) is None


def test_motion_that_bending_hides_keeps_a_taxel_unknown_and_a_contact_listed() -> None:
    """As it becomes known that the chip bends, less is left of a force that grows, or falls, in the same proportion."""
    release, taxel = Release(), int(CONTACT[0])
    touched = NOWHERE.copy()
    touched[CONTACT] = True
    release.run(hold(0.1, 20))
    for number in range(20):
        course = at(0.012 - 0.0005 * number, *CONTACT.tolist())
        mean = at(0.5 * DEVIATION, *CONTACT.tolist())
        released = release.detector.update(
            [CONTACT], mean, course, NOTHING, touched, release.variance, release.noise, BLOCK
        )
        assert not released.any()
    assert not release.detector.has_left(taxel, 0.5 * DEVIATION, NOISE)


def test_a_taxel_has_left_once_its_force_has_hardly_changed_or_is_below_zero() -> None:
    release = Release()
    release.run(hold(0.1, 20))
    taxel = int(CONTACT[0])
    assert release.detector.has_left(taxel, 0.1, NOISE)
    release.run([at(force, *CONTACT.tolist()) for force in np.linspace(0.1, 0.05, 10)])
    assert not release.detector.has_left(taxel, 0.05, NOISE)
    assert release.detector.has_left(taxel, -6.0 * NOISE, NOISE)
    release.run(hold(0.05, STILL_BLOCKS + 1))
    assert release.detector.has_left(taxel, 0.05, NOISE)
    with pytest.raises(ValueError, match="taxel must be"):
        release.detector.has_left(TAXELS, 0.05, NOISE)


def test_all_taxels_of_a_contact_are_released_together_and_no_others() -> None:
    one, other = hold(1.0, 20), hold(1.0, 40, OTHER)
    forces = [a + b for a, b in zip(one + hold(0.0, 20), other, strict=True)]
    found = Release().run(forces, (CONTACT, OTHER))
    assert found[-1] == CONTACT.tolist()
    # One loaded taxel keeps its contact.
    kept = hold(1.0, 20) + [at(0.05, int(CONTACT[0]))] * 50
    assert first(Release().run(kept)) is None


def test_nothing_is_released_before_it_can_be_known_to_be_still() -> None:
    assert first(Release().run(hold(1.0, 1) + hold(0.0, STILL_BLOCKS - 1))) is None


PER_KELVIN = -np.linspace(0.8, 1.2, TAXELS)
SPREAD = 0.02


def uniform() -> UniformChange:
    return UniformChange(PER_KELVIN, SPREAD)


def explanation(policy: UniformChange, residual: Array, where: NDArray[np.bool_] = EVERYWHERE) -> float:
    return policy.temperature(residual, where, np.full(TAXELS, 10 * NOISE), np.full(TAXELS, NOISE), BLOCK)


@pytest.mark.parametrize("kelvin", [-0.05, -0.01, 0.01, 0.05])
def test_a_change_by_the_pyroelectric_response_is_a_temperature(kelvin: float) -> None:
    assert explanation(uniform(), kelvin * PER_KELVIN) == pytest.approx(kelvin, rel=1e-12)


def test_a_change_within_its_deviation_needs_no_explanation() -> None:
    shared = NOISE * math.sqrt(10**2 - 1 + 1 / TAXELS)
    change = shared / PER_KELVIN.mean() * PER_KELVIN
    assert explanation(uniform(), 0.95 * GATE * change) == 0.0
    assert explanation(uniform(), 1.05 * GATE * change) != 0.0


def test_a_rise_by_another_pattern_is_a_press() -> None:
    # A uniform pressure: forces are equal, where warmth would follow the pyroelectric responses.
    assert explanation(uniform(), np.full(TAXELS, 0.04)) == 0.0


def test_a_few_touched_taxels_do_not_hide_a_temperature_change() -> None:
    residual = -0.02 * PER_KELVIN
    residual[[0, 7]] += 1.0
    assert explanation(uniform(), -residual) == pytest.approx(0.02, rel=0.05)
    assert explanation(uniform(), residual) == pytest.approx(-0.02, rel=0.05)


def test_a_rise_faster_than_heat_is_a_press_but_no_fall_is() -> None:
    fast = 1.2 * FASTEST_WARMING * BLOCK
    assert explanation(uniform(), -fast * PER_KELVIN) == 0.0
    assert explanation(uniform(), fast * PER_KELVIN) == pytest.approx(fast)


def test_a_fall_is_never_a_press_whatever_its_pattern() -> None:
    assert explanation(uniform(), np.full(TAXELS, -0.04)) == pytest.approx(0.04, rel=0.25)


def test_too_few_taxels_tell_nothing() -> None:
    few = NOWHERE.copy()
    few[: FEWEST_FOR_UNIFORM - 1] = True
    assert explanation(uniform(), -0.02 * PER_KELVIN, few) == 0.0
    small = UniformChange(PER_KELVIN[: FEWEST_FOR_UNIFORM - 1], SPREAD)
    assert not small.observable


@pytest.mark.parametrize("without", [1, TAXELS - 1])
@pytest.mark.parametrize("force", [0.04, -0.04])
def test_taxels_without_pyroelectric_response_tell_nothing(without: int, force: float) -> None:
    response = PER_KELVIN.copy()
    response[:without] = 0.0
    policy = UniformChange(response, SPREAD)
    assert not policy.observable
    assert explanation(policy, np.full(TAXELS, force)) == 0.0


CLAIMED = 0.1
READING = 0.004


def decide(
    policy: UniformChange,
    shown: float,
    claimed: float = CLAIMED,
    wait: float = 0.0,
    odd: NDArray[np.bool_] = NOWHERE,
    negligible: float = 0.0,
) -> int | str:
    """Return the number of blocks after which a rise of the film is refused, "kept", or "open"."""
    policy.begin()
    for number in range(1, 200):
        if policy.is_refused(odd, EVERYWHERE, claimed, shown, READING, negligible, wait, BLOCK):
            return number
        if not policy.open:
            return "kept"
    return "open"


@pytest.mark.parametrize("wait", [0.0, 0.3, 1.1])
def test_a_rise_that_the_sensors_do_not_show_is_refused_once_they_must(wait: float) -> None:
    number = decide(uniform(), 0.9 * UniformChange.CONFIRMED * CLAIMED, wait=wait)
    assert isinstance(number, int)
    expected = max(blocks_in(wait), 1)
    assert expected <= number <= expected + 1


def test_a_rise_that_the_sensors_show_is_kept() -> None:
    assert decide(uniform(), 1.1 * UniformChange.CONFIRMED * CLAIMED) == "kept"
    assert decide(uniform(), CLAIMED, wait=0.8) == "kept"


def test_a_rise_that_the_sensors_contradict_is_refused() -> None:
    assert isinstance(decide(uniform(), -CLAIMED), int)


def test_a_rise_stays_undecided_while_the_sensors_tell_nothing_of_it() -> None:
    assert decide(uniform(), math.nan) == "open"
    assert decide(uniform(), 0.0, claimed=0.9 * UniformChange.DISTINCT * READING) == "open"
    assert isinstance(decide(uniform(), 0.0, claimed=1.1 * UniformChange.DISTINCT * READING), int)


def test_a_rise_that_makes_no_difference_is_kept() -> None:
    assert decide(uniform(), 0.0, claimed=0.9 * READING, negligible=READING) == "kept"
    assert decide(uniform(), 0.0, claimed=1.1 * READING, negligible=READING) == "open"


def test_a_rise_whose_pattern_ceases_to_fit_is_refused_at_once() -> None:
    odd = NOWHERE.copy()
    odd[: math.ceil(UniformChange.MISFITS * TAXELS)] = True
    assert decide(uniform(), CLAIMED, wait=1.0, odd=odd) == 1


def test_a_refused_hypothesis_is_not_made_again_for_a_while() -> None:
    policy = uniform()
    policy.begin()
    policy.refuse()
    assert not policy.open
    rise = -0.02 * PER_KELVIN
    blocks = 0
    while explanation(policy, rise) == 0.0:
        assert not policy.is_refused(NOWHERE, EVERYWHERE, 0.0, 0.0, READING, 0.0, 0.0, BLOCK)
        blocks += 1
    assert blocks_in(UniformChange.PAUSE) <= blocks <= blocks_in(UniformChange.PAUSE) + 1


def test_a_refused_hypothesis_waits_while_no_force_is_known() -> None:
    policy = uniform()
    policy.refuse()
    for _ in range(blocks_in(2.0 * UniformChange.PAUSE)):
        assert not policy.is_refused(NOWHERE, NOWHERE, 0.0, 0.0, READING, 0.0, 0.0, BLOCK)
    assert explanation(policy, 0.02 * PER_KELVIN) != 0.0  # a fall needs no hypothesis
    assert explanation(policy, -0.02 * PER_KELVIN) == 0.0


def test_residuals_that_are_positive_in_many_blocks_are_unexplained_and_white_ones_are_not() -> None:
    found, random = UnexplainedResiduals(1000, 0.02), np.random.default_rng(1)
    every = np.ones(1000, np.bool_)
    alarms = sum(int(found.persistent(every, random.standard_normal(1000)).sum()) for _ in range(300))
    assert alarms <= 3, "five deviations: once in 3.5 million"
    for _ in range(2 * PERSISTENT_BLOCKS):
        raised = found.persistent(every, random.standard_normal(1000) + 1.5)
    assert raised.mean() > 0.95
    assert not found.persistent(~every, np.full(1000, 9.0)).any(), "begins anew where it does not count"
