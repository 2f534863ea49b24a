# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The physics: a parallel gripper over an object on a pedestal, in MuJoCo. Knows no sensor."""

from __future__ import annotations

import math
from dataclasses import dataclass

import mujoco
import numpy as np

STEP = 0.5e-3
"""Step of the physics [s]."""
OPENING = 0.022
"""Distance of the fingertips when open [m]."""
FACE = 0.006
"""Half the side of the face of a fingertip [m]: the chip with its rim."""
SLIP_SPEED = 1e-3
"""Speed of the object against the fingertips from which it truly slips [m/s]. MuJoCo's friction creeps below that, by
up to 0.4 mm/s here."""
GROSS_SPEED = 2e-3
"""A second, less strict threshold of slip [m/s]: five times the fastest creep."""
REST = 0.03
"""Time below that speed after which the next slip begins [s]."""
LIFT = 0.02
"""Height by which the object is lifted [m]."""
FINGERS = ("left", "right")

_RIBS = "".join(
    f'<geom name="rib {side:+d} {row}" type="capsule" size="0.001 0.003" euler="90 0 0" mass="0.0001"'
    f' pos="{side * 0.007} 0 {0.004 * row}"/>'
    for side in (-1, 1)
    for row in range(-3, 4)
)
_GEOMS = {
    "sphere": '<geom name="object" type="sphere" size="0.008" mass="{mass}"/>',
    "box": '<geom name="object" type="box" size="0.008 0.003 0.0025" mass="{mass}"/>',
    "soft": '<geom name="object" type="sphere" size="0.009" mass="{mass}" solref="0.015 1"/>',
    "textured": '<geom name="object" type="box" size="0.0065 0.006 0.013" mass="{mass}" conaffinity="0" contype="2"/>'
    + _RIBS,
}
HALF_HEIGHTS = {"sphere": 0.008, "box": 0.0025, "soft": 0.009, "textured": 0.013}
"""Half the height of each object [m]; a box is flat enough to lie on the array whole."""
EFFECTIVE_MODULI = {"sphere": 4e6, "box": 4e6, "soft": 0.2e6, "textured": 4e6}
"""Effective modulus of each object and the skin together [Pa]; assumed."""
OBJECTS = tuple(_GEOMS)

_MODEL = """
<mujoco>
  <option timestep="{step}" cone="elliptic" impratio="20" integrator="implicitfast"/>
  <visual><global offwidth="480" offheight="480"/></visual>
  <default><geom condim="4" friction="{friction} 0.003 0.0001" solref="0.008 1" solimp="0.9 0.95 0.0003"/></default>
  <worldbody>
    <geom name="pedestal" type="box" size="0.003 0.006 0.01" pos="0 0 -0.01" contype="2" conaffinity="3"/>
    <body name="hand" gravcomp="1" pos="0 0 {height}">
      <joint name="lift" type="slide" axis="0 0 1" damping="20"/>
      <geom name="palm" type="box" size="0.03 0.006 0.003" pos="0 0 0.03" mass="0.2" contype="0" conaffinity="0"/>
      <body name="left" gravcomp="1" pos="-{half} 0 0">
        <joint name="left" type="slide" axis="1 0 0" damping="10"/>
        <geom name="left" type="box" size="0.003 {face} {face}" pos="-0.003 0 0" mass="0.02"/>
        <site name="left" xyaxes="0 1 0 0 0 1"/>
      </body>
      <body name="right" gravcomp="1" pos="{half} 0 0">
        <joint name="right" type="slide" axis="-1 0 0" damping="10"/>
        <geom name="right" type="box" size="0.003 {face} {face}" pos="0.003 0 0" mass="0.02"/>
        <site name="right" xyaxes="0 -1 0 0 0 1"/>
      </body>
    </body>
    <body name="object" pos="0 {offset} {height}"><freejoint name="object"/>{geoms}</body>
  </worldbody>
  <equality><joint joint1="left" joint2="right"/></equality>
  <actuator>
    <general name="grip" joint="left" gear="2" dyntype="filterexact" dynprm="{lag}"/>
    <position name="lift" joint="lift" kp="2000" kv="40"/>
  </actuator>
</mujoco>
"""


