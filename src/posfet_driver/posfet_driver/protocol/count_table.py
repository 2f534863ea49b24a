# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Counts of a scan in the frames of any board: places and look-up tables of all taxels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from posfet_driver.protocol.bit_field import BitField
from posfet_model.sensor.description import Adc
from posfet_model.sensor.frame_mapping import FrameMapping
from posfet_model.sensor.scan import FULL_SCALE_COUNT

MAX_BITS: Final = 16
"""Longest signal of a count."""
MAX_ENTRIES: Final = 1 << 22
"""Largest number of raw values in all look-up tables together (8 MiB)."""

_VOLTS: Final = {"V": 1.0, "mV": 1e-3, "uV": 1e-6, "µV": 1e-6}


def conversion(signal: Any, adc: Adc) -> NDArray[np.uint16]:
    """Return the count of every raw value of a signal.

    A signal in V, mV or uV is a voltage; its count is the place of this voltage in the range of the ADC. Any other is a
    code: the minimum of the DBC is the low end of the ADC's range and the maximum the high end; without them, the
    smallest and the largest value that the bits can hold. What is outside is clipped to 0 or 65535.

    Parameters
    ----------
    signal : cantools.database.Signal
        Source of length, sign, scaling, range and unit.
    adc : Adc
        Source of the range of the ADC [V].

    Returns
    -------
    ndarray
        Counts, shape [2 ** signal.length], by the unsigned raw value.
    """
    raw = np.arange(1 << signal.length, dtype=np.int64)
    if signal.is_signed:
        sign = 1 << signal.length - 1
        raw = (raw ^ sign) - sign
    physical = raw * float(signal.scale) + float(signal.offset)
    if signal.unit in _VOLTS:
        physical, low, high = physical * _VOLTS[signal.unit], adc.low, adc.high
    elif signal.minimum is None or signal.maximum is None:
        low, high = physical.min(), physical.max()
    else:
        low, high = float(signal.minimum), float(signal.maximum)
    counts = np.rint((physical - low) * (FULL_SCALE_COUNT / (high - low)))
    return np.clip(counts, 0, FULL_SCALE_COUNT).astype(np.uint16)


def check_count(mapping: FrameMapping, signal: Any, adc: Adc) -> None:
    """Check that a signal can hold a count.

    Parameters
    ----------
    mapping : FrameMapping
        Source of the key for the message.
    signal : cantools.database.Signal
        The signal.
    adc : Adc
        The ADC of the board.

    Raises
    ------
    ConfigError
        When it is no whole number of at most 16 bits, or its scaling or range cannot be used.
    """
    name = signal.name
    if signal.is_float:
        raise mapping.error("counts", f"signal {name} is a floating-point number, a count must be a whole number")
    if signal.length > MAX_BITS:
        raise mapping.error("counts", f"signal {name} has {signal.length} bits, a count has at most {MAX_BITS}")
    if signal.length < adc.bits:
        raise mapping.error("counts", f"signal {name} has {signal.length} bits, adc.bits = {adc.bits} must not be more")
    low, high = signal.minimum, signal.maximum
    if not float(signal.scale) or (low is not None and high is not None and not high > low):
        raise mapping.error("counts", f"signal {name}: the scale must not be 0 and the maximum must exceed the minimum")


class CountTable:
    """Where the count of each taxel is in the data of the frames of a scan, and the count of each raw value.

    Parameters
    ----------
    mapping : FrameMapping
        Source of the key for error messages.
    fields : sequence of (int, BitField, Signal)
        For each taxel, row by row: offset of its frame in the data of all frames of a scan
        [byte], place and signal of cantools.
    adc : Adc
        The ADC of the board.

    Raises
    ------
    ConfigError
        When the signals have too many different scalings.
    """

    def __init__(self, mapping: FrameMapping, fields: Sequence[tuple[int, BitField, Any]], adc: Adc) -> None:
        bases: dict[tuple[object, ...], int] = {}
        tables: list[NDArray[np.uint16]] = []
        entries = 0
        taxels = len(fields)
        base = [0] * taxels
        for taxel, (_, _, signal) in enumerate(fields):
            key = (
                signal.length,
                signal.is_signed,
                signal.scale,
                signal.offset,
                signal.minimum,
                signal.maximum,
                signal.unit,
            )
            if key not in bases:
                bases[key] = entries
                entries += 1 << signal.length
                if entries > MAX_ENTRIES:
                    raise mapping.error("counts", f"the signals have too many different scalings: {len(bases)} or more")
                tables.append(conversion(signal, adc))
            base[taxel] = bases[key]
        table = np.concatenate(tables)
        self.places: Final = [(offset, field, base[taxel]) for taxel, (offset, field, _) in enumerate(fields)]
        """For each taxel, row by row: offset of its frame [byte], place, and index of the count of raw value 0."""
        self.table: Final = table if len(tables) > 1 or not np.array_equal(table, np.arange(len(table))) else table[:0]
        """Counts of all raw values of all scalings, shape [entries]; none where raw values are counts."""
