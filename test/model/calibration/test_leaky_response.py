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
from numpy.typing import NDArray

from posfet_core import scan_path
from posfet_model.calibration.leaky_response import high_pass


def test_the_recurrence_is_that_of_its_definition() -> None:
    rng = np.random.default_rng(1)
    decay, change = rng.uniform(0.0, 1.0, 50), rng.standard_normal((50, 3))
    expected = np.zeros((51, 3))
    for step in range(50):
        expected[step + 1] = decay[step] * expected[step] + change[step]
    np.testing.assert_array_equal(scan_path.recurrence(decay, change), expected)


@pytest.mark.parametrize("change", [np.zeros(3), np.zeros((2, 1))])
def test_a_change_without_a_row_for_each_step_is_refused(change: NDArray[np.float64]) -> None:
    with pytest.raises(ValueError, match="a row for each value of decay"):
        scan_path.recurrence(np.zeros(3), change)


def test_one_scan_has_no_response() -> None:
    assert high_pass(np.zeros(1), np.ones((1, 2)), 0.3).tolist() == [[0.0, 0.0]]
    assert high_pass(np.zeros(1), np.ones(1), 0.3).tolist() == [0.0]
