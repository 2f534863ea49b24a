# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Bits of the ADC that never change, although others do."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from posfet_model.calibration.stuck_bits import find_stuck_bits

MIDDLE, NOISE, SCANS = 32768, 6.0, 20_000


def recording(span: float, seed: int) -> NDArray[np.uint16]:
    """Return the counts of four taxels that are pressed, and fall below their rest when released."""
    random = np.random.default_rng(seed)
    press = np.sin(np.linspace(0.0, 40.0, SCANS))[:, np.newaxis] * span
    rest = MIDDLE + random.uniform(-300.0, 300.0, 4)
    return np.rint(rest + press + NOISE * random.standard_normal((SCANS, 4))).astype(np.uint16)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("span", [0.0, 600.0, 20_000.0])
def test_a_sound_taxel_has_none(span: float, seed: int) -> None:
    assert not find_stuck_bits(recording(span, seed)).any()


@pytest.mark.parametrize("resolution", [1, 16])
@pytest.mark.parametrize("value", [0, 1])
@pytest.mark.parametrize("bit", range(8, 13))
def test_the_taxel_is_found_whatever_the_value_of_the_bit(bit: int, value: int, resolution: int) -> None:
    counts = recording(7000.0, bit) // resolution * resolution
    counts[:, 2] = counts[:, 2] & (0xFFFF ^ (1 << bit)) | (value << bit)
    np.testing.assert_array_equal(find_stuck_bits(counts.astype(np.uint16)), [False, False, True, False])


def test_a_coarser_converter_and_a_constant_taxel_have_none() -> None:
    counts = recording(7000.0, 0) // 64 * 64
    counts[:, 1] = MIDDLE
    assert not find_stuck_bits(counts.astype(np.uint16)).any()
    assert not find_stuck_bits(counts[:1].astype(np.uint16)).any()
