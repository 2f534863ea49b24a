# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Counts of a scan out of the frames of any board with NumPy: one gather, shift and look-up for all taxels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from posfet_driver.protocol.count_table import CountTable


class CountGather:
    """Gathers the counts of all taxels out of the data of the frames of a scan.

    Parameters
    ----------
    counts : CountTable
        Places and look-up tables.
    wire : bytearray
        Data of all frames of a scan, followed by one zero byte.
    """

    def __init__(self, counts: CountTable, wire: bytearray) -> None:
        taxels = len(counts.places)
        base = np.array([base for _, _, base in counts.places], np.intp)
        places = [field for _, field, _ in counts.places]
        width = 2 if all(field.end - field.first <= 2 for field in places) else 4
        index = np.full((taxels, width), len(wire) - 1, np.intp)
        for taxel, (offset, field, _) in enumerate(counts.places):
            span = range(offset + field.first, offset + field.end)
            index[taxel, : len(span)] = span if field.order == "little" else span[::-1]
        self._wire = np.frombuffer(wire, np.uint8)
        self._index = index.reshape(-1)
        self._bytes = np.zeros(index.size, np.uint8)
        self._words = self._bytes.view(f"<u{width}")
        word = self._words.dtype
        aligned = all(field.shift == 0 and field.length in {8, 16} for field in places)
        self._shift = None if aligned else np.array([field.shift for field in places], word)
        self._mask = np.array([field.mask for field in places], word)
        self._raw = np.zeros(taxels, np.intp)
        self._base = base if base.any() else None
        self._table = counts.table
        self._unchanged = not len(counts.table)

    def decode(self, out: NDArray[np.uint16]) -> None:
        """Write the counts in the wire to `out`, shape [taxels]."""
        self._wire.take(self._index, None, self._bytes, "clip")
        words = self._words
        if self._shift is not None:
            np.right_shift(words, self._shift, words)
            np.bitwise_and(words, self._mask, words)
        if self._unchanged:
            out[:] = words
            return
        raw = self._raw
        raw[:] = words
        if self._base is not None:
            np.add(raw, self._base, raw)
        self._table.take(raw, None, out, "clip")
