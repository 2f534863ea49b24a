# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Soft rectangular pads with a texture of ridges or bumps, which conform to the surface.

The mean pressure is uniform over the pad (assumed; on a bent chip, too, to which the pad conforms). The indentation has
no closed form: the path of a pad gives its force.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from posfet_sim.contact.indenters import Bend
from posfet_sim.contact.quadrature import Line, half_ellipse, uniform
from posfet_sim.contact.soft_faces import SoftFace
from posfet_sim.contact.taxel_forces import Footprint, points_for


@dataclass(frozen=True)
class TexturedPad(SoftFace):
    """Common part of the textured pads."""

    length: float
    """Length along u [m]."""
    width: float
    """Width along v [m]."""

    def area(self, force: float, bend: Bend) -> float:
        """Return the area of the pad [m2]."""
        return self.length * self.width


@dataclass(frozen=True)
class Ridges(TexturedPad):
    """Sinusoidal ridges across u, a whole number of them, with troughs at both ends.

    Pressure of a wavy surface (Westergaard 1939; Johnson, Contact Mechanics, 1985, section 13.2): above the mean
    pressure ``p* = pi*E*amplitude/wavelength`` it is the mean plus ``p*`` times a cosine (full contact); below, each
    ridge is in contact over the half-width a with ``sin^2(pi*a/wavelength) = mean/p*``. Each ridge is approximated as
    one of an infinite row.
    """

    ridges: int
    """Number of ridges."""
    amplitude: float
    """Amplitude: height of the crests above the mean [m]."""
    effective_modulus: float
    """Effective modulus E [Pa]."""

    def footprints(self, force: float, spread: float, bend: Bend) -> list[Footprint]:
        """Return the pressure of the ridges, plus a uniform pressure beyond full contact."""
        wavelength = self.length / self.ridges
        full = math.pi * self.effective_modulus * self.amplitude / wavelength * self.length * self.width
        widest = max(self.length, self.width) / 2
        half_length, half_width = self.length / 2, self.width / 2
        v, v_weight = _uniform_across(points_for(half_width, spread, widest))
        order = points_for(wavelength / 2, spread, widest)
        if force < full:
            u, weight = _crests(self.ridges, order, force / full)
        else:
            u, crests, uniform_points = _full_contact(self.ridges, order, points_for(half_length, spread, widest))
            weight = crests * (full / force) + uniform_points * (1 - full / force)
        return [Footprint(half_length, half_width, u, weight, v, v_weight, False)]


@lru_cache(maxsize=64)
def _crests(ridges: int, order: int, load: float) -> Line:
    """Return points of the pressure of ridges on [-1, 1], each in contact over its middle part.

    `load` is the force relative to that of full contact, in (0, 1]. At 1 the pressure is one plus a cosine.
    """
    chord, chord_weight = half_ellipse(order)
    inside = 2 / math.pi * np.arcsin(math.sqrt(load) * chord)
    crests = np.arange(1 - ridges, ridges, 2)
    return np.add.outer(crests, inside).ravel() / ridges, np.tile(chord_weight, ridges) / ridges


@lru_cache(maxsize=64)
def _full_contact(
    ridges: int, order: int, uniform_order: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return points for full contact, their weights for the ridges, and those for the uniform pressure."""
    crests, crests_weight = _crests(ridges, order, 1.0)
    uniform_points, uniform_weight = uniform(uniform_order)
    weights = np.zeros((2, len(crests) + len(uniform_points)))
    weights[0, : len(crests)], weights[1, len(crests) :] = crests_weight, uniform_weight
    return np.concatenate([crests, uniform_points]), weights[0], weights[1]


@lru_cache(maxsize=64)
def _uniform_across(order: int) -> Line:
    """Return `uniform` as a row of points."""
    points, weights = uniform(order)
    return points[None, :], weights


@dataclass(frozen=True)
class Roughness(TexturedPad):
    """Bumps at random positions that carry random fractions of the force, the same at every force (assumed).

    The fractions are exponentially distributed, as for bumps of exponentially distributed height (Greenwood and
    Williamson, Proc. R. Soc. A 295, 1966). The bumps are small compared with the spread of the elastomer skin, and
    positioned so that the centre of pressure is the centre of the pad.
    """

    bumps: int
    """Number of bumps."""
    seed: int
    """Seed of positions and fractions."""

    @cached_property
    def _points(self) -> Footprint:
        random = np.random.default_rng(self.seed)
        fraction = random.exponential(size=self.bumps)
        fraction /= fraction.sum()
        u, v = (random.random((2, self.bumps)) - 0.5) * np.array([[self.length], [self.width]])
        u, v = u - fraction @ u, v - fraction @ v
        half_length, half_width = (max(float(np.abs(points).max()), 1e-9) for points in (u, v))
        return Footprint(
            half_length=half_length,
            half_width=half_width,
            u=u / half_length,
            u_weight=fraction,
            v=v[:, None] / half_width,
            v_weight=np.ones(1),
            mirrored=False,
        )

    def footprints(self, force: float, spread: float, bend: Bend) -> list[Footprint]:
        """Return the bumps as points."""
        return [self._points]
