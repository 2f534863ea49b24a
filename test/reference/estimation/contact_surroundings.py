# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""What the taxels beside a contact feel of it: the elastomer skin spreads every force."""

from __future__ import annotations

from typing import Final

import numpy as np

from posfet_model._lib.types import Array, Mask
from posfet_model.sensor.description import Layout
from posfet_model.sensor.grid import CORNER_NEIGHBOURS, EDGE_NEIGHBOURS, dilate, neighbour_table

DIAGONAL: Final = 0.3
"""Weight of the force of a taxel at a corner against that of one at an edge, for what a taxel beside them feels [1],
assumed."""


class ContactSurroundings:
    """Neighbours of the taxels of an array, and the greatest force that a taxel beside a contact can feel.

    A Gaussian spreads every point load, and a contact that is pressed in one piece is log-concave along each axis, as
    is the result: each force is at most that of a geometric decline from the two before it, f1*f1/f2. Under the shipped
    fingertips it is a tenth of that, within a factor of two; the greatest force of the array in place of f2 says half
    as much.

    Parameters
    ----------
    layout : Layout
        The array.
    """

    def __init__(self, layout: Layout) -> None:
        self._at_edge = neighbour_table(layout, EDGE_NEIGHBOURS)
        self._at_corner = neighbour_table(layout, CORNER_NEIGHBOURS)
        self._neighbours = np.hstack((self._at_edge, self._at_corner))
        outside = np.full((1, len(EDGE_NEIGHBOURS)), layout.taxels)
        further = np.vstack((self._at_edge, outside))
        self._behind = np.stack([further[self._at_edge[:, side], side] for side in range(len(EDGE_NEIGHBOURS))], axis=1)

    def dilated(self, mask: Mask) -> Mask:
        """Return a mask of taxels with their neighbours, shape [taxels]."""
        return dilate(mask, self._neighbours)

    def completed(self, force: Array, least: float) -> Array:
        """Return the forces with the greatest that each unknown one can be beside the others [N], shape [taxels].

        Parameters
        ----------
        force : ndarray of float64, shape [taxels]
            Forces, >= 0 [N]; NaN where unknown.
        least : float
            As for `geometric_decline`.
        """
        unknown = np.isnan(force)
        return np.where(unknown, self.geometric_decline(force, least), force) if unknown.any() else force

    def greatest_neighbour(self, force: Array) -> Array:
        """Return the greatest force of each taxel's neighbours; those at a corner count less.

        Parameters
        ----------
        force : ndarray of float64, shape [taxels]
            Forces, >= 0 [N].
        """
        padded = np.append(force, 0.0)
        at_edge, at_corner = padded[self._at_edge].max(axis=-1), padded[self._at_corner].max(axis=-1)
        greatest: Array = np.maximum(at_edge, DIAGONAL * at_corner)
        return greatest

    def geometric_decline(self, force: Array, least: float) -> Array:
        """Return the force of each taxel if forces declined geometrically towards it [N], shape [taxels].

        Of the lines along the axes of the array that end at the taxel, the one with the greatest force counts. Where
        the second taxel of a line is unknown or outside the array, the greatest force of the array stands in for it.

        Parameters
        ----------
        force : ndarray of float64, shape [taxels]
            Forces, >= 0 [N]; NaN where unknown.
        least : float
            Least force that stands in for an unknown one [N].
        """
        greatest = max(float(np.nanmax(force, initial=0.0)), least)
        padded = np.append(force, np.nan)
        first, second = (np.where(np.isnan(padded), other, padded) for other in (0.0, greatest))
        first, second = first[self._at_edge], second[self._behind]
        denominator = np.maximum(first, second)
        decline: Array = (first * first / np.where(denominator > 0.0, denominator, 1.0)).max(axis=-1)
        return decline
