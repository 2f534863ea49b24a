# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The compiled estimator against the one in Python: the same forces, covariances and decisions in random stories."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from hypothesis import strategies as st
from numpy.typing import NDArray

from posfet_core import scan_path
from posfet_model.calibration.taxel_calibration import Calibration, Residuals
from posfet_model.estimation.error_states import COUNT, ErrorPriors, Shared
from posfet_model.estimation.force_estimator import BLOCK, LAG, RESUME_TIME, ForceEstimator
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_model.sensor.signal_chain import charge_per_newton, force_noise_rms
from reference.estimation import force_estimator as plain
from reference.estimation.error_states import start_covariance, start_mean
from reference.estimation.thermal_contact import LEFT_BLOCKS
from support.example_counts import each_of, examples

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

SENSOR = load_sensor()
STEP = 4e-3
"""Time between two scans [s]: five in a block."""

TOLERANCE = 1e-9
"""Relative to the deviation or the greatest value of a kind [1]: sums are added up in other orders, and exponentials
rounded otherwise, each within 1e-15, of which some hundred blocks make 1e-12. Of 160 random stories one reached
7e-11."""

WARMING_TOLERANCE = 1e-7
"""The same while the film's temperature jumps. The filter then admits a change a million times greater than what is
left of it after the update: those digits are lost. Up to 2e-9 was seen."""

ONSET, WARMING, GAP, FAULTS, TARE, SATURATION, LONG_STEPS, UNLISTED, DIVERGED = range(9)


@dataclass(frozen=True)
class Story:
    """What happens to an array, block by block."""

    rows: int
    cols: int
    seed: int
    calibrated: bool = False
    force: float = 1.0
    """Greatest force of a finger [N]."""
    trouble: float = 0.0
    """Probability of an event of any kind in a block [1]."""
    kinds: tuple[int, ...] = tuple(range(8))
    """Kinds of events."""
    sensed: bool = True
    """Whether the temperature sensors show the film's temperature."""
    telegraph: float = 0.0
    """Amplitude of the telegraph noise of every fifth taxel [N]."""
    warmth: float = 0.0
    """By how much what touches is warmer than the film [K]."""
    held: bool = False
    """Whether something touches since before the start."""
    known: bool = True
    """Whether a calibration knows how warm that is, in place of what is as warm as the film."""
    rise: float = 0.02
    """Time constant with which forces rise and fall [s]."""

    @property
    def tolerance(self) -> float:
        """Relative difference that rounding may make [1]."""
        return WARMING_TOLERANCE if self.trouble and WARMING in self.kinds else TOLERANCE

    @property
    def sensor(self) -> Sensor:
        """The sensor."""
        return replace(SENSOR, layout=replace(SENSOR.layout, rows=self.rows, cols=self.cols))


def stories(largest: int) -> st.SearchStrategy[Story]:
    sizes = st.integers(1, largest)
    return st.builds(
        Story,
        sizes,
        sizes,
        st.integers(0, 2**32 - 1),
        st.booleans(),
        st.sampled_from([0.05, 0.5, 3.0]),
        st.sampled_from([0.0, 0.05, 0.2]),
        st.sampled_from([tuple(range(8)), tuple(kind for kind in range(8) if kind != WARMING)]),
        sensed=st.booleans(),
        telegraph=st.sampled_from([0.0, 0.0, 5e-3]),
        warmth=st.sampled_from([0.0, 0.0, 0.3]),
    )


