"""How much of a bus is in use, reckoned from the frames that are heard."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final

from posfet_driver.bus.frame import ERROR, EXTENDED, FD, RATE_SWITCH, REMOTE, Frame
from posfet_driver.bus.frame_timing import classic_time, fd_time

PERIOD: Final = 1_000_000_000
"""Time over which the load is taken [ns]."""
EXTENDED_BITS: Final = 20
"""Bits that an identifier of 29 bits adds, before stuffing."""
ERROR_BITS: Final = 20
"""Bits of an error frame with the error delimiter, at the least."""


class BusLoad:
    """Adds up the time that frames take, with half of the stuff bits that there can be."""

    def __init__(self, bitrate: int, data_bitrate: int) -> None:
        """Take the bitrates of the bus [bit/s]."""
        self.load = math.nan
        """Share of the last whole period in which the bus was in use; 1 is full; NaN before the first."""
        self._bitrate = bitrate
        self._data_bitrate = data_bitrate
        self._times: dict[tuple[int, int], float] = {}
        self._begin = 0
        self._busy = 0.0

    def add(self, frames: Iterable[Frame], now: int) -> None:
        """Take the frames that were read at `now` [ns]."""
        times, busy = self._times, 0.0
        for _, kind, data in frames:
            try:
                busy += times[kind, len(data)]
            except KeyError:
                busy += times.setdefault((kind, len(data)), self._time(kind, len(data)))
        self._busy += busy
        if now - self._begin >= PERIOD:
            # After a pause of the reader the frames of the pause come at once: their time is the whole of it.
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
