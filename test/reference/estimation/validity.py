# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Contradictions in the estimated force: negative forces, and forces known only as a lower bound."""

from __future__ import annotations

import numpy as np

from posfet_model._lib.types import Array, Mask
from reference.reductions import any_true


class NegativeForceMonitor:
    """Finds baseline errors: forces that stay negative and steady.

    State variables: time below zero while steady [s], shape [taxels].

    Parameters
    ----------
    taxels : int
        Number of taxels.
    steady_time : float
        Time for which a negative force must be steady to be a baseline error [s].
    """

    def __init__(self, taxels: int, steady_time: float) -> None:
        self._steady = np.zeros(taxels)
        self._steady_time = steady_time
        self._any = False

    def update(self, where: Mask, mean: Array, limit: Array, still: Mask, duration: float) -> Mask:
        """Process a block's mean forces [N]; return the mask of the taxels with a confirmed baseline error.

        Parameters
        ----------
        where : ndarray of bool, shape [taxels]
            Taxels to be examined.
        mean : ndarray of float64, shape [taxels]
            Mean forces of the block [N].
        limit : ndarray of float64, shape [taxels]
            A force below -limit is impossible [N], > 0.
        still : ndarray of bool, shape [taxels]
            Taxels whose mean equals that of the previous block within noise.
        duration : float
            Duration of the block [s].

        Returns
        -------
        ndarray of bool, shape [taxels]
            Taxels whose force has been negative and steady for `steady_time`.
        """
        below = where & (mean < -limit)
        if not (self._any or any_true(below)):
            return below
        self._any = any_true(below)
        self._steady = np.where(below & still, self._steady + duration, 0.0)
        confirmed: Mask = self._steady >= self._steady_time
        self._steady[confirmed] = 0.0
        return confirmed

    def reset(self, where: Mask | slice) -> None:
        """Reset the masked taxels."""
        self._steady[where] = 0.0


class LowerBoundMonitor:
    """Marks the taxels whose force is known only as a lower bound after an interruption, until the touch ends.

    The remaining charge was caused by a force, so at least that force is applied. A negative charge means that the
    force was released. Where neither remains, a force that leaked away cannot be distinguished from no force; after
    `release_time` it counts as no force. Touches in between do not restart that time: where touches repeat, forces
    would never be valid.

    State variables: the mask of marked taxels, and the time without a measurable force since the interruption [s].

    Parameters
    ----------
    taxels : int
        Number of taxels.
    threshold : float
        Least measurable force [N].
    release_time : float
        Time without a measurable force, in all, after which no force is applied [s].
    """

    def __init__(self, taxels: int, threshold: float, release_time: float) -> None:
        self.mask = np.zeros(taxels, np.bool_)
        """Taxels whose force is a lower bound."""
        self._threshold = threshold
        self._release_time = release_time
        self._quiet = 0.0

    def start(self, before: Array, remaining: Array) -> None:
        """Mark taxels after an interruption, from the forces before it and the remaining charges as forces [N].

        Parameters
        ----------
        before : ndarray of float64, shape [taxels]
            Forces before the interruption [N].
        remaining : ndarray of float64, shape [taxels]
            Remaining charges as forces [N].
        """
        self.mask |= ((before > self._threshold) & (remaining > -self._threshold)) | (remaining > self._threshold)
        self._quiet = 0.0

    def update(self, force: Array, elapsed: float) -> None:
        """Process the mean forces [N] of a block of `elapsed` [s].

        Parameters
        ----------
        force : ndarray of float64, shape [taxels]
            Mean forces of the block [N].
        elapsed : float
            Duration of the block [s].
        """
        if not any_true(self.mask):
            return
        self.mask &= force > -self._threshold
        if not (force[self.mask] > self._threshold).any():
            self._quiet += elapsed
        if self._quiet >= self._release_time:
            self.mask[:] = False
