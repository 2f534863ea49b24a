# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Stamps that never step back, whatever becomes known of the board's clock."""

from __future__ import annotations


class AscendingStamps:
    """Orders the times of acquisition of the scans that are published.

    A frame with a shorter delay than all before lowers the offset of the board's clock: the scans that follow were
    acquired earlier than was known, and so may seem to be earlier than those published before. Until their times have
    caught up, stamps advance at half the rate of the board's clock; by `excess` they are late meanwhile, and by no more
    than the scan was delayed. Scans of one batch may have the same stamp: that of its arrival.
    """

    def __init__(self) -> None:
        self.excess = 0
        """Time by which the newest stamp is later than the clock says [ns]."""
        self._device_time = 0  # of the newest scan [us]
        self._stamp = -1 << 63  # of the newest scan [ns]

    def stamp(self, time: int, device_time: int, arrival: int) -> int:
        """Return the stamp of the next scan that is published.

        Parameters
        ----------
        time : int
            Its time of acquisition by the mapping of the board's clock [ns].
        device_time : int
            The same on the board's clock, unwrapped [us].
        arrival : int
            Time at which it arrived [ns], not before that of the previous scan.

        Returns
        -------
        int
            Monotonic time [ns], from the stamp of the previous scan to `arrival`.
        """
        time = min(time, arrival)  # else all that follow would wait for a clock that was in error
        step = (device_time - self._device_time) * 500  # half of it [ns]
        least = self._stamp + (step if step > 0 else 0)
        stamp = time if time >= least else max(min(least, arrival), self._stamp)
        self.excess, self._device_time, self._stamp = stamp - time, device_time, stamp
        return stamp
