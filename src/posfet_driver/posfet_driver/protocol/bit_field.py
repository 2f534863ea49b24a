# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Bits of a signal within a frame, in either byte order."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, Literal

from posfet_core.protocol import BitField as Compiled

MAX_LENGTH: Final = 64
"""Longest signal that is read [bit]."""


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

    def compiled(self) -> Compiled:
        """Return it as the compiled decoder reads it."""
        return Compiled(self.first, self.end, self.order == "big", self.shift, self.length)
