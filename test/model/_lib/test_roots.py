# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Tests of the roots of many functions at once."""

from __future__ import annotations

import numpy as np
import pytest

from posfet_model._lib.roots import false_position


def test_false_position_finds_each_root_between_its_ends_in_either_direction() -> None:
    inside, outside = np.array([0.0, 3.0, -1.0]), np.array([4.0, 0.0, 9.0])
    wanted = np.array([1.0, 2.0, 0.5])
    sign = np.sign(outside - inside)

    def function(at: np.ndarray) -> np.ndarray:
        return sign * np.array([1.0, 5.0, 0.2]) * (wanted**3 - at**3)

    found = false_position(function, inside, outside, 20)
    np.testing.assert_allclose(found, wanted, atol=1e-9)


def test_a_kink_or_values_that_are_missing_do_not_keep_a_bracket_wide() -> None:
    def kinked(at: np.ndarray) -> np.ndarray:
        return np.where(at < 0.7, 1e-3, -1e6)

    def broken(at: np.ndarray) -> np.ndarray:
        return np.where(at < 0.7, 1.0, np.nan)

    for function in (kinked, broken):
        found = false_position(function, np.zeros(1), np.ones(1), 40)
        assert found[0] == pytest.approx(0.7, abs=1e-3)


def test_roots_at_or_next_to_an_end_are_found() -> None:
    wanted = np.array([0.0, 1e-9, 1e-3, 0.999, 1.0 - 1e-9, 1.0])

    def function(at: np.ndarray) -> np.ndarray:
        return wanted - at + 0.3 * (wanted**2 - at**2)

    found = false_position(function, np.zeros(6), np.ones(6), 11)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-15)
