"""When an estimated force contradicts itself: negative forces, and forces lost in an interruption."""

from __future__ import annotations

import numpy as np

from posfet_model._lib.reductions import any_true
from posfet_model._lib.types import Array, Mask


class BelowZero:
    """For how long each taxel has been below zero, and how steadily: one that is steady is not still settling."""

    def __init__(self, taxels: int, patience: float) -> None:
        """Take for how long a force below zero has to be steady until it is a wrong zero [s]."""
        self.lasts = np.zeros(taxels)
        """[s]."""
        self._steady = np.zeros(taxels)
        self._patience = patience
        self._any = False

    def look(self, where: Mask, mean: Array, limit: Array, still: Mask, duration: float) -> Mask:
        """Take the mean forces [N] of a block of `duration` [s]; return which of the masked taxels have a wrong zero.

        Forces below -limit [N] cannot be; `still` masks those that are as in the block before.
        """
        below = where & (mean < -limit)
        if not (self._any or any_true(below)):
            return below
        self._any = any_true(below)
        self.lasts = np.where(below, self.lasts + duration, 0.0)
        self._steady = np.where(below & still, self._steady + duration, 0.0)
        ripe: Mask = self._steady >= self._patience
        self._steady[ripe] = 0.0
        return ripe

    def forget(self, where: Mask) -> None:
        """Begin anew with the masked taxels."""
        self.lasts[where] = self._steady[where] = 0.0


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
        if not any_true(self.mask):
            return
        self.mask &= force > -self._threshold
        pressing = bool((force[self.mask] > self._threshold).any())
        self._quiet = 0.0 if pressing else self._quiet + elapsed
        if self._quiet >= self._patience:
            self.mask[:] = False
