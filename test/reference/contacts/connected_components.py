# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Reference: 8-connected components of a small array, with masks as bits of a Python integer.

Row r, column c of the array is bit ``r*(cols + 1) + c``: the empty column at the end of each row keeps a shift from
carrying one row into the next. Dilation by the eight neighbours is then four shifts of an integer, which for arrays of
this size costs less than one call into an array library.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


class BitMap:
    """Conversion between masks of an array and integers, and morphology on the integers.

    Parameters
    ----------
    rows, cols : int
        Size of the array.
    """

    def __init__(self, rows: int, cols: int) -> None:
        self._cols = cols
        self._stride = cols + 1
        self._padded = np.zeros((rows, self._stride), np.bool_)
        self._inner = self._padded[:, :cols]
        self._bytes = (self._padded.size + 7) // 8
        self._taxel = np.zeros(self._padded.size, np.intp)
        self._taxel.reshape(rows, self._stride)[:, :cols] = np.arange(rows * cols).reshape(rows, cols)
        self.all = self.pack(np.ones(rows * cols, np.bool_))
        """Bits of all taxels."""

    def pack(self, mask: NDArray[np.bool_]) -> int:
        """Return the bits of a mask, shape [rows * cols]."""
        self._inner[...] = mask.reshape(self._inner.shape)
        return int.from_bytes(np.packbits(self._padded, bitorder="little").tobytes(), "little")

    def taxels(self, bits: int) -> NDArray[np.intp]:
        """Return the indices of the taxels in `bits`, ascending."""
        flags = np.unpackbits(np.frombuffer(bits.to_bytes(self._bytes, "little"), np.uint8), bitorder="little")
        found: NDArray[np.intp] = self._taxel[flags.nonzero()[0]]
        return found

    def bits(self, taxels: NDArray[np.intp]) -> int:
        """Return the bits of the taxels with the given indices."""
        mask = np.zeros(self._inner.size, np.bool_)
        mask[taxels] = True
        return self.pack(mask)

    def mask(self, bits: int, out: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return the mask of `bits` in `out`, shape [rows * cols].

        Parameters
        ----------
        bits : int
            Bits of the taxels.
        out : ndarray of bool, shape [rows * cols]
            Array to fill.
        """
        out[:] = False
        out[self.taxels(bits)] = True
        return out

    def dilate(self, bits: int) -> int:
        """Return the taxels of `bits` and their eight neighbours."""
        wide = bits | bits << 1 | bits >> 1
        return (wide | wide << self._stride | wide >> self._stride) & self.all

    def components(self, bits: int) -> list[int]:
        """Return the 8-connected components of `bits`, each as bits, in order of their first taxel."""
        found = []
        while bits:
            component, grown = 0, bits & -bits
            while grown != component:
                component = grown
                grown = self.dilate(component) & bits
            found.append(component)
            bits ^= component
        return found
