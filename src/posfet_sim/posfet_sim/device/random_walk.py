# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Random walks on many channels whose values depend on seed and time only."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_sim.device.random_streams import Stream, generator

KNOT_INTERVAL: Final = 1.0
"""Interval of the knots [s], between which a walk is linear."""
_PAGE: Final = 64  # knots drawn at once


class RandomWalk:
    """Independent random walks from 0 with the variance of the time since the start [s].

    Parameters
    ----------
    seed : int
        Seed of the board.
    stream : Stream
        Random stream.
    channels : int
        Number of walks.
    """

    def __init__(self, seed: int, stream: Stream, channels: int) -> None:
        self._seed = seed
        self._stream = stream
        self._page = 0
        self._knots = self._from(np.zeros(channels), 0)

    def at(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the walks at ascending times that are not before those of the last call.

        Parameters
        ----------
        times : numpy.ndarray
            Times since the start [s], shape [times].

        Returns
        -------
        numpy.ndarray
            Shape [times, channels], in sqrt(s).
        """
        positions = times / KNOT_INTERVAL
        values = np.empty((len(times), self._knots.shape[1]))
        pages = (positions // _PAGE).astype(np.int64)
        for page in np.unique(pages).tolist():
            while self._page < page:
                self._page += 1
                self._knots = self._from(self._knots[-1], self._page)
            chosen = pages == page
            knot, fraction = np.divmod(positions[chosen] - page * _PAGE, 1.0)
            before = self._knots[knot.astype(np.int64)]
            after = self._knots[knot.astype(np.int64) + 1]
            values[chosen] = before + (after - before) * fraction[:, None]
        return values

    def _from(self, start: NDArray[np.float64], page: int) -> NDArray[np.float64]:
        """Return the knots of a page and the first one of the next, shape [_PAGE + 1, channels]."""
        steps = generator(self._seed, self._stream, page).standard_normal((_PAGE, start.size))
        knots = np.cumsum(steps, axis=0) * math.sqrt(KNOT_INTERVAL) + start
        return np.concatenate([start[None], knots])
