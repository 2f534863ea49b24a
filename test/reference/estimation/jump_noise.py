# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Noise that single taxels have beyond their description: steps of the signal."""

from __future__ import annotations

from typing import Final

import numpy as np

from posfet_model._lib.types import Array, Mask
from reference.estimation.signal_steps import STEP

SEEN: Final = 2.0
"""Number of such differences that show the same step [1], with a block between the two."""

QUIET: Final = 0.3
"""Time for which no contact must have been listed [s]: the end of a release is no step."""

DWELL: Final = 1.0
"""Mean time between two steps, for which an offset by one lasts [s], assumed."""

MEMORY: Final = 30.0
"""Time over which the steps of a taxel are averaged [s], and"""

LEAST_MEMORY: Final = 2.0
"""the least one after the start [s]: a single step in it counts for no more."""


class JumpNoise:
    """Random walk of each force error due to steps of its signal.

    A signal that switches between two levels (random telegraph noise) has an offset that lasts for a while, in which
    the integration adds up its charge. Over longer times that is a random walk of the force error, of the variance
    J*(1 + (D/(2*tau))^2) in each second, with the mean square of the steps in a second J and the time between them D,
    about a drift: the offset that is observed is that of the present level, and its mean is half a step away, of the
    square J*D/4.

    State variables, shapes [taxels]: J [N2/s], and the time of observation [s].

    Parameters
    ----------
    time_constant : ndarray of float64, shape [taxels]
        Leakage time constants tau [s]; not copied.
    """

    def __init__(self, time_constant: Array) -> None:
        self._tau = time_constant
        self._squares, self._time = np.zeros((2, len(time_constant)))
        self._any = False

    def observe(self, where: Mask, step: Array, change: Array, noise: Array, duration: float) -> None:
        """Process the steps of the signals and, while nothing touches, the changes of the mean forces.

        From one block to the one after the next: a step within the block in between is seen whole.

        Parameters
        ----------
        where : ndarray of bool, shape [taxels]
            Taxels whose signals count.
        step : ndarray of float64, shape [taxels]
            Steps whose kind is certain [N] (`signal_steps`); 0: none.
        change : ndarray of float64, shape [taxels]
            Changes [N].
        noise : ndarray of float64, shape [taxels]
            Variance of a mean [N2].
        duration : float
            Time between two blocks that follow each other [s].
        """
        self._time += np.where(where, duration, 0.0)
        square = change * change
        # A rise may be a touch that is too weak to be listed, and falls of several taxels the release of one that was
        # there at the start. Levels are left as often as they are taken: falls count twice.
        falls = where & (change < 0.0) & (square > 2.0 * STEP * STEP * noise)
        falls &= np.count_nonzero(falls) == 1
        if not (self._any or falls.any() or step.any()):
            return
        self._any = True
        seen = np.where(step != 0.0, step * step, np.where(falls, 2.0 * square, 0.0))
        rate = seen / SEEN / duration - self._squares
        self._squares += np.where(where, duration / np.clip(self._time, LEAST_MEMORY, MEMORY), 0.0) * rate
        self.admit(step)

    def admit(self, step: Array) -> None:
        """Take steps of the signals that were found otherwise: one that steps does so again, however long it was quiet.

        Parameters
        ----------
        step : ndarray of float64, shape [taxels]
            Steps [N]; 0: none.
        """
        self._any = self._any or bool(step.any())
        np.maximum(self._squares, step * step / DWELL, out=self._squares)

    def variance(self, duration: float) -> Array | float:
        """Return the variance [N2] by which each force error grows in a time [s], shape [taxels]; 0.0: none."""
        if not self._any:
            return 0.0
        variance: Array = self._squares * (1.0 + (0.5 * DWELL / self._tau) ** 2) * duration
        return variance

    def least_offset_variance(self) -> Array | float:
        """Return the least variance of each offset [N2], shape [taxels]: that of its mean; 0.0: none."""
        return self._squares * (0.25 * DWELL) if self._any else 0.0
