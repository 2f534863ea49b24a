# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Serialisation of ROS messages without ROS: little-endian CDR as Fast DDS writes it.

Alignment counts from after the four bytes of the encoding header; sequences and strings start with their length; a
string ends with a zero byte that its length includes (OMG, DDS-XTypes 1.3, section 7.4.3, encoding version 1).
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from functools import lru_cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from posfet_sim.recording.message_definitions import message_fields
from posfet_sim.recording.ros2msg import Field

ENCODING: Final = b"\x00\x01\x00\x00"
"""Header of every message: plain CDR, little-endian."""

_TYPES: Final = {
    "bool": "?", "byte": "B", "char": "B", "int8": "b", "uint8": "B", "int16": "<i2", "uint16": "<u2", "int32": "<i4",
    "uint32": "<u4", "int64": "<i8", "uint64": "<u8", "float32": "<f4", "float64": "<f8",
}  # fmt: skip
DTYPES: Final = {name: np.dtype(code) for name, code in _TYPES.items()}
"""Little-endian types of numbers by name."""
_STRUCTS: Final = {name: struct.Struct(f"<{dtype.char}") for name, dtype in DTYPES.items()} | {
    "int64": struct.Struct("<q"),
    "uint64": struct.Struct("<Q"),
}
_LENGTH: Final = struct.Struct("<I")


def serialise(name: str, values: Mapping[str, Any]) -> bytes:
    """Serialise a message.

    Parameters
    ----------
    name : str
        Type of the message, package/Name.
    values : mapping of str to Any
        Every field and no other: numbers, text, mappings for messages, sequences of those; a sequence of numbers may
        be an array of any shape.

    Returns
    -------
    bytes
        The message with its encoding header.

    Raises
    ------
    ValueError
        A field is missing or unknown.
    struct.error
        A number is out of the range of its type.
    """
    buffer = bytearray()
    _write_message(buffer, name, values)
    return ENCODING + bytes(buffer)


class PreparedMessage:
    """A serialised message whose numbers are overwritten in place, for many messages of equal lengths.

    Parameters
    ----------
    name : str
        Type of the message, package/Name.
    values : mapping of str to Any
        Every field, as for `serialise`: with the lengths and texts of all messages.

    Raises
    ------
    ValueError
        A field is missing or unknown.
    """

    def __init__(self, name: str, values: Mapping[str, Any]) -> None:
        buffer = bytearray()
        self._ends: dict[str, int] = {}
        _write_message(buffer, name, values, self._ends)
        self._buffer = bytearray(ENCODING) + buffer

    def numbers(self, field: str, dtype: str, count: int) -> NDArray[Any]:
        """Return the last numbers of a field as an array to write to.

        Parameters
        ----------
        field : str
            Name of a field of the message, or of one in it, as header.stamp.
        dtype : str
            Little-endian type of the numbers, such as "<f4".
        count : int
            Number of numbers; they follow each other without gaps.
        """
        size = np.dtype(dtype).itemsize * count
        return np.frombuffer(self._buffer, dtype, count, len(ENCODING) + self._ends[field] - size)

    def data(self) -> bytes:
        """Return the message with its encoding header."""
        return bytes(self._buffer)


def _write_message(
    buffer: bytearray, name: str, values: Mapping[str, Any], ends: dict[str, int] | None = None, within: str = ""
) -> None:
    """Append a message; `ends` receives where each field ends, also those of messages in it, as header.stamp."""
    known = message_fields(name)
    if values.keys() != _names(name):
        names = ", ".join(field.name for field in known)
        raise ValueError(f"{name} must have the fields {names}, got {', '.join(values)}")
    for field in known:
        if field.many:
            _write_sequence(buffer, field, values[field.name])
        else:
            _write_one(buffer, field.type, values[field.name], ends, f"{within}{field.name}.")
        if ends is not None:
            ends[within + field.name] = len(buffer)


@lru_cache
def _names(name: str) -> frozenset[str]:
    return frozenset(field.name for field in message_fields(name))


def _write_sequence(buffer: bytearray, field: Field, values: Any) -> None:
    dtype = DTYPES.get(field.type)
    array = None if dtype is None else np.asarray(values, dtype)
    size = len(values) if array is None else array.size
    if field.length is None:
        _align(buffer, 4)
        buffer += _LENGTH.pack(size)
    elif size != field.length:
        raise ValueError(f"{field.name}: must have {field.length} elements, got {size}")
    if array is not None:
        if array.size:
            _align(buffer, array.itemsize)
        buffer += array.tobytes()
        return
    for value in values:
        _write_one(buffer, field.type, value)


def _write_one(buffer: bytearray, kind: str, value: Any, ends: dict[str, int] | None = None, within: str = "") -> None:
    packer = _STRUCTS.get(kind)
    if packer is not None:
        _align(buffer, packer.size)
        buffer += packer.pack(value)
    elif kind == "string":
        data = value.encode() + b"\0"
        _align(buffer, 4)
        buffer += _LENGTH.pack(len(data)) + data
    else:
        _write_message(buffer, kind, value, ends, within)


def _align(buffer: bytearray, size: int) -> None:
    missing = -len(buffer) % size
    if missing:
        buffer += bytes(missing)