class Film:
    """Charges of an array under moving fingers, with leakage, a film that warms, offsets and noise."""

    def __init__(self, story: Story) -> None:
        self.random, self.story, self.sensor = np.random.default_rng(story.seed), story, story.sensor
        sensor = self.sensor
        self._positions, self._noise = sensor.layout.positions, force_noise_rms(sensor)
        layout, device = sensor.layout, sensor.device
        self.per_newton = charge_per_newton(sensor)
        self._tau = device.leak_time_constant * self.random.uniform(0.9, 1.1, layout.taxels)
        self._per_kelvin = device.pyroelectric_coefficient / self.per_newton
        self._offset = self.random.normal(0.0, 0.3 * sensor.contact.threshold, layout.taxels)
        self._signal, (self._force, self._warmth) = self._offset.copy(), np.zeros((2, layout.taxels))
        self._at, self._target, self._level = np.zeros(2), 0.0, 0.0
        self._high = np.zeros(layout.taxels, np.bool_)
        self.chip = self.film = self.rate = 0.0
        self.gain = self.random.normal(1.0, 0.02, layout.taxels)
        if story.held:
            self.press()
            for _ in range(round(5.0 / STEP)):
                self.after(STEP)

    def press(self) -> None:
        """Let a finger press anywhere, or lift it."""
        layout = self.sensor.layout
        reach = 0.6 * np.array([layout.cols * layout.pitch_x, layout.rows * layout.pitch_y])
        if self._target == 0.0:
            self._at = self.random.uniform(-reach, reach)
        self._target = 0.0 if self._target else self.story.force * float(self.random.uniform(0.1, 1.0))

    def after(self, step: float) -> Array:
        """Return the charge densities a step later [C/m2]."""
        random = self.random
        self._level += (self._target - self._level) * (1.0 - math.exp(-step / self.story.rise))
        square = ((self._positions - self._at) ** 2).sum(axis=1)
        force = self._level * np.exp(-0.5 * square / 1e-3**2)
        self.chip += self.rate * step
        before, self.film = self.film, self.film + (self.chip - self.film) * (1.0 - math.exp(-step / 0.06))
        warming = self.story.warmth * -np.expm1(-force / 0.03) - self._warmth
        warming *= 1.0 - math.exp(-step / 0.5)
        self._warmth += warming
        change = force - self._force + self._per_kelvin * (self.film - before + warming)
        self._force = force
        flipped = random.random(len(force)) < step
        flipped &= np.arange(len(force)) % 5 == 0
        self._high ^= flipped
        self._signal = self._offset + (self._signal - self._offset) * np.exp(-step / self._tau) + self.gain * change
        read = self._signal + self.story.telegraph * self._high + random.normal(0.0, self._noise, len(force))
        return np.asarray(read * self.per_newton)

    def readings(self) -> NDArray[np.float32]:
        """Return the readings of the temperature sensors [degC]."""
        shown = round(10.0 * (25.0 + (self.chip if self.story.sensed else 0.0))) / 10.0
        return np.where(self.random.random(2) < 0.1, math.nan, shown).astype(np.float32)


def calibration(story: Story) -> Calibration | None:
    if not story.calibrated:
        return None
    random, nominal = np.random.default_rng(story.seed), Calibration.nominal(story.sensor)

    def vary(values: Array, deviation: float) -> Array:
        return values * random.normal(1.0, deviation, len(values))

    return replace(
        nominal,
        gain=vary(nominal.gain, 0.03),
        leak_time_constant=vary(nominal.leak_time_constant, 0.05),
        pyroelectric_gain=vary(nominal.pyroelectric_gain, 0.05),
        warmth=story.warmth if story.known else 1e-4,
        warmth_deviation=0.25 * story.warmth * story.known + 3e-3,
        warmth_force=0.03,
        warmth_steepness=random.choice([1.0, 4.0]),
        hysteresis_half_widths=np.array([0.02, 0.1, 0.4]),
        hysteresis_weights=np.array([-0.03, -0.04, -0.02]),
        hysteresis_slope=-0.04,
        bending=np.array([2e-3, 1e-3, -0.5e-3, 0.2e-3]),
        bending_deviation=np.full(4, 1e-5),
        bending_profile=vary(np.ones(len(nominal.gain)), 0.3),
        temperature_sensor_lag=0.2,
        temperature_sensor_dead_time=0.1,
        leak_per_kelvin=0.046,
        temperature=23.0,
        residuals=Residuals(1e-3, 2e-3, 1),
    )


