"""What a person sees of the stack at one moment, and what is left to say at the end."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class ContactView:
    """One contact as it is shown."""

    id: int
    state: str
    x: float
    """Centre of pressure [m]."""
    y: float
    force: float
    """Normal force [N], positive when pushed."""
    standard_deviation: float
    """Of the force [N]."""
    area: float
    """[m2]."""
    age: float
    """[s]."""


@dataclass(frozen=True)
class TrueContact:
    """Where the scene touches the simulated sensor."""

    x: float
    """[m]"""
    y: float
    force: float
    """[N]"""


@dataclass(frozen=True)
class Snapshot:
    """The stack at one moment."""

    time: float
    """Monotonic time [s]."""
    scans: int
    """Whole scans the model has worked on."""
    frames_lost: int
    """CAN frames lost; 0 without a bus."""
    scans_lost: int
    """Scans that never reached the model."""
    rows: int
    cols: int
    force: NDArray[np.floating]
    """Force on each taxel [N], shape [rows * cols]; NaN where not known."""
    total_force: float
    """[N]"""
    data_valid: bool
    contacts: tuple[ContactView, ...] = ()
    truth: tuple[TrueContact, ...] = ()
    state: str = ""
    """What the source of scans says of itself."""


class SnapshotSource(Protocol):
    """Something that can be asked for the newest snapshot."""

    def snapshot(self) -> Snapshot | None:
        """Return the newest snapshot, or None before the first scan."""
        ...


FORCE_COMPARED = 0.1
"""True contacts below this force [N] are not compared: the first and last moments of a touch."""


@dataclass
class Record:
    """What has been seen from the first snapshot on."""

    first: Snapshot | None = None
    last: Snapshot | None = None
    ids: set[int] = field(default_factory=set)
    errors: list[float] = field(default_factory=list)
    """Distance of each true contact from the nearest reported one [m], sampled; infinite when there was none."""

    def add(self, snapshot: Snapshot) -> float:
        """Take in one snapshot and return the rate of scans since the one before [Hz], NaN for the first."""
        before, self.last = self.last, snapshot
        self.first = self.first or snapshot
        self.ids.update(contact.id for contact in snapshot.contacts)
        if snapshot.data_valid:
            self.errors += [off_scene(snapshot, true) for true in snapshot.truth if true.force >= FORCE_COMPARED]
        return rate(before, snapshot) if before else math.nan

    def summary(self) -> str:
        """Return the closing line."""
        if self.first is None or self.last is None:
            return "posfet: no scan arrived"
        words = [
            f"{self.last.time - self.first.time:.1f} s",
            f"{self.last.scans} scans",
            f"{rate(self.first, self.last):.0f} scans/s",
            f"{self.last.frames_lost} frames lost",
            f"{self.last.scans_lost} scans missing",
            f"{len(self.ids)} contact{'s' if len(self.ids) != 1 else ''}",
        ]
        if self.errors:
            median, high = np.quantile(self.errors, [0.5, 0.95], method="nearest") * 1e3
            words.append(f"centre of pressure off the scene's by {median:.3f} mm (median), {high:.3f} mm (95 %)")
        return f"posfet: {', '.join(words)}"


def rate(before: Snapshot, after: Snapshot) -> float:
    """Return the rate of scans between two snapshots [Hz]."""
    elapsed = after.time - before.time
    return (after.scans - before.scans) / elapsed if elapsed > 0 else math.nan


def off_scene(snapshot: Snapshot, true: TrueContact) -> float:
    """Return the distance of a true contact from the nearest reported one [m], infinite when there is none."""
    distances = [math.hypot(contact.x - true.x, contact.y - true.y) for contact in snapshot.contacts]
    return min(distances, default=math.inf)


def line(snapshot: Snapshot, elapsed: float, scan_rate: float) -> str:
    """Return one line for people who watch without a terminal; times [s], rates [Hz]."""
    contacts = [
        f"#{contact.id} {contact.state} {contact.force:.2f} N at ({contact.x * 1e3:+.2f}, {contact.y * 1e3:+.2f}) mm"
        for contact in snapshot.contacts
    ]
    total = f"{snapshot.total_force:.2f} N" if snapshot.data_valid else "settling"
    return (
        f"{elapsed:6.1f} s  {scan_rate:6.0f} scans/s  total {total}  "
        f"{'; '.join(contacts) or 'no contact'}  {snapshot.frames_lost} frames lost"
    )
