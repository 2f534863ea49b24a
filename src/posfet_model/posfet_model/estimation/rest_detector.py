"""Whether the array is at rest, so that offsets may be learnt from its signals.

A model may start amid a touch. A force that grows evenly looks like an offset then (rate times tau), and a held one
leaks. So an offset is believed only once the signals of the whole array stand still: for a moment when they are all
alike, as without touch, and for as long as a held force needs to leak away when they are not.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.reductions import upper_median

STILL: Final = 8.0
"""A signal stands still within this many standard deviations of a reading [1]."""

FAR: Final = 10.0
"""One taxel alone is no touch, unless it moves by this many times more: it may be noisy [1]."""

LEAKED: Final = 5.0
"""Time constants of the leak after which no held force is left in the signals [1]."""


class Rest:
    """Watches the signals of all taxels block by block, while some offset is not known."""

    def __init__(self, taxels: int, noise: float, alike: float, settle: float, leak: float) -> None:
        """Take the noise of a reading [N], within what offsets are alike [N], and the times to wait for.

        settle [s] is that for signals that are alike, leak [s] the time constant of the leak.
        """
        self._still = STILL * noise
        self._alike = alike
        self._settle = settle
        self._long = LEAKED * leak
        self._signal = np.full(taxels, np.inf)
        self._lasts = 0.0
        self.moved = False
        """Whether something moved in the last block."""

    def begin(self, signal: NDArray[np.float64]) -> None:
        """Take the signals of the first scan [N], against which later ones are held."""
        self._signal[:] = signal
        self._lasts = 0.0

    def look(
        self, signal: NDArray[np.float64], ignored: NDArray[np.bool_], duration: float, warming: bool = False
    ) -> bool:
        """Take the signals [N] at the end of a block of `duration` [s]; return whether offsets may be believed.

        While the chip is warming, what all taxels do alike is no motion.
        """
        change = signal - self._signal
        if warming:
            change -= upper_median(change[~ignored])
        change = np.abs(change)
        change[ignored] = 0.0
        moving = int(np.count_nonzero(change > self._still))
        self.moved = moving >= min(2, len(signal)) or bool((change > FAR * self._still).any())
        if self.moved:
            self._signal[:] = signal
            self._lasts = 0.0
            return False
        self._lasts += duration
        if self._lasts >= self._long:
            return True
        usable = signal[~ignored]
        return self._lasts >= self._settle and bool((np.abs(usable - upper_median(usable)) <= self._alike).all())
