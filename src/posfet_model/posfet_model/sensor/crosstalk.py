"""Electrical crosstalk undone: what a taxel shows of its four neighbours.

With a share c of each neighbour, ``x = s + c*N s``, N the sum over the four neighbours. On a grid N splits into its two
axes, and sines diagonalise it: the mode (j, k) of rows and columns passes with ``1 + 2*c*(cos(pi*j/(rows + 1)) +
cos(pi*k/(cols + 1)))``. So the inverse is two small matrices on either side of the map, and one dense matrix where the
map is small; both are exact. The regularisation: no mode is amplified more than twice, which shares up to 1/8 never
need. It is applied to the signals, before the leak is inverted, where it is linear whatever their sign.

Forces of a contact are not negative, which the inverse does not know. `non_negative` says it afterwards, on the taxels
of a contact alone, and keeps their sum. The spread of pressure by the elastic cover is no crosstalk in this sense: it
is what the force on a taxel's cell *is*.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.validation import real_number
from posfet_model.sensor.description import Layout

DENSE: Final = 64
"""Most taxels for which one dense matrix is faster than four small ones (benchmarks/crosstalk.py)."""

LARGEST_GAIN: Final = 2.0
"""Greatest amplification of a pattern by the inverse [1]."""


class CrosstalkCompensator:
    """Undoes the crosstalk of one array."""

    def __init__(self, layout: Layout, share: float) -> None:
        """Take the share of each of the four neighbours [1], in [0, 0.2]."""
        self._share = real_number("share", share, 0.0, 0.2)
        self._shape = layout.rows, layout.cols
        self._sines = tuple(_sines(size) for size in self._shape)
        along, across = (2.0 * np.cos(np.pi * np.arange(1, size + 1) / (size + 1)) for size in self._shape)
        passes = 1.0 + self._share * (along[:, None] + across)
        self._gain = 1.0 / np.maximum(passes, 1.0 / LARGEST_GAIN)
        self._work = np.zeros(self._shape), np.zeros(self._shape)
        self._dense: NDArray[np.float64] | None = None
        if layout.taxels <= DENSE:
            modes = np.kron(*self._sines)
            self._dense = (modes * self._gain.reshape(-1)) @ modes

    @property
    def present(self) -> bool:
        """Whether there is anything to undo."""
        return self._share > 0.0

    def apply(self, signal: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the signals without crosstalk, shape [rows * cols]."""
        if self._dense is not None:
            return self._dense @ signal
        (rows, cols), (one, other) = self._sines, self._work
        np.matmul(rows, signal.reshape(self._shape), out=one)
        np.matmul(one, cols, out=other)
        other *= self._gain
        np.matmul(rows, other, out=one)
        undone: NDArray[np.float64] = np.matmul(one, cols).reshape(-1)
        return undone


def _sines(size: int) -> NDArray[np.float64]:
    """Return the modes of a row of taxels, shape [size, size]; the matrix is symmetric and its own inverse."""
    number = np.arange(1, size + 1)
    modes: NDArray[np.float64] = math.sqrt(2.0 / (size + 1)) * np.sin(np.pi * np.outer(number, number) / (size + 1))
    return modes
