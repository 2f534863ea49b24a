# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Reference of the interpolation from neighbours, in NumPy, for that of posfet_model/sensor/neighbour_estimate.py."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from posfet_model._lib.types import Array, Mask
from posfet_model.sensor.description import Layout
from posfet_model.sensor.grid import CORNER_NEIGHBOURS, neighbour_table
from posfet_model.sensor.neighbour_estimate import INTERPOLATION_UNCERTAINTY

TWIST_FORCE = 10.0
"""Smallest force of a square, over the floor, from which it shows the twist more than that there is none [1]."""


class NeighbourInterpolation:
    """Interpolates forces from the 2 x 2 squares around each taxel of one array.

    Parameters
    ----------
    layout : Layout
        The array.
    """

    def __init__(self, layout: Layout) -> None:
        self._horizontal = neighbour_table(layout, [(0, right) for _, right in CORNER_NEIGHBOURS])
        self._vertical = neighbour_table(layout, [(down, 0) for down, _ in CORNER_NEIGHBOURS])
        self._diagonal = neighbour_table(layout, CORNER_NEIGHBOURS)
        self._turn = np.array([np.sign(down * right) for down, right in CORNER_NEIGHBOURS])
        self._inside = self._diagonal < layout.taxels
        self._shape = layout.rows, layout.cols
        self._all = np.concatenate([self._horizontal, self._vertical, self._diagonal], axis=1)
        self._values = np.zeros(layout.taxels + 1)

    def interpolate(
        self, force: Array, unknown: Mask, wanted: NDArray[np.intp], floor: float, most_x: float, most_y: float
    ) -> tuple[Array, Array]:
        """Return the forces [N] of the `wanted` taxels as their neighbours predict them, and their deviations [N].

        Parameters
        ----------
        force : ndarray
            Force on each taxel [N], shape [rows * cols].
        unknown : ndarray
            Mask of the taxels whose force is not to be used, shape [rows * cols].
        wanted : ndarray
            Indices of the taxels to interpolate, shape [wanted].
        floor : float
            Smaller forces count as this one [N].
        most_x, most_y : float
            Greatest force over that of a neighbour along a row, and along a column [1].

        Returns
        -------
        force : ndarray
            Forces [N], shape [wanted]. 0 where no known neighbour exceeds `floor`. NaN where every square of a taxel
            contains an `unknown` one or leaves the array.
        deviation : ndarray
            Standard uncertainty of each [N], shape [wanted].
        """
        horizontal, vertical, diagonal = self._squares(force, unknown, wanted, floor)
        with np.errstate(invalid="ignore", divide="ignore"):
            twist = np.array([self._twist(force, unknown, int(taxel), floor) for taxel in wanted])
            logarithm = np.log(horizontal * vertical / diagonal) + self._turn * twist[:, None]
            informative = np.isfinite(logarithm)
            weight = np.where(informative, np.minimum(np.minimum(horizontal, vertical), diagonal), 0.0)
            weighted = np.add.reduce(weight * np.where(informative, logarithm, 0.0), axis=1)
            total = np.add.reduce(weight, axis=1)
            estimate: Array = np.exp(weighted / total)
            squares = np.add.reduce(weight * np.where(informative, logarithm, 0.0) ** 2, axis=1)
            disagreement = np.maximum(squares / total - (weighted / total) ** 2, 0.0)
            errors = (weight / horizontal) ** 2 + (weight / vertical) ** 2 + (weight / diagonal) ** 2
            variance = np.add.reduce(np.where(informative, errors, 0.0), axis=1)
            variance *= (floor / total) ** 2
            most = np.fmax.reduce(np.fmax(most_x * horizontal, most_y * vertical), axis=1)
        relative = np.sqrt(INTERPOLATION_UNCERTAINTY**2 + disagreement + variance)
        limited = estimate > most
        estimate[limited], relative[limited] = most[limited], 1.0
        largest = np.fmax.reduce(np.maximum(horizontal, vertical), axis=1)  # of the squares that are known
        estimate[largest <= floor] = relative[largest <= floor] = 0.0
        return estimate, estimate * relative

    def _twist(self, force: Array, unknown: Mask, taxel: int, floor: float) -> float:
        """Return the twist of the logarithm of the forces in the squares next to those of a taxel."""
        values = np.where(unknown, np.nan, np.maximum(force, floor)).reshape(self._shape)
        row, col = divmod(taxel, self._shape[1])
        corners = values[:-1, :-1], values[:-1, 1:], values[1:, :-1], values[1:, 1:]
        twist = np.log(corners[0] * corners[3] / (corners[1] * corners[2]))
        weight = np.minimum.reduce(corners) ** 2
        top, left = np.indices(twist.shape)
        near = (abs(top + 0.5 - row) < 2.0) & (abs(left + 0.5 - col) < 2.0)
        own = (abs(top + 0.5 - row) < 1.0) & (abs(left + 0.5 - col) < 1.0)
        used = near & ~own & np.isfinite(twist) & (weight > floor**2)
        total = float(np.sum(weight[used])) + (TWIST_FORCE * floor) ** 2
        return float(np.sum(weight[used] * twist[used])) / total if total > 0.0 else 0.0

    def lower_bound(self, force: Array, unknown: Mask, wanted: NDArray[np.intp], floor: Array | float) -> Array:
        """Return the smallest force [N] that any square of each `wanted` taxel predicts.

        A square is informative when its other three taxels are known and at least `floor`. All squares that lie on the
        array have to be informative, so that a taxel in a gap between two contacts is not expected to show a force.

        Parameters
        ----------
        force : ndarray
            Force on each taxel [N], shape [rows * cols].
        unknown : ndarray
            Mask of the taxels whose force is not to be used, shape [rows * cols].
        wanted : ndarray
            Indices of the taxels to bound, shape [wanted].
        floor : ndarray or float
            Force from which each taxel is informative [N].

        Returns
        -------
        ndarray
            Forces [N], shape [wanted]; 0 where a square is not informative.
        """
        horizontal, vertical, diagonal = self._squares(force, unknown, wanted, 0.0)
        inside = self._inside.take(wanted, axis=0)
        least = np.append(np.broadcast_to(floor, len(force)), 0.0)
        informative = np.ones_like(inside)
        for values, table in (
            (horizontal, self._horizontal), (vertical, self._vertical), (diagonal, self._diagonal)
        ):  # fmt: skip
            informative &= values >= least.take(table.take(wanted, axis=0))  # False for NaN
        bounded = (informative | ~inside).all(axis=1) & inside.any(axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            forces = np.where(informative, horizontal * vertical / diagonal, np.inf).min(axis=1)
        return np.where(bounded, forces, 0.0)

    def _squares(
        self, force: Array, unknown: Mask, wanted: NDArray[np.intp], floor: float
    ) -> tuple[Array, Array, Array]:
        """Return the horizontal, vertical and diagonal neighbours' forces in each square, shape [wanted, 4]."""
        values = self._values
        np.maximum(force, floor, out=values[:-1])
        values[:-1][unknown] = np.nan
        values[-1] = np.nan
        horizontal, vertical, diagonal = (
            values.take(table.take(wanted, axis=0)) for table in (self._horizontal, self._vertical, self._diagonal)
        )
        return horizontal, vertical, diagonal

    def max_neighbour(self, level: Array) -> Array:
        """Return the largest value among the eight neighbours of each taxel.

        Parameters
        ----------
        level : ndarray
            Value of each taxel, in any unit, shape [rows * cols].

        Returns
        -------
        ndarray
            Largest value, shape [rows * cols]; -inf where a taxel has no neighbour.
        """
        self._values[:-1] = level
        self._values[-1] = -np.inf
        greatest: Array = self._values.take(self._all).max(axis=1)
        return greatest
