# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Analogue-to-digital converter (ADC): volts to counts and back, with clipping flagged.

The transfer function is mid-tread: code `c` represents the voltage in the middle of its step, `low + c*lsb`, with
`lsb = (high - low)/(2**bits - 1)`, so that the first code is `low` and the last is `high`. The quantisation error of an
unclipped conversion is at most lsb/2. Thermal noise, offset and gain errors belong to the signal chain, not here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from posfet_model._lib.validation import real_array, real_number, whole_number

MAX_BITS: Final = 24
MAX_VOLTS: Final = 1e6
_MIN_RELATIVE_SPAN: Final = 1e-6  # with 24 bits a step is then still 100 times the spacing of float64


@dataclass(frozen=True)
class Conversion:
    """Result of converting an array of voltages; both fields have the shape of the voltages."""

    counts: NDArray[np.unsignedinteger[Any]]
    """Codes, uint16 up to 16 bits, uint32 above."""
    clipped: NDArray[np.bool_]
    """True where the voltage lies more than half a step outside [low, high], so that the code is not the nearest."""


def lsb(bits: int, low: float, high: float) -> float:
    """Return the voltage of one step (least significant bit) [V], `(high - low)/(2**bits - 1)`.

    Parameters
    ----------
    bits : int
        Resolution, in [1, 24].
    low, high : float
        Ends of the input range [V], in [-1e6, 1e6], low < high; their difference is at least 1e-6 of the larger
        magnitude.

    Returns
    -------
    float
        Voltage of one step [V].

    Raises
    ------
    ValueError
        An argument is not a real, finite number or out of range.
    """
    bits = whole_number("bits", bits, 1, MAX_BITS)
    low = real_number("low", low, -MAX_VOLTS, MAX_VOLTS)
    high = real_number("high", high, -MAX_VOLTS, MAX_VOLTS)
    least = low + _MIN_RELATIVE_SPAN * max(abs(low), abs(high))
    if not high > least:
        raise ValueError(f"high must be in ({least:g}, {MAX_VOLTS:g}], got {high:g}")
    return (high - low) / ((1 << bits) - 1)


def volts_to_counts(volts: ArrayLike, bits: int, low: float, high: float) -> Conversion:
    """Convert voltages to the nearest codes; a tie goes to the even code.

    Parameters
    ----------
    volts : array_like
        Voltages [V], any shape. A voltage outside [low, high] is no error: it gets the first or last code, and a flag.
    bits, low, high : int / float / float
        Resolution and input range, as in `lsb`.

    Returns
    -------
    Conversion
        Codes and clipping flags, of the shape of `volts`.

    Raises
    ------
    ValueError
        A voltage is NaN or infinite, or the resolution or input range is invalid (see `lsb`).
    """
    step = lsb(bits, low, high)
    last = (1 << bits) - 1
    values = real_array("volts", volts).astype(np.float64, copy=False)
    span = high - low
    # The first clip keeps 1e308 V from overflowing below; it moves only what is flagged anyway.
    nearest = np.rint((np.clip(values, low - 2 * span, high + 2 * span) - low) / step)
    counts = np.clip(nearest, 0, last)
    return Conversion(
        counts=np.asarray(counts, dtype=np.uint16 if bits <= 16 else np.uint32),
        clipped=np.asarray(counts != nearest),
    )


def counts_to_volts(counts: ArrayLike, bits: int, low: float, high: float) -> NDArray[np.float64]:
    """Return the voltages [V] that codes represent, ``low + counts*lsb``.

    Parameters
    ----------
    counts : array_like
        Codes, any shape, in [0, 2**bits - 1]; they need not be integers, so the mean of several scans is allowed.
    bits, low, high : int / float / float
        Resolution and input range, as in `lsb`.

    Returns
    -------
    ndarray
        Voltages [V], of the shape of `counts`.

    Raises
    ------
    ValueError
        A code is out of range, or the resolution or input range is invalid (see `lsb`).
    """
    step = lsb(bits, low, high)
    values = real_array("counts", counts, 0, (1 << bits) - 1).astype(np.float64, copy=False)
    return np.asarray(low + values * step)
