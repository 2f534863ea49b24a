"""Forces that cannot be known after an interruption: what was pressed before it may have leaked, or gone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from posfet_model.arrays import some

Array = NDArray[np.float64]


class LostForce:
    """Taxels whose force is no more than a lower bound, until the touch ends.

    Charge that is left was pressed, so at least that much presses. Charge below zero says that the force has gone.
    Where neither is left nothing tells a force that leaked from none, and after a while it counts as none.
    """

    def __init__(self, taxels: int, threshold: float, patience: float) -> None:
        """Take the force that counts [N], and for how long nothing has to be felt until nothing presses [s]."""
        self.mask = np.zeros(taxels, np.bool_)
        """Where the force is not known."""
        self._threshold = threshold
        self._patience = patience
        self._quiet = 0.0

    def begin(self, before: Array, left: Array) -> None:
        """Take the forces before the interruption [N], and the charge that is left after it, as forces [N]."""
        self.mask |= ((before > self._threshold) & (left > -self._threshold)) | (left > self._threshold)
        self._quiet = 0.0

    def close(self, force: Array, elapsed: float) -> None:
        """Take the mean forces [N] of a block of `elapsed` [s]."""
        if not some(self.mask):
            return
        self.mask &= force > -self._threshold
        pressing = bool((force[self.mask] > self._threshold).any())
        self._quiet = 0.0 if pressing else self._quiet + elapsed
        if self._quiet >= self._patience:
            self.mask[:] = False
