# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Detection of the true slips of objects in a scene: delay, recall and false detections."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from posfet_model.contacts.slip import SLIP_END_SPEED, SLIP_SPEED
from posfet_sim.device.ground_truth import Truth

SLIP_LATE: Final = 0.05
"""Maximum delay of a detection [s]; later ones do not count."""

MIN_REST: Final = 0.02
"""Minimum time without motion between two slips of an object [s]."""

MAX_STEP: Final = 0.005
"""Maximum interval between two scans for the computation of a speed [s]."""

MIN_FORCE: Final = 0.1
"""Minimum force of an object to slip [N]."""


@dataclass
class _Object:
    centre: tuple[float, float]
    time: float
    slips: bool = False
    slipped: float = -math.inf
    """Last time at which it was faster than `SLIP_END_SPEED` [s]."""
    waiting: float = math.nan
    """Onset of a slip that is not detected yet [s]; NaN for none."""


class SlipScorer:
    """Compares detected with true slips, scan by scan."""

    def __init__(self) -> None:
        """Create an empty scorer."""
        self._objects: dict[int, _Object] = {}
        self._detected: set[int] = set()
        self._delays: list[float] = []
        self.missed = 0
        """Number of slips that were not detected."""
        self.false = 0
        """Number of false detections."""

    def add(self, truth: Truth, partners: dict[int, int], slipping: set[int]) -> None:
        """Add one scan.

        Parameters
        ----------
        truth : Truth
            Ground truth of the scan.
        partners : dict of int to int
            Track id of the contact of each detected object, by its index.
        slipping : set of int
            Track ids that are detected as slipping.
        """
        objects, time = truth.objects, truth.time
        moving: set[int] = set()
        present = {}
        for index, number in enumerate(objects.contact_objects.tolist()):
            if objects.contact_forces[index] < MIN_FORCE:
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
            self.missed += number not in present and not math.isnan(known.waiting)
        self._objects = present
        self.false += len(slipping - self._detected - moving)
        self._detected = slipping

    def _move(self, known: _Object, centre: tuple[float, float], time: float) -> None:
        step = time - known.time
        if 0.0 < step <= MAX_STEP:
            speed = math.dist(centre, known.centre) / step
            if speed >= SLIP_SPEED and not known.slips:
                known.slips, known.waiting = True, time
            if speed >= SLIP_END_SPEED:
                known.slipped = time
            elif time - known.slipped > MIN_REST:
                known.slips = False
        if time - known.waiting > SLIP_LATE:
            self.missed += 1
            known.waiting = math.nan
        known.centre, known.time = centre, time

    def delay(self) -> dict[str, float | None]:
        """Return mean and maximum delay of the detected slips [ms]; None when there was none."""
        if not self._delays:
            return {"mean": None, "max": None}
        return {"mean": 1e3 * sum(self._delays) / len(self._delays), "max": 1e3 * max(self._delays)}

    def recall(self) -> float | None:
        """Return the fraction of the slips that were detected [1]; None when there was none."""
        slips = len(self._delays) + self.missed
        return len(self._delays) / slips if slips else None
