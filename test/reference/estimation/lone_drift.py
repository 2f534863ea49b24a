# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A taxel whose force drifts alone while all else is still: its signal has stepped.

A signal that steps by D has another offset from then on: the uncorrected force drifts by D/tau. While the force moves,
the step itself is not seen (`signal_steps`), and while it is held, no zero shows the drift. But what touches, once it
is still, changes several taxels: in proportion to their forces (creep, leakage), or against each other (tremor). A
drift that one taxel has alone, and that stays the same, is that of its signal.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.types import Array
from reference.estimation.known_forces import GATE
from reference.estimation.steady_force import HOP

Mask = NDArray[np.bool_]

BLOCKS: Final = 16
"""Blocks of a window."""

OTHERS: Final = 0.4
"""Part of a drift up to which others change in the same time [1], assumed: of a force, neighbours feel more."""

WINDOWS: Final = 6
"""Windows in a row that show the same drift."""

SAME: Final = 0.15
"""Part by which a drift may differ from that of the first window [1]: what warms or cools differs by more."""


class Drift(NamedTuple):
    """A drift of one taxel."""

    taxel: int
    """Index of the taxel."""
    rate: float
    """Of its force [N/s]."""
    earliest: float
    """Time for which it may have been there [s]."""
    latest: float
    """Time for which it has been there [s]."""


class LoneDrift:
    """Finds drifts of single taxels in windows of blocks.

    Parameters
    ----------
    taxels : int
        Number of taxels.
    """

    def __init__(self, taxels: int) -> None:
        self._means: deque[Array] = deque(maxlen=BLOCKS)
        self._spans: deque[float] = deque(maxlen=BLOCKS)
        self._seen = 0
        self._listed_for = np.zeros(taxels, dtype=int)
        self._since = np.zeros(taxels)
        self._found: list[tuple[int, float]] = []

    def restart(self) -> None:
        """Forget the last blocks: a correction since then is no drift."""
        self._means.clear()
        self._spans.clear()
        self._seen = 0
        self._found.clear()

    def observe(
        self, mean: Array, counts: Mask, listed: Mask, touched: Mask, variance: float, duration: float
    ) -> Drift | None:
        """Process a block; return a drift once it is known.

        Parameters
        ----------
        mean : ndarray of float64, shape [taxels]
            Mean forces [N].
        counts, listed, touched : ndarray of bool, shape [taxels]
            Taxels that count, that are in contact, and that are touched in any way.
        variance : float
            Variance of a mean [N2].
        duration : float
            Duration of the block [s].
        """
        self._means.append(mean.copy())
        self._spans.append(duration)
        self._seen += 1
        self._listed_for = np.where(listed, self._listed_for + 1, 0)
        self._since = np.where(touched, self._since + duration, 0.0)
        if not listed.any() or self._seen < BLOCKS or self._seen % HOP:
            return None
        time = np.cumsum(self._spans)
        window = float(time[-1] - time[0])
        time -= time.mean()
        squares = float(time @ time)
        rate = time @ np.array(self._means) / squares
        noise = math.sqrt(variance / squares)
        held = counts & (self._listed_for >= BLOCKS)
        taxel = int(np.argmax(np.where(held, np.abs(rate), 0.0)))
        rest = held.copy()
        rest[taxel] = False
        forces = float(mean[rest] @ mean[rest])
        common = float(rate[rest] @ mean[rest]) / forces if forces > 0.0 else 0.0
        own = float(rate[taxel] - common * mean[taxel]) if held[taxel] else 0.0
        others = counts.copy()
        others[taxel] = False
        beyond = np.abs(rate - np.where(held, common * mean, 0.0))[others]
        greatest = float(beyond.max()) if len(beyond) else 0.0
        if max(abs(own), greatest) < GATE * noise:
            self._since = np.minimum(self._since, window)
        first = self._found[0] if self._found else (taxel, math.inf)
        if not abs(own) > GATE * noise or not greatest < OTHERS * abs(own):
            self._found = []
            return None
        if taxel != first[0] or not abs(own - first[1]) < SAME * abs(first[1]):
            self._found = [(taxel, own)]
            return None
        self._found.append((taxel, own))
        if len(self._found) < WINDOWS:
            return None
        found = Drift(taxel, float(np.mean([each for _, each in self._found])), max(self._since[taxel], window), window)
        self._found = []
        self._since[taxel] = 0.0  # from now on it is known
        return found