@dataclass(frozen=True)
class Task:
    """What is grasped, and what then pulls at it. All values are assumed."""

    object: str = "sphere"
    """One of `OBJECTS`."""
    mass: float = 0.03
    """Mass [kg]."""
    friction: float = 0.6
    """Coefficient of friction [1]."""
    offset: float = 0.0
    """Distance of the object from the middle of the fingertips, sideways [m]."""
    pull_start: float = 0.85
    """Time from which a growing weight pulls the object down [s]."""
    pull_rate: float = 1.0
    """Growth of the weight [N/s]."""
    pull_end: float = 1.2
    """Greatest weight [N]."""
    actuator_lag: float = 0.005
    """Time constant with which the grip force follows its command [s]."""


class Gripper:
    """The gripper and its object; forces and positions of the engine are the ground truth.

    Parameters
    ----------
    task : Task
        What is grasped.
    """

    def __init__(self, task: Task) -> None:
        self.task = task
        """What is grasped."""
        text = _MODEL.format(
            step=STEP, friction=task.friction, height=HALF_HEIGHTS[task.object], half=OPENING / 2, face=FACE,
            offset=task.offset, geoms=_GEOMS[task.object].format(mass=task.mass), lag=task.actuator_lag,
        )  # fmt: skip
        self.model = mujoco.MjModel.from_xml_string(text)
        """MuJoCo's model."""
        self.data = mujoco.MjData(self.model)
        """MuJoCo's state."""
        self.slips: list[float] = []
        """Times at which the lifted object truly began to slip [s]."""
        self.gross: list[float] = []
        """Time at which each of these slips reached GROSS_SPEED [s]; NaN for one that did not."""
        self._slipped = -math.inf  # last time of true slip
        self._object = self.model.body("object").id
        self._down = self.model.joint("object").dofadr[0] + 2
        self._lift = self.model.joint("lift").dofadr[0]
        mujoco.mj_forward(self.model, self.data)

    @property
    def time(self) -> float:
        """Time of the physics [s]."""
        return float(self.data.time)

    @property
    def height(self) -> float:
        """Height of the object over its place on the pedestal [m]."""
        return float(self.data.xpos[self._object, 2]) - HALF_HEIGHTS[self.task.object]

    @property
    def sunk(self) -> float:
        """Distance by which the object hangs below the middle of the fingertips [m]."""
        return float(self.data.body("hand").xpos[2] - self.data.xpos[self._object, 2])

    @property
    def slip_speed(self) -> float:
        """Vertical speed of the object against the fingertips [m/s], positive when it slips down."""
        return float(self.data.qvel[self._lift] - self.data.qvel[self._down])

    @property
    def pull(self) -> float:
        """Weight that pulls at the object, without its own [N]."""
        return float(min(max(self.time - self.task.pull_start, 0.0) * self.task.pull_rate, self.task.pull_end))

    @property
    def least_grip(self) -> float:
        """Least grip force that Coulomb's law allows for the present weight [N]."""
        return (self.pull + 9.81 * self.task.mass) / (2 * self.task.friction)

    @property
    def grip(self) -> float:
        """Grip force of the actuator, behind its lag [N]."""
        return float(self.data.act[0])

    def command(self, grip: float, lift: float) -> None:
        """Set the grip force [N] and the height of the hand [m]."""
        self.data.ctrl[:] = grip, lift

    def advance(self, time: float) -> None:
        """Step the physics to a time [s], at least."""
        while self.time < time - 1e-9:
            self.data.xfrc_applied[self._object, 2] = -self.pull
            mujoco.mj_step(self.model, self.data)
            if self.data.ctrl[1] >= LIFT and self.slip_speed > SLIP_SPEED:
                if self.time - self._slipped > REST:
                    self.slips.append(self.time)
                    self.gross.append(math.nan)
                self._slipped = self.time
                if self.slip_speed > GROSS_SPEED and math.isnan(self.gross[-1]):
                    self.gross[-1] = self.time

    def finger_gap(self) -> float:
        """Return the distance of the two faces [m]."""
        left, right = (self.data.site(name).xpos[0] for name in FINGERS)
        return float(np.abs(right - left))
