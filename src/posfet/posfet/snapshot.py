# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""State of the stack at one time for display, and the summary of a run."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from posfet.number_text import fixed, signed


@dataclass(frozen=True)
class ContactView:
    """One contact for display."""

    id: int
    state: str
    x: float
    """Centre of pressure along the surface [m]."""
    y: float
    force: float
    """Normal force [N], positive for a push."""
    standard_deviation: float
    """Standard deviation of the force [N]."""
    area: float
    """Contact area [m2]."""
    age: float
    """Time since the onset of the contact [s]."""
    major_axis: tuple[float, float] = (math.nan, math.nan)
    """Principal axis (x, y) of the force distribution, one standard deviation long [m]."""
    minor_axis: tuple[float, float] = (math.nan, math.nan)
    """Axis perpendicular to it, one standard deviation long [m]."""
    velocity: tuple[float, float] = (math.nan, math.nan)
    """Velocity (x, y) of the centre of pressure [m/s]; NaN: unknown."""


@dataclass(frozen=True)
class TrueContact:
    """Ground truth of one contact on the simulated sensor."""

    x: float
    """Centre of pressure [m]."""
    y: float
    force: float
    """Normal force [N]."""


@dataclass(frozen=True)
class Snapshot:
    """State of the stack at one time."""

    time: float
    """Monotonic time [s]."""
    scans: int
    """Scans processed by the model."""
    frames_lost: int
    """CAN frames lost; 0 without a bus."""
    scans_lost: int
    """Scans that did not reach the model."""
    rows: int
    cols: int
    force: NDArray[np.floating]
    """Force on each taxel [N], shape [rows * cols]; NaN where unknown."""
    total_force: float
    """Sum of the forces [N]."""
    data_valid: bool
    contacts: tuple[ContactView, ...] = ()
    truth: tuple[TrueContact, ...] = ()
    state: str = ""
    """State of the source of scans, in one line."""
    calibration: str = ""
    """Date of the calibration, or what its absence costs, in one line; empty: not reported."""
    standard_deviation: NDArray[np.floating] | None = None
    """Standard deviation of `force` [N], shape [rows * cols], NaN where unknown; None: not reported."""
    status: NDArray[np.uint8] | None = None
    """Values of TaxelStatus, shape [rows * cols]; None: not reported."""
    total_standard_deviation: float = math.nan
    """Standard deviation of `total_force` [N]; NaN: unknown."""
    sequence: int = 0
    """Sequence of the scan."""
    stamp: int = 0
    """Acquisition time of the scan [ns] since the Unix epoch."""

    @property
    def uncalibrated(self) -> bool:
        """Whether the model reports that there is no calibration."""
        return self.calibration.startswith("uncalibrated")


OLD: Final = 1.0
"""Time without a new scan that is reported [s]."""


def old_text(snapshot: Snapshot, age: float) -> str:
    """Return for how long there has been no new scan, and the state of the source, in one line; '' if there was one.

    Parameters
    ----------
    snapshot : Snapshot
        The newest snapshot.
    age : float
        Time since its scan was new [s].
    """
    return f"no new scans for {age:.0f} s: {snapshot.state}" if age > OLD else ""


class SnapshotSource(Protocol):
    """Something that has a newest snapshot."""

    def snapshot(self) -> Snapshot | None:
        """Return the newest snapshot, or None before the first scan."""
        ...


class ScanCount:
    """Scans from the first snapshot on, by the sequence and a count of lost scans that lags behind it; never falls."""

    def __init__(self) -> None:
        self.total = 0
        """The count."""
        self._before = 0  # at the newest restart of the board or of the count of lost scans
        self._first = (0, 0)  # sequence and lost scans then
        self._newest = (-1, 0)

    def update(self, sequence: int, lost: int) -> int:
        """Return the count with a scan.

        Parameters
        ----------
        sequence : int
            Sequence of the scan; smaller than before when the board has restarted.
        lost : int
            Scans lost, as reported last; those before the first call do not count.
        """
        if self._newest[0] < 0 or sequence < self._newest[0] or lost < self._newest[1]:
            self._before, self._first = self.total, (sequence - (sequence != self._newest[0]), lost)
        self._newest = sequence, lost
        self.total = max(self.total, self._before + sequence - self._first[0] - (lost - self._first[1]))
        return self.total


