# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Reference of the compensation of crosstalk, in NumPy; posfet_core, crosstalk.hpp, says why."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from posfet_model._lib.types import Array
from posfet_model._lib.validation import real_number
from posfet_model.sensor.description import Layout

DENSE: Final = 64
"""Largest number of taxels of which one dense matrix is used."""

MAX_GAIN: Final = 2.0
"""Largest amplification of a mode by the inverse [1]."""


class CrosstalkCompensator:
    """Compensates the crosstalk of one array.

    Parameters
    ----------
    layout : Layout
        The array.
    share : float
        Share c of each of the four neighbours that a taxel picks up [1], in [0, 0.2].

    Raises
    ------
    ValueError
        The share is out of range.
    """

    def __init__(self, layout: Layout, share: float) -> None:
        self._share = real_number("share", share, 0.0, 0.2)
        self._shape = layout.rows, layout.cols
        self._sines = tuple(_sines(size) for size in self._shape)
        along, across = (2.0 * np.cos(np.pi * np.arange(1, size + 1) / (size + 1)) for size in self._shape)
        mode_gain = 1.0 + self._share * (along[:, None] + across)
        self._inverse_gain = 1.0 / np.maximum(mode_gain, 1.0 / MAX_GAIN)
        self._work = np.zeros(self._shape), np.zeros(self._shape)
        self._dense: Array | None = None
        if layout.taxels <= DENSE:
            modes = np.kron(*self._sines)
            self._dense = (modes * self._inverse_gain.reshape(-1)) @ modes

    @property
    def present(self) -> bool:
        """Whether there is crosstalk to compensate."""
        return self._share > 0.0

    def apply(self, signal: Array) -> Array:
        """Return the signals with the crosstalk compensated.

        Parameters
        ----------
        signal : ndarray
            Signals with crosstalk, in any unit, shape [rows * cols].

        Returns
        -------
        ndarray
            Signals without crosstalk, in the same unit, shape [rows * cols].
        """
        if self._dense is not None:
            return self._dense @ signal
        (rows, cols), (one, other) = self._sines, self._work
        np.matmul(rows, signal.reshape(self._shape), out=one)
        np.matmul(one, cols, out=other)
        other *= self._inverse_gain
        np.matmul(rows, other, out=one)
        compensated: Array = np.matmul(one, cols).reshape(-1)
        return compensated


def _sines(size: int) -> Array:
    """Return the modes of a row of taxels, shape [size, size]; the matrix is symmetric and its own inverse."""
    number = np.arange(1, size + 1)
    modes: Array = math.sqrt(2.0 / (size + 1)) * np.sin(np.pi * np.outer(number, number) / (size + 1))
    return modes
