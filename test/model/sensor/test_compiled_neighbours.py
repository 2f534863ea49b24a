# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The compiled interpolation from neighbours equals the plain reference in Python."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.neighbour_estimate import NeighbourInterpolation
from reference import neighbour_estimate as reference

LAYOUT = load_sensor().layout


@given(
    st.integers(1, 64),
    st.integers(1, 64),
    st.integers(0, 2**32 - 1),
    st.sampled_from([0.0, 0.1, 0.6, 1.0]),
    st.sampled_from([0.0, 1e-3, 0.3]),
)
def test_estimates_equal_those_of_the_reference(rows: int, cols: int, seed: int, unknown: float, floor: float) -> None:
    layout, random = replace(LAYOUT, rows=rows, cols=cols), np.random.default_rng(seed)
    compiled, plain = NeighbourInterpolation(layout), reference.NeighbourInterpolation(layout)
    force = random.choice([1.0, 1e-2, 0.0, math.nan], layout.taxels, p=[0.6, 0.2, 0.15, 0.05])
    force *= random.uniform(-0.2, 1.0, layout.taxels)
    force += 0.0  # no -0.0: NumPy does not say which zero is the greater one
    hidden, wanted = random.random(layout.taxels) < unknown, random.permutation(layout.taxels)[: 1 + seed % 50]
    for name in ("interpolate", "lower_bound"):
        found = getattr(compiled, name)(force, hidden, wanted, floor)
        np.testing.assert_allclose(found, getattr(plain, name)(force, hidden, wanted, floor), rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(compiled.max_neighbour(force), plain.max_neighbour(force))


def test_a_taxel_that_does_not_exist_is_refused() -> None:
    none = np.zeros(LAYOUT.taxels, np.bool_)
    for taxel in (-1, LAYOUT.taxels):
        with pytest.raises(IndexError, match="wanted must have indices of taxels"):
            NeighbourInterpolation(LAYOUT).interpolate(np.zeros(LAYOUT.taxels), none, [taxel], 0.0)
