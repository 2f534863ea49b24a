# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The environment `posfet/Grasp-v0`: hold an object of unknown weight and friction with the least force; gymnasium."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final, TypeAlias

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from posfet_model.contacts.tracker import ContactState
from posfet_model.reconstruction.reconstructor import Reconstruction
from posfet_model.sensor.description import DEFAULT_SENSOR, Sensor, load_sensor
from posfet_sim.contact.indenters import Sphere
from posfet_sim.defaults import DEFAULT, SEED_MAX
from posfet_sim.device.error_model import load_error_model
from posfet_sim.grasp.fingertip import Fingertip
from posfet_sim.grasp.mechanics import FINGERS, Control, GraspedObject, GraspMechanics, Gripper
from posfet_sim.grasp.picture import picture
from posfet_sim.physics.engine_loads import EngineContact

ENVIRONMENT: Final = "posfet/Grasp-v0"
"""Name of the environment."""
STEP: Final = 0.01
"""Time of a step [s]."""
DURATION: Final = 3.0
"""Time of an episode [s]."""
SETTLING: Final = 0.25
"""Time without touch before an episode [s], in which the model learns the offsets."""
DROP_DISTANCE: Final = 3e-3
"""Slip at which the object is lost [m]."""
FORCE_COST: Final = 0.5
"""Cost of the largest grip force for a step [1]."""
SLIP_COST: Final = 5.0
"""Cost of a slip of 1 mm [1]."""
DROP_COST: Final = 100.0
"""Cost of a lost object [1]."""
RANGES: Final[Mapping[str, tuple[float, float]]] = {
    "mass": (0.05, 0.2),
    "static_friction": (0.5, 1.0),
    "gap": (0.5e-3, 1.5e-3),
    "stiffness": (1500.0, 3000.0),
    "lift_time": (0.8, 1.0),
    "growth": (0.0, 0.4),
    "growth_time": (1.6, 2.2),
}
"""Ranges of the random properties of the object, uniform, as in `GraspedObject`."""
KINETIC_SHARE: Final = 0.85
"""Kinetic over static friction [1], assumed."""
BALL: Final = Sphere(radius=6e-3, effective_modulus=1e6)
"""Shape of the object at each fingertip."""
CENTRE: Final = (1.0e-3, 1.5e-3)
"""Largest x, and y, of the contact at the start from the middle of the array [m]."""

Observation: TypeAlias = "dict[str, Any]"
"""Arrays by name."""


