"""Textured pads: a soft rectangle that follows the surface, with ridges or bumps that press more than what is between.

The mean pressure is the same all over the pad (assumed, on a bent chip too, which the pad follows). How deep a pad
sinks in has no closed form: its path gives its force.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from posfet_sim.contact.closed_forms import FORCE_LIMIT
from posfet_sim.contact.indenters import Bend
from posfet_sim.contact.quadrature import Line, half_ellipse, uniform
from posfet_sim.contact.taxel_forces import Footprint, points_for


@dataclass(frozen=True)
class Pad:
    """What all textured pads share."""

    length: float
    """Along u [m]."""
    width: float
    """Along v [m]."""
    turns: ClassVar[bool] = True
    height: ClassVar[float] = 0.0
    greatest_force: ClassVar[float] = FORCE_LIMIT

    def indentation(self, force: float, bend: Bend) -> float:
        """Return 0: the pad's face is taken to lie in the surface."""
        return 0.0

    def area(self, force: float, bend: Bend) -> float:
        """Return the area of the pad [m2]."""
        return self.length * self.width

    def force(self, indentation: float, bend: Bend) -> float:
        """Raise ValueError: a pad's force does not follow from an indentation."""
        raise ValueError("a textured pad must be given a force, not an indentation")


@dataclass(frozen=True)
class Ridges(Pad):
    """Sinusoidal ridges across u, a whole number of them, troughs at both ends.

    Pressure of a wavy surface (Westergaard 1939; Johnson, Contact Mechanics, 1985, section 13.2): above the mean
    pressure ``p* = pi*E*amplitude/wavelength`` it is the mean plus ``p*`` times a cosine; below, each ridge touches
    over the half-width a with ``sin^2(pi*a/wavelength) = mean/p*``. Each ridge is taken as one of an endless row.
    """

    ridges: int
    amplitude: float
    """Height of the crests above the mean [m]."""
    effective_modulus: float
    """E [Pa]."""

    def footprints(self, force: float, spread: float, bend: Bend) -> list[Footprint]:
        """Return the pressure of the ridges, and above the full contact what is even on top of it."""
        wavelength = self.length / self.ridges
        full = math.pi * self.effective_modulus * self.amplitude / wavelength * self.length * self.width
        widest = max(self.length, self.width) / 2
        half_length, half_width = self.length / 2, self.width / 2
        v, v_weight = _even_across(points_for(half_width, spread, widest))
        order = points_for(wavelength / 2, spread, widest)
        if force < full:
            u, weight = _crests(self.ridges, order, force / full)
        else:
            u, crests, even = _closed(self.ridges, order, points_for(half_length, spread, widest))
            weight = crests * (full / force) + even * (1 - full / force)
        return [Footprint(half_length, half_width, u, weight, v, v_weight, False)]


@lru_cache(maxsize=64)
def _crests(ridges: int, order: int, touching: float) -> Line:
    """Return points of the pressure of ridges on [-1, 1], each touching over its middle part: `touching` of its load.

    At `touching` 1 a ridge touches all over: its pressure is one and a cosine.
    """
    chord, chord_weight = half_ellipse(order)
    inside = 2 / math.pi * np.arcsin(math.sqrt(touching) * chord)
    crests = np.arange(1 - ridges, ridges, 2)
    return np.add.outer(crests, inside).ravel() / ridges, np.tile(chord_weight, ridges) / ridges


@lru_cache(maxsize=64)
def _closed(
    ridges: int, order: int, even_order: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return points for ridges that touch all over, their weights for the ridges, and those for what is even."""
    crests, crests_weight = _crests(ridges, order, 1.0)
    even, even_weight = uniform(even_order)
    weights = np.zeros((2, len(crests) + len(even)))
    weights[0, : len(crests)], weights[1, len(crests) :] = crests_weight, even_weight
    return np.concatenate([crests, even]), weights[0], weights[1]


@lru_cache(maxsize=64)
def _even_across(order: int) -> Line:
    """Return `uniform` as a row of points."""
    points, weights = uniform(order)
    return points[None, :], weights


@dataclass(frozen=True)
class Roughness(Pad):
    """Bumps at random places that carry random shares of the force, the same at every force (assumed).

    The shares are exponential: those of bumps of exponentially distributed height (Greenwood and Williamson, Proc. R.
    Soc. A 295, 1966). The bumps are small against the cover's spread, and placed so that the centre of pressure is the
    pad's.
    """

    bumps: int
    seed: int

    @cached_property
    def _points(self) -> Footprint:
        random = np.random.default_rng(self.seed)
        share = random.exponential(size=self.bumps)
        share /= share.sum()
        u, v = (random.random((2, self.bumps)) - 0.5) * np.array([[self.length], [self.width]])
        u, v = u - share @ u, v - share @ v
        half_length, half_width = (max(float(np.abs(points).max()), 1e-9) for points in (u, v))
        return Footprint(
            half_length=half_length,
            half_width=half_width,
            u=u / half_length,
            u_weight=share,
            v=v[:, None] / half_width,
            v_weight=np.ones(1),
            mirrored=False,
        )

    def footprints(self, force: float, spread: float, bend: Bend) -> list[Footprint]:
        """Return the bumps."""
        return [self._points]
