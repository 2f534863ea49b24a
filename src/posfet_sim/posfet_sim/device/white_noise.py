# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""White noise of the simulated readout: drawn number by number, or for a large array from a table of normal numbers."""

from __future__ import annotations

from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from posfet_sim.device.random_streams import Stream, generator

TABLE_SIZE: Final = 1 << 20
"""Normal numbers in a table (8 MB)."""


class WhiteNoise(Protocol):
    """White noise of independent taxels, in blocks of scans."""

    def block(self, number: int, deviation: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the noise of one block of scans.

        Parameters
        ----------
        number : int
            Number of the block; the same number gives the same noise, whatever was asked for before.
        deviation : numpy.ndarray
            Standard deviation of each taxel, shape [taxels].

        Returns
        -------
        numpy.ndarray
            Noise in the unit of `deviation`, shape [scans, taxels]; the next call overwrites it.
        """
        ...


class DrawnNoise:
    """Every number is drawn: 8 to 10 ns each.

    Parameters
    ----------
    seed : int
        Seed of the board.
    scans : int
        Scans of a block.
    taxels : int
        Number of taxels.
    """

    def __init__(self, seed: int, scans: int, taxels: int) -> None:
        self._seed = seed
        self._numbers = np.empty((scans, taxels))

    def block(self, number: int, deviation: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the noise of one block of scans."""
        generator(self._seed, Stream.WHITE, number).standard_normal(out=self._numbers)
        self._numbers *= deviation
        return self._numbers


class TabulatedNoise:
    """Every scan reads a window of a table of normal numbers at an offset of its own, in a tenth of the time.

    The table is drawn once from the seed, and shifted and scaled to a mean of 0 and a variance of 1. The offsets are
    independent and uniform over the table, which continues at its beginning. So the numbers of one scan are independent
    normal ones, and those of one taxel in successive scans are independent draws of the table: white, and normal up to
    the largest number of the table, about 5 standard deviations. Windows of two scans overlap with the probability
    ``2*taxels/TABLE_SIZE``; those scans share numbers, on different taxels unless their offsets are equal, which
    happens once in TABLE_SIZE pairs of scans.

    Parameters
    ----------
    seed : int
        Seed of the board.
    scans : int
        Scans of a block.
    taxels : int
        Number of taxels, at most TABLE_SIZE.
    """

    def __init__(self, seed: int, scans: int, taxels: int) -> None:
        self._seed = seed
        table = generator(seed, Stream.WHITE_TABLE).standard_normal(TABLE_SIZE)
        table -= table.mean()
        table /= table.std()
        self._table = np.concatenate([table, table[:taxels]])
        self._numbers = np.empty((scans, taxels))

    def block(self, number: int, deviation: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the noise of one block of scans."""
        scans, taxels = self._numbers.shape
        offsets = generator(self._seed, Stream.WHITE, number).integers(TABLE_SIZE, size=scans)
        for row, offset in zip(self._numbers, offsets.tolist(), strict=True):
            np.multiply(self._table[offset : offset + taxels], deviation, out=row)
        return self._numbers
