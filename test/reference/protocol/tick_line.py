# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Times of the ticks between two classic headers."""

from __future__ import annotations

from collections import deque
from statistics import median
from typing import Final

from posfet_driver.protocol.scan_codec import HEADER_SCANS

STEPS: Final = 5
"""Newest steps from header to header of which the period is the median; assumed."""
NOMINAL: Final = 2
"""Steps for which the nominal period counts [1]: it holds against that many others."""
CONFIRMING: Final = 2
"""Steps that confirm a period which another host may have set: the first may have begun before."""
AGREEMENT: Final = 20.0
"""Difference of times that are rounded to microseconds, from header to header [us]."""
LATEST: Final = 0.95
"""Time by which a tick may be sampled late [scan periods]; later, and period or sequence have changed. Assumed."""


class TickLine:
    """The ticks of a board's scan timer, on the board's clock: equidistant, as long as the period is the same.

    A header states when its scan was sampled. That is the time of its tick, or later when the board was busy, but by
    less than a period, and never earlier. The ticks are therefore a line with the headers on it or above: its slope is
    the median of the steps between the newest headers, and it runs through the earliest of them.

    Where a header contradicts the line, or another host sets the period, the next headers decide on the period.
    """

    def __init__(self) -> None:
        self.period = 0.0
        """Scan period [us], as announced, or as measured when most of the newest headers contradict that."""
        self.nominal = 0.0
        """Scan period [us], as announced, or as measured when two steps contradict that alike."""
        self._announced = 0.0
        self._unconfirmed = 0  # steps that have to fit before the period is certain again
        self._contradiction = 0.0  # step before that does not fit [us]; 0: it did
        self._steps: deque[float] = deque(maxlen=STEPS)  # periods from one header to the next [us]
        self._headers: deque[tuple[int, int]] = deque(maxlen=STEPS + 1)  # sequence and time, on one line
        self._newest = 0, 0
        self._tick = 0.0
        self.lowered = False
        """Whether the newest header shows that those before were sampled late."""
        self.agreed = False
        """Whether two headers lie on the line: one alone may have been sampled late."""

    def restart(self, period: float) -> None:
        """Forget all headers: the board announces a scan period [us], or has restarted."""
        self._announced = self.nominal = self.period = period
        self._unconfirmed = 0
        self._contradiction = 0.0
        self._steps.clear()
        self._headers.clear()

    @property
    def certain(self) -> bool:
        """Whether the period is: the times of the ticks since the newest header are."""
        return self._unconfirmed == 0

    @property
    def continued(self) -> bool:
        """Whether the newest header is on one line with the one before."""
        return len(self._headers) > 1

    def spans(self, sequence: int) -> bool:
        """Return whether a scan is between two headers of the line.

        Parameters
        ----------
        sequence : int
            Sequence of the scan.
        """
        return self.continued and self._headers[0][0] <= sequence

    def question(self) -> None:
        """Note that the period may be another one from one of the ticks to come on."""
        self._unconfirmed = CONFIRMING

    def add(self, sequence: int, time: int, estimated: bool) -> None:
        """Take a header.

        Parameters
        ----------
        sequence : int
            Sequence of its scan.
        time : int
            Its time on the board's clock, unwrapped [us].
        estimated : bool
            Whether the time is counted on by the sequence: then it measures nothing.
        """
        scans, elapsed = sequence - self._newest[0], time - self._newest[1]
        if self._headers:
            if abs(elapsed - scans * self.period) > LATEST * self.period:
                step = elapsed / scans if 0 < scans <= HEADER_SCANS else 0.0
                again = abs(step - self._contradiction) <= LATEST * step / HEADER_SCANS
                measured = again and step > 0
                self.nominal = self.period = step if measured else self._announced
                self._unconfirmed = 0 if measured else max(self._unconfirmed, 1)
                self._contradiction = step
                self._steps.clear()
                self._headers.clear()
            else:
                self._unconfirmed = max(self._unconfirmed - 1, 0)
                self._contradiction = 0.0
                if scans <= HEADER_SCANS and not estimated:
                    self._steps.append(elapsed / scans)
                    self.period = median([*[self.nominal] * NOMINAL, *self._steps])
        expected = self._tick + scans * self.period
        self._newest = sequence, time
        self._headers.append(self._newest)
        ticks = [earlier + (sequence - before) * self.period for before, earlier in self._headers]
        self._tick = min(ticks)
        self.agreed = sum(tick - self._tick <= AGREEMENT for tick in ticks) > 1
        self.lowered = self.continued and expected - self._tick > AGREEMENT

    def time(self, sequence: int) -> int:
        """Return the time of the tick of a scan since the newest header [us]."""
        return round(self._tick + (sequence - self._newest[0]) * self.period)