@dataclass
class Both:
    """The estimator in C++ and in Python, given the same scans and contacts."""

    story: Story
    compiled: ForceEstimator = field(init=False)
    python: plain.ForceEstimator = field(init=False)
    seen: Counter[str] = field(default_factory=Counter)
    """What happened, by name."""

    def __post_init__(self) -> None:
        arguments = (self.story.sensor, None, calibration(self.story))
        self.compiled, self.python = ForceEstimator(*arguments), plain.ForceEstimator(*arguments)
        self.taxels = self.story.sensor.layout.taxels
        self.touched = np.zeros(self.taxels, np.bool_)
        self.limit = np.full(self.taxels, self.story.sensor.contact.threshold)

    def each(self) -> Iterator[ForceEstimator | plain.ForceEstimator]:
        yield self.compiled
        yield self.python

    def scan(self, charge: Array, readings: NDArray[np.float32], step: float, saturated: Mask | None) -> None:
        for estimator in self.each():
            integration = estimator.integration
            if not integration.process(charge, readings, step):
                estimator.start(charge)
            if saturated is not None:
                integration.clip(saturated, step)
            integration.compensate_common_mode(bool(self.touched.any()))
        self.touched |= self.python.force > self.limit

    def close_block(self, listed: bool) -> None:
        touched = self.touched & self.python.offset_known & listed
        halves = np.arange(self.taxels) % self.story.sensor.layout.cols < self.story.sensor.layout.cols // 2
        contacts = [part.nonzero()[0] for part in (touched & halves, touched & ~halves) if part.any()]
        for estimator in self.each():
            estimator.close_block(touched, contacts)
        self.compare()
        threshold = self.story.sensor.contact.threshold
        self.limit = np.maximum(threshold, 2.5 * np.sqrt(self.python.variance(np.empty(self.taxels))))
        self.touched = self.python.force > self.limit
        self._count()

    def tare(self, forced: bool) -> None:
        self.close(*(estimator.tare(forced) for estimator in self.each()), "tare", self.force_scale())
        self.compare()

    def close(self, mine: object, other: object, name: str, scale: float = 0.0) -> None:
        mine, other = np.asarray(mine), np.asarray(other)
        scale = max(float(np.abs(other).max(initial=0.0)), scale)
        tolerance = self.story.tolerance * scale
        if not (np.abs(mine - other) <= tolerance).all():  # rare, and what follows takes a hundred times as long
            np.testing.assert_allclose(mine, other, rtol=0, atol=tolerance, err_msg=name)

    def force_scale(self) -> float:
        """Return the greatest force of the integration, which is never corrected [N]."""
        return float(np.abs(self.python.integration.raw).max())

    def compare(self) -> None:
        mine, other = self.compiled, self.python
        assert mine.valid == other.valid
        assert mine.restarts == other.restarts
        np.testing.assert_array_equal(mine.offset_known, other.offset_known)
        np.testing.assert_array_equal(mine.ignored, other.ignored)
        forces = self.force_scale()
        for name in ("force", "change", "residual_charge"):
            self.close(getattr(mine, name), getattr(other, name), name, forces)
        for name in ("correction", "rate", "lost"):
            self.close(getattr(mine.integration, name), getattr(other.integration, name), name, forces)
        for name in ("variance", "force_variance"):
            self.close(*(getattr(each, name)(np.empty(self.taxels)) for each in self.each()), name)
        deviations = math.sqrt(float(other.force_variance(np.empty(self.taxels)).max()))
        self.close(mine.correlated_error, other.correlated_error, "correlated_error", deviations)
        belief, expected = mine.belief, other.belief
        self.close(belief.shared, expected.shared, "shared", 1.0)
        deviation = np.sqrt(np.diag(expected.covariance))
        each = np.outer(deviation, deviation)
        self.close(belief.covariance / each, expected.covariance / each, "covariance")
        # Of the regressions only what they make of the shared states: where those hardly vary, anything is right.
        level, axes = np.linalg.eigh(expected.covariance / each)
        root = deviation[:, None] * axes * np.sqrt(np.maximum(level, 0.0))
        spread, expected_spread = belief.slope @ root, expected.slope @ root
        variance = expected.own + expected_spread @ expected_spread.transpose(0, 2, 1)
        for state in range(belief.error.shape[1]):
            # What rounds in the force error does so in the small force: both are measured by one residual.
            known = math.sqrt(
                float(max(variance[:, each, each].max() for each in ((0, 2) if state == 2 else (state,))))
            )
            self.close(belief.error[:, state], expected.error[:, state], f"error {state}", known + forces * (state < 3))
            self.close(spread[:, state], expected_spread[:, state], f"slope {state}", known)
            for column in range(state + 1):
                both = known * math.sqrt(float(variance[:, column, column].max()))
                self.close(belief.own[:, state, column], expected.own[:, state, column], f"own {state} {column}", both)

    def _count(self) -> None:
        python = self.python
        self.seen["hypothesis open"] += python._unheated is not None
        self.seen["hypothesis refused"] += python._uniform.pause == python._uniform.PAUSE
        self.seen["lower bound"] += bool(python._lower_bound.mask.any())
        self.seen["walk observed"] += python._walk.intensity > python._walk._least
        self.seen["jumps observed"] += bool(np.any(python._jumps.least_offset_variance()))
        self.seen["lone drift"] = python.lone_drifts
        self.seen["left unseen"] += bool(python._left_force.any())
        self.seen["rising"] += bool(python._unexplained.rising.any())
        self.seen["hot film"] += python._hot
        self.seen["warmed"] += bool(python._thermal_contact.warmed.any())
        self.seen["left"] += int(python._thermal_contact._cooled_for.max()) >= LEFT_BLOCKS
        self.seen["may touch"] += python._hidden_touch.may_touch
        self.seen["pressed"] += bool(python._hidden_touch.pressed.any())
        self.seen["touched"] += bool(python._touched.any())
        self.seen["valid"] += python.valid
        self.seen["invalid"] += not python.valid
        self.seen["offset unknown"] += not python.offset_known.all()
        self.seen["absorbed"] += bool(python._absorbed().any())
        self.seen["warmer"] += float(python.belief.shared[Shared.WARMTH]) > 0.05
        self.seen["small forces"] += bool((python.belief.own[:, 2, 2] > 0.0).any())
        self.seen["processed again"] = self.compiled.processed_again
        self.seen["restarts"] = self.compiled.restarts


