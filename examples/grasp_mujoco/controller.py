# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The grip controller: closes until contact, holds with little force, and grips harder when the object slips.

It sees what /tactile offers, contacts and force images of two fingertips, and gives one grip force. It knows neither
physics nor ROS.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

from examples.grasp_mujoco.creep import CreepWatch, FloatArray


@dataclass(frozen=True)
class Touch:
    """What one fingertip feels in one scan."""

    force: float = 0.0
    """Sum of the normal forces of its contacts [N]."""
    image: FloatArray | None = None
    """Force on each taxel [N], NaN where it is unknown, shape [rows, cols]; None without contact."""
    slipping: bool = False
    """Whether one of the contacts is reported as slipping."""
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
    """Time after a raise for which only contacts that are reported as slipping count [s]: the images change."""
    creep: float = 5e-6
    """Displacement of the object, within about 10 ms and beyond the noise, that counts as slip, too [m]: a little more
    than the engine's friction lets a held object creep; infinite: only contacts that are reported as slipping count."""
    creep_lifting: float = 15e-6
    """The same while the hand lifts it [m]: the weight that the fingertips take over shifts the pressure."""
    calm: float = 0.5
    """Time without slip after which the grip force sinks again [s]."""
    greatest: float = 8.0
    """Greatest grip force [N]."""


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
            What both fingertips feel.
        """
        step = time - self._time
        self._time = time
        settings = self.settings
        last = self.raised[-1] if self.raised else -math.inf
        if time - last < settings.blank:
            self._creep.clear()
        least = settings.creep if self.phase is Phase.HOLD else max(settings.creep, settings.creep_lifting)
        creeps = self._creep.update(*(touch.image for touch in touches)) > least
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
