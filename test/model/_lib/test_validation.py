# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""What arguments are accepted, what they become, and what the error says."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from posfet_model._lib.shown import interval
from posfet_model._lib.validation import common_dtype, instance, real_array, real_number, whole_number


@pytest.mark.parametrize(
    ("low", "high", "exclusive", "text"),
    [
        (0.0, 1.0, False, "[0, 1]"),
        (0.0, 1.0, True, "(0, 1)"),
        (-math.inf, 2.5, False, "(-inf, 2.5]"),
        (1e-6, math.inf, False, "[1e-06, inf)"),
        (-math.inf, math.inf, False, "(-inf, inf)"),
    ],
)
def test_an_interval_is_written_with_its_ends_closed_or_open(
    low: float, high: float, exclusive: bool, text: str
) -> None:
    assert interval(low, high, exclusive) == text


@pytest.mark.parametrize(
    ("value", "dtype"),
    [
        (3, np.float64),
        ([1, 2], np.float64),
        (np.uint16([7]), np.float64),
        (np.float32([1.5]), np.float32),
        (np.float16([1.5]), np.float64),
        (np.zeros((0, 3)), np.float64),
    ],
)
def test_real_numbers_become_float64_and_float32_stays(value: Any, dtype: type[np.floating[Any]]) -> None:
    found = real_array("x", value)
    assert found.dtype == dtype
    assert found.shape == np.shape(value)
    assert found.tolist() == np.asarray(value).tolist()


def test_an_array_of_float64_is_not_copied() -> None:
    value = np.arange(3.0)
    assert real_array("x", value) is value


@pytest.mark.parametrize("value", [np.ma.masked_array([1.0, 9.0], mask=[0, 1]), [np.ma.masked, 1.0], np.ma.masked])
def test_a_masked_array_is_refused_in_one_line(value: Any) -> None:
    """Not unmasked: the hidden value would be calculated with."""
    with pytest.raises(ValueError, match=r"^x must be without a mask, got a masked array; use .*$"):
        real_array("x", value)


def test_the_ends_of_an_interval_belong_to_it_only_when_closed() -> None:
    assert real_array("x", [0.0, 1.0], 0, 1).tolist() == [0.0, 1.0]
    assert real_number("x", np.nextafter(0.0, 1.0), 0, 1, exclusive=True) > 0.0
    for end in (0.0, 1.0):
        with pytest.raises(ValueError, match=re.escape("x must be in (0, 1), got")):
            real_array("x", end, 0, 1, exclusive=True)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (math.nan, "x must be in (-inf, inf), got nan"),
        ([0.0, math.inf], "x must be in (-inf, inf), got inf"),
        (1j, "x must be real numbers, got 1j of type complex128"),
        ("2", "x must be real numbers, got '2' of type <U1"),
        (True, "x must be real numbers, got True of type bool"),
        (None, "x must be real numbers, got None of type object"),
        (Fraction(1, 2), "x must be real numbers, got Fraction(1, 2) of type object"),
        ([[1.0], [1.0, 2.0]], "x must be a whole array of real numbers, got [[1.0], [1.0, 2.0]]"),
    ],
)
def test_what_is_no_finite_real_number_is_refused(value: Any, message: str) -> None:
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        real_array("x", value)


def test_the_error_shows_the_first_value_out_of_range() -> None:
    with pytest.raises(ValueError, match=r"^tau must be in \[0, 10\], got -2$"):
        real_array("tau", [[1.0, -2.0], [11.0, 3.0]], 0, 10)


def test_a_number_is_no_array_not_even_of_one_element() -> None:
    assert type(real_number("x", np.float32(0.5))) is float
    assert real_number("x", np.array(0.5)) == 0.5
    with pytest.raises(ValueError, match=r"^x must be a single number, got an array of shape \(1,\)$"):
        real_number("x", [0.5])  # type: ignore[arg-type]


@pytest.mark.parametrize("value", [2, 5, np.uint8(3), np.int64(4)])
def test_whole_numbers_in_the_interval_become_int(value: int) -> None:
    assert whole_number("n", value, 2, 5) == value
    assert type(whole_number("n", value, 2, 5)) is int


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (1, "n must be in [2, 5], got 1"),
        (6, "n must be in [2, 5], got 6"),
        (3.0, "n must be a whole number in [2, 5], got 3.0"),
        (True, "n must be a whole number in [2, 5], got True"),
        (np.True_, f"n must be a whole number in [2, 5], got {np.True_!r}"),
        ("3", "n must be a whole number in [2, 5], got '3'"),
    ],
)
def test_other_numbers_are_refused(value: Any, message: str) -> None:
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        whole_number("n", value, 2, 5)


def test_an_instance_is_returned_itself_and_another_class_is_named() -> None:
    value = [1]
    assert instance("values", value, list) is value
    with pytest.raises(ValueError, match=r"^values must be a dict, got \[1\]$"):
        instance("values", value, dict)


SINGLE, DOUBLE, ONE = np.ones(3, np.float32), np.ones(3), np.array(2.0)


@pytest.mark.parametrize(
    ("arrays", "dtype"),
    [
        ({"a": SINGLE, "b": SINGLE}, np.float32),
        ({"a": SINGLE, "b": DOUBLE}, np.float64),
        ({"a": SINGLE, "b": ONE}, np.float32),  # a scalar does not decide
        ({"a": ONE, "b": np.array(1.0, np.float32)}, np.float64),  # unless there is nothing else
        ({"a": np.array(1.0, np.float32)}, np.float32),
    ],
)
def test_arrays_get_one_dtype(arrays: dict[str, Any], dtype: type[np.floating[Any]]) -> None:
    found = common_dtype(**arrays)
    assert [array.dtype for array in found] == [dtype] * len(arrays)
    for before, after in zip(arrays.values(), found, strict=True):
        np.testing.assert_array_equal(before, after)


def test_shapes_that_do_not_broadcast_are_named() -> None:
    with pytest.raises(ValueError, match=r"^shapes must broadcast together, got force \(3,\), tau \(2, 4\)$"):
        common_dtype(force=SINGLE, tau=np.ones((2, 4)))


@pytest.mark.parametrize("check", [real_array, real_number])
def test_a_long_value_does_not_fill_the_error(check: Callable[..., Any]) -> None:
    with pytest.raises(ValueError, match="x must be real numbers") as error:
        check("x", "9" * 1000)
    assert len(str(error.value)) < 120
    assert "\n" not in str(error.value)
