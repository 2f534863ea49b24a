# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""One grasp in lock-step: physics, two boards, their bus, decoder and model, and the controller, each 1 ms in turn.

No clock of the computer is read: the same task and seed give the same grasp on every run of a machine.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from examples.grasp_mujoco.controller import GripController, GripSettings
from examples.grasp_mujoco.fingertip import Fingertip
from examples.grasp_mujoco.gripper import FINGERS, LIFT, OBJECTS, REST, Gripper, Task
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_sim.device.error_model import ErrorModel

LAST = 0.05
"""Time before the end of a grasp in which the reaction to a slip may be missed [s]."""
DROPPED = 0.006
"""Distance by which an object that was dropped has left the fingertips downwards [m]."""


@dataclass
class Trial:
    """What happened in a grasp: one row a scan."""

    task: Task
    feedback: bool
    rows: list[tuple[float, ...]] = field(default_factory=list)
    """Time [s], grip command [N], grip force [N], weight [N], least grip [N], height [m], slip speed [m/s], and the
    forces on the left and the right fingertip as estimated [N]."""
    raised: list[float] = field(default_factory=list)
    """Times at which the controller raised the grip force [s]."""
    slips: list[float] = field(default_factory=list)
    """Times at which the object truly began to slip [s]."""
    gross: list[float] = field(default_factory=list)
    """Time at which each of them reached the second speed [s]; NaN for one that did not."""
    dropped: bool = False
    """Whether the object fell."""

    def reactions(self) -> list[tuple[float, float]]:
        """Return time and reaction time of each slip [s]; NaN for one without a reaction before the next slip.

        Slips that began within `LAST` of the end are left out.
        """
        found = []
        over = self.rows[-1][0] - LAST if self.rows else np.inf
        for index, slip in enumerate(self.slips):
            if slip > over:
                break
            end = self.slips[index + 1] if index + 1 < len(self.slips) else np.inf
            after = [time - slip for time in self.raised if slip - REST <= time < end - REST]
            found.append((slip, min(after) if after else np.nan))
        return found

    def columns(self) -> np.ndarray:
        """Return the rows as an array, shape [9, scans]."""
        return np.array(self.rows).T


def seeded_task(seed: int, kind: str | None = None) -> Task:
    """Return a task drawn from a seed; of this object, or of each in turn."""
    random = np.random.default_rng(seed)
    return Task(
        object=kind or OBJECTS[seed % len(OBJECTS)],
        mass=random.uniform(0.02, 0.04),
        friction=random.uniform(0.5, 0.8),
        offset=random.uniform(-0.5e-3, 0.5e-3),
        pull_rate=random.uniform(0.6, 1.6),
    )


def grasp(
    task: Task,
    seed: int = 0,
    feedback: bool = True,
    duration: float = 1.9,
    sensor: Sensor | None = None,
    error_model: ErrorModel | None = None,
    settings: GripSettings | None = None,
    watch: Callable[[Gripper, tuple[Fingertip, Fingertip], GripController], None] | None = None,
) -> Trial:
    """Run one grasp until its end, or until the object is dropped.

    Parameters
    ----------
    task : Task
        What is grasped.
    seed : int
        Seed of both boards.
    feedback : bool
        Whether the controller reacts to slip.
    duration : float
        Duration [s].
    sensor : Sensor, optional
        Sensor description; default: the shipped one.
    error_model : ErrorModel, optional
        Non-idealities of the boards; default: `ErrorModel.default()`.
    settings : GripSettings, optional
        Settings of the controller.
    watch : callable, optional
        Called after each scan.

    Returns
    -------
    Trial
        What happened.
    """
    sensor = sensor or load_sensor()
    model = error_model or ErrorModel.default()
    gripper, controller = Gripper(task), GripController(settings, feedback)
    left, right = (Fingertip(gripper, name, sensor, 2 * seed + side, model) for side, name in enumerate(FINGERS))
    trial = Trial(task, feedback, raised=controller.raised, slips=gripper.slips, gross=gripper.gross)
    for index in range(round(duration * sensor.can.scan_rate)):
        time = index / sensor.can.scan_rate
        gripper.advance(time)
        touches = left.scan(), right.scan()
        grip = controller.update(time, touches)
        gripper.command(grip, controller.lift)
        forces = touches[0].force, touches[1].force
        weight = gripper.pull + 9.81 * task.mass
        trial.rows.append(
            (time, grip, gripper.grip, weight, gripper.least_grip, gripper.height, gripper.slip_speed, *forces)
        )
        if watch:
            watch(gripper, (left, right), controller)
        if controller.lift >= LIFT and gripper.sunk > DROPPED:
            trial.dropped = True
            break
    return trial
