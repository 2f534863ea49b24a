# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Boards of the independent plant that follow other laws than `film`, of the same sizes.

A model that was made with one plant in view may have learnt its laws. Each of these boards changes one of them; what it
takes in its place is assumed. ``python -m independent.judge --law NAME`` judges them.
"""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from independent.film import Array, Board, low_pass, opening, play


class CreepOfTenSeconds(Board):
    """Creep comes in with one time constant."""

    creep_times: ClassVar[tuple[float, ...]] = (10.0, 10.0, 10.0)


class CreepOfTheCover(Board):
    """Creep is that of the cover: it comes in where the cover spreads the force to."""

    def _charge(self, force: Array, applied: Array, step: float) -> Array:
        charge = _without(self, creep=0.0)._charge(force, applied, step)
        distance = np.hypot(*(self.sensor.layout.positions[:, None] - self.sensor.layout.positions).T)
        spread = np.exp(-np.square(distance / (0.7 * self.sensor.layout.pitch_x)))
        wide = force @ (spread / spread.sum(axis=0))
        share = self.effects.creep / len(self.creep_times)
        for time in self.creep_times:
            charge += share * low_pass(wide, np.full(force.shape[1], time), step)
        return charge


class LoopsOfOneSize(Board):
    """Hysteresis is one play operator of 50 mN, with all that it leaves at no force."""

    def _charge(self, force: Array, applied: Array, step: float) -> Array:
        charge = _without(self, hysteresis=0.0)._charge(force, applied, step)
        size = np.array([0.05])
        return charge + play(force, size, np.array([self.effects.hysteresis / opening(size)]))


class ClosedLoops(Board):
    """Hysteresis leaves nothing: the way down is above the way up, by most at half of the force."""

    def _charge(self, force: Array, applied: Array, step: float) -> Array:
        charge = _without(self, hysteresis=0.0)._charge(force, applied, step)
        peak = np.zeros(force.shape[1])
        for index, each in enumerate(force):
            peak = np.where(each < 1e-4, 0.0, np.maximum(peak, each))
            part = np.divide(each, peak, out=np.ones_like(each), where=peak > 0.0)
            charge[index] += 4.0 * self.effects.hysteresis * part * (1.0 - part) * peak
        return charge


class BendingAboutThePlace(Board):
    """The chip bends more near the place that is pressed."""

    def _charge(self, force: Array, applied: Array, step: float) -> Array:
        charge = _without(self, bending=0.0)._charge(force, applied, step)
        place = self.sensor.layout.positions / np.abs(self.sensor.layout.positions).max(axis=0)
        total = force.sum(axis=1, keepdims=True)
        centre = np.divide(force @ place, total, out=np.zeros((len(force), 2)), where=total > 1e-3)
        return charge + self.effects.bending * applied[:, None] * (1.0 + 0.5 * centre @ place.T)


class SensorsInTwoStages(Board):
    """The temperature sensors lag behind by two equal stages."""

    def _readings(self, chip: Array, step: float, rng: np.random.Generator) -> NDArray[np.float32]:
        half = 0.5 * self.effects.sensor_lag
        behind = low_pass(chip[:, None], np.array([half]), step)[:, 0]
        return _without(self, sensor_lag=half)._readings(behind, step, rng)


class ConductingFilm(Board):
    """Half of the warmth of a taxel is its own, the rest that of its four neighbours."""

    def _thermal_contact(self, force: Array) -> Array:
        positions = self.sensor.layout.positions
        distance = np.hypot(*(positions[:, None] - positions).T) / self.sensor.layout.pitch_x
        conducted = 0.5 * np.eye(len(positions)) + 0.125 * (np.abs(distance - 1.0) < 0.1)
        shared: Array = super()._thermal_contact(force) @ (conducted / conducted.sum(axis=0))
        return shared


class RareTelegraphNoise(Board):
    """The levels of telegraph noise last for 1 to 20 s, in place of 0.05 to 1 s."""

    telegraph_dwells: ClassVar[tuple[float, float]] = (1.0, 20.0)


LAWS: Final[dict[str, type[Board]]] = {
    "film": Board,
    "creep_10s": CreepOfTenSeconds,
    "creep_cover": CreepOfTheCover,
    "loops_one_size": LoopsOfOneSize,
    "loops_closed": ClosedLoops,
    "bending_place": BendingAboutThePlace,
    "sensors_two_stages": SensorsInTwoStages,
    "conduction": ConductingFilm,
    "telegraph_rare": RareTelegraphNoise,
}
"""Boards by the names of their laws; `film` is that of `independent.film`."""


def _without(board: Board, **effects: float) -> Board:
    """Return a board of `film` with other sizes of some effects, and otherwise the same."""
    return Board(board.sensor, replace(board.effects, **effects), board.seed)
