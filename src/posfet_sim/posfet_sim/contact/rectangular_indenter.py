# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A rigid flat rectangular indenter: the pressure has no closed form and is solved for numerically, once per shape.

The pressure is the product of two strip pressures, ``1/(pi^2*a*b*sqrt(1 - u^2)*sqrt(1 - v^2))`` with u and v in half
sides, times a sum of ``c_ij*T_2i(u)*T_2j(v)``, T_n the Chebyshev polynomials. The c_ij minimise the energy (Galerkin)
for a uniform displacement of the surface: the pressure is uniform over small rectangles, finer towards the sides, with
the displacement of Love's closed form (Phil. Trans. R. Soc. A 228, 1929; Johnson, Contact Mechanics, 1985, section
3.2). The stiffness of a square indenter is 0.1 % too low.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, Final

import numpy as np

from posfet_model._lib.types import Array
from posfet_sim.contact.closed_forms import FORCE_LIMIT
from posfet_sim.contact.indenters import Bend
from posfet_sim.contact.taxel_forces import Footprint, points_for

MAX_ASPECT_RATIO: Final = 20.0
"""Maximum ratio of the sides [1]."""

_TERMS: Final = 4  # even polynomials along each axis; six change the fraction of a taxel by less than 3e-4
_PARTS: Final = 16  # small rectangles along half a side


@dataclass(frozen=True)
class RectangularIndenter:
    """A rigid flat rectangular indenter on a flat chip. The error of the force of a taxel is 3e-4 of the total."""

    length: float
    """Length along u [m]."""
    width: float
    """Width along v [m]; the ratio of the sides is in [1/20, 20]."""
    effective_modulus: float
    """Effective modulus E [Pa]."""
    depends_on_angle: ClassVar[bool] = True
    needs_flat_chip: ClassVar[bool] = True
    needs_force: ClassVar[bool] = False
    height: ClassVar[float] = 0.0
    max_force: ClassVar[float] = FORCE_LIMIT

    @property
    def _stiffness(self) -> float:
        """Force over indentation [N/m]."""
        return self.effective_modulus * self.width / 2 * _solution(self.length / self.width)[1]

    def indentation(self, force: float, bend: Bend) -> float:
        """Return the indentation [m]."""
        return force / self._stiffness

    def force(self, indentation: float, bend: Bend) -> float:
        """Return the force [N] for an indentation [m]."""
        return max(indentation, 0.0) * self._stiffness

    def area(self, force: float, bend: Bend) -> float:
        """Return the area of the face [m2]."""
        return self.length * self.width

    def footprints(self, force: float, spread: float, bend: Bend) -> list[Footprint]:
        """Return the pressure, one part per polynomial across."""
        half_length, half_width = self.length / 2, self.width / 2
        widest = max(half_length, half_width)
        orders = points_for(half_length, spread, widest), points_for(half_width, spread, widest)
        points = _points(self.length / self.width, *orders)
        return [Footprint(half_length, half_width, u, weight, v, across, True) for u, weight, v, across in points]


@lru_cache(maxsize=64)
def _points(ratio: float, order_u: int, order_v: int) -> list[tuple[Array, Array, Array, Array]]:
    """Return points and weights of each part along u (points above 0, then their mirror images) and along v."""
    coefficients, _ = _solution(ratio)
    angle = (np.arange(order_u // 2) + 0.5) * math.pi / order_u
    u = np.concatenate([np.cos(angle), -np.cos(angle)])
    along = np.cos(np.multiply.outer(2 * np.arange(_TERMS), angle)) / order_u
    angle = (np.arange(order_v) + 0.5) * math.pi / order_v
    v = np.cos(angle)[None]
    across = np.cos(np.multiply.outer(2 * np.arange(_TERMS), angle)) / order_v
    return [(u, coefficients[:, term] @ along, v, across[term]) for term in range(_TERMS)]


@lru_cache(maxsize=64)
def _solution(ratio: float) -> tuple[Array, float]:
    """Return c_ij with c_00 = 1, and the stiffness in units of E times half the width, for length over width."""
    angles = np.linspace(math.pi / 2, 0, _PARTS + 1)
    edges = np.cos(angles)
    middle, half = (edges[1:] + edges[:-1]) / 2, np.diff(edges) / 2
    part = np.empty((_PARTS, _TERMS))  # force of each polynomial on each rectangle of half a side
    part[:, 0] = -np.diff(angles) / math.pi
    for term in range(1, _TERMS):
        part[:, term] = -np.diff(np.sin(2 * term * angles)) / (2 * term * math.pi)
    x, y = (each.ravel() for each in np.meshgrid(middle * ratio, middle, indexing="ij"))
    half_x, half_y = (each.ravel() for each in np.meshgrid(half * ratio, half, indexing="ij"))
    displacement = sum(
        _love(x[:, None] - side * x, y[:, None] - other * y, half_x, half_y) for side in (1, -1) for other in (1, -1)
    )
    displacement /= 4 * math.pi * half_x * half_y
    forces = np.einsum("ik,jl->ijkl", part, part).reshape(_PARTS**2, _TERMS**2)
    whole = 4 * forces.sum(axis=0)
    solution = np.linalg.solve(4 * forces.T @ displacement @ forces, whole)
    return solution.reshape(_TERMS, _TERMS) / solution[0], float(whole @ solution)


def _love(x: Array, y: Array, half_x: Array, half_y: Array) -> Array:
    """Return pi*E times the displacement at (x, y) from the middle of a rectangle under unit pressure."""

    def part(along: Array, across: Array) -> Array:
        product: Array = along * np.arcsinh(across / np.abs(along))
        return product

    right, left, top, bottom = x + half_x, x - half_x, y + half_y, y - half_y
    along_x = part(right, top) - part(right, bottom) - part(left, top) + part(left, bottom)
    return along_x + part(top, right) - part(top, left) - part(bottom, right) + part(bottom, left)
