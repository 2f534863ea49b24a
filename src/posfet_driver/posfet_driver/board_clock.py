"""A board's clock on the time of this machine."""

from __future__ import annotations

from typing import Final

DRIFT: Final = 100e-6
"""Greatest difference in speed between the two clocks [s/s] that is followed: two crystals of 50 ppm each; assumed."""


class BoardClock:
    """Maps device time to the machine's monotonic time by the frames that were on their way for the shortest time.

    The difference of arrival and device time is the clocks' offset plus the time on the way, which is never below that
    of an undelayed frame. The least difference is kept and raised by `DRIFT` a second, so that a board that runs slow
    is followed; one that runs fast shows lower differences by itself. The error is the least delay on the way (0.2 ms
    of frame and adapter), plus 0.1 ms for each second without any undelayed frame.
    """

    def __init__(self) -> None:
        self._offset = 0.0
        self._last = 0
        self._known = False

    def reset(self) -> None:
        """Forget the offset: the board's clock began anew."""
        self._known = False

    def to_monotonic(self, device_time: int, arrival: int) -> int:
        """Return the monotonic time [ns] of `device_time` [us], wraps undone, for a frame that came at `arrival` [ns].

        Never after `arrival`.
        """
        difference = float(arrival - device_time * 1000)
        if self._known:
            followed = self._offset + max(arrival - self._last, 0) * DRIFT
            self._offset = min(difference, followed)
        else:
            self._offset = difference
            self._known = True
        self._last = arrival
        return device_time * 1000 + round(self._offset)
