"""Line contacts of finite length: a lying cylinder, and the edge of a wedge.

On a flat chip the pressure is even along the length; what a stiff body's ends add is left out. On a chip bent along the
line the load per length falls from the middle as 1 - fall*u^2, and each place has the width of its load on an endless
line. The twist of a line that lies askew to the bend is left out.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np

from posfet_sim.contact.closed_forms import cylinder_half_width, line_stiffness, wedge_half_width
from posfet_sim.contact.indenters import Bend, ellipse_shape
from posfet_sim.contact.quadrature import Line, half_ellipse, uniform_both, wedge
from posfet_sim.contact.taxel_forces import Footprint, points_for

_FLAT: Final = 1e-6  # curvature along over curvature across that counts as none
_SAME_FORCE: Final = 1e-13
_MOST_STEPS: Final = 60


@dataclass(frozen=True)
class LineLoad:
    """How the load is shared out along a line."""

    half_length: float
    """Of the part that touches [m]."""
    middle: float
    """Load per length in the middle [N/m]."""
    fall: float
    """The load per length at u is middle*(1 - fall*u^2) [1/m2]."""
    indentation: float
    """In the middle [m]."""


@dataclass(frozen=True)
class LineShape(ABC):
    """What cylinder and edge share."""

    length: float
    """L [m]."""
    effective_modulus: float
    """E [Pa]."""
    turns: ClassVar[bool] = True
    _profile: ClassVar[float]
    _half_length_share: ClassVar[float] = 0.25
    """Greatest half-width over the length: the closed form of the indentation holds for a contact longer than wide."""

    @abstractmethod
    def half_width(self, line_load: float, curvature: float) -> float:
        """Return the half-width [m] under a load per length [N/m] on a chip of that curvature across [1/m]."""

    @abstractmethod
    def _across(self, order: int) -> Line:
        """Return the points of the pressure across the line."""

    def line_load(self, force: float, bend: Bend) -> LineLoad:
        """Return how a force [N] above 0 is shared out: in slices (assumed).

        Each presses with k*(d - curvature*u^2/2), where that is above 0; k is the stiffness of the line on a flat chip.
        """
        stiffness, curvature, half_length = self._stiffness(force, bend), bend[0], self.length / 2
        depth = force / (stiffness * self.length) + curvature * self.length**2 / 24
        if depth < curvature * half_length**2 / 2:  # the ends do not touch
            depth = (0.75 * force / stiffness * math.sqrt(curvature / 2)) ** (2 / 3)
            half_length = math.sqrt(2 * depth / curvature)
        return LineLoad(half_length, stiffness * depth, curvature / (2 * depth), depth)

    def _stiffness(self, force: float, bend: Bend) -> float:
        """Return the load per length over the indentation [N/m2] of the whole line on a flat chip."""
        half_width = self.half_width(force / self.length, bend[1])
        return line_stiffness(self.length, half_width, self.effective_modulus, self._profile)

    def indentation(self, force: float, bend: Bend) -> float:
        """Return how deep the middle is pressed in [m]; on a flat chip F/(pi*L*E)*(2*ln(2*L/b) + c)."""
        return self.line_load(force, bend).indentation if force > 0 else 0.0

    def force(self, indentation: float, bend: Bend) -> float:
        """Return the force [N] for an indentation [m], by the secant rule on the logarithms of both."""
        if indentation <= 0:
            return 0.0
        wanted = math.log(indentation)
        before, force = 0.5 * self.effective_modulus * self.length * indentation, 0.0
        at_before = math.log(self.indentation(before, bend)) - wanted
        force = before * math.exp(-at_before)
        for _ in range(_MOST_STEPS):
            at_force = math.log(self.indentation(force, bend)) - wanted
            if abs(at_force) < _SAME_FORCE or at_force == at_before:
                break
            slope = (at_force - at_before) / math.log(force / before)
            before, at_before, force = force, at_force, force * math.exp(-at_force / slope)
        return force

    def area(self, force: float, bend: Bend) -> float:
        """Return the area of contact [m2], between that of a strip and that of an ellipse."""
        load = self.line_load(force, bend)
        roundness = load.fall * load.half_length**2  # from 0 for a strip to 1 for an ellipse
        return 4 * load.half_length * self.half_width(load.middle, bend[1]) * (1 - roundness * (1 - math.pi / 4))

    def footprints(self, force: float, spread: float, bend: Bend) -> list[Footprint]:
        """Return the pressure of the line."""
        load = self.line_load(force, bend)
        middle_width = self.half_width(load.middle, bend[1])
        widest = max(load.half_length, middle_width)
        order = points_for(load.half_length, spread, widest)
        u, weight = uniform_both(order)
        across, across_weight = self._across(points_for(middle_width, spread, widest))
        v = across[None, :]
        if bend[0] > 0:
            shares = np.maximum(1 - load.fall * load.half_length**2 * u[: order // 2] ** 2, 0.0)
            weight = weight * shares
            weight *= 0.5 / weight.sum()
            widths = [self.half_width(load.middle * share, bend[1]) / middle_width for share in shares.tolist()]
            v = np.multiply.outer(widths, across)
        return [Footprint(load.half_length, middle_width, u, weight, v, across_weight, True)]


@dataclass(frozen=True)
class Cylinder(LineShape):
    """A lying cylinder, its axis along u: Hertz across. A chip bent across adds its curvature, exactly.

    On a chip bent along the axis, length and depth of the contact are those of Hertz's ellipse until it reaches the
    ends; what is pressed beyond that counts as even along the length (assumed). The width is at most 13 % too great,
    where the ellipse is a circle.
    """

    radius: float
    """R [m]."""
    _profile: ClassVar[float] = 1.0

    @property
    def height(self) -> float:
        """The middle of the axis is the reference point."""
        return self.radius

    @property
    def greatest_force(self) -> float:
        """At it the contact is as wide as the cylinder, or half as wide as long."""
        half_width = min(self.radius, self._half_length_share * self.length)
        return math.pi * self.effective_modulus * self.length * half_width**2 / (4 * self.radius)

    def line_load(self, force: float, bend: Bend) -> LineLoad:
        """Return how a force [N] above 0 is shared out."""
        across = 1 / self.radius + bend[1]
        if bend[0] < _FLAT * across:
            return super().line_load(force, (0.0, bend[1]))
        ellipse = ellipse_shape(bend[0], across, self.effective_modulus)
        closing = (self.length / 2 / ellipse.along) ** 3
        rounded = min(force, closing)
        half_length = ellipse.along * math.pow(rounded, 1 / 3)
        bulge, even = 0.75 * rounded / half_length, (force - rounded) / self.length
        depth = ellipse.depth * math.pow(rounded, 2 / 3)
        if even > 0:
            depth += even / self._stiffness(force, bend)
        return LineLoad(half_length, bulge + even, bulge / (bulge + even) / half_length**2, depth)

    def half_width(self, line_load: float, curvature: float) -> float:
        """Return the half-width [m] by Hertz."""
        return cylinder_half_width(line_load, 1 / (1 / self.radius + curvature), self.effective_modulus)

    def _across(self, order: int) -> Line:
        return half_ellipse(order)


@dataclass(frozen=True)
class Edge(LineShape):
    """A straight edge along u, with flanks that rise evenly. The chip's curvature across is left out.

    On a chip bent along the edge the slices make the contact too long: against Hertz, for a cylinder of 1 to 10 mm
    radius on a chip bent to 10 to 100 mm, by 17 % to 108 %.
    """

    slope: float
    """Tangent of the angle between flank and surface [1]."""
    _profile: ClassVar[float] = 2.0
    height: ClassVar[float] = 0.0

    @property
    def greatest_force(self) -> float:
        """At it the contact is half as wide as long."""
        return self.effective_modulus * self.slope * self._half_length_share * self.length**2

    def half_width(self, line_load: float, curvature: float) -> float:
        """Return the half-width [m] of a wedge's contact."""
        return wedge_half_width(line_load, self.slope, self.effective_modulus)

    def _across(self, order: int) -> Line:
        return wedge(order)
