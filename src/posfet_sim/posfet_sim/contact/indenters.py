# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Shapes of the objects: indentation and contact pressure under a force, on a flat and on a bent chip.

Coordinates are those of the object: u along it, v across, both in the surface of the chip. A bent chip is a cylinder;
`bend` holds its curvatures [1/m] along u and along v, (0, 0) for a flat one. Each shape documents its approximations
there. Force and indentation are those of an elastic half-space; moduli are effective ones, of object and elastomer skin
together.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, Final, Protocol, TypeAlias

from posfet_sim.contact.closed_forms import FORCE_LIMIT, EllipseShape, flat_indentation, hertz_ellipse
from posfet_sim.contact.quadrature import DiscRule, flat_disc, hertz_disc
from posfet_sim.contact.taxel_forces import Footprint, points_for

Bend: TypeAlias = tuple[float, float]
"""Curvatures of the chip along u and along v [1/m], at least 0: the array is on the convex side."""

FLAT: Final[Bend] = (0.0, 0.0)
"""Curvatures of a flat chip."""


class Shape(Protocol):
    """Shape of an object that presses on the array."""

    @property
    def height(self) -> float:
        """Height of the reference point of the object above its lowest point [m]."""
        ...

    @property
    def depends_on_angle(self) -> bool:
        """Whether its angle about the normal changes the contact."""
        ...

    @property
    def needs_flat_chip(self) -> bool:
        """Whether its contact with a bent chip is unknown."""
        ...

    @property
    def needs_force(self) -> bool:
        """Whether its force does not follow from an indentation."""
        ...

    @property
    def max_force(self) -> float:
        """Maximum force [N] for which the contact theory is valid."""
        ...

    def indentation(self, force: float, bend: Bend) -> float:
        """Return the indentation [m] under a force [N].

        Parameters
        ----------
        force : float
            Normal force [N].
        bend : Bend
            Curvatures of the chip along and across the object [1/m].
        """
        ...

    def force(self, indentation: float, bend: Bend) -> float:
        """Return the force [N] for an indentation [m]; 0 unless that is positive.

        Parameters
        ----------
        indentation : float
            Indentation [m].
        bend : Bend
            Curvatures of the chip along and across the object [1/m].
        """
        ...

    def area(self, force: float, bend: Bend) -> float:
        """Return the contact area [m2] under a force [N] above 0.

        Parameters
        ----------
        force : float
            Normal force [N], above 0.
        bend : Bend
            Curvatures of the chip along and across the object [1/m].
        """
        ...

    def footprints(self, force: float, spread: float, bend: Bend) -> list[Footprint]:
        """Return the contact pressure as weighted points.

        Parameters
        ----------
        force : float
            Normal force [N], above 0.
        spread : float
            Standard deviation of the spread by the elastomer skin [m]; sets the number of points.
        bend : tuple of float
            Curvatures of the chip along u and v [1/m].
        """
        ...


@lru_cache(maxsize=64)
def ellipse_shape(along: float, across: float, effective_modulus: float) -> EllipseShape:
    """Return `hertz_ellipse`, cached.

    Parameters
    ----------
    along : float
        Curvature of the gap along the object [1/m].
    across : float
        Curvature of the gap across it [1/m].
    effective_modulus : float
        Effective modulus E of object and skin [Pa].
    """
    return hertz_ellipse(along, across, effective_modulus)


@dataclass(frozen=True)
class Sphere:
    """A sphere or round fingertip. On a bent chip the contact is an ellipse (exact Hertz theory)."""

    radius: float
    """Radius R [m]."""
    effective_modulus: float
    """Effective modulus E [Pa]."""
    depends_on_angle: ClassVar[bool] = False
    needs_flat_chip: ClassVar[bool] = False
    needs_force: ClassVar[bool] = False

    @property
    def height(self) -> float:
        """Height of the centre, which is the reference point [m]."""
        return self.radius

    @property
    def max_force(self) -> float:
        """Force at which the contact on a flat chip is as wide as the sphere [N]."""
        return 4 / 3 * self.effective_modulus * self.radius**2

    def _shape(self, bend: Bend) -> EllipseShape:
        return ellipse_shape(1 / self.radius + bend[0], 1 / self.radius + bend[1], self.effective_modulus)

    def indentation(self, force: float, bend: Bend) -> float:
        """Return the indentation [m]; a^2/R on a flat chip."""
        return self._shape(bend).depth * math.pow(force, 2 / 3)

    def force(self, indentation: float, bend: Bend) -> float:
        """Return the force [N]; 4/3*E*sqrt(R)*d^1.5 on a flat chip."""
        return math.pow(max(indentation, 0.0) / self._shape(bend).depth, 1.5)

    def area(self, force: float, bend: Bend) -> float:
        """Return the area of the contact ellipse [m2]."""
        shape = self._shape(bend)
        return math.pi * shape.along * shape.across * math.pow(force, 2 / 3)

    def footprints(self, force: float, spread: float, bend: Bend) -> list[Footprint]:
        """Return the Hertz pressure on the ellipse."""
        shape, size = self._shape(bend), math.pow(force, 1 / 3)
        return [_disc(hertz_disc, shape.along * size, shape.across * size, spread)]


