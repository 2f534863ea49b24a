# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The grip controller: closes until contact, holds with little force, and grips harder when the object slips.

It sees what /tactile offers, contacts of two fingertips, and gives one grip force. It knows neither physics nor ROS.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from enum import Enum


@dataclass(frozen=True)
class Touch:
    """The contacts of one fingertip in one scan."""

    force: float = 0.0
    """Sum of their normal forces [N]."""
    centre: tuple[float, float] = (math.nan, math.nan)
    """Their common centre of pressure, x and y in the frame of the array [m]; NaN without contact."""
    slipping: bool = False
    """Whether one of them is reported as slipping."""
    valid: bool = False
    """Whether the forces are valid: the grip closes only then."""


class Phase(Enum):
    """What the controller does."""

    WAIT = "wait"
    """Until the forces of both fingertips are valid."""
    CLOSE = "close"
    """Until both fingertips touch."""
    SETTLE = "settle"
    """Holds with the first grip force."""
    LIFT = "lift"
    HOLD = "hold"
    """Lets the grip force sink slowly until slip says that it is the least."""


@dataclass(frozen=True)
class GripSettings:
    """Settings of the controller; all chosen for this gripper."""

    closing: float = 0.4
    """Force with which the fingers close [N]."""
    first: float = 0.6
    """Grip force after contact [N]."""
    settle: float = 0.1
    """Time for which it is held before the lift [s]."""
    lift_time: float = 0.35
    """Duration of the lift [s]."""
    lift: float = 0.02
    """Height of the lift [m]."""
    relaxing: float = 0.15
    """Share of the grip force that is given up per second of holding [1/s]."""
    margin: float = 1.15
    """Least ratio of the grip force to that at the last slip [1]."""
    rise: float = 1.25
    """Ratio by which the grip force is raised at slip [1]."""
    least_rise: float = 0.05
    """Least raise [N]."""
    pause: float = 0.006
    """Least time between two raises [s]: the force needs it to follow."""
    blank: float = 0.025
    """Time after a raise for which only contacts that are reported as slipping count [s]: a raise moves the centre."""
    creep: bool = True
    """Whether creep counts, too; else only contacts that are reported as slipping."""
    calm: float = 0.5
    """Time without slip after which the grip force sinks again [s]."""
    greatest: float = 8.0
    """Greatest grip force [N]."""


class CreepWatch:
    """Detects that an object creeps in the hand, before its contacts are reported as slipping at 10 mm/s.

    A held object does not move against the fingertips, so that a small displacement tells: that of the mean centre of
    pressure over the newest `NEW` scans from that over the scans before. Both fingertips count together, as the object
    moves past both, each with the inverse of the variance of its centre. That depends on board, object and force, and
    is estimated from scan to scan. It does not need valid forces: what makes them uncertain changes slowly.
    """

    NEW = 4
    """Scans of the newest mean."""
    REFERENCE = 16
    """Most scans of the mean before."""
    LEAST_REFERENCE = 8
    """Least scans of it."""
    LEAST_DISPLACEMENT = 12e-6
    """[m]"""
    DEVIATIONS = 5.5
    """Standard deviations of the noise that do not count."""
    MEMORY = 64
    """Scans over which the noise is averaged."""

    def __init__(self) -> None:
        self._centres: deque[tuple[tuple[float, float], tuple[float, float]]] = deque(maxlen=self.NEW + self.REFERENCE)
        self._variances = [1e-10, 1e-10]  # of each coordinate of the centre on each fingertip [m2]

    def clear(self) -> None:
        """Take a new reference."""
        self._centres.clear()

    def update(self, touches: tuple[Touch, Touch]) -> bool:
        """Add a scan and return whether the object creeps."""
        if not all(touch.force > 0.0 for touch in touches):
            self._centres.clear()
            return False
        (left_x, left_y), right = touches[0].centre, touches[1].centre
        centres = (-left_x, left_y), right  # the fingertips face each other: x is mirrored
        if self._centres:
            for side, (now, before) in enumerate(zip(centres, self._centres[-1], strict=True)):
                step = math.dist(now, before)
                self._variances[side] += (step * step / 4 - self._variances[side]) / self.MEMORY
        self._centres.append(centres)
        count = len(self._centres) - self.NEW
        if count < self.LEAST_REFERENCE:
            return False
        precisions = [1 / max(variance, 1e-14) for variance in self._variances]
        total = sum(precisions)
        displacement = []
        for axis in (0, 1):
            both = [sum(p * c[axis] for p, c in zip(precisions, each, strict=True)) / total for each in self._centres]
            displacement.append(sum(both[count:]) / self.NEW - sum(both[:count]) / count)
        noise = math.sqrt((1 / count + 1 / self.NEW) / total)
        return math.hypot(*displacement) > max(self.LEAST_DISPLACEMENT, self.DEVIATIONS * noise)


