# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Contacts of a physics engine as loads of the simulated board.

The engine says where an object touches, with which normal force, and how that is distributed (`EngineContact`). The
elastomer skin spreads it onto the taxels as in a scene. Tangential force and sliding are kept as ground truth: the
taxels do not measure them.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from threading import RLock
from typing import Final, NamedTuple

import numpy as np

from posfet_model._lib.types import Array
from posfet_model._lib.validation import real_number
from posfet_model.sensor.description import Sensor
from posfet_sim.contact.indenters import FLAT
from posfet_sim.contact.taxel_forces import Cells
from posfet_sim.loads import ObjectsState, Patch
from posfet_sim.physics.face_pressure import Pressure

KEPT: Final = 0.1
"""Time for which past states are kept [s]."""
SUM_ERROR: Final = 1e-5
"""Maximum relative error of a force that the cells of the array and what is beyond them receive together [1]: that of
the interpolated tables of `posfet_sim.contact.cell_table`."""
TIME_ERROR: Final = 1e-9
"""Time by which the newest state may be earlier than a scan [s]: rounding, as an engine adds up its steps."""
MAX_FORCE: Final = 1000.0
"""Maximum normal force of a contact [N]."""


@dataclass(frozen=True)
class EngineContact:
    """One contact of an object with the surface of the array, in the frame of the array."""

    object: str
    """Name of the object."""
    position: tuple[float, float]
    """Reference point of the pressure, x and y [m]: the middle of a `FacePressure`, the centre of a sphere."""
    force: float
    """Normal force [N], positive when pushed into the sensor; at least 0."""
    pressure: Pressure
    """Distribution of the force: `FacePressure`, or a shape such as `posfet_sim.contact.indenters.Sphere`."""
    angle: float = 0.0
    """Rotation of the pressure about the outward normal [rad]."""
    tangential_force: tuple[float, float] = (0.0, 0.0)
    """Tangential force on the sensor, x and y [N]."""
    sliding: tuple[float, float] = (0.0, 0.0)
    """Velocity of the object's surface against that of the sensor, x and y [m/s]."""


class ForceBalance(NamedTuple):
    """Where the normal force of the engine goes."""

    engine: float
    """Sum of the normal forces of the contacts [N]."""
    taxels: float
    """Force on all taxels [N]."""

    @property
    def outside(self) -> float:
        """Force beyond the array [N]."""
        return self.engine - self.taxels


class _State(NamedTuple):
    time: float
    force: Array
    contacts: tuple[EngineContact, ...]
    temperature: float


