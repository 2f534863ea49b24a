# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Detection of rest: whether offsets may be estimated from the signals.

The model may start during a touch. A force that grows at a constant rate then looks like an offset (rate times tau),
and a held force leaks. So an offset counts as known only after the signals of the whole array have been still: for a
short time where they are all equal, as they are without touch, and otherwise for as long as a held force takes to leak
away.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from reference.reductions import upper_median

STILL: Final = 8.0
"""A signal is still within this many standard deviations of a reading [1]."""

SINGLE_TAXEL_FACTOR: Final = 10.0
"""A single moving taxel counts as motion only beyond this many times that limit [1]: it may be noisy."""

LEAKED: Final = 5.0
"""Time constants of the leakage after which no held force is left in the signals [1]."""


class RestDetector:
    """Detects rest block by block, while some offset is unknown.

    State variables: the reference signals [N], shape [taxels], and the time since the last motion [s].

    Parameters
    ----------
    taxels : int
        Number of taxels.
    noise : float
        Standard deviation of a reading [N].
    offset_spread : float
        Greatest deviation of an untouched taxel's signal from the median [N].
    time_constant : float
        Leakage time constant [s].
    """

    def __init__(self, taxels: int, noise: float, offset_spread: float, time_constant: float) -> None:
        self._still = STILL * noise
        self._offset_spread = offset_spread
        self._leak_time = LEAKED * time_constant
        self._signal = np.full(taxels, np.inf)
        self._duration = 0.0
        self.moved = False
        """Whether a signal moved in the last block."""

    def start(self, signal: NDArray[np.float64]) -> None:
        """Set the reference signals [N] from the first scan."""
        self._signal[:] = signal
        self._duration = 0.0

    def update(
        self, signal: NDArray[np.float64], ignored: NDArray[np.bool_], duration: float, warming: bool = False
    ) -> bool:
        """Process the signals [N] at the end of a block of `duration` [s]; return whether the array is at rest.

        While the chip is `warming`, the common-mode component does not count as motion.

        Parameters
        ----------
        signal : ndarray of float64, shape [taxels]
            Signals at the end of the block [N].
        ignored : ndarray of bool, shape [taxels]
            Taxels to ignore.
        duration : float
            Duration of the block [s].
        warming : bool, optional
            Whether the chip temperature changes.
        """
        change = signal - self._signal
        if warming:
            change -= upper_median(change[~ignored])
        change = np.abs(change)
        change[ignored] = 0.0
        moving = int(np.count_nonzero(change > self._still))
        self.moved = moving >= min(2, len(signal)) or bool((change > SINGLE_TAXEL_FACTOR * self._still).any())
        if self.moved:
            self._signal[:] = signal
            self._duration = 0.0
            return False
        self._duration += duration
        if self._duration >= self._leak_time:
            return True
        usable = signal[~ignored]
        spread = np.abs(usable - upper_median(usable))
        return bool((spread <= self._offset_spread).all())
