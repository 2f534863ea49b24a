# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Synchronisation of a board's clock with the clock of this machine."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

MAX_DRIFT: Final = 100e-6
"""Greatest relative drift of the two clocks that is followed [s/s]: two crystals of 50 ppm each; assumed."""

WINDOW: Final = 1_000_000_000
"""Time within which one frame has to arrive undelayed [ns]."""

WINDOWS: Final = 10
"""Windows that are remembered: the offset rises when no frame of so many was undelayed. Assumed."""

NEVER: Final = 1 << 63


class Window(NamedTuple):
    """What a window tells of the offset."""

    end: int
    """When its last frame was acquired [ns]."""
    offset: float
    """The offset then, by the frames of the window alone [ns]."""
    undelayed: int
    """When the frame that determined it was acquired [ns]."""


class SyncState(NamedTuple):
    """What a `ClockSync` knows."""

    offset: float = 0.0
    last: int = 0
    acquired: int = 0
    undelayed: int = 0
    known: bool = False
    windows: tuple[Window, ...] = ()
    window_end: int = 0
    window_offset: float = math.inf
    window_undelayed: int = 0
    doubted: bool = False
    recent: float = math.inf
    recent_before: float = math.inf


class ClockSync:
    """Maps device time to this machine's monotonic time, using the frames with the shortest transit time.

    Arrival time minus device time is the clock offset plus the transit time, and the transit time is never below that
    of an undelayed frame. The minimum of this difference is the estimated offset. It is raised by `MAX_DRIFT` per
    second, so that a slow board clock is followed; a fast one lowers the minimum by itself. The error is the minimum
    transit time (0.2 ms of frame and adapter), plus 0.2 ms for each second without an undelayed frame. These are
    seconds between acquisitions: frames that wait to be read for a minute have drifted by no more than when they were
    sent.

    The minimum is that of the last ten seconds with frames. A clock that was set back makes all frames late: whether
    that or a delay is the cause cannot be observed. The stamps are early by the shortest delay at most (`lead`), and
    after ten seconds that delay is taken for a step of the clock.
    """

    def __init__(self) -> None:
        self.offset = 0.0
        """This machine's time less the device time, after the newest frame [ns]."""
        self.known = False
        """Whether there was a frame."""
        self.last = 0
        """Arrival of the newest frame [ns]."""
        self._acquired = 0  # when the newest frame was acquired, as far as is known, and no earlier one later [ns]
        self._undelayed = 0  # the same of the frame that determined the offset
        self._lowest = math.inf  # to which the offset may be too high, as device times may be ahead of the clock
        self._settled = NEVER  # when the frames since that was last noted have told [ns]
        self._windows: tuple[Window, ...] = ()
        self._window_end = 0
        self._window_offset = math.inf  # by the frames of the present window alone
        self._window_undelayed = 0
        self._doubted = False  # the windows before tell nothing
        # Offset by the frames since the window began, or an interruption, and by those of the window before.
        self._recent = self._recent_before = math.inf
        self._interrupted = -WINDOW  # when that was last noted

    @property
    def drift(self) -> float:  # numpydoc ignore=RT01
        """Possible drift of the offset since the last undelayed frame [ns]; NaN before the first frame.

        The offset is raised by `MAX_DRIFT` while the board's clock may be fast by as much. The minimum transit time
        adds to it: no mapping of this kind can observe it.
        """
        return 2 * max(self._acquired - self._undelayed, 0) * MAX_DRIFT if self.known else math.nan

    @property
    def lead(self) -> float:  # numpydoc ignore=RT01
        """Shortest delay of the frames of the last one or two seconds [ns]: stamps may be early by it.

        After `interrupt` and `doubt` it is that of the frames since then.
        """
        return max(min(self._recent, self._recent_before) - self.offset, 0.0) if self.known else math.nan

    @property
    def uncertainty(self) -> float:  # numpydoc ignore=RT01
        """Possible error of the offset [ns], by drift or a step of the board's clock; NaN before the first frame.

        For a window after `interrupt` without the `lead`: the first frame may just have been delayed.
        """
        settled = self._doubted or self.last - self._interrupted >= WINDOW
        return self.drift + (self.lead if settled else 0.0) + self.excess

    @property
    def excess(self) -> float:  # numpydoc ignore=RT01
        """Time by which the offset may be too high, as device times may be ahead of the clock [ns]."""
        return max(self.offset - self._lowest, 0.0)

    def error(self, late: float, early: float, delay: float) -> float:
        """Return the largest error of a stamp by the newest frame [ns].

        Parameters
        ----------
        late : float
            Time by which it may be late, whatever the offset [ns].
        early : float
            Time by which it may be early, whatever the offset [ns].
        delay : float
            Time from the stamp to the arrival of its frame, by which it is early at most [ns].
        """
        offset, recent, before = self.offset, self._recent, self._recent_before
        recent = min(recent, before)
        if recent > offset:
            early += recent - offset
        early = min(early, delay)
        if self._lowest < offset:
            late += offset - self._lowest
        drifting = self._acquired - self._undelayed
        return (late if late > early else early) + (2 * drifting * MAX_DRIFT if drifting > 0 else 0.0)

    def delay(self, device_time: int, arrival: int) -> float:
        """Return how much later a frame arrived than an undelayed one [ns]; NaN before the first frame.

        Parameters
        ----------
        device_time : int
            Time of acquisition on the board's clock, unwrapped [us].
        arrival : int
            Monotonic time at which the frame arrived [ns].
        """
        if not self.known:
            return math.nan
        return arrival - device_time * 1000 - self.offset + (arrival - self.last) * MAX_DRIFT

    def reset(self) -> None:
        """Discard the offset: the board's clock has restarted."""
        self._set(SyncState())
        self._lowest, self._settled = math.inf, NEVER

    def interrupt(self, device_time: int, arrival: int) -> None:
        """Note that the board's clock may have been set unnoticed: the frames before no longer tell the `lead`.

        Parameters
        ----------
        device_time : int
            Time of acquisition on the board's clock as of now, unwrapped [us].
        arrival : int
            Monotonic time at which the frame arrived [ns].
        """
        if self.known:
            self._recent, self._recent_before = float(arrival - device_time * 1000), math.inf
            self._interrupted = arrival

    def doubt(self, device_time: int, arrival: int, ahead: float = 0.0) -> None:
        """Note that the board's clock may have been set: within a window the offset is found by the frames from now on.

        Parameters
        ----------
        device_time : int
            Time of acquisition on the board's clock as of now, unwrapped [us].
        arrival : int
            Monotonic time at which the frame arrived [ns].
        ahead : float, default 0
            Time by which `device_time` may be ahead of the clock [us].
        """
        if self.known:
            self.widen(ahead, arrival)
            self._doubted, self._window_end = True, arrival + WINDOW
            self._window_offset, self._window_undelayed = float(arrival - device_time * 1000), self._acquired
            self.interrupt(device_time, arrival)

    def widen(self, ahead: float, arrival: int) -> None:
        """Note that device times from now on may be ahead of the clock: so much too high the offset may be.

        Parameters
        ----------
        ahead : float
            Longest time by which they may be [us].
        arrival : int
            Monotonic time at which the frame arrived [ns].
        """
        if ahead > 0.0:
            drift = 2 * max(arrival - self._undelayed, 0) * MAX_DRIFT
            self._lowest = min(self._lowest, self.offset) - ahead * 1000 - drift
            self._settled = arrival + WINDOW

    def save(self) -> SyncState:
        """Return what is known, for `restore`."""
        return SyncState(
            self.offset,
            self.last,
            self._acquired,
            self._undelayed,
            self.known,
            self._windows,
            self._window_end,
            self._window_offset,
            self._window_undelayed,
            self._doubted,
            self._recent,
            self._recent_before,
        )

    def restore(self, state: SyncState) -> None:
        """Forget the frames since `save`, unless nothing was known then: their device times may have been wrong."""
        if not state.known:
            return
        self._lowest, self._settled = min(self._lowest, self.offset), self.last + WINDOW
        self._set(state)

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
        if self.known:
            acquired = device_time * 1000 + int(self.offset)
            acquired = arrival if acquired > arrival else acquired
            if acquired > self._acquired:
                rise, self._acquired = (acquired - self._acquired) * MAX_DRIFT, acquired
            else:
                rise = 0.0
            offset, recent = self.offset + rise, self._window_offset + rise
            if difference <= recent:
                recent, self._window_undelayed = difference, self._acquired
                if difference <= offset:
                    offset, self._undelayed = difference, self._acquired
            self.offset, self._window_offset = offset, recent
            since = self._recent + rise
            self._recent = difference if difference < since else since
            self._recent_before += rise
        else:
            self.offset = self._window_offset = self._recent = difference
            self._acquired = self._undelayed = self._window_undelayed = arrival
            self.known, self._window_end = True, arrival + WINDOW
        self.last = arrival
        if arrival >= self._window_end:
            self._end_window(arrival)
        if arrival >= self._settled:
            self._lowest, self._settled = math.inf, NEVER
        return device_time * 1000 + round(self.offset)

    def _end_window(self, arrival: int) -> None:
        """Find the offset anew, from the windows that are remembered."""
        window = Window(self._acquired, self._window_offset, self._window_undelayed)
        self._windows = (window,) if self._doubted else (*self._windows[1 - WINDOWS :], window)
        self._doubted = False
        self.offset, self._undelayed = min(
            (offset + (self._acquired - end) * MAX_DRIFT, undelayed) for end, offset, undelayed in self._windows
        )
        self._window_offset, self._window_end = math.inf, arrival + WINDOW
        self._recent, self._recent_before = math.inf, self._recent

    def _set(self, state: SyncState) -> None:
        self.offset, self.last = state.offset, state.last
        self._acquired, self._undelayed = state.acquired, state.undelayed
        self.known, self._doubted, self._windows = state.known, state.doubted, state.windows
        self._window_offset, self._window_undelayed = state.window_offset, state.window_undelayed
        self._window_end, self._recent, self._recent_before = state.window_end, state.recent, state.recent_before


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
