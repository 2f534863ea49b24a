"""Connected regions of a small map, as bits of one whole number.

Row r, column c of the map is bit ``r*(cols + 1) + c``: the column left empty at the end of each row keeps a shift from
carrying one row into the next. Growing a region by its eight neighbours is then four shifts of a number, which for
arrays of this size costs less than one call into an array library.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


class BitMap:
    """Masks of an array of rows * cols taxels as whole numbers, and back."""

    def __init__(self, rows: int, cols: int) -> None:
        self._cols = cols
        self._stride = cols + 1
        self._padded = np.zeros((rows, self._stride), np.bool_)
        self._inner = self._padded[:, :cols]
        self._bytes = (self._padded.size + 7) // 8
        self._taxel = np.zeros(self._padded.size, np.intp)
        self._taxel.reshape(rows, self._stride)[:, :cols] = np.arange(rows * cols).reshape(rows, cols)
        self.all = self.pack(np.ones(rows * cols, np.bool_))
        """Every taxel."""

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
        """Return the bits of taxels that are given by their indices."""
        mask = np.zeros(self._inner.size, np.bool_)
        mask[taxels] = True
        return self.pack(mask)

    def mask(self, bits: int, out: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Set `out`, shape [rows * cols], to the mask of `bits`."""
        out[:] = False
        out[self.taxels(bits)] = True
        return out

    def grow(self, bits: int) -> int:
        """Return the taxels of `bits` and their eight neighbours."""
        wide = bits | bits << 1 | bits >> 1
        return (wide | wide << self._stride | wide >> self._stride) & self.all

    def regions(self, bits: int) -> list[int]:
        """Return the 8-connected regions of `bits`, each as bits, in order of their first taxel."""
        found = []
        while bits:
            region, grown = 0, bits & -bits
            while grown != region:
                region = grown
                grown = self.grow(region) & bits
            found.append(region)
            bits ^= region
        return found