def play(story: Story, blocks: int) -> Counter[str]:
    """Play a story in both estimators, and compare them after every block; return what happened."""
    both, film, random = Both(story), Film(story), np.random.default_rng(story.seed + 1)
    readings = film.readings()
    faulty = np.zeros(both.taxels, np.bool_)
    both.compare()
    for block in range(blocks):
        kind = int(random.choice(story.kinds)) if random.random() < story.trouble else -1
        if kind == ONSET or (block > 30 and random.random() < 0.03):
            film.press()
        if kind == WARMING:
            film.rate = float(random.choice([0.0, 0.0, 0.05, -0.5, 2.5]))
        if kind == GAP and random.random() < 0.3:
            for estimator in both.each():
                estimator.interrupt()
            film.after(float(random.choice([0.05, 1.0])))
        if kind == FAULTS:
            faulty = random.random(both.taxels) < random.choice([0.0, 0.1])
            noise = force_noise_rms(story.sensor) ** 2 * random.uniform(1.0, 4.0, both.taxels)
            for estimator in both.each():
                estimator.ignore(faulty)
                estimator.informative[:] = faulty & (np.arange(both.taxels) % 2 == 0)
                estimator.set_noise_variance(noise)
        if kind == TARE:
            both.tare(bool(random.random() < 0.3))
        if kind == DIVERGED:
            for estimator in both.each():
                estimator.belief.own[:, 0, 0] = math.nan
        saturated = random.random(both.taxels) < 0.2 if kind == SATURATION else None
        if block % 5 == 0:
            readings = film.readings()
        while both.python.block_time < BLOCK:
            step = 0.05 if kind == LONG_STEPS else STEP
            both.scan(film.after(step), readings, step, saturated)
        both.close_block(listed=kind != UNLISTED)
    return both.seen


@examples(4, 25)
def test_both_estimators_agree(count: int) -> None:
    each_of(count, stories(6), lambda story: play(story, 90))


@examples(1, 3)
def test_both_agree_on_large_arrays(count: int) -> None:
    each_of(count, stories(16), lambda story: play(story, 60))


def test_both_agree_on_the_largest_array() -> None:
    assert play(Story(64, 64, 7, trouble=0.1, kinds=(ONSET,)), 40)["touched"]