@dataclass(frozen=True)
class FlatIndenter:
    """A rigid flat circular indenter (Johnson's flat punch), with the exact pressure F/(2*pi*a*sqrt(a^2 - r^2)).

    On a bent chip its gap is approximated by that of a sphere of the mean curvature, with a contact that ends at the
    rim of the indenter: the difference of the curvatures along and across the bend is neglected.
    """

    radius: float
    """Radius a [m]."""
    effective_modulus: float
    """Effective modulus E [Pa]."""
    depends_on_angle: ClassVar[bool] = False
    needs_flat_chip: ClassVar[bool] = False
    needs_force: ClassVar[bool] = False
    height: ClassVar[float] = 0.0
    max_force: ClassVar[float] = FORCE_LIMIT

    def _rounding(self, bend: Bend) -> tuple[float, float]:
        """Return the mean curvature [1/m], and the force [N] at which the contact reaches the rim."""
        curvature = (bend[0] + bend[1]) / 2
        return curvature, 4 / 3 * self.effective_modulus * self.radius**3 * curvature

    def indentation(self, force: float, bend: Bend) -> float:
        """Return the indentation [m]; F/(2*a*E) on a flat chip."""
        curvature, closing = self._rounding(bend)
        if force < closing:
            return math.pow((0.75 * force / self.effective_modulus) ** 2 * curvature, 1 / 3)
        return self.radius**2 * curvature + flat_indentation(force - closing, self.radius, self.effective_modulus)

    def force(self, indentation: float, bend: Bend) -> float:
        """Return the force [N]; 2*a*E*d on a flat chip."""
        depth = max(indentation, 0.0)
        curvature, closing = self._rounding(bend)
        deeper = depth - self.radius**2 * curvature
        if deeper < 0:
            return 4 / 3 * self.effective_modulus * math.sqrt(depth**3 / curvature)
        return closing + 2 * self.radius * self.effective_modulus * deeper

    def area(self, force: float, bend: Bend) -> float:
        """Return the area of the circular contact [m2]."""
        closing = self._rounding(bend)[1]
        return math.pi * self.radius**2 * (math.pow(force / closing, 2 / 3) if force < closing else 1.0)

    def footprints(self, force: float, spread: float, bend: Bend) -> list[Footprint]:
        """Return the pressure.

        On a bent chip it is a Hertz pressure up to contact at the rim, and a flat one for the rest of the force.

        Parameters
        ----------
        force : float
            Normal force [N].
        spread : float
            Standard deviation of the spread by the elastomer skin [m].
        bend : Bend
            Curvatures of the chip along and across the object [1/m].
        """
        curvature, closing = self._rounding(bend)
        if force < closing:
            radius = (0.75 * force / self.effective_modulus / curvature) ** (1 / 3)
            return [_disc(hertz_disc, radius, radius, spread)]
        flat = _disc(flat_disc, self.radius, self.radius, spread, 1 - closing / force)
        if closing == 0:
            return [flat]
        return [flat, _disc(hertz_disc, self.radius, self.radius, spread, closing / force)]


def _disc(
    rule: Callable[[int], DiscRule], along: float, across: float, spread: float, fraction: float = 1.0
) -> Footprint:
    """Return a pressure on an ellipse of these semi-axes [m] that carries a fraction of the force."""
    disc = rule(points_for(max(along, across), spread, max(along, across)))
    weight = disc.x_weight if fraction == 1 else disc.x_weight * fraction
    return Footprint(along, across, disc.both, weight, disc.y, disc.y_weight, True)
