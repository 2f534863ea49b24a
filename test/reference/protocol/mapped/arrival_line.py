# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""What the arrival of scans tells when a board sends no time, or a counter that wraps soon."""

from __future__ import annotations

from typing import Final

RATE_TOLERANCE: Final = 0.005
"""Greatest relative difference of the board's scan rate from the sensor file's [1]: CAN needs such clocks, too."""
WINDOW_SCANS: Final = 32
WINDOW_BATCHES: Final = 3
"""Smallest number of scans, of scan periods and of batches in which one scan has to arrive undelayed."""
LONGEST_DELAY: Final = 250_000_000
"""Longest time that frames wait in adapter and kernel before they are read [ns]; assumed."""


class ArrivalLine:
    """Follows the arrival of undelayed scans, which is a straight line over their sequence.

    A scan cannot arrive before the previous one plus its period, but later. The line therefore advances by one period
    per scan, up to the arrival and not beyond. What remains between line and arrival is a delay, or scans that were
    lost without trace, because the counter of the board has wrapped or there is none. A delay has gone when the frames
    that were waiting have been read; lost scans never come.

    Parameters
    ----------
    period : float
        Scan period [ns].
    """

    def __init__(self, period: float) -> None:
        self.time = 0.0
        """Monotonic time at which the newest scan would have arrived undelayed [ns]."""
        self._step = period * (1.0 + RATE_TOLERANCE)
        self.arrival = 0
        """Monotonic time at which the newest batch was read [ns]."""
        self._waiting = 0.0  # time that the frames after the first scan of the batch span [ns]
        self._first = False  # no scan of the batch yet
        self._least = 0.0  # smallest delay in the window
        self._scans = self._batches = 0
        self._window_end = 0.0  # frames that had been waiting are read in less than this

    def begin_batch(self, arrival: int, scans: float) -> None:
        """Begin a batch of frames.

        Parameters
        ----------
        arrival : int
            Monotonic time at which it was read [ns].
        scans : float
            Largest number of scans that can be in it.
        """
        self.arrival, self._waiting, self._first = arrival, max(scans - 1.0, 0.0) * self._step, True

    def restart(self) -> None:
        """Let the next scan be undelayed."""
        self.time = float(self.arrival)
        self._begin_window()

    def room(self) -> float:
        """Return the time since the newest scan [ns]; the scans since then fit into it."""
        return self.arrival - self.time

    def advance(self, scans: int) -> None:
        """Advance by `scans`, of which the last has arrived in this batch."""
        time = self.time + scans * self._step
        self.time = time if time < self.arrival else float(self.arrival)

    def missing(self, span: float) -> int:
        """Return how many times `span` was lost without trace before the newest scan, and advance the line by it.

        Parameters
        ----------
        span : float
            Time after which a loss leaves no trace [ns]: that of one wrap of the board's counter or clock.
        """
        delay = self.arrival - self.time
        if delay < self._least:  # noqa: PLR1730  # faster than min() for every scan
            self._least = delay
        self._scans += 1
        first, self._first = self._first, False
        self._batches += first
        if first and delay - self._waiting > LONGEST_DELAY:  # even the last scan of this batch is late
            lost = round((delay - self._waiting) / span)
        elif self._scans >= WINDOW_SCANS and self._batches >= WINDOW_BATCHES and self.arrival >= self._window_end:
            lost = round(self._least / span)
        else:
            return 0
        self._begin_window()
        self.time = min(self.time + lost * span, float(self.arrival))
        return lost

    def _begin_window(self) -> None:
        self._least, self._scans, self._batches = float("inf"), 0, 0
        self._window_end = self.arrival + (WINDOW_SCANS - 1) * self._step