class EngineLoads:
    """Loads of the simulated board from any physics engine; see `posfet_sim.loads.Loads`.

    Either the engine leads and calls `push` before each scan is read; or the board leads: `advance` is called with the
    time that a scan needs, steps the engine at least to that time, and calls `push`. Between two states the force on
    each taxel is linear over time. All methods are thread-safe.

    Parameters
    ----------
    sensor : Sensor
        Sensor description; a bent chip is not supported.
    advance : callable, optional
        Called with a time [s] for which there is no state yet.
    name : str
        Name of the loads.
    temperature : float
        Chip temperature [degC] until `push` states another.
    spread : float, optional
        Standard deviation of the spread by the elastomer skin [m]; default: that of the sensor.

    Raises
    ------
    ValueError
        The chip is bent, or temperature or spread is out of range.

    Examples
    --------
    A ball of 5 mm radius that an engine of one line, a spring, presses onto the middle taxel:

    >>> from posfet_model.sensor.description import load_sensor
    >>> from posfet_sim.contact.indenters import Sphere
    >>> ball, sensor = Sphere(radius=5e-3, effective_modulus=2e6), load_sensor()
    >>> loads = EngineLoads(sensor)
    >>> for step in range(101):
    ...     spring_force = 400.0 * 1e-5 * step
    ...     loads.push(1e-3 * step, [EngineContact("ball", (0.0, 0.0), spring_force, ball)])
    >>> [patch] = loads.forces([0.05])
    >>> round(float(patch.force.sum()), 4), round(float(patch.force.max()), 4)
    (0.2, 0.1056)
    """

    live: Final = True

    def __init__(
        self,
        sensor: Sensor,
        advance: Callable[[float], None] | None = None,
        *,
        name: str = "physics engine",
        temperature: float = 25.0,
        spread: float | None = None,
    ) -> None:
        if math.isfinite(sensor.layout.bend_radius):
            raise ValueError("sensor must be flat: a bent chip is not supported")
        temperature = real_number("temperature", temperature, -100, 200)
        self.name = name
        """Name of the loads."""
        self._layout = sensor.layout
        self._cells = Cells(sensor.layout, sensor.device.contact_spread if spread is None else spread)
        self._whole = slice(0, sensor.layout.rows), slice(0, sensor.layout.cols)
        self._advance = advance
        self._lock = RLock()
        none = np.zeros((sensor.layout.rows, sensor.layout.cols))
        self._states = [_State(0.0, none, (), temperature)]

    @property
    def time(self) -> float:
        """Time of the newest state [s]."""
        return self._states[-1].time

    @property
    def contacts(self) -> tuple[EngineContact, ...]:
        """Contacts of the newest state."""
        return self._states[-1].contacts

    @property
    def balance(self) -> ForceBalance:
        """Balance of the normal forces of the newest state."""
        state = self._states[-1]
        return ForceBalance(math.fsum(each.force for each in state.contacts), float(state.force.sum()))

    def push(self, time: float, contacts: Sequence[EngineContact], temperature: float | None = None) -> None:
        """Add the state of the engine at a time.

        Parameters
        ----------
        time : float
            Time since the start of the board [s], at least that of the newest state, which it replaces if equal.
        contacts : sequence of EngineContact
            All contacts with the surface.
        temperature : float, optional
            Chip temperature [degC]; default: that of the newest state.

        Raises
        ------
        ValueError
            Time, temperature, a force or a position is out of range.
        """
        with self._lock:
            newest = self._states[-1]
            time = real_number("time", time, newest.time, math.inf)
            chip = newest.temperature if temperature is None else real_number("temperature", temperature, -100, 200)
            state = _State(time, self._pressed(contacts), tuple(contacts), chip)
            if time == newest.time:
                self._states[-1] = state
            else:
                self._states.append(state)

    def forces(self, times: Sequence[float]) -> list[Patch]:
        """Return the forces on the array at these times [s]; raises ValueError where the engine has not been yet."""
        with self._lock:
            force = np.stack([self._at(time)[0] for time in times])
            self._forget(times[0] - KEPT)
        return [Patch(*self._whole, force)] if force.any() else []

    def temperatures(self, times: Sequence[float]) -> list[float]:
        """Return the chip temperature [degC] at each of these times [s]."""
        with self._lock:
            return [self._at(time)[1] for time in times]

    def constant_until(self, time: float) -> float:
        """Return the time itself: what the engine does next is not known."""
        return time

    def objects(self, time: float) -> ObjectsState:
        """Return the contacts of the newest state up to a time [s] as ground truth; objects have no height."""
        with self._lock:
            index = bisect_right(self._states, time + TIME_ERROR, key=lambda state: state.time) - 1
            state = self._states[max(index, 0)]
        contacts = [each for each in state.contacts if each.force > 0]
        count = len(contacts)
        half = np.array([each.angle / 2 for each in contacts])
        turns = np.zeros((count, 4))
        turns[:, 2], turns[:, 3] = np.sin(half), np.cos(half)
        centres = np.reshape([each.position for each in contacts], (-1, 2))
        return ObjectsState(
            names=tuple(each.object for each in contacts),
            positions=np.concatenate([centres, np.zeros((count, 1))], axis=1),
            orientations=turns,
            contact_objects=np.arange(count),
            contact_centres=centres,
            contact_normals=np.tile([0.0, 0.0, 1.0], (count, 1)),
            contact_forces=np.array([each.force for each in contacts], np.float64),
        )

    def _pressed(self, contacts: Sequence[EngineContact]) -> Array:
        """Return the force of contacts on each taxel [N], shape [rows, cols]."""
        whole = np.zeros((self._layout.rows, self._layout.cols))
        for each in contacts:
            force = real_number("force", each.force, 0, MAX_FORCE)
            x, y, angle = (
                real_number("position and angle", value, -1e3, 1e3) for value in (*each.position, each.angle)
            )
            if force == 0:
                continue
            footprints = each.pressure.footprints(force, self._cells.spread, FLAT)
            patch = self._cells.press([footprints], *(np.array([value]) for value in (x, y, angle, force)))
            if patch is None:
                continue
            received = float(patch.force.sum())
            if not -SUM_ERROR * force <= received <= (1 + SUM_ERROR) * force:
                raise ValueError(f"pressure must distribute the whole force {force} N, got {received} N on the taxels")
            whole[patch.rows, patch.cols] += patch.force[0]
        whole.flags.writeable = False
        return whole

    def _at(self, time: float) -> tuple[Array, float]:
        """Return force [N] and temperature [degC] at a time [s]."""
        if time > self.time + TIME_ERROR and self._advance is not None:
            self._advance(time)
        if time > self.time + TIME_ERROR:
            raise ValueError(f"time must be at most {self.time}, of the engine's newest state, got {time}: push first")
        states, time = self._states, min(time, self.time)
        after = bisect_left(states, time, key=lambda state: state.time)
        if after == 0 or states[after].time == time:
            return states[after].force, states[after].temperature
        before, end = states[after - 1], states[after]
        share = (time - before.time) / (end.time - before.time)
        chip = before.temperature + share * (end.temperature - before.temperature)
        return before.force + share * (end.force - before.force), chip

    def _forget(self, time: float) -> None:
        """Forget the states that no time from here on [s] needs."""
        needed = bisect_left(self._states, time, key=lambda state: state.time) - 1
        if needed > 0:
            del self._states[:needed]
