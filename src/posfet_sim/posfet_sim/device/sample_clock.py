# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Sampling times of a simulated board, with clock drift and jitter."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_sim.device.random_streams import Stream, generator

JITTER_END: Final = 4.0
"""Jitter is limited to this many standard deviations [1]."""
JITTER_SHARE: Final = 0.1
"""Jitter is limited to this fraction of the scan interval [1], so that scans stay in order."""
_PAGE: Final = 1024


class SampleClock:
    """Sampling times since the board started [s]: ``index/rate*(1 + drift)`` plus jitter, which is never negative.

    Parameters
    ----------
    rate : float
        Nominal scan rate [Hz].
    drift : float
        Relative excess of the interval [1].
    jitter : float
        Standard deviation of the jitter [s].
    seed : int
        Seed of the board.
    """

    def __init__(self, rate: float, drift: float, jitter: float, seed: int) -> None:
        self._interval = (1 + drift) / rate
        self._jitter = jitter
        self._seed = seed
        self._limit = min(JITTER_END * jitter, JITTER_SHARE * self._interval)
        self._page = -1
        self._offsets: NDArray[np.float64] = np.zeros(0)

    @property
    def interval(self) -> float:
        """Mean time between two scans [s]."""
        return self._interval

    def time(self, index: int) -> float:
        """Return the time of scan `index` [s]."""
        if not self._jitter:
            return index * self._interval
        page, row = divmod(max(index, 0), _PAGE)
        return index * self._interval + self._offsets_of(page).item(row)

    def times(self, first: int, count: int) -> NDArray[np.float64]:
        """Return the times of `count` scans from scan `first` on [s], shape [count].

        Parameters
        ----------
        first : int
            Index of the first scan.
        count : int
            Number of scans.
        """
        times = np.arange(first, first + count, dtype=np.float64)
        times *= self._interval
        if self._jitter:
            done = 0
            while done < count:
                page, row = divmod(max(first + done, 0), _PAGE)
                part = (
                    self._offsets_of(page)[row : row + count - done] if first + done >= 0 else self._offsets_of(0)[:1]
                )
                times[done : done + len(part)] += part
                done += len(part)
        return times

    def steps(self, first: int, count: int) -> NDArray[np.float64]:
        """Return the intervals [s] that end at each of `count` scans from scan `first` on, shape [count].

        Parameters
        ----------
        first : int
            Index of the first scan.
        count : int
            Number of scans.
        """
        if not self._jitter:
            return np.full(count, self._interval)
        return np.diff(self.times(first - 1, count + 1))

    def between(self, first: int, last: int) -> float:
        """Return the time from scan `first` to scan `last` [s]; without jitter it depends on their difference only.

        Parameters
        ----------
        first : int
            Index of the earlier scan.
        last : int
            Index of the later scan.
        """
        if not self._jitter:
            return (last - first) * self._interval
        return self.time(last) - self.time(first)

    def spans(self, origin: int, first: int, count: int) -> NDArray[np.float64]:
        """Return the times from scan `origin` to each of `count` scans from scan `first` on [s], shape [count].

        Parameters
        ----------
        origin : int
            Index of the scan from which the times count.
        first : int
            Index of the first scan.
        count : int
            Number of scans.
        """
        if not self._jitter:
            return np.arange(first - origin, first - origin + count, dtype=np.float64) * self._interval
        times: NDArray[np.float64] = self.times(first, count) - self.time(origin)
        return times

    def last_by(self, time: float) -> int:
        """Return a scan that is taken by `time` [s]: the last one or, due to rounding or jitter, the one before."""
        if not math.isfinite(time):
            return 2**62
        return min(math.floor((time - 2 * self._limit) / self._interval), 2**62)

    def _offsets_of(self, page: int) -> NDArray[np.float64]:
        """Return the jitter of each scan of a page [s]."""
        if page != self._page:
            values = generator(self._seed, Stream.JITTER, page).standard_normal(_PAGE) * self._jitter
            self._offsets = np.clip(values, -self._limit, self._limit) + self._limit
            self._page = page
        return self._offsets
