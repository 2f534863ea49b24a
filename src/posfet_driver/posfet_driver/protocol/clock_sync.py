"""Synchronisation of a board's clock with the clock of this machine."""

from __future__ import annotations

import math
from typing import Final

MAX_DRIFT: Final = 100e-6
"""Greatest relative drift of the two clocks that is followed [s/s]: two crystals of 50 ppm each; assumed."""

WINDOW: Final = 1_000_000_000
"""Time within which one frame has to arrive undelayed [ns]."""

STEP_LIMIT: Final = 5_000_000.0
"""Delay of every frame of a window that is interpreted as a step of the board's clock [ns]; assumed."""


class ClockSync:
    """Maps device time to this machine's monotonic time, using the frames with the shortest transit time.

    Arrival time minus device time is the clock offset plus the transit time, and the transit time is never below that
    of an undelayed frame. The minimum of this difference is the estimated offset. It is raised by `MAX_DRIFT` per
    second, so that a slow board clock is followed; a fast one lowers the minimum by itself. The error is the minimum
    transit time (0.2 ms of frame and adapter), plus 0.2 ms for each second without an undelayed frame. When every frame
    of one second is late by more than 5 ms, the board's clock has been set back, and the offset is re-estimated.

    A board whose clock is frozen is mapped in the same manner by the sequence of its scans, which are equidistant.
    """

    def __init__(self) -> None:
        self._offset = 0.0
        self._last = 0
        self._known = False
        self._window_end = 0
        self._window_minimum = 0.0
        self._undelayed = 0

    @property
    def uncertainty(self) -> float:  # numpydoc ignore=RT01
        """Possible drift of the offset since the last undelayed frame [ns]; NaN before the first frame.

        The offset is raised by `MAX_DRIFT` while the board's clock may be fast by as much. The minimum transit time
        adds to it: no mapping of this kind can observe it.
        """
        return 2 * (self._last - self._undelayed) * MAX_DRIFT if self._known else math.nan

    def delay(self, device_time: int, arrival: int) -> float:
        """Return how much later a frame arrived than an undelayed one [ns]; 0 before the first frame.

        Parameters
        ----------
        device_time : int
            Time of acquisition on the board's clock, unwrapped [us].
        arrival : int
            Monotonic time at which the frame arrived [ns].
        """
        return arrival - device_time * 1000 - self._offset if self._known else 0.0

    def reset(self) -> None:
        """Discard the offset: the board's clock has restarted."""
        self._known = False

    def to_monotonic(self, device_time: int, arrival: int) -> int:
        """Return the monotonic time that corresponds to a device time.

        Parameters
        ----------
        device_time : int
            Time of acquisition on the board's clock, unwrapped [us].
        arrival : int
            Monotonic time at which the frame arrived [ns].

        Returns
        -------
        int
            Monotonic time of acquisition [ns]; never after `arrival`.
        """
        difference = float(arrival - device_time * 1000)
        if self._known:
            elapsed = arrival - self._last
            followed = self._offset + elapsed * MAX_DRIFT if elapsed > 0 else self._offset
            if difference <= followed:
                followed, self._undelayed = difference, arrival
            self._offset = followed
            if difference < self._window_minimum:  # noqa: PLR1730  # faster than min() for every scan
                self._window_minimum = difference
            if arrival >= self._window_end:
                self._end_window(difference, arrival)
        else:
            self._offset = difference
            self._known = True
            self._undelayed = arrival
            self._begin_window(difference, arrival)
        self._last = arrival
        return device_time * 1000 + round(self._offset)

    def _end_window(self, difference: float, arrival: int) -> None:
        """Re-estimate the offset when no frame of the window arrived undelayed."""
        if self._window_minimum > self._offset + STEP_LIMIT:
            self._offset = self._window_minimum
            self._undelayed = arrival
        self._begin_window(difference, arrival)

    def _begin_window(self, difference: float, arrival: int) -> None:
        self._window_end = arrival + WINDOW
        self._window_minimum = difference


class WallOffset:
    """Wall time less monotonic time, read with each batch of frames.

    Of two consecutive readings the smaller is used: a process that is suspended between its reads of the two clocks
    reads too large a value.
    """

    def __init__(self) -> None:
        self.value = 0
        """The offset to be used [ns]."""
        self._last = 1 << 63  # more than any

    def read(self, offset: int) -> None:
        """Take a reading [ns]."""
        self.value = offset if offset < self._last else self._last
        self._last = offset
