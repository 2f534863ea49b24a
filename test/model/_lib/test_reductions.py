# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Median and any-true of small arrays, compared with NumPy and with Python's own sort."""

from __future__ import annotations

import statistics

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from reference.reductions import any_true, median, upper_median

NUMBERS = st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=40)


@given(NUMBERS)
def test_the_upper_median_is_that_of_the_standard_library(values: list[float]) -> None:
    assert upper_median(np.array(values)) == statistics.median_high(values)


@given(NUMBERS.filter(lambda values: len(values) % 2))
def test_of_an_odd_number_of_values_it_is_the_median_of_numpy(values: list[float]) -> None:
    assert upper_median(np.array(values)) == np.median(values)


@given(NUMBERS)
def test_the_median_is_that_of_the_standard_library(values: list[float]) -> None:
    assert median(np.array(values)) == pytest.approx(statistics.median(values), rel=1e-15)


def test_the_upper_median_of_nothing_is_zero_and_the_argument_is_not_sorted() -> None:
    assert upper_median(np.zeros(0)) == 0.0
    values = np.array([3.0, 1.0, 2.0, 4.0])
    assert upper_median(values) == 3.0
    assert values.tolist() == [3.0, 1.0, 2.0, 4.0]


@given(st.lists(st.booleans(), max_size=300))
def test_any_true_is_that_of_python(mask: list[bool]) -> None:
    assert any_true(np.array(mask, np.bool_)) is any(mask)


@pytest.mark.parametrize("where", [(0, 0), (3, 1), (6, 4)])
def test_any_true_finds_one_element_of_a_matrix_and_of_every_other_column(where: tuple[int, int]) -> None:
    mask = np.zeros((7, 5), np.bool_)
    assert not any_true(mask)
    mask[where] = True
    assert any_true(mask)
    assert any_true(mask[:, ::2]) is (where[1] % 2 == 0)
