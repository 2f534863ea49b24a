# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Functions of Python that read the signals of a frame."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

from posfet_driver.protocol.bit_field import BitField
from posfet_driver.protocol.frame_tables import Part, Reading

Reader: TypeAlias = Callable[[bytes], int]
"""Reads the unsigned bits of a signal from the data of a frame that is long enough."""


def reader(field: BitField) -> Reader:
    """Return a function that reads the bits."""
    first, end, order, shift, mask = field.first, field.end, field.order, field.shift, field.mask
    return lambda data: int.from_bytes(data[first:end], order) >> shift & mask


class ReadReading:
    """A signal besides the scan."""

    def __init__(self, reading: Reading) -> None:
        self._reading, self._read = reading, reader(reading.field)
        self.temperature, self.flag = reading.temperature, reading.flag

    def read(self, data: bytes) -> float:
        """Return the bits of a flag, or the physical value; NaN outside the range that the DBC states."""
        raw, reading = self._read(data), self._reading
        if reading.flag:
            return raw
        physical = ((raw ^ reading.sign) - reading.sign) * reading.scale + reading.offset
        return physical if reading.low <= physical <= reading.high else float("nan")


class ReadPart:
    """What the frames with one identifier, and one value of its multiplexer, hold."""

    def __init__(self, part: Part) -> None:
        self.block = part.block
        self.sequence = reader(part.sequence) if part.sequence else None
        self.time = reader(part.time) if part.time else None
        self.readings = [ReadReading(each) for each in part.readings]


@dataclass
class Message:
    """A message of the DBC that the mapping uses."""

    length: int
    sent_length: int
    select: Reader | None
    parts: Mapping[int, ReadPart]
    unrelated: frozenset[int]
