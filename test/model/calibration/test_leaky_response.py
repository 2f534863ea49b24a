# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Leakage as the fit of a calibration computes it."""

from __future__ import annotations

import numpy as np
import pytest

from posfet_core import scan_path
from posfet_model._lib.types import Array
from posfet_model.calibration.leaky_response import high_pass
from reference import leaky_response


@pytest.fixture
def time() -> Array:
    """Return times that are not evenly spaced, with a gap and a repeated one [s]."""
    steps = np.random.default_rng(1).uniform(2e-3, 6e-3, 500)
    steps[200], steps[300] = 3.0, 0.0
    return np.cumsum(steps)


@pytest.fixture
def source(time: Array) -> Array:
    return np.random.default_rng(2).standard_normal((len(time), 5)).cumsum(axis=0)


@pytest.mark.parametrize("name", ["high_pass", "low_pass"])
@pytest.mark.parametrize("time_constant", [1e-3, 0.26, 1e5])
def test_the_response_is_that_of_the_reference(name: str, time_constant: float, time: Array, source: Array) -> None:
    compiled, expected = getattr(scan_path, name), getattr(leaky_response, name)
    whole = expected(time, source, time_constant)
    np.testing.assert_allclose(compiled(time, source, time_constant), whole, rtol=0, atol=1e-12 * np.abs(source).max())
    np.testing.assert_array_equal(
        compiled(time, source[:, 0], time_constant), compiled(time, source, time_constant)[:, 0]
    )


def test_the_distance_from_a_play_operator_is_that_of_the_reference(source: Array) -> None:
    np.testing.assert_array_equal(scan_path.play_distance(source, 1.5), leaky_response.play_distance(source, 1.5))


@pytest.mark.parametrize(("first_signal", "end_of_signals"), [(5, 5), (2, 4)])
@pytest.mark.parametrize("block", [1, 7, 500])
def test_columns_of_a_fit_are_those_of_the_reference(
    first_signal: int, end_of_signals: int, block: int, time: Array, source: Array
) -> None:
    given = 0.26, np.array([1.0, -0.3, 0.2, 0.1, 2.0]), 0.7, first_signal, end_of_signals, block
    means = scan_path.fit_columns(time, source, *given)
    expected = leaky_response.fit_columns(time, source, *given)
    np.testing.assert_allclose(means, expected, rtol=0, atol=1e-12 * np.abs(source).max())


def test_arrays_that_do_not_fit_are_refused(time: Array, source: Array) -> None:
    with pytest.raises(ValueError, match="a value for each row of source"):
        scan_path.high_pass(time[1:], source, 0.3)
    with pytest.raises(ValueError, match="source must have a row or more"):
        scan_path.low_pass(np.zeros(0), np.zeros((0, 2)), 0.3)
    with pytest.raises(ValueError, match="force must have a row or more"):
        scan_path.play_distance(np.zeros((0, 2)), 0.3)
    with pytest.raises(ValueError, match="a column for each coefficient"):
        scan_path.fit_columns(time, source, 0.3, np.zeros(4), 0.0, 5, 5, 7)
    with pytest.raises(ValueError, match="block must be 1 or more"):
        scan_path.fit_columns(time, source, 0.3, np.zeros(5), 0.0, 5, 5, 0)


def test_one_scan_has_no_response() -> None:
    assert high_pass(np.zeros(1), np.ones((1, 2)), 0.3).tolist() == [[0.0, 0.0]]
    assert high_pass(np.zeros(1), np.ones(1), 0.3).tolist() == [0.0]
