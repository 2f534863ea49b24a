"""Analogue-to-digital converter: volts to counts and back, with clipping flagged.

The transfer is mid-tread: code `c` stands for the voltage in the middle of its step, `low + c*lsb`, with
`lsb = (high - low)/(2**bits - 1)`, so that the first code is `low` and the last is `high`. An unclipped conversion is
within lsb/2 of the truth. Thermal noise, offset and gain errors belong to the signal chain, not here.
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
    """What the converter delivers for an array of voltages, both fields of the voltages' shape."""

    counts: NDArray[np.unsignedinteger[Any]]
    """Codes, uint16 up to 16 bits, uint32 above."""
    clipped: NDArray[np.bool_]
    """True where the voltage lies more than half a step outside [low, high], so that the code is not the nearest."""


def lsb(bits: int, low: float, high: float) -> float:
    """Return the voltage of one step [V], `(high - low)/(2**bits - 1)`.

    bits in [1, 24]; low, high [V] in [-1e6, 1e6] with low < high (their difference at least 1e-6 of their size).
    Raises ValueError otherwise.
    """
    bits = whole_number("bits", bits, 1, MAX_BITS)
    low = real_number("low", low, -MAX_VOLTS, MAX_VOLTS)
    high = real_number("high", high, -MAX_VOLTS, MAX_VOLTS)
    least = low + _MIN_RELATIVE_SPAN * max(abs(low), abs(high))
    if not high > least:
        raise ValueError(f"high must be in ({least:g}, {MAX_VOLTS:g}], got {high:g}")
    return (high - low) / ((1 << bits) - 1)


def volts_to_counts(volts: ArrayLike, bits: int, low: float, high: float) -> Conversion:
    """Convert voltages [V], any shape, to the nearest codes; a tie goes to the even code.

    Raises ValueError for a NaN or infinite voltage and for what `lsb` refuses. A voltage out of range is not an error:
    it gets the first or last code and a flag.
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
    """Return the voltages [V] that codes stand for, `low + counts*lsb`, in the codes' shape.

    Counts are in [0, 2**bits - 1] and need not be whole: the mean of several scans is welcome. Raises ValueError
    otherwise, and for what `lsb` refuses.
    """
    step = lsb(bits, low, high)
    values = real_array("counts", counts, 0, (1 << bits) - 1).astype(np.float64, copy=False)
    return np.asarray(low + values * step)
