# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Forces that are known only as a lower bound."""

from __future__ import annotations

import numpy as np

from posfet_model._lib.types import Array, Mask


class LowerBoundMonitor:
    """Marks the taxels whose force is known only as a lower bound after an interruption, until the touch ends.

    The remaining charge was caused by a force, so at least that force is applied. A negative charge that lasts means
    that the force was released. Where neither remains, a force that leaked away cannot be distinguished from no force;
    after `release_time` it counts as no force. Touches in between do not restart that time: where touches repeat,
    forces would never be valid.

    State variables: the mask of marked taxels, for how long each has been negative and steady [s], and the time without
    a measurable force since the interruption [s].

    Parameters
    ----------
    taxels : int
        Number of taxels.
    threshold : float
        Least measurable force [N].
    negative_time : float
        Time for which a negative force must be steady to be none [s].
    release_time : float
        Time without a measurable force, in all, after which no force is applied [s].
    """

    def __init__(self, taxels: int, threshold: float, negative_time: float, release_time: float) -> None:
        self.mask = np.zeros(taxels, np.bool_)
        """Taxels whose force is a lower bound."""
        self._threshold = threshold
        self._negative_time = negative_time
        self._negative_for = np.zeros(taxels)
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
        self._negative_for[:] = self._quiet = 0.0

    def update(self, mean: Array, still: Mask, elapsed: float) -> Mask:
        """Process the mean forces of a block [N]; return the mask of those that were released, no longer marked.

        Parameters
        ----------
        mean : ndarray of float64, shape [taxels]
            Mean forces of the block [N].
        still : ndarray of bool, shape [taxels]
            Taxels whose mean equals that of the block before within noise.
        elapsed : float
            Duration of the block [s].
        """
        negative = self.mask & still & (mean < -self._threshold)
        self._negative_for = np.where(negative, self._negative_for + elapsed, 0.0)
        ended: Mask = self._negative_for >= self._negative_time
        self.mask &= ~ended
        if not (mean[self.mask] > self._threshold).any():
            self._quiet += elapsed
        if self._quiet >= self._release_time:
            self.mask[:] = False
        return ended
