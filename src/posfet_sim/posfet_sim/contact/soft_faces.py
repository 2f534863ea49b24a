# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Soft objects with a plain face: a rectangular pad, a ring, and the slotted head of a screw.

The pressure is uniform over the face (assumed): a soft object, or a thin rigid one on a thick soft skin, levels the
concentration that a rigid face has at its edges (`FlatIndenter`, `RectangularIndenter`). On a bent chip the face
conforms to the surface (assumed). The indentation has no closed form: the path of such an object gives its force.
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
from posfet_sim.contact.quadrature import uniform, uniform_both
from posfet_sim.contact.taxel_forces import MIN_RELATIVE_SPREAD, Footprint, points_for

_ANGLES_PER_SPREAD: Final = 5.1
"""Equally spaced points on a circle per radius over spread [1].

Their sum has a relative error of about exp(-n^2*s^2/(2*R^2)), that of the n-th Fourier coefficient of a Gaussian of
standard deviation s centred on the circle of radius R: 2e-6 for n = 5.1*R/s.
"""

_ONE: Final = np.ones(1)


class SoftFace:
    """Common part of objects that conform to the surface and whose indentation is not modelled."""

    depends_on_angle: ClassVar[bool] = True
    needs_flat_chip: ClassVar[bool] = False
    needs_force: ClassVar[bool] = True
    height: ClassVar[float] = 0.0
    max_force: ClassVar[float] = FORCE_LIMIT

    def indentation(self, force: float, bend: Bend) -> float:
        """Return 0: the face is assumed to lie in the surface."""
        return 0.0

    def force(self, indentation: float, bend: Bend) -> float:
        """Raise ValueError: the force of a soft face does not follow from an indentation."""
        raise ValueError("a soft face must be given a force, not an indentation")


@dataclass(frozen=True)
class Pad(SoftFace):
    """A flat soft rectangular pad: the pressure is F/(length*width) on the whole face (assumed)."""

    length: float
    """Length along u [m]."""
    width: float
    """Width along v [m]."""

    def area(self, force: float, bend: Bend) -> float:
        """Return the area of the pad [m2]."""
        return self.length * self.width

    def footprints(self, force: float, spread: float, bend: Bend) -> list[Footprint]:
        """Return the uniform pressure."""
        half_length, half_width = self.length / 2, self.width / 2
        widest = max(half_length, half_width)
        u, u_weight = uniform_both(points_for(half_length, spread, widest))
        v, v_weight = _row(points_for(half_width, spread, widest))
        return [Footprint(half_length, half_width, u, u_weight, v, v_weight, True)]


@dataclass(frozen=True)
class Ring(SoftFace):
    """A ring: a cup, tube or hollow pad that presses at its rim only.

    The pressure is F/(pi*(R^2 - r^2)) between the inner radius r and the outer radius R, and 0 inside (assumed).
    """

    outer_radius: float
    """Outer radius R [m]."""
    inner_radius: float
    """Inner radius r [m], below the outer one."""
    depends_on_angle: ClassVar[bool] = False

    def area(self, force: float, bend: Bend) -> float:
        """Return the area of the ring [m2]."""
        return math.pi * (self.outer_radius**2 - self.inner_radius**2)

    def footprints(self, force: float, spread: float, bend: Bend) -> list[Footprint]:
        """Return the uniform pressure on the ring."""
        outer = self.outer_radius
        narrowest = max(spread, MIN_RELATIVE_SPREAD * outer)
        radial = points_for((outer - self.inner_radius) / 2, spread, outer)
        angles = 2 * math.ceil(_ANGLES_PER_SPREAD / 2 * outer / narrowest) + 4
        return [_scattered(outer, _ring_points(self.inner_radius / outer, radial, angles))]


@dataclass(frozen=True)
class ScrewHead(SoftFace):
    """The flat head of a slotted screw, its slot through the middle along u.

    The pressure is uniform on the two segments beside the slot and 0 in the slot (assumed). A rigid head on a thin
    skin would press harder at its rim and at the edges of the slot.
    """

    radius: float
    """Radius R of the head [m]."""
    slot_width: float
    """Width of the slot [m], below the diameter."""

    def area(self, force: float, bend: Bend) -> float:
        """Return the area of the head without the slot [m2]: 2*R^2*(q - sin(q)*cos(q)), cos(q) = width/(2*R)."""
        half_angle = math.acos(self.slot_width / 2 / self.radius)
        return 2 * self.radius**2 * (half_angle - math.sin(half_angle) * math.cos(half_angle))

    def footprints(self, force: float, spread: float, bend: Bend) -> list[Footprint]:
        """Return the uniform pressure beside the slot."""
        order = points_for(self.radius, spread, self.radius)
        return [_scattered(self.radius, _segment_points(self.slot_width / 2 / self.radius, order))]


def _scattered(radius: float, points: tuple[Array, Array, Array]) -> Footprint:
    """Return weighted points (u, v) on the unit disc, scaled to a radius [m]."""
    u, v, weight = points
    return Footprint(radius, radius, u, weight, v, _ONE, False)


@lru_cache(maxsize=64)
def _ring_points(inner: float, radial: int, angles: int) -> tuple[Array, Array, Array]:
    """Return u [n], v [n, 1] and weights [n] of a ring between the radii `inner` and 1: Gauss-Legendre in r^2."""
    points, weights = uniform(radial)
    radius = np.sqrt((1 + inner**2) / 2 + (1 - inner**2) / 2 * points)[:, None]
    angle = np.arange(angles) * (2 * math.pi / angles)
    u, v = radius * np.cos(angle), radius * np.sin(angle)
    return u.ravel(), v.reshape(-1, 1), np.repeat(weights / angles, angles)


@lru_cache(maxsize=64)
def _segment_points(slot: float, order: int) -> tuple[Array, Array, Array]:
    """Return the same of the unit disc without abs(v) < `slot`, with `order` points along each axis of a segment.

    With v = sin(q) the weight of a chord, 2*cos(q)*dv, is 2*cos(q)^2*dq: smooth up to the rim.
    """
    points, weights = uniform(order)
    low = math.asin(slot)
    angle = (math.pi / 2 + low) / 2 + (math.pi / 2 - low) / 2 * points
    across = weights * np.cos(angle) ** 2
    across /= 2 * across.sum()
    u = np.multiply.outer(np.cos(angle), points).ravel()
    v = np.repeat(np.sin(angle), order)
    weight = np.multiply.outer(across, weights).ravel()
    return np.concatenate([u, u]), np.concatenate([v, -v])[:, None], np.concatenate([weight, weight])


@lru_cache(maxsize=64)
def _row(order: int) -> tuple[Array, Array]:
    """Return `uniform` as a row of points; cached, as footprints with the same weights are computed at once."""
    points, weights = uniform(order)
    return points[None], weights