class GripController:
    """Gives the grip force for each pair of scans.

    Parameters
    ----------
    settings : GripSettings
        Settings.
    feedback : bool
        Whether it reacts to slip, and gives up force that it might not need.
    """

    def __init__(self, settings: GripSettings | None = None, feedback: bool = True) -> None:
        self.settings = settings or GripSettings()
        """Settings."""
        self.phase = Phase.WAIT
        """What it does."""
        self.grip = 0.0
        """Grip force [N]."""
        self.lift = 0.0
        """Height of the hand [m]."""
        self.raised: list[float] = []
        """Times at which the grip force was raised since slip was reported [s]."""
        self.slipping = False
        """Whether slip is detected now."""
        self._feedback = feedback
        self._creep = CreepWatch()
        self._since = math.nan  # begin of the phase [s]
        self._time = math.nan
        self._slip_grip = 0.0  # grip force at the last slip [N]

    def update(self, time: float, touches: tuple[Touch, Touch]) -> float:
        """Return the grip force [N] after a scan of both fingertips.

        Parameters
        ----------
        time : float
            Time of the scans [s].
        touches : tuple of Touch
            Contacts of both fingertips.
        """
        step = time - self._time
        self._time = time
        settings = self.settings
        last = self.raised[-1] if self.raised else -math.inf
        if time - last < settings.blank:
            self._creep.clear()
        creeps = settings.creep and self._creep.update(touches)
        self.slipping = creeps or any(touch.slipping for touch in touches)
        elapsed = time - self._since
        if self.phase is Phase.WAIT and all(touch.valid for touch in touches):
            self._enter(Phase.CLOSE, time)
            self.grip = settings.closing
        elif self.phase is Phase.CLOSE and all(touch.force > 0 for touch in touches):
            self._enter(Phase.SETTLE, time)
            self.grip = settings.first
        elif self.phase is Phase.SETTLE and elapsed >= settings.settle:
            self._enter(Phase.LIFT, time)
        elif self.phase is Phase.LIFT:
            share = min(elapsed / settings.lift_time, 1.0)
            self.lift = settings.lift * share**3 * (10 - 15 * share + 6 * share**2)  # minimum jerk
            if elapsed >= settings.lift_time + 0.1:
                self._enter(Phase.HOLD, time)
        if self._feedback and self.phase in {Phase.LIFT, Phase.HOLD}:
            self._hold(time, step)
        return self.grip

    def _hold(self, time: float, step: float) -> None:
        """Raise the grip force at slip, and let it sink slowly otherwise."""
        settings = self.settings
        last = self.raised[-1] if self.raised else -math.inf
        if self.slipping and time - last >= settings.pause:
            self._slip_grip = self.grip
            self.grip = min(max(self.grip * settings.rise, self.grip + settings.least_rise), settings.greatest)
            self.raised.append(time)
        elif self.phase is Phase.HOLD and time - last > settings.calm:
            sunk = self.grip * (1 - settings.relaxing * step)
            self.grip = max(sunk, min(self.grip, settings.margin * self._slip_grip))

    def _enter(self, phase: Phase, time: float) -> None:
        self.phase, self._since = phase, time
