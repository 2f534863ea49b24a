# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The compiled filter of the force errors against the one in Python, over random steps of any kind."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import strategies as st
from numpy.typing import NDArray

from posfet_core import scan_path
from posfet_core.scan_path import OWN_STATES as OWN
from posfet_model.estimation.error_states import COUNT, ErrorPriors, Shared
from reference import force_error_filter as plain
from reference.estimation.error_states import start_belief, start_covariance, start_mean
from support.example_counts import each_of, examples

Array = NDArray[np.float64]
PARTS = ("shared", "covariance", "error", "slope", "own")
STEPS = (
    "predict", "update", "update_alone", "admit", "widen", "measure_shared", "measure_temperature",
    "restart_temperature",
    "integrate", "respond", "cool", "forget_small_forces", "forget", "restart",
)  # fmt: skip


def covariance(random: np.random.Generator, size: int, scale: float = 1.0) -> Array:
    factor = random.standard_normal((size, size))
    return scale * (factor @ factor.T / size + 0.3 * np.eye(size))


class Both:
    """The same belief in both filters, and random steps for them."""

    def __init__(self, taxels: int, states: int, seed: int) -> None:
        self.random = random = np.random.default_rng(seed)
        self.taxels, self.states = taxels, states
        parts = [
            random.standard_normal(states),
            covariance(random, states),
            random.standard_normal((taxels, OWN)),
            0.3 * random.standard_normal((taxels, OWN, states)),
            np.array([covariance(random, OWN, 0.3) for _ in range(taxels)]),
        ]
        small = random.random(taxels) < 0.5  # of the others the small force is known exactly
        parts[3][small, 2] = parts[4][small, 2] = parts[4][small, :, 2] = 0.0
        self.compiled = scan_path.ForceErrorFilter(scan_path.Belief(*parts))
        self.plain = plain.ForceErrorFilter(plain.Belief(*(each.copy() for each in parts)))

    def step(self, kind: str) -> None:
        """Take a step in both, and compare."""
        arguments = getattr(self, f"_{kind}")()
        belief = kind in {"integrate", "respond", "cool", "forget_small_forces", "forget", "restart"}
        for each in (self.compiled, self.plain):
            getattr(each.belief if belief else each, kind)(*arguments)
        self.compare()

    def compare(self) -> None:
        for part in PARTS:
            mine, other = (getattr(each.belief, part) for each in (self.compiled, self.plain))
            scale = max(float(np.abs(other).max(initial=0.0)), 1.0)
            np.testing.assert_allclose(mine, other, rtol=0, atol=1e-11 * scale, err_msg=part)
        response, measured, noise = self._response(), self.random.standard_normal(self.taxels), self._variance()
        found, expected = (each.innovation(measured, response, noise) for each in (self.compiled, self.plain))
        self._same(found, expected)
        self._same(*([each.predicted(response)] for each in (self.compiled, self.plain)))
        (own, factor), (other, rows) = (each.covariance_root(response) for each in (self.compiled, self.plain))
        self._same([own, factor @ factor.T], [other, rows @ rows.T])  # a root is not unique
        if self.states == COUNT:
            self._same(*(each.temperature_innovation(0.3, 0.1, 2.0) for each in (self.compiled, self.plain)))

    @staticmethod
    def _same(found: object, expected: object) -> None:
        for mine, other in zip(found, expected, strict=True):  # type: ignore[call-overload]
            scale = max(float(np.abs(other).max(initial=0.0)), 1.0)
            np.testing.assert_allclose(mine, other, rtol=0, atol=1e-11 * scale)

    def _where(self) -> NDArray[np.bool_]:
        return self.random.random(self.taxels) < 0.6

    def _response(self) -> Array:
        return self.random.standard_normal((self.taxels, self.states))

    def _variance(self) -> Array:
        return self.random.uniform(0.05, 0.5, self.taxels)

    def _predict(self) -> tuple[Array, ...]:
        random, states, taxels = self.random, self.states, self.taxels
        matrix = np.eye(states) + 0.05 * random.standard_normal((states, states)) * (random.random(states) < 0.3)
        own = np.array([covariance(random, OWN, 0.02) for _ in range(taxels)])
        own[:, 2] = own[:, :, 2] = 0.0
        own[:, 2, 2] = 0.1 * self._where()
        after, (leaked, driven) = random.standard_normal(states), self._integrate()
        return after, matrix, covariance(random, states, 0.1), leaked, driven, own

    def _integrate(self) -> tuple[Array, Array]:
        return self.random.uniform(-0.1, 0.3, self.taxels), 0.1 * self._response()

    def _update(self) -> tuple[Array, ...]:
        return self._where(), self.random.standard_normal(self.taxels), self._response(), self._variance()

    _update_alone = _update

    def _admit(self) -> tuple[Array, float]:
        return self.random.standard_normal(self.states), 0.3

    _widen = _admit

    def _measure_shared(self) -> tuple[float, Array, float]:
        return 0.4, self.random.standard_normal(self.states), 0.2

    def _measure_temperature(self) -> tuple[float, float, float]:
        return 0.7, 0.3, 2.0

    def _restart_temperature(self) -> tuple[float, Array, Array]:
        return 0.5, self.random.standard_normal(self.states), covariance(self.random, self.states)

    def _respond(self) -> tuple[Array]:
        return (0.1 * self.random.standard_normal(self.taxels),)

    def _cool(self) -> tuple[Array]:
        return (self.random.uniform(0.0, 0.3, self.taxels) * self._where(),)

    def _forget_small_forces(self) -> tuple[Array]:
        return (self._where(),)

    def _restart(self) -> tuple[int, float, float]:
        return int(self.random.integers(self.states)), 0.3, 0.2

    def _forget(self) -> tuple[Array, int]:
        return self._where(), int(self.random.integers(OWN))


