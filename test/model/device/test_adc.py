# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The ADC: nearest code, ties to even, clipping flagged, round trip over every code."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posfet_model.device.adc import counts_to_volts, lsb, volts_to_counts


@pytest.mark.parametrize("bits", [1, 8, 12, 16])
@pytest.mark.parametrize(("low", "high"), [(0.0, 3.3), (-5.0, 5.0), (2.0, 2.001), (-1e6, 1e6)])
def test_every_code_survives_the_round_trip(bits: int, low: float, high: float) -> None:
    codes = np.arange(2**bits)
    converted = volts_to_counts(counts_to_volts(codes, bits, low, high), bits, low, high)
    np.testing.assert_array_equal(converted.counts, codes)
    assert not converted.clipped.any()


def test_first_and_last_codes_are_the_ends_of_the_range() -> None:
    np.testing.assert_allclose(counts_to_volts([0, 4095], 12, -1.0, 2.0), [-1.0, 2.0], rtol=0, atol=1e-15)
    assert lsb(12, 0.0, 4.095) == pytest.approx(1e-3, abs=1e-18)


def test_ties_round_to_the_even_code() -> None:
    volts = np.array([0.5, 1.5, 2.5, 3.5])  # 1 V per code
    np.testing.assert_array_equal(volts_to_counts(volts, 3, 0.0, 7.0).counts, [0, 2, 2, 4])


def test_clipping_starts_half_a_step_outside() -> None:
    volts = np.array([-1e308, -0.51, -0.49, 3.0, 7.49, 7.51, 1e308])
    converted = volts_to_counts(volts, 3, 0.0, 7.0)
    np.testing.assert_array_equal(converted.counts, [0, 0, 0, 3, 7, 7, 7])
    np.testing.assert_array_equal(converted.clipped, [True, True, False, False, False, True, True])


@given(
    bits=st.integers(1, 24),
    low=st.floats(-1e3, 1e3),
    span=st.floats(0.01, 1e3),
    fraction=st.floats(0, 1),
)
def test_error_is_at_most_half_a_step(bits: int, low: float, span: float, fraction: float) -> None:
    high = low + span
    volts = low + fraction * span
    converted = volts_to_counts(volts, bits, low, high)
    error = abs(float(counts_to_volts(converted.counts, bits, low, high)) - volts)
    assert not converted.clipped
    assert error <= 0.5 * lsb(bits, low, high) + 4e-13  # float64 spacing of 2e3 V


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("shape", [(), (0,), (5, 5), (2, 3, 4), (1_000_000,)])
def test_shape_is_preserved(dtype: type, shape: tuple[int, ...]) -> None:
    converted = volts_to_counts(np.full(shape, 1.0, dtype), 12, 0.0, 3.3)
    assert converted.counts.shape == converted.clipped.shape == shape
    assert converted.counts.dtype == np.uint16
    assert counts_to_volts(converted.counts, 12, 0.0, 3.3).shape == shape


def test_more_than_16_bits_need_a_wider_dtype() -> None:
    assert volts_to_counts(1.0, 17, 0.0, 1.0).counts == 2**17 - 1
    assert volts_to_counts(1.0, 17, 0.0, 1.0).counts.dtype == np.uint32


@pytest.mark.parametrize(
    ("volts", "bits", "low", "high", "message"),
    [
        (math.nan, 12, 0.0, 3.3, r"volts must be in \(-inf, inf\), got nan"),
        (math.inf, 12, 0.0, 3.3, "volts must be in"),
        (1 + 1j, 12, 0.0, 3.3, "volts must be real numbers"),
        ("1", 12, 0.0, 3.3, "volts must be real numbers"),
        (1.0, 0, 0.0, 3.3, r"bits must be in \[1, 24\], got 0"),
        (1.0, 12.0, 0.0, 3.3, "bits must be a whole number"),
        (1.0, 12, 3.3, 3.3, "high must be in"),
        (1.0, 12, 3.3, 0.0, "high must be in"),
        (1.0, 12, 1.0, 1.0 + 1e-9, "high must be in"),
        (1.0, 12, math.nan, 3.3, "low must be in"),
        (1.0, 12, 0.0, 1e7, "high must be in"),
    ],
)
def test_invalid_arguments_are_rejected_by_name(
    volts: object, bits: int, low: float, high: float, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        volts_to_counts(volts, bits, low, high)  # type: ignore[arg-type]


@pytest.mark.parametrize("counts", [-1, 4096, math.nan, [[0, 5000]]])
def test_counts_out_of_range_are_rejected(counts: object) -> None:
    with pytest.raises(ValueError, match=r"counts must be in \[0, 4095\]"):
        counts_to_volts(counts, 12, 0.0, 3.3)  # type: ignore[arg-type]
