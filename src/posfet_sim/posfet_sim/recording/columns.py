# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Messages as columns: one array for each field, for NumPy and HDF5."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.units import NANOSECONDS
from posfet_sim.recording.cdr import DTYPES
from posfet_sim.recording.ros2msg import Definitions

_TIMES: Final = ("builtin_interfaces/Time", "builtin_interfaces/Duration")
"""Messages that become one number [ns]."""
_INT64: Final = np.dtype(np.int64)


class _Numbers:
    """Numbers in a buffer: `many` of them per message, or sequences of any length, whose ends are kept, too."""

    def __init__(self, dtype: np.dtype[Any], many: bool, length: int | None) -> None:
        self._dtype = dtype
        self._many, self._length = many, length
        self._data = bytearray()
        self._ends = [0]

    def add(self, value: Any) -> None:
        array = np.asarray(value, self._dtype)
        self._data += array.tobytes()
        if self._many and self._length is None:
            self._ends.append(self._ends[-1] + array.size)

    def arrays(self, name: str) -> dict[str, NDArray[Any]]:
        values = np.frombuffer(self._data, self._dtype)
        if not self._many:
            return {name: values}
        if self._length is not None:
            return {name: values.reshape(-1, self._length)}
        lengths = set(np.diff(self._ends).tolist())
        if len(lengths) == 1:  # as in images: all are of the same length
            return {name: values.reshape(len(self._ends) - 1, lengths.pop())}
        return {name: values, f"{name}.ends": np.asarray(self._ends[1:], np.int64)}


class _Texts:
    """Texts: one per message, or lists of them joined by line breaks."""

    def __init__(self) -> None:
        self._texts: list[str] = []

    def add(self, value: Any) -> None:
        self._texts.append(value if isinstance(value, str) else "\n".join(value))

    def arrays(self, name: str) -> dict[str, NDArray[Any]]:
        return {name: np.asarray(self._texts, np.str_)}


class Columns:
    """Columns of messages of one type.

    A field is an array of one row per message. Times are whole nanoseconds; sequences that differ in length are one
    array with the end of each in `<name>.ends`; a list of messages is a table of its own, `<name>/...`, in which `row`
    is the message that each belongs to.

    Parameters
    ----------
    definitions : mapping of str to tuple of Field
        Fields of the type and of all types in it.
    name : str
        Type of the messages, package/Name.
    """

    def __init__(self, definitions: Definitions, name: str) -> None:
        self._rows = 0
        self._columns: dict[str, _Numbers | _Texts] = {}
        self._parts: dict[str, Columns] = {}
        self._lists: dict[str, Columns] = {}
        self._row_of = _Numbers(_INT64, many=False, length=None)
        self._times: set[str] = set()
        for field in definitions[name]:
            if field.type in DTYPES:
                self._columns[field.name] = _Numbers(DTYPES[field.type], field.many, field.length)
            elif field.type == "string":
                self._columns[field.name] = _Texts()
            elif field.type in _TIMES and not field.many:
                self._times.add(field.name)
                self._columns[field.name] = _Numbers(_INT64, many=False, length=None)
            elif field.many:
                self._lists[field.name] = Columns(definitions, field.type)
            else:
                self._parts[field.name] = Columns(definitions, field.type)

    def add(self, values: Mapping[str, Any]) -> None:
        """Add a message.

        Parameters
        ----------
        values : mapping of str to Any
            Its fields by name.
        """
        for name, column in self._columns.items():
            value = values[name]
            column.add(value["sec"] * NANOSECONDS + value["nanosec"] if name in self._times else value)
        for name, part in self._parts.items():
            part.add(values[name])
        for name, table in self._lists.items():
            for item in values[name]:
                table.add(item)
                table._row_of.add(self._rows)
        self._rows += 1

    def arrays(self, prefix: str) -> dict[str, NDArray[Any]]:
        """Return the arrays by name.

        Parameters
        ----------
        prefix : str
            What precedes each name, with a slash between.
        """
        found: dict[str, NDArray[Any]] = {}
        for name, column in self._columns.items():
            found |= column.arrays(f"{prefix}/{name}")
        for name, part in self._parts.items():
            found |= part.arrays(f"{prefix}/{name}")
        for name, table in self._lists.items():
            found |= table._row_of.arrays(f"{prefix}/{name}/row") | table.arrays(f"{prefix}/{name}")
        return found
