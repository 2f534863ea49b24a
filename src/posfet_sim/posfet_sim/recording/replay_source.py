# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A recording as a source of scans, at the pace at which it was recorded, at another one, or without any."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from posfet_driver.board.faults import Health
from posfet_driver.board.scan_source import SourceReport
from posfet_driver.clock import Clock, SystemClock
from posfet_model._lib.units import NANOSECONDS
from posfet_model.sensor.scan import Scan
from posfet_sim.recording.recorded_scans import RecordedScans

LONGEST_DELAY: Final = NANOSECONDS // 2
"""Delay of a scan [ns] beyond which the replay goes on from there, as long as the backlog of a simulated board."""
LONGEST_PAUSE: Final = 10 * NANOSECONDS
"""Pause between two stamps [ns] above which, as when stamps step back, the next scan follows at once."""


class ReplaySource:
    """Delivers the scans of a recording with their stamps.

    The first `read` starts the replay. At its end nothing more is delivered; `open` starts it again. A late reader gets
    the scans that are due one after the other; beyond LONGEST_DELAY the replay goes on from there instead, later by
    that time, which is reported: what was recorded is not lost.

    Parameters
    ----------
    scans : RecordedScans
        The recording.
    rate : float
        Playback speed factor; 0: as fast as scans are read.
    simulated : bool
        Whether the signals come from a model.
    clock : Clock, optional
        Default: the clock of this machine.
    """

    def __init__(self, scans: RecordedScans, rate: float, simulated: bool, clock: Clock | None = None) -> None:
        self._recorded = scans
        self._rate = rate
        self._simulated = simulated
        self._clock = clock or SystemClock()
        self._scans: Iterator[Scan] | None = None
        self._next: Scan | None = None
        self._anchor = (0, 0)  # monotonic time and stamp of a scan [ns]
        self._stamp = 0
        self._delivered = 0
        self._lost = 0
        self._delay = 0  # [ns]
        self.finished = False
        """Whether all scans were delivered."""

    @property
    def simulated(self) -> bool:
        """Whether the signals come from a model instead of a device."""
        return self._simulated

    def open(self) -> None:
        """Begin at the first scan."""
        self._scans = self._recorded.scans()
        self._next = None
        self._stamp = 0
        self.finished = False

    def close(self) -> None:
        """Stop the replay."""
        self._scans = self._next = None

    def read(self, timeout: float) -> Scan | None:
        """Return the next scan if it is due within `timeout` [s], else None after that time."""
        if self._next is None and self._scans is not None:
            self._next = next(self._scans, None)
            self.finished = self._next is None
        scan = self._next
        if scan is None:
            self._clock.sleep(timeout)
            return None
        wait = self._wait(scan.stamp) if self._rate else 0
        if wait > 0:
            self._clock.sleep(min(wait / NANOSECONDS, timeout))
            if wait > timeout * NANOSECONDS:
                return None
        self._next = None
        self._stamp = scan.stamp
        self._delivered += 1
        self._lost = scan.frames_lost
        return scan

    def _wait(self, stamp: int) -> int:
        """Return the time [ns] until a scan is due; after LONGEST_DELAY it is due now."""
        now = self._clock.monotonic()
        wait = self._due(stamp, now) - now
        if wait >= -LONGEST_DELAY:
            return wait
        self._delay -= wait
        self._anchor = now, stamp
        return 0

    def _due(self, stamp: int, now: int) -> int:
        """Return the monotonic time [ns] at which a scan is due."""
        if not self._stamp or not 0 <= stamp - self._stamp <= LONGEST_PAUSE:
            self._anchor = now, stamp
            self._stamp = stamp
        start, first = self._anchor
        return start + round((stamp - first) / self._rate)

    def report(self) -> SourceReport:
        """Return the state for diagnostics."""
        path = self._recorded.recording.path
        if self._scans is None:
            health, state = Health.STALE, "replay stopped"
        elif not self.finished:
            health, state = Health.OK, f"replaying {path}"
        elif self._recorded.problem:
            health, state = Health.WARN, f"replay finished: {self._recorded.problem}"
        else:
            health, state = Health.OK, f"replay of {path} finished"
        values = {"scans in the recording": str(len(self._recorded)), "topic": self._recorded.topic.name}
        if self._delay:
            values["delayed, this machine was too slow [s]"] = f"{self._delay / NANOSECONDS:.1f}"
        return SourceReport(health, state, self._delivered, self._lost, values=values)
