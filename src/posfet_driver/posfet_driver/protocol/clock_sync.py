"""A board's clock on the time of this machine."""

from __future__ import annotations

import math
from typing import Final

DRIFT: Final = 100e-6
"""Greatest difference in speed between the two clocks [s/s] that is followed: two crystals of 50 ppm each; assumed."""


WINDOW: Final = 1_000_000_000
"""Time [ns] within which one frame has to come undelayed."""

STEP_LIMIT: Final = 5_000_000.0
"""Delay [ns] of every frame of a window that is taken for a step of the clock, unnoticed until then; assumed."""


class BoardClock:
    """Maps device time to the machine's monotonic time by the frames that were on their way for the shortest time.

    The difference of arrival and device time is the clocks' offset plus the time on the way, which is never below that
    of an undelayed frame. The least difference is kept and raised by `DRIFT` a second, so that a board that runs slow
    is followed; one that runs fast shows lower differences by itself. The error is the least delay on the way (0.2 ms
    of frame and adapter), plus 0.1 ms for each second without any undelayed frame. When every frame of a second is late
    by more than 5 ms, the board's clock has been set back, and the map begins anew.

    A board that sends no time is mapped in the same way by the number of its scan: it scans evenly.
    """

    def __init__(self) -> None:
        self._offset = 0.0
        self._last = 0
        self._known = False
        self._window_end = 0
        self._window_least = 0.0
        self._undelayed = 0

    @property
    def uncertainty(self) -> float:
        """How far the map may have run ahead since the last undelayed frame [ns]; NaN before the first frame.

        To this comes the least delay on the way, which no map can see.
        """
        return (self._last - self._undelayed) * DRIFT if self._known else math.nan

    def reset(self) -> None:
        """Forget the offset: the board's clock began anew."""
        self._known = False

    def to_monotonic(self, device_time: int, arrival: int) -> int:
        """Return the monotonic time [ns] of `device_time` [us], wraps undone, for a frame that came at `arrival` [ns].

        Never after `arrival`.
        """
        difference = float(arrival - device_time * 1000)
        if self._known:
            elapsed = arrival - self._last
            followed = self._offset + elapsed * DRIFT if elapsed > 0 else self._offset
            if difference <= followed:
                followed, self._undelayed = difference, arrival
            self._offset = followed
            self._window_least = min(self._window_least, difference)
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
        """Begin anew when no frame of a window came undelayed."""
        if self._window_least > self._offset + STEP_LIMIT:
            self._offset = self._window_least
            self._undelayed = arrival
        self._begin_window(difference, arrival)

    def _begin_window(self, difference: float, arrival: int) -> None:
        self._window_end = arrival + WINDOW
        self._window_least = difference
