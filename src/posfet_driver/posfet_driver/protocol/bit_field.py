# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Bits of a signal within a frame, in either byte order, and functions that read them without the DBC."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

Reader: TypeAlias = Callable[[bytes], int]
"""Reads the unsigned bits of a signal from the data of a frame that is long enough."""


@dataclass(frozen=True)
class BitField:
    """Place of a signal: the number in bytes [first, end) shifted right by `shift`, of which `length` bits are kept."""

    first: int
    end: int
    order: Literal["little", "big"]
    shift: int
    length: int

    @classmethod
    def of_signal(cls, signal: Any) -> BitField:
        """Return the place of a signal of cantools; a DBC names the highest bit of a big-endian one.

        Parameters
        ----------
        signal : cantools.database.Signal
            The signal.
        """
        byte, bit = divmod(signal.start, 8)
        if signal.byte_order == "little_endian":
            return cls(byte, byte + (bit + signal.length + 7) // 8, "little", bit, signal.length)
        end_bit = 8 * byte + 7 - bit + signal.length
        end = (end_bit + 7) // 8
        return cls(byte, end, "big", 8 * end - end_bit, signal.length)

    @property
    def mask(self) -> int:
        """Largest number that the bits can hold."""
        return (1 << self.length) - 1

    def reader(self) -> Reader:
        """Return the fastest function that reads the bits."""
        first, end, order, shift, mask = self.first, self.end, self.order, self.shift, self.mask
        if end - first == 1:
            return lambda data: data[first] >> shift & mask
        return lambda data: int.from_bytes(data[first:end], order) >> shift & mask

    def value_reader(self, signal: Any) -> Callable[[bytes], float]:
        """Return a function that reads the physical value; NaN outside the range that the DBC states.

        Parameters
        ----------
        signal : cantools.database.Signal
            Source of sign, scaling and range.
        """
        read, sign = self.reader(), (1 << self.length - 1) if signal.is_signed else 0
        scale, offset = float(signal.scale), float(signal.offset)
        low = float("-inf") if signal.minimum is None else float(signal.minimum)
        high = float("inf") if signal.maximum is None else float(signal.maximum)

        def value(data: bytes) -> float:
            physical = ((read(data) ^ sign) - sign) * scale + offset
            return physical if low <= physical <= high else float("nan")

        return value
