# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Reading of serialised ROS messages by the schema that a file carries: CDR of either byte order."""

from __future__ import annotations

import struct
from typing import Any, Final

import numpy as np

from posfet_sim.recording.cdr import DTYPES
from posfet_sim.recording.ros2msg import Definitions, Field

_ORDERS: Final = {b"\x00\x00": ">", b"\x00\x01": "<"}
"""Byte order by the first two bytes of a message: plain CDR, encoding version 1."""
_LETTERS: Final = {"int64": "q", "uint64": "Q"}
"""Types whose letter in NumPy depends on the machine."""
_HEADER: Final = 4
"""Size of the encoding header [byte]."""


class MessageReader:
    """Reads messages of one type.

    Whatever the bytes are, reading ends with a message or with ValueError, and takes memory in proportion to their
    number.

    Parameters
    ----------
    definitions : mapping of str to tuple of Field
        Fields of the type and of all types in it, as `posfet_sim.recording.ros2msg.parse_schema` returns them.
    name : str
        Type of the messages, package/Name.
    """

    def __init__(self, definitions: Definitions, name: str) -> None:
        self._definitions = definitions
        self._name = name
        self._structs = {
            order: {kind: struct.Struct(order + _LETTERS.get(kind, dtype.char)) for kind, dtype in DTYPES.items()}
            for order in "<>"
        }
        self._data = b""
        self._at = 0
        self._order = "<"

    def read(self, data: bytes) -> dict[str, Any]:
        """Return the fields of a message by name.

        Parameters
        ----------
        data : bytes
            The message with its encoding header.

        Returns
        -------
        dict of str to Any
            Numbers, text, dictionaries for messages; arrays for many numbers, lists for many of all else.

        Raises
        ------
        ValueError
            The bytes are no such message; one line.
        """
        order = _ORDERS.get(bytes(data[:2]))
        if order is None or len(data) < _HEADER:
            raise ValueError(f"{self._name}: not plain CDR")
        self._data, self._at, self._order = data, _HEADER, order
        try:
            return self._message(self._name)
        except struct.error as error:
            raise ValueError(f"{self._name}: the message is too short") from error
        except UnicodeDecodeError as error:
            raise ValueError(f"{self._name}: a text is not UTF-8") from error

    def _message(self, name: str) -> dict[str, Any]:
        return {
            field.name: self._many(field) if field.many else self._one(field.type) for field in self._definitions[name]
        }

    def _many(self, field: Field) -> Any:
        length = self._one("uint32") if field.length is None else field.length
        if length > len(self._data) - self._at:  # every element has a byte at least
            raise ValueError(f"{self._name}: {field.name} with {length} elements is longer than the message")
        dtype = DTYPES.get(field.type)
        if dtype is None:
            return [self._one(field.type) for _ in range(length)]
        if not length:
            return np.empty(0, dtype)
        self._align(dtype.itemsize)
        begin, self._at = self._at, self._at + length * dtype.itemsize
        if self._at > len(self._data):
            raise ValueError(f"{self._name}: {field.name} is longer than the message")
        if field.type == "bool":  # a byte other than 0 and 1 is no bool of NumPy's
            return np.frombuffer(self._data, np.uint8, length, begin) != 0
        if self._order == ">":
            return np.frombuffer(self._data, dtype.newbyteorder(">"), length, begin).astype(dtype)
        return np.frombuffer(self._data, dtype, length, begin)

    def _one(self, kind: str) -> Any:
        packed = self._structs[self._order].get(kind)
        if packed is not None:
            self._align(packed.size)
            (value,) = packed.unpack_from(self._data, self._at)
            self._at += packed.size
            return value
        if kind != "string":
            return self._message(kind)
        size = self._one("uint32")
        begin, self._at = self._at, self._at + size
        if self._at > len(self._data):
            raise ValueError(f"{self._name}: a text is longer than the message")
        return str(self._data[begin : self._at].rstrip(b"\0"), "utf-8")

    def _align(self, size: int) -> None:
        self._at += (_HEADER - self._at) % size
