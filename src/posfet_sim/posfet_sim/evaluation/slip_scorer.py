"""True slips of a scene's objects, and how soon they were told."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from posfet_model.contacts.slip import SLIP_END_SPEED, SLIP_SPEED
from posfet_sim.device.ground_truth import Truth

SLIP_LATE: Final = 0.05
"""A slip that is told later than this is not found [s]."""

APART: Final = 0.02
"""An object that rested for less than this goes on slipping [s]."""

LARGEST_STEP: Final = 0.005
"""Longest time between two scans over which a speed is taken [s]."""

PRESSING: Final = 0.1
"""Objects that press with less [N] are not said to slip."""


@dataclass
class _Object:
    centre: tuple[float, float]
    time: float
    slips: bool = False
    slipped: float = -math.inf
    """When it last was faster than `SLIP_END_SPEED` [s]."""
    waiting: float = math.nan
    """Onset of a slip not told yet [s]."""


class Slips:
    """Compares scan by scan."""

    def __init__(self) -> None:
        self._objects: dict[int, _Object] = {}
        self._told: set[int] = set()
        self._delays: list[float] = []
        self._missed = 0
        self.false = 0
        """Slips told that were none."""

    def add(self, truth: Truth, partners: dict[int, int], slipping: set[int]) -> None:
        """Take a scan: the id of the contact of each object that was found, and the ids that are said to slip."""
        objects, time = truth.objects, truth.time
        moving: set[int] = set()
        present = {}
        for index, number in enumerate(objects.contact_objects.tolist()):
            if objects.contact_forces[index] < PRESSING:
                continue
            x, y = objects.contact_centres[index].tolist()
            known = self._objects.get(number) or _Object((x, y), time)
            self._move(known, (x, y), time)
            present[number] = known
            if time - known.slipped <= SLIP_LATE:
                moving.add(partners.get(number, 0))
            if not math.isnan(known.waiting) and partners.get(number) in slipping:
                self._delays.append(time - known.waiting)
                known.waiting = math.nan
        for number, known in self._objects.items():
            self._missed += number not in present and not math.isnan(known.waiting)
        self._objects = present
        self.false += len(slipping - self._told - moving)
        self._told = slipping

    def _move(self, known: _Object, centre: tuple[float, float], time: float) -> None:
        step = time - known.time
        if 0.0 < step <= LARGEST_STEP:
            speed = math.dist(centre, known.centre) / step
            if speed >= SLIP_SPEED and not known.slips:
                known.slips, known.waiting = True, time
            if speed >= SLIP_END_SPEED:
                known.slipped = time
            elif time - known.slipped > APART:
                known.slips = False
        if time - known.waiting > SLIP_LATE:
            self._missed += 1
            known.waiting = math.nan
        known.centre, known.time = centre, time

    def delay(self) -> dict[str, float | None]:
        """Return mean and greatest delay [ms] of the slips that were found."""
        if not self._delays:
            return {"mean": None, "max": None}
        return {"mean": 1e3 * sum(self._delays) / len(self._delays), "max": 1e3 * max(self._delays)}

    def recall(self) -> float | None:
        """Return the share of the slips that were found; None when there was none."""
        slips = len(self._delays) + self._missed
        return len(self._delays) / slips if slips else None
