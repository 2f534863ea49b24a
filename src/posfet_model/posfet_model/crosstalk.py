"""Electrical crosstalk undone: what a taxel shows of its four neighbours.

With a share c of each neighbour, ``x = s + c*N s``, N the sum over the four neighbours. For the small shares of a
working array the inverse is local, ``s = x - c*N x + c^2*N N x``, with an error of (4*c)^3 of the greatest neighbour:
0.05 % at 2 %. It is applied to the signals, before the leak is inverted, where it is linear whatever their sign; the
spread of pressure by the elastic cover is no crosstalk in this sense. It is what the force on a taxel's cell *is*.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from posfet_model.checks import real_number
from posfet_model.sensor import Layout


class CrosstalkInverse:
    """Undoes the crosstalk of one array."""

    def __init__(self, layout: Layout, share: float) -> None:
        """Take the share of each of the four neighbours [1], in [0, 0.2]."""
        self._share = real_number("share", share, 0.0, 0.2)
        self._padded = np.zeros((layout.rows + 2, layout.cols + 2))
        self._inner = self._padded[1:-1, 1:-1]
        self._shape = layout.rows, layout.cols
        self._sum = np.zeros(self._shape)

    @property
    def present(self) -> bool:
        """Whether there is anything to undo."""
        return self._share > 0.0

    def apply(self, signal: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the signals without crosstalk, shape [rows * cols]."""
        given = signal.reshape(self._shape)
        self._inner[...] = given
        first = self._neighbours() * self._share
        self._inner[...] = first
        undone = given - first
        undone += self._neighbours() * self._share
        return undone.reshape(-1)

    def _neighbours(self) -> NDArray[np.float64]:
        padded, total = self._padded, self._sum
        np.add(padded[:-2, 1:-1], padded[2:, 1:-1], out=total)
        total += padded[1:-1, :-2]
        total += padded[1:-1, 2:]
        return total
