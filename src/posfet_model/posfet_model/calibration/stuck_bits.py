# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Bits of the ADC that never change, although the ones above them do."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.types import Mask

LEAST_STEP: Final = 8.0
"""Least value of a bit that is judged, over the usual change from one scan to the next [1]."""


def find_stuck_bits(counts: NDArray[np.uint16]) -> Mask:
    """Return the taxels that have a stuck bit.

    A signal changes a bit more often than the ones above it. One that stays the same while a lower and a higher one
    change is stuck: the codes skip by its value wherever it should change. A bit above the range of the signal, or
    below the resolution of the ADC, cannot be judged.

    Parameters
    ----------
    counts : ndarray of uint16, shape [scans, taxels]
        A recording with presses on all taxels.

    Returns
    -------
    ndarray of bool, shape [taxels]
        Taxels with a stuck bit.
    """
    if len(counts) < 2:
        return np.zeros(counts.shape[1], np.bool_)
    changed = np.bitwise_or.reduce(counts, axis=0) ^ np.bitwise_and.reduce(counts, axis=0)
    usual = np.median(np.abs(np.diff(counts.astype(np.int32), axis=0)), axis=0)
    least = LEAST_STEP * np.maximum(usual, 1.0)
    stuck: Mask = np.zeros(counts.shape[1], np.bool_)
    for bit in range(1, 15):
        value = 1 << bit
        above, below = changed >> (bit + 1), changed & (value - 1)
        stuck |= ((changed & value) == 0) & (above != 0) & (below != 0) & (value > least)
    return stuck
