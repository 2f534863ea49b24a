# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Readers of recordings: those of python-can with limits, so that a small or damaged file takes little memory."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator
from typing import Final

import can
from can.io.blf import BLFParseError, BLFReader

LONGEST_LINE: Final = 1 << 16
"""Longest line of a text file [characters]; assumed. Frames take some hundred."""
LARGEST_OBJECT: Final = 1 << 20
"""Largest object of a BLF file [byte]; assumed. Frames take some hundred."""
LARGEST_CONTAINER: Final = 16 << 20
"""Largest unpacked container of a BLF file [byte]; assumed. 128 KiB are usual."""

_SIGNATURE: Final = b"LOBJ"
_OBJECT: Final = struct.Struct("<4sHHLL")
"""Header of an object: signature, length of the header, its version, length of the object, type."""
_CONTAINER: Final = 10
"""Type of an object that contains others."""
_PACKING: Final = struct.Struct("<H14x")
"""Header of a container's content: how it is packed, then its length, which nothing relies on."""
_NOT_PACKED: Final = 0
_DEFLATED: Final = 2


class BoundedLines(io.TextIOWrapper):
    """Lines of a text file; a longer one than `LONGEST_LINE` raises ValueError."""

    def __next__(self) -> str:  # type: ignore[override]  # of text, not of bytes
        """Return the next line."""
        line = self.readline(LONGEST_LINE + 1)
        if len(line) > LONGEST_LINE:
            raise ValueError(f"a line is longer than {LONGEST_LINE} characters")
        if not line:
            raise StopIteration
        return line


class BoundedBlfReader(BLFReader):  # type: ignore[misc]  # python-can is not checked here
    """Limits python-can's reader, which unpacks any container, and reads an object with a length of 0 for ever."""

    def __iter__(self) -> Iterator[can.Message]:
        """Yield the messages. Raises BLFParseError for a damaged file, and zlib.error."""
        while head := self.file.read(_OBJECT.size):
            signature, _, _, length, kind = _OBJECT.unpack(head)
            if signature != _SIGNATURE:
                raise BLFParseError("an object has no signature")
            rest = _checked(length, LARGEST_CONTAINER) - _OBJECT.size
            content = self.file.read(rest)
            self.file.read(length % 4)  # padding
            if kind == _CONTAINER:
                yield from self._parse_container(_unpacked(content))
        self.stop()

    def _parse_data(self, data: bytes) -> Iterator[can.Message]:
        position = 0
        while (position := data.find(_SIGNATURE, position, position + 8)) >= 0:
            if len(data) - position < _OBJECT.size:
                break
            position += _checked(_OBJECT.unpack_from(data, position)[3], LARGEST_OBJECT)
        yield from super()._parse_data(data)


def _checked(length: int, limit: int) -> int:
    """Return the length of an object [byte]; raise BLFParseError when it cannot be."""
    if not _OBJECT.size <= length <= limit:
        raise BLFParseError(f"an object is {length} bytes long: it must be {_OBJECT.size} to {limit}")
    return length


def _unpacked(content: bytes) -> bytes:
    """Return the objects of a container."""
    (packing,) = _PACKING.unpack_from(content)
    packed = content[_PACKING.size :]
    if packing == _NOT_PACKED:
        return packed
    if packing != _DEFLATED:
        raise BLFParseError(f"a container is packed in an unknown way ({packing})")
    unpacked = zlib.decompressobj().decompress(packed, LARGEST_CONTAINER + 1)
    if len(unpacked) > LARGEST_CONTAINER:
        raise BLFParseError(f"a container unpacks to more than {LARGEST_CONTAINER >> 20} MiB")
    return unpacked