MIN_COMPARED_FORCE = 0.1
"""Smallest true force of a contact whose position is compared [N]; excludes onset and release."""


@dataclass
class Record:
    """Statistics from the first snapshot on."""

    first: Snapshot | None = None
    last: Snapshot | None = None
    ids: set[int] = field(default_factory=set)
    errors: list[float] = field(default_factory=list)
    """Centre-of-pressure error of each true contact in each snapshot [m]; infinite if no contact was reported."""
    _before: tuple[int, int] = (0, 0)
    """Scans, and scans missing, that were counted before the model counted from 0 again, as with a new calibration."""

    def add(self, snapshot: Snapshot) -> float:
        """Add one snapshot and return the scan rate since the previous one [Hz]; NaN: the first, or counted from 0."""
        before, self.last = self.last, snapshot
        self.first = self.first or snapshot
        restarted = before is not None and snapshot.scans < before.scans
        if before is not None and restarted:
            self._before = self._before[0] + before.scans, self._before[1] + before.scans_lost
        self.ids.update(contact.id for contact in snapshot.contacts)
        self.errors += position_errors(snapshot)
        return math.nan if before is None or restarted else rate(before, snapshot)

    def summary(self) -> str:
        """Return the summary in one line."""
        if self.first is None or self.last is None:
            return "posfet: no scan arrived"
        scans, missing = self._before
        whole = replace(self.last, scans=self.last.scans + scans, scans_lost=self.last.scans_lost + missing)
        words = [
            f"{whole.time - self.first.time:.1f} s",
            f"{whole.scans} scans",
            f"{rate(self.first, whole):.0f} scans/s",
            f"{whole.frames_lost} frames lost",
            f"{whole.scans_lost} scans missing",
            f"{len(self.ids)} contact{'s' if len(self.ids) != 1 else ''}",
        ]
        if self.errors:
            median, high = np.quantile(self.errors, [0.5, 0.95], method="nearest") * 1e3
            words.append(f"centre-of-pressure error {median:.3f} mm (median), {high:.3f} mm (95 %)")
        return f"posfet: {', '.join(words)}"


def rate(before: Snapshot, after: Snapshot) -> float:
    """Return the scan rate between two snapshots [Hz].

    Parameters
    ----------
    before : Snapshot
        Earlier snapshot.
    after : Snapshot
        Later snapshot.
    """
    elapsed = after.time - before.time
    return (after.scans - before.scans) / elapsed if elapsed > 0 else math.nan


def position_errors(snapshot: Snapshot) -> list[float]:
    """Return the distance of each true contact from the nearest reported one [m], infinite if there is none.

    Parameters
    ----------
    snapshot : Snapshot
        Snapshot with the reported contacts. True contacts of less than `MIN_COMPARED_FORCE` are not compared, and none
        is while forces are not valid.
    """
    compared = [true for true in snapshot.truth if snapshot.data_valid and true.force >= MIN_COMPARED_FORCE]
    return [
        min((math.hypot(contact.x - true.x, contact.y - true.y) for contact in snapshot.contacts), default=math.inf)
        for true in compared
    ]


def line(snapshot: Snapshot, elapsed: float, scan_rate: float, age: float = 0.0) -> str:
    """Return the snapshot in one line, for output that is no terminal.

    Parameters
    ----------
    snapshot : Snapshot
        What to print.
    elapsed : float
        Time since the start [s].
    scan_rate : float
        Scan rate [Hz].
    age : float, optional
        Time since the scan was new [s]: what an old one says is not printed.
    """
    if old := old_text(snapshot, age):
        return f"{elapsed:6.1f} s  {old}"
    contacts = [
        f"#{each.id} {each.state} {fixed(each.force, 2)} N at ({signed(each.x * 1e3, 2)}, {signed(each.y * 1e3, 2)}) mm"
        for each in snapshot.contacts
    ]
    total = f"{fixed(snapshot.total_force, 2)} N" if snapshot.data_valid else "unknown"
    total += " (uncalibrated)" if snapshot.uncalibrated else ""
    return (
        f"{elapsed:6.1f} s  {scan_rate:6.0f} scans/s  total {total}  "
        f"{'; '.join(contacts) or 'no contact'}  {snapshot.frames_lost} frames lost"
    )