CASES = st.tuples(
    st.integers(1, 64),
    st.sampled_from([1, 2, 5, COUNT]),
    st.integers(0, 2**32 - 1),
    st.lists(st.sampled_from(STEPS), min_size=1, max_size=8),
)
"""Numbers of taxels and of states, seed, steps."""


@examples(50, 150)
def test_any_steps_give_the_same_belief(count: int) -> None:
    each_of(count, CASES, lambda case: compare(*case))


def compare(taxels: int, states: int, seed: int, steps: list[str]) -> None:
    both = Both(taxels, states, seed)
    for kind in steps:
        if states == COUNT or "temperature" not in kind:
            both.step(kind)


@pytest.mark.parametrize("taxels", [1, 256, pytest.param(4096, marks=pytest.mark.slow)])
def test_arrays_of_any_size_have_the_same_belief(taxels: int) -> None:
    both = Both(taxels, COUNT, taxels)
    for kind in ("predict", "update", "measure_temperature", "predict", "update_alone"):
        both.step(kind)


def test_the_states_of_the_temperatures_are_those_of_the_estimator() -> None:
    assert tuple(Shared)[: len(scan_path.THERMAL_STATES)] == scan_path.THERMAL_STATES
    assert scan_path.THERMAL_STATES[-1] == Shared.ZERO
    assert OWN == plain.OWN
    assert scan_path.NEGLIGIBLE_CORRELATION == plain.NEGLIGIBLE


def test_a_copy_and_what_was_read_before_stay_as_they_are() -> None:
    both = Both(4, 3, 0)
    belief = both.compiled.belief
    copy, shared, before = belief.copy(), belief.shared, belief.covariance
    kept = [getattr(copy, part).copy() for part in PARTS]
    both.step("predict")
    for part, value in zip(PARTS, kept, strict=True):
        np.testing.assert_array_equal(getattr(copy, part), value)
    np.testing.assert_array_equal(shared, copy.shared)
    np.testing.assert_array_equal(before, copy.covariance)


def test_another_belief_of_the_same_array_can_be_followed() -> None:
    both = Both(4, 3, 0)
    other = both.compiled.belief.copy()
    both.compiled.belief = other
    other.error[:, 0] += 1.0
    np.testing.assert_array_equal(both.compiled.belief.error, other.error)
    with pytest.raises(ValueError, match="belief must be of the same array"):
        both.compiled.belief = Both(5, 3, 0).compiled.belief


def test_arrays_of_another_shape_are_refused() -> None:
    compiled = Both(4, 3, 0).compiled
    where, values, rows = np.ones(4, np.bool_), np.ones(4), np.ones((4, 3))
    with pytest.raises(ValueError, match=r"sensitivity must have the shape \[4, 3\]"):
        compiled.update(where, values, np.ones((4, 4)), values)
    with pytest.raises(ValueError, match="where must have one value for each of 4 taxels"):
        compiled.update(where[:3], values, rows, values)
    with pytest.raises(ValueError, match=r"matrix must have the shape \[3, 3\]"):
        compiled.predict(np.ones(3), np.eye(4), np.eye(3), values, rows, np.zeros((4, OWN, OWN)))
    with pytest.raises(ValueError, match=r"slope must have the shape \[4, 5, 3\]"):
        scan_path.Belief(np.ones(3), np.eye(3), np.ones((4, OWN)), rows, np.zeros((4, OWN, OWN)))
    with pytest.raises(ValueError, match="no states for the temperatures"):
        compiled.measure_temperature(0.0, 1.0, 0.0)
    with pytest.raises(IndexError, match="state must be one of a taxel"):
        compiled.belief.forget(where, OWN)


def test_a_covariance_that_is_not_positive_is_refused() -> None:
    priors = ErrorPriors()
    covariance = start_covariance(priors)
    covariance[0, 1] = covariance[1, 0] = 1.0  # beyond a correlation of 1
    compiled = scan_path.ForceErrorFilter(start_belief(2, start_mean(priors), covariance))
    with pytest.raises(ValueError, match="a covariance must be positive"):
        compiled.covariance_root(np.zeros((2, COUNT)))