STORIES = {
    "touches": (Story(5, 5, 1, force=2.0), ("touched", "valid", "processed again", "small forces"), 150),
    "slow touches of all kinds": (
        Story(5, 5, 2, force=0.05, trouble=0.2),
        ("rising", "restarts", "offset unknown"),
        250,
    ),
    "objects that are hot": (Story(5, 5, 6, warmth=0.5), ("hot film", "invalid"), 150),
    "objects whose warmth hides forces": (
        Story(5, 5, 1, calibrated=True, force=0.5, warmth=0.1),
        ("warmed", "left"),
        220,
    ),
    "slow presses whose warmth hides them": (
        Story(5, 5, 7, calibrated=True, force=0.1, warmth=0.1, rise=4.0),
        ("may touch", "pressed"),
        400,
    ),
    "objects warmer than that of the calibration": (
        Story(5, 5, 3, calibrated=True, force=2.0, warmth=0.1, known=False),
        ("warmer", "valid"),
        160,
    ),
    "a film that warms": (Story(5, 5, 14, trouble=0.1, kinds=(WARMING,)), ("hypothesis open", "walk observed"), 170),
    "a film that warms unseen": (
        Story(5, 5, 3, trouble=0.1, kinds=(WARMING,), sensed=False),
        ("hypothesis open", "hypothesis refused"),
        330,
    ),
    "interruptions": (Story(5, 5, 5, trouble=0.2, kinds=(ONSET, GAP)), ("lower bound", "invalid"), 220),
    "telegraph noise": (Story(5, 5, 6, telegraph=5e-3), ("jumps observed",), 120),
    "signals that step as forces move": (Story(2, 2, 9, telegraph=3e-3), ("lone drift",), 400),
    "objects held since before the start": (
        Story(5, 5, 3, force=2.0, held=True, calibrated=True, warmth=0.03),
        ("left unseen", "valid"),
        150,
    ),
    "presses that are found late": (Story(5, 5, 7, trouble=0.3, kinds=(ONSET, UNLISTED)), ("absorbed",), 120),
    "a filter that diverges": (Story(5, 5, 9, trouble=0.03, kinds=(ONSET, DIVERGED)), ("restarts", "valid"), 120),
    "one taxel": (Story(1, 1, 8, trouble=0.2), ("touched",), 120),
}
"""Stories by name, with what happens in them, and the number of blocks in which it does."""


@pytest.mark.parametrize("name", STORIES)
def test_both_agree_where_something_happens(name: str) -> None:
    story, events, blocks = STORIES[name]
    seen = play(story, blocks)
    assert {event for event in events if not seen[event]} == set()


@pytest.mark.slow
@pytest.mark.parametrize("name", STORIES)
def test_both_agree_long_after_something_has_happened(name: str) -> None:
    play(STORIES[name][0], 400)


def test_the_start_is_that_of_the_priors() -> None:
    priors = ErrorPriors(lag=0.3, creep_mean=(0.01, 0.02, 0.03), warmth_mean=0.004)
    belief = ForceEstimator(SENSOR, priors).belief
    np.testing.assert_allclose(belief.shared, start_mean(priors), rtol=1e-15, atol=0)
    np.testing.assert_allclose(belief.covariance, start_covariance(priors), rtol=1e-15, atol=0)


def test_constants_and_states_are_those_of_the_compiled_estimator() -> None:
    assert (plain.BLOCK, plain.LAG, plain.RESUME_TIME) == (BLOCK, LAG, RESUME_TIME)
    assert scan_path.SHARED_STATES == COUNT == max(Shared) + 3


def test_arguments_of_other_arrays_are_refused() -> None:
    estimator = ForceEstimator(SENSOR)
    wrong = np.zeros(SENSOR.layout.taxels + 1)
    for call in (
        lambda: estimator.start(wrong),
        lambda: estimator.close_block(wrong),
        lambda: estimator.ignore(wrong),
        lambda: estimator.set_noise_variance(wrong),
        lambda: estimator.variance(wrong),
    ):
        with pytest.raises(ValueError, match=r"must have"):
            call()
    with pytest.raises(IndexError, match="contacts must have indices of taxels"):
        estimator.close_block(np.zeros(SENSOR.layout.taxels), [[SENSOR.layout.taxels]])
