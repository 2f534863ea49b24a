# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Bus load, computed from the frames received."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final

from posfet_driver.bus.frame import ERROR, EXTENDED, FD, RATE_SWITCH, REMOTE, Frame
from posfet_driver.bus.frame_timing import classic_time, fd_time

PERIOD: Final = 1_000_000_000
"""Time over which the load is averaged [ns]."""
EXTENDED_BITS: Final = 20
"""Bits that an identifier of 29 bits adds, before stuffing."""
ERROR_BITS: Final = 20
"""Smallest number of bits of an error frame with the error delimiter."""


class BusLoad:
    """Sums the time that frames occupy the bus, with half of the possible stuff bits.

    Parameters
    ----------
    bitrate : int
        Nominal bit rate [bit/s].
    data_bitrate : int
        Bit rate of the CAN FD data phase [bit/s].
    """

    def __init__(self, bitrate: int, data_bitrate: int) -> None:
        self.load = math.nan
        """Share of the last complete period in which the bus was in use, in [0, 1]; NaN before the first."""
        self._bitrate = bitrate
        self._data_bitrate = data_bitrate
        self._times: dict[tuple[int, int], float] = {}
        self._begin = 0
        self._busy = 0.0

    def reset(self) -> None:
        """Forget what was added: the bus was closed."""
        self.load, self._begin, self._busy = math.nan, 0, 0.0

    def add(self, frames: Iterable[Frame], now: int) -> None:
        """Add the frames that were read at `now` [ns].

        Parameters
        ----------
        frames : iterable of Frame
            Frames that were read.
        now : int
            Monotonic time [ns].
        """
        self.add_counts(((kind, len(data), 1) for _, kind, data in frames), now)

    def add_counts(self, frames: Iterable[tuple[int, int, int]], now: int) -> None:
        """Add frames that were read up to `now` [ns].

        Parameters
        ----------
        frames : iterable of tuple of int, int, int
            Kind and length [byte] of frames, and their number.
        now : int
            Monotonic time [ns].
        """
        times, busy = self._times, 0.0
        for kind, length, number in frames:
            try:
                busy += times[kind, length] * number
            except KeyError:
                busy += times.setdefault((kind, length), self._time(kind, length)) * number
        self._busy += busy
        if now - self._begin >= PERIOD:
            # After a pause of the reader all frames of the pause arrive at once: the period is the whole pause.
            self.load = self._busy * 1e9 / (now - self._begin) if self._begin else math.nan
            self._begin, self._busy = now, 0.0

    def _time(self, kind: int, length: int) -> float:
        if kind & ERROR:
            return ERROR_BITS / self._bitrate
        extra = EXTENDED_BITS / self._bitrate if kind & EXTENDED else 0.0
        if kind & FD:
            time = fd_time(length, self._bitrate, self._data_bitrate if kind & RATE_SWITCH else self._bitrate)
        else:
            time = classic_time(0 if kind & REMOTE else min(length, 8), self._bitrate)
        return (time.least + time.most) / 2 + extra
