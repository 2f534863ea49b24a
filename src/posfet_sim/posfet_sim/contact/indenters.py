"""The objects' shapes: how deep and where each presses under a force, on a flat chip and on a bent one.

Each shape answers in its own frame: u along it, v across, both in the chip's surface. A bent chip is a cylinder; `bend`
holds its curvatures [1/m] along u and along v, (0, 0) for a flat one. What is approximated there is said at each shape.
Force and indentation are those of an elastic half-space; moduli are effective ones, of object and cover together.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar, Final, Protocol, TypeAlias

from posfet_sim.contact.closed_forms import FORCE_LIMIT, EllipseShape, hertz_ellipse, punch_indentation
from posfet_sim.contact.quadrature import DiscRule, hertz_disc, punch_disc
from posfet_sim.contact.taxel_forces import Footprint, points_for

Bend: TypeAlias = tuple[float, float]
"""Curvatures of the chip along u and along v [1/m], at least 0: the array is on the outer side."""

FLAT: Final[Bend] = (0.0, 0.0)


class Shape(Protocol):
    """What an object presses with."""

    @property
    def height(self) -> float:
        """Height of the object's reference point above its lowest one [m]."""
        ...

    @property
    def turns(self) -> bool:
        """Whether its angle makes a difference to the array."""
        ...

    @property
    def greatest_force(self) -> float:
        """Force [N] up to which the theory of its contact holds."""
        ...

    def indentation(self, force: float, bend: Bend) -> float:
        """Return how deep it is pressed in [m] by a force [N]."""
        ...

    def force(self, indentation: float, bend: Bend) -> float:
        """Return the force [N] that presses it in by `indentation` [m]; 0 when that is not above 0."""
        ...

    def area(self, force: float, bend: Bend) -> float:
        """Return the area of contact [m2] under a force [N] above 0."""
        ...

    def footprints(self, force: float, spread: float, bend: Bend) -> list[Footprint]:
        """Return the pressure under a force [N] above 0, fine enough for a cover of that spread [m]."""
        ...


@lru_cache(maxsize=64)
def ellipse_shape(along: float, across: float, effective_modulus: float) -> EllipseShape:
    """Return `hertz_ellipse`, remembered."""
    return hertz_ellipse(along, across, effective_modulus)


@dataclass(frozen=True)
class Sphere:
    """A ball, or a round fingertip. On a bent chip the contact is an ellipse, by Hertz exactly."""

    radius: float
    """R [m]."""
    effective_modulus: float
    """E [Pa]."""
    turns: ClassVar[bool] = False

    @property
    def height(self) -> float:
        """The centre is the reference point."""
        return self.radius

    @property
    def greatest_force(self) -> float:
        """At it the contact on a flat chip is as wide as the sphere."""
        return 4 / 3 * self.effective_modulus * self.radius**2

    def _shape(self, bend: Bend) -> EllipseShape:
        return ellipse_shape(1 / self.radius + bend[0], 1 / self.radius + bend[1], self.effective_modulus)

    def indentation(self, force: float, bend: Bend) -> float:
        """Return how deep it is pressed in [m]: a^2/R on a flat chip."""
        return self._shape(bend).depth * math.pow(force, 2 / 3)

    def force(self, indentation: float, bend: Bend) -> float:
        """Return the force [N]: 4/3*E*sqrt(R)*d^1.5 on a flat chip."""
        return math.pow(max(indentation, 0.0) / self._shape(bend).depth, 1.5)

    def area(self, force: float, bend: Bend) -> float:
        """Return the area of the ellipse [m2]."""
        shape = self._shape(bend)
        return math.pi * shape.along * shape.across * math.pow(force, 2 / 3)

    def footprints(self, force: float, spread: float, bend: Bend) -> list[Footprint]:
        """Return the elliptic pressure."""
        shape, size = self._shape(bend), math.pow(force, 1 / 3)
        return [_disc(hertz_disc, shape.along * size, shape.across * size, spread)]


@dataclass(frozen=True)
class Punch:
    """A flat, stiff, round punch with the exact pressure F/(2*pi*a*sqrt(a^2 - r^2)).

    On a bent chip its gap is taken as that of a sphere of the mean curvature whose contact cannot grow past the
    punch's rim: the curvature's difference between along and across the bend is left out.
    """

    radius: float
    """a [m]."""
    effective_modulus: float
    """E [Pa]."""
    turns: ClassVar[bool] = False
    height: ClassVar[float] = 0.0
    greatest_force: ClassVar[float] = FORCE_LIMIT

    def _rounding(self, bend: Bend) -> tuple[float, float]:
        """Return the mean curvature [1/m], and the force [N] at which the contact reaches the rim."""
        curvature = (bend[0] + bend[1]) / 2
        return curvature, 4 / 3 * self.effective_modulus * self.radius**3 * curvature

    def indentation(self, force: float, bend: Bend) -> float:
        """Return how deep it is pressed in [m]: F/(2*a*E) on a flat chip."""
        curvature, closing = self._rounding(bend)
        if force < closing:
            return math.pow((0.75 * force / self.effective_modulus) ** 2 * curvature, 1 / 3)
        return self.radius**2 * curvature + punch_indentation(force - closing, self.radius, self.effective_modulus)

    def force(self, indentation: float, bend: Bend) -> float:
        """Return the force [N]: 2*a*E*d on a flat chip."""
        depth = max(indentation, 0.0)
        curvature, closing = self._rounding(bend)
        deeper = depth - self.radius**2 * curvature
        if deeper < 0:
            return 4 / 3 * self.effective_modulus * math.sqrt(depth**3 / curvature)
        return closing + 2 * self.radius * self.effective_modulus * deeper

    def area(self, force: float, bend: Bend) -> float:
        """Return the area of the circle that touches [m2]."""
        closing = self._rounding(bend)[1]
        return math.pi * self.radius**2 * (math.pow(force / closing, 2 / 3) if force < closing else 1.0)

    def footprints(self, force: float, spread: float, bend: Bend) -> list[Footprint]:
        """Return the punch's pressure; on a bent chip that of the rounding, and of what is left the punch's."""
        curvature, closing = self._rounding(bend)
        if force < closing:
            radius = (0.75 * force / self.effective_modulus / curvature) ** (1 / 3)
            return [_disc(hertz_disc, radius, radius, spread)]
        flat = _disc(punch_disc, self.radius, self.radius, spread, 1 - closing / force)
        if closing == 0:
            return [flat]
        return [flat, _disc(hertz_disc, self.radius, self.radius, spread, closing / force)]


def _disc(rule: Callable[[int], DiscRule], along: float, across: float, spread: float, share: float = 1.0) -> Footprint:
    """Return a pressure on an ellipse of these semi-axes [m] that carries a share of the force."""
    disc = rule(points_for(max(along, across), spread, max(along, across)))
    weight = disc.x_weight if share == 1 else disc.x_weight * share
    return Footprint(along, across, disc.both, weight, disc.y, disc.y_weight, True)
