"""What a taxel should read, told from the taxels around it.

Pressure that came through an elastic cover falls off like a Gaussian, whose values on a grid obey ``f00 = f01*f10/f11``
for every square of four neighbouring taxels, if its axes are those of the grid. The four squares around a taxel taken
together (mean of the logarithms, weighted by the least force in each) come near it for other contacts too.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from posfet_model.sensor.description import Layout

INTERPOLATION_UNCERTAINTY: Final = 0.2
"""Standard deviation of an estimate, as a share of it [1]: 0.11 on spheres of 1.5 to 6 mm radius all over a 5 x 5, the
rest for 5 % mismatch of the gains."""


class NeighbourInterpolation:
    """The squares of neighbours around each taxel of one array."""

    def __init__(self, layout: Layout) -> None:
        padded = np.full((layout.rows + 2, layout.cols + 2), layout.taxels, np.intp)
        padded[1:-1, 1:-1] = np.arange(layout.taxels).reshape(layout.rows, layout.cols)
        rows, cols = np.divmod(np.arange(layout.taxels), layout.cols)
        corners = [(down, right) for down in (0, 2) for right in (0, 2)]
        self._beside = np.stack([padded[rows + 1, cols + right] for _, right in corners], axis=1)
        self._above = np.stack([padded[rows + down, cols + 1] for down, _ in corners], axis=1)
        self._across = np.stack([padded[rows + down, cols + right] for down, right in corners], axis=1)
        self._inside = self._across < layout.taxels
        self._all = np.concatenate([self._beside, self._above, self._across], axis=1)
        self._values = np.zeros(layout.taxels + 1)

    def interpolate(
        self, force: NDArray[np.float64], unknown: NDArray[np.bool_], wanted: NDArray[np.intp], floor: float
    ) -> NDArray[np.float64]:
        """Return what the `wanted` taxels should read [N], shape [wanted], from forces [N], shape [rows * cols].

        Forces below `floor` [N] count as that much; where nothing beside a taxel is above it the answer is 0. NaN where
        every square of a taxel has an `unknown` one, or leaves the array.
        """
        beside, above, across = self._squares(force, unknown, wanted, floor)
        with np.errstate(invalid="ignore", divide="ignore"):
            logarithm = np.log(beside * above / across)
            tells = np.isfinite(logarithm)
            weight = np.where(tells, np.minimum(np.minimum(beside, above), across), 0.0)
            weighted = np.add.reduce(weight * np.where(tells, logarithm, 0.0), axis=1)
            estimate: NDArray[np.float64] = np.exp(weighted / np.add.reduce(weight, axis=1))
        loudest = np.fmax.reduce(np.maximum(beside, above), axis=1)  # of the squares that are known
        estimate[loudest <= floor] = 0.0
        return estimate

    def lower_bound(
        self, force: NDArray[np.float64], unknown: NDArray[np.bool_], wanted: NDArray[np.intp], floor: float
    ) -> NDArray[np.float64]:
        """Return the least that the `wanted` taxels must read [N] by any of their squares; 0 where one does not tell.

        A square tells when all of its three taxels are known and above `floor` [N]. All squares that lie on the array
        have to, so that a taxel in a gap between two contacts is not expected to read anything.
        """
        beside, above, across = self._squares(force, unknown, wanted, 0.0)
        inside = self._inside.take(wanted, axis=0)
        tells = np.minimum(np.minimum(beside, above), across) >= floor  # False for NaN
        sure = (tells | ~inside).all(axis=1) & inside.any(axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            values = np.where(tells, beside * above / across, np.inf).min(axis=1)
        return np.where(sure, values, 0.0)

    def _squares(
        self, force: NDArray[np.float64], unknown: NDArray[np.bool_], wanted: NDArray[np.intp], floor: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return the forces beside, above and across in the squares of the `wanted` taxels, shape [wanted, 4]."""
        values = self._values
        np.maximum(force, floor, out=values[:-1])
        values[:-1][unknown] = np.nan
        values[-1] = np.nan
        beside, above, across = (way.take(wanted, axis=0) for way in (self._beside, self._above, self._across))
        return values.take(beside), values.take(above), values.take(across)

    def max_neighbour(self, level: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the greatest value among the neighbours of each taxel, shape [rows * cols]; -inf without any."""
        self._values[:-1] = level
        self._values[-1] = -np.inf
        greatest: NDArray[np.float64] = self._values.take(self._all).max(axis=1)
        return greatest
