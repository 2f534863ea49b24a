# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Mechanics of a parallel grasp: grip force, weight, friction and slip of one object between two fingertips.

One degree of freedom for the jaws and one for the object, which slips down along y of the arrays. All values of the
gripper are assumed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import Final

GRAVITY: Final = 9.81
"""Acceleration of gravity [m/s2]."""
FINGERS: Final = 2
"""Fingertips, on opposite sides of the object."""


class Control(Enum):
    """What the gripper controls."""

    FORCE = "force"
    """The grip force."""
    WIDTH = "width"
    """The distance of the jaws; the grip force is that of skin and object as springs."""


@dataclass(frozen=True)
class GraspedObject:
    """An object and how it is offered. Weight and friction are what a controller does not know."""

    mass: float
    """Mass m [kg]."""
    static_friction: float
    """Coefficient of static friction mu_s of each fingertip [1]."""
    kinetic_friction: float
    """Coefficient of kinetic friction mu_k [1], at most that of static friction."""
    gap: float
    """Distance of each jaw from the object at the start [m]; without effect on a gripper that controls force."""
    stiffness: float
    """Stiffness of skin and object in series, per finger [N/m]."""
    lift_time: float
    """Time at which the object is lifted [s]: the support is gone `LIFT_DURATION` later."""
    growth: float
    """Weight that is added, relative to the weight [1]."""
    growth_time: float
    """Time at which the weight begins to grow, for `GROWTH_DURATION` [s]."""

    @property
    def least_grip_force(self) -> float:
        """Grip force that holds the whole weight, once it has grown, without slip [N]: ``m*g/(2*mu_s)``."""
        return self.mass * (1.0 + self.growth) * GRAVITY / (FINGERS * self.static_friction)


@dataclass(frozen=True)
class Gripper:
    """Properties of the gripper."""

    control: Control = Control.FORCE
    """What is controlled."""
    force_max: float = 4.0
    """Largest grip force [N]."""
    force_rate: float = 20.0
    """Largest rate of the commanded force [N/s]."""
    speed: float = 0.02
    """Largest speed of each jaw [m/s]."""
    lag: float = 0.02
    """Time constant of the grip force behind the command [s]."""


LIFT_DURATION: Final = 0.3
"""Time in which the support is withdrawn [s]."""
GROWTH_DURATION: Final = 0.5
"""Time in which the weight grows [s]."""
TEXTURE_PERIOD: Final = 0.4e-3
"""Period of the object's texture [m]."""
TEXTURE_FORCE: Final = 0.03
"""Relative amplitude of the normal force while the texture passes [1]."""


class GraspMechanics:
    """State of a grasp: `step` advances it.

    Coulomb friction: while ``T <= 2*mu_s*N`` the object sticks; otherwise it slips with
    ``m*dv/dt = T - 2*mu_k*N`` until v is 0 again. N is the grip force, T the weight that the support does not carry.
    The grip force follows its command with a first-order lag. Not modelled: shear of the skin before slip, rotation,
    and the inertia of the gripper.

    Parameters
    ----------
    grasped : GraspedObject
        The object.
    gripper : Gripper
        The gripper.
    """

    def __init__(self, grasped: GraspedObject, gripper: Gripper) -> None:
        self.grasped = grasped
        """The object."""
        self._gripper = gripper
        self.time = 0.0
        """Time since the start [s]."""
        self.command = 0.0
        """Commanded grip force [N], or how far each jaw has closed [m]."""
        self.force = 0.0
        """Grip force N, the normal force on each fingertip [N]."""
        self.slip = 0.0
        """Distance by which the object has slipped down [m]."""
        self.velocity = 0.0
        """Velocity of the slip [m/s]."""

    @property
    def load(self) -> float:
        """Tangential force T that the fingertips carry together if nothing slips [N]."""
        grasped = self.grasped
        lifted = min(max((self.time - grasped.lift_time) / LIFT_DURATION, 0.0), 1.0)
        return lifted * self.mass * GRAVITY

    @property
    def mass(self) -> float:
        """Mass with what was added so far [kg]."""
        grasped = self.grasped
        grown = min(max((self.time - grasped.growth_time) / GROWTH_DURATION, 0.0), 1.0)
        return grasped.mass * (1.0 + grasped.growth * grown)

    @property
    def lifted(self) -> bool:
        """Whether the support carries less than the whole weight."""
        return self.time > self.grasped.lift_time

    @property
    def normal_force(self) -> float:
        """Force on each fingertip with what the texture adds while the object slips [N]."""
        if self.slip == 0.0:
            return self.force
        return self.force * (1.0 + TEXTURE_FORCE * math.sin(2.0 * math.pi * self.slip / TEXTURE_PERIOD))

    def move(self, action: float, duration: float) -> None:
        """Change the command.

        Parameters
        ----------
        action : float
            Rate of the command relative to the largest one, in [-1, 1]; positive closes.
        duration : float
            Time for which it acts [s].
        """
        gripper = self._gripper
        rate = gripper.force_rate if gripper.control is Control.FORCE else gripper.speed
        self.command = min(max(self.command + action * rate * duration, 0.0), self.command_max)

    @property
    def command_max(self) -> float:
        """Largest command [N or m]."""
        if self._gripper.control is Control.FORCE:
            return self._gripper.force_max
        return self.grasped.gap + self._gripper.force_max / self.grasped.stiffness

    def step(self, duration: float) -> None:
        """Advance by a time.

        Parameters
        ----------
        duration : float
            Time [s], short against `Gripper.lag`.
        """
        self.time += duration
        wanted = self.command
        if self._gripper.control is Control.WIDTH:
            wanted = self.grasped.stiffness * max(self.command - self.grasped.gap, 0.0)
        self.force += (wanted - self.force) * -math.expm1(-duration / self._gripper.lag)
        self._slide(duration)

    def _slide(self, duration: float) -> None:
        grasped, load = self.grasped, self.load
        if self.velocity == 0.0 and load <= FINGERS * grasped.static_friction * self.force:
            return
        friction = FINGERS * grasped.kinetic_friction * self.force
        self.velocity = max(self.velocity + duration * (load - friction) / self.mass, 0.0)
        self.slip += self.velocity * duration
