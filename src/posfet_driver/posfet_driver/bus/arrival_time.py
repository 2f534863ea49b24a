# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Monotonic time at which frames arrived, from the kernel's time stamps."""

from __future__ import annotations

from typing import Final

OFFSET_TOLERANCE: Final = 100_000
"""Difference of two readings of the wall clock's offset [ns] above which the wall clock was set between them, or this
process was suspended while it read the two clocks; slewing by 500 ppm changes it by less within 0.2 s."""


class ArrivalTime:
    """Maps the kernel's stamp of the newest frame of each read, on the wall clock, to monotonic time.

    The frame arrived after the previous read and before this one, whatever the stamp says. Where the offset of the wall
    clock is not that of the previous read, the time of this read replaces the stamp: the wall clock may have been set
    after the frame had arrived.
    """

    def __init__(self) -> None:
        self._last_read = 0
        self._last_offset = 0

    def of_newest(self, stamp: int, now: int, wall_offset: int) -> int:
        """Return the time at which the newest frame arrived.

        Parameters
        ----------
        stamp : int
            Wall time of its arrival [ns]; 0: unknown.
        now : int
            Monotonic time after the read [ns].
        wall_offset : int
            Wall time less monotonic time, read at `now` [ns].

        Returns
        -------
        int
            Monotonic time [ns], from the previous read to `now`; `now` when nothing better is known.
        """
        steady = abs(wall_offset - self._last_offset) < OFFSET_TOLERANCE
        arrival = stamp - min(wall_offset, self._last_offset) if stamp and steady else now
        arrival = min(max(arrival, self._last_read), now)
        self._last_read, self._last_offset = now, wall_offset
        return arrival
