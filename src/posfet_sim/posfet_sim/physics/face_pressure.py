# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Pressure under a flat face of which an engine knows the force and its point of application."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np

from posfet_model._lib.types import Array
from posfet_sim.contact.indenters import FLAT, Bend
from posfet_sim.contact.taxel_forces import Footprint, points_for


class Pressure(Protocol):
    """Distribution of a force over the surface of the array; every shape of `posfet_sim.contact` is one."""

    def footprints(self, force: float, spread: float, bend: Bend) -> list[Footprint]:
        """Return the contact pressure as weighted points.

        Parameters
        ----------
        force : float
            Normal force [N], above 0.
        spread : float
            Standard deviation of the spread by the elastomer skin [m]; sets the number of points.
        bend : Bend
            Curvatures of the chip [1/m].
        """
        ...


@dataclass(frozen=True)
class FacePressure:
    """Pressure that varies linearly along both sides of a rectangle and acts at a given point of it.

    Along each side the density is ``(1 + 3*c*u/a^2)/(2*a)``, u from the middle, a half the side, c the coordinate of
    the centre of pressure. Beyond ``abs(c) = a/3``, where that would pull, it is a triangle that ends within the side,
    as under a footing with an eccentric load. The pressure is the product of both, so that force and centre of pressure
    are exactly those of the engine. That the pressure is linear is assumed: an elastomer skin under a stiff face.
    """

    half_length: float
    """Half the side along u [m], above 0."""
    half_width: float
    """Half the side along v [m], above 0."""
    centre: tuple[float, float] = (0.0, 0.0)
    """Centre of pressure (u, v) from the middle of the rectangle [m], within it."""

    def footprints(self, force: float, spread: float, bend: Bend = FLAT) -> list[Footprint]:
        """Return the pressure; the same for every force and bend."""
        widest = max(self.half_length, self.half_width)
        u, u_weight = _linear(self.half_length, self.centre[0], points_for(self.half_length, spread, widest))
        v, v_weight = _linear(self.half_width, self.centre[1], points_for(self.half_width, spread, widest))
        return [Footprint(self.half_length, self.half_width, u, u_weight, v[None], v_weight, False)]


@lru_cache(maxsize=64)
def _gauss_legendre(points: int) -> tuple[Array, Array]:
    nodes, weights = np.polynomial.legendre.leggauss(points)
    return nodes, weights / 2


def _linear(half: float, centre: float, points: int) -> tuple[Array, Array]:
    """Return positions over the half-side, and weights with sum 1 and this centre [m], of a linear density."""
    nodes, weights = _gauss_legendre(points)
    share = max(min(centre / half, 1.0), -1.0)
    if abs(share) <= 1 / 3:
        return nodes, weights * (1 + 3 * share * nodes)
    # A triangle from the loaded end inwards, three times as long as its centroid is from that end.
    length = 1.5 * max(1 - abs(share), 1e-6)
    side = 1.0 if share > 0 else -1.0
    return side * (1 - length * (1 - nodes)), weights * (1 + nodes)