class GraspEnv(gymnasium.Env[Observation, NDArray[np.float32]]):
    """Two simulated POSFET fingertips hold an object whose weight and friction are random and not observed.

    The object stands on a support, is lifted after about 1 s, and later becomes heavier. Where the friction does not
    carry its weight it slips down over the fingertips; at 3 mm it is lost. A step takes 10 ms, an episode 3 s. Friction
    is Coulomb's (`GraspMechanics`); each scan of the boards, 1000 per second, goes through the sensor error model and
    the model of the stack.

    **Action**, Box(-1, 1, (1,)): rate at which the grip closes (positive) or opens, relative to the largest one: of the
    commanded grip force, 20 N/s, or with ``control="width"`` of the position of each jaw, 20 mm/s.

    **Observation**, a dict, in SI units, all 0 where unknown:

    - ``force`` (2, rows, cols): force on each taxel of each fingertip [N]
    - ``contact`` (2, 5): of the strongest contact of each fingertip its force [N], x and y [m], velocity along y [m/s],
      and 1 if it slips, else 0; 0 without contact
    - ``valid`` (2,): 1 if the forces are fit for control
    - ``command`` (1,): commanded grip force [N], or how far each jaw has closed [m]
    - ``time`` (1,): since the start [s]

    **Reward** of a step: 1 if the object is lifted and did not slip, minus ``0.5*N/4 N`` for the grip force N, minus 5
    for each mm of slip, minus 100 if it is lost, which terminates the episode. ``info`` has the ground truth: grip
    force, slip, load, the properties of the object, and the least grip force that holds it.

    Parameters
    ----------
    control : str, default "force"
        What the gripper controls: force or width.
    sensor : str or Sensor, default "posfet_5x5"
        Name or file of the sensor of both fingertips, or its description.
    imperfections : str, default "default"
        Sensor error model: none, default, moderate, hard, or a YAML file.
    render_mode : str, optional
        "rgb_array": `render` returns both force maps as a picture.

    Raises
    ------
    ConfigError
        Sensor or error model cannot be used; one line.
    ValueError
        Control or render mode is unknown.

    Examples
    --------
    >>> env = GraspEnv()
    >>> observation, info = env.reset(seed=1, options={"mass": 0.1})
    >>> observation["force"].shape, info["mass"]
    ((2, 5, 5), 0.1)
    >>> observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
    """

    metadata: dict[str, Any] = {  # noqa: RUF012  # as in gymnasium.Env
        "render_modes": ["rgb_array"],
        "render_fps": round(1 / STEP),
    }

    def __init__(
        self,
        control: str = "force",
        sensor: str | Sensor = DEFAULT_SENSOR,
        imperfections: str = DEFAULT,
        render_mode: str | None = None,
    ) -> None:
        if control not in {each.value for each in Control}:
            raise ValueError(f"control must be force or width, got {control!r}")
        if render_mode not in {None, *self.metadata["render_modes"]}:
            raise ValueError(f"render_mode must be None or rgb_array, got {render_mode!r}")
        self.render_mode = render_mode
        self.sensor = sensor if isinstance(sensor, Sensor) else load_sensor(sensor)
        self._error_model = load_error_model(imperfections)
        self._gripper = Gripper(Control(control))
        layout = self.sensor.layout
        self._scan_period = 1.0 / self.sensor.can.scan_rate
        self._scans = max(round(STEP / self._scan_period), 1)
        self._fingers: tuple[Fingertip, ...] = ()
        self._results: list[Reconstruction] = []
        self._force = np.zeros((FINGERS, layout.rows, layout.cols), np.float32)
        limit = 2.0 * self._gripper.force_max
        command = limit if control == "force" else RANGES["gap"][1] + limit / RANGES["stiffness"][0]
        reach = np.array([limit, layout.cols * layout.pitch_x, layout.rows * layout.pitch_y, 1.0, 1.0], np.float32)
        lowest = np.array([0.0, *-reach[1:4], 0.0], np.float32)
        self.action_space = spaces.Box(-1.0, 1.0, (1,), np.float32)
        self._boxes = {
            "force": spaces.Box(-limit, limit, self._force.shape, np.float32),
            "contact": spaces.Box(np.tile(lowest, (FINGERS, 1)), np.tile(reach, (FINGERS, 1)), dtype=np.float32),
        }
        self.observation_space: spaces.Space[Observation] = spaces.Dict(
            {
                **self._boxes,
                "valid": spaces.MultiBinary(FINGERS),
                "command": spaces.Box(0.0, command, (1,), np.float32),
                "time": spaces.Box(0.0, DURATION + STEP, (1,), np.float32),
            }
        )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode with another object and other boards.

        Parameters
        ----------
        seed : int, optional
            Seed; the same one gives the same episode for the same actions.
        options : dict, optional
            Properties of the object that are not random, by their names in `GraspedObject`.

        Returns
        -------
        tuple of dict and dict
            Observation and info.

        Raises
        ------
        ValueError
            An option is unknown.
        """
        super().reset(seed=seed)
        drawn = {name: float(self.np_random.uniform(*limits)) for name, limits in RANGES.items()}
        given = options or {}
        for name in given.keys() - {*drawn, "kinetic_friction"}:
            raise ValueError(f"options: {name} must be one of {', '.join([*drawn, 'kinetic_friction'])}")
        values = {"kinetic_friction": KINETIC_SHARE * given.get("static_friction", drawn["static_friction"])}
        self._mechanics = GraspMechanics(GraspedObject(**{**values, **drawn, **given}), self._gripper)
        self._centre = (
            float(self.np_random.uniform(-CENTRE[0], CENTRE[0])),
            float(self.np_random.uniform(0.0, CENTRE[1])),
        )
        seeds = self.np_random.integers(0, SEED_MAX, FINGERS)
        self._fingers = tuple(Fingertip(self.sensor, int(each), self._error_model) for each in seeds)
        for _ in range(round(SETTLING / self._scan_period)):
            self._results = [finger.scan(()) for finger in self._fingers]
        return self._observation(), self._info()

    def step(self, action: NDArray[np.float32]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Let 10 ms pass.

        Parameters
        ----------
        action : ndarray of float32, shape [1]
            Rate at which the grip closes, in [-1, 1].

        Returns
        -------
        tuple
            Observation, reward, whether the object is lost, whether the time is over, and info.
        """
        if not self._fingers:
            raise gymnasium.error.ResetNeeded("call reset before step")
        mechanics, before = self._mechanics, self._mechanics.slip
        mechanics.move(float(np.clip(action[0], -1.0, 1.0)), self._scans * self._scan_period)
        for _ in range(self._scans):
            mechanics.step(self._scan_period)
            contacts = self._contacts()
            self._results = [finger.scan(contacts) for finger in self._fingers]
        slipped = mechanics.slip - before
        lost = mechanics.slip >= DROP_DISTANCE
        reward = float(mechanics.lifted and slipped == 0.0) - FORCE_COST * mechanics.force / self._gripper.force_max
        reward -= SLIP_COST * slipped * 1e3 + DROP_COST * lost
        return self._observation(), reward, lost, mechanics.time >= DURATION - 0.5 * STEP, self._info()

    def render(self) -> NDArray[np.uint8] | None:
        """Return both force maps as a picture, uint8, shape [height, width, 3]; None without a render mode."""
        return picture(self._force, self._gripper.force_max) if self.render_mode == "rgb_array" else None

    def _contacts(self) -> list[EngineContact]:
        mechanics = self._mechanics
        if mechanics.force < 1e-6 or mechanics.slip >= DROP_DISTANCE:
            return []
        x, y = self._centre
        return [
            EngineContact(
                "object",
                (x, y - mechanics.slip),
                mechanics.normal_force,
                BALL,
                tangential_force=(0.0, -mechanics.load / FINGERS),
                sliding=(0.0, -mechanics.velocity),
            )
        ]

    def _observation(self) -> Observation:
        forces = [finger.force() for finger in self._fingers]
        self._force = np.nan_to_num(np.stack(forces))
        observation = {
            "force": self._force.copy(),
            "contact": np.stack([_strongest(result) for result in self._results]),
            "valid": np.array([_is_known(result) for result in self._results], np.int8),
            "command": np.array([self._mechanics.command], np.float32),
            "time": np.array([self._mechanics.time], np.float32),
        }
        for name, space in self._boxes.items():
            np.clip(observation[name], space.low, space.high, out=observation[name])
        return observation

    def _info(self) -> dict[str, Any]:
        mechanics, grasped = self._mechanics, self._mechanics.grasped
        return {
            "grip_force": mechanics.force,
            "slip": mechanics.slip,
            "load": mechanics.load,
            "least_grip_force": grasped.least_grip_force,
            "mass": grasped.mass,
            "static_friction": grasped.static_friction,
            "lift_time": grasped.lift_time,
        }


def _is_known(result: Reconstruction) -> bool:
    """Return whether forces are fit for control, and that of each contact is known."""
    return result.valid and not any(math.isnan(each.region.force) for each in result.contacts)


def _strongest(result: Reconstruction) -> NDArray[np.float32]:
    """Return force, x, y, velocity along y, and slip of the strongest contact; 0 without one."""
    row = np.zeros(5, np.float32)
    held = [each for each in result.contacts if each.state is not ContactState.RELEASED and each.region.force > 0.0]
    if held:
        contact = max(held, key=lambda each: each.region.force)
        speed = contact.velocity[1]
        motion = result.motions.get(contact.id)
        slips = motion is not None and motion.slipping
        row[:] = (contact.region.force, *contact.region.centre_of_pressure, 0.0 if math.isnan(speed) else speed, slips)
    return row
