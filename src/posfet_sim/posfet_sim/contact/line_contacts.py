# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Line contacts of finite length: a cylinder, and the edge of a wedge.

On a flat chip the pressure is uniform along the length; the concentration at the ends of a stiff body is neglected. On
a chip bent along the line the force per length decreases from the middle as 1 - fall*u^2, and each position has the
width of an infinite line with its force per length. The twist of a line that is rotated against the bend is neglected.
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

_FLAT: Final = 1e-6  # ratio of curvature along to across that counts as flat
_TOLERANCE: Final = 1e-13
_MAX_STEPS: Final = 60


@dataclass(frozen=True)
class LineLoad:
    """Distribution of the force along a line."""

    half_length: float
    """Half-length of the contact [m]."""
    middle: float
    """Force per length in the middle [N/m]."""
    fall: float
    """Curvature of the distribution [1/m2]: the force per length at u is middle*(1 - fall*u^2)."""
    indentation: float
    """Indentation in the middle [m]."""


@dataclass(frozen=True)
class LineShape(ABC):
    """Common part of cylinder and edge."""

    length: float
    """Length L [m]."""
    effective_modulus: float
    """Effective modulus E [Pa]."""
    depends_on_angle: ClassVar[bool] = True
    needs_flat_chip: ClassVar[bool] = False
    needs_force: ClassVar[bool] = False
    _profile: ClassVar[float]
    _max_aspect: ClassVar[float] = 0.25
    """Maximum half-width over length [1]: the closed form of the indentation is for contacts longer than wide."""

    @abstractmethod
    def half_width(self, line_load: float, curvature: float) -> float:
        """Return the half-width [m] under a force per length [N/m] on a chip of this curvature across [1/m].

        Parameters
        ----------
        line_load : float
            Force per length [N/m].
        curvature : float
            Curvature of the chip across the line [1/m].
        """

    @abstractmethod
    def _across(self, order: int) -> Line:
        """Return the points of the pressure across the line."""

    def line_load(self, force: float, bend: Bend) -> LineLoad:
        """Return the distribution of a force [N] above 0 along the line, by independent slices (assumed).

        Each slice carries k*(d - curvature*u^2/2), if positive; k is the stiffness of the line on a flat chip.

        Parameters
        ----------
        force : float
            Normal force [N], above 0.
        bend : Bend
            Curvatures of the chip along and across the object [1/m].
        """
        stiffness, curvature, half_length = self._stiffness(force, bend), bend[0], self.length / 2
        depth = force / (stiffness * self.length) + curvature * self.length**2 / 24
        if depth < curvature * half_length**2 / 2:  # the ends do not touch
            depth = (0.75 * force / stiffness * math.sqrt(curvature / 2)) ** (2 / 3)
            half_length = math.sqrt(2 * depth / curvature)
        return LineLoad(half_length, stiffness * depth, curvature / (2 * depth), depth)

    def _stiffness(self, force: float, bend: Bend) -> float:
        """Return the force per length over the indentation [N/m2] of the whole line on a flat chip."""
        half_width = self.half_width(force / self.length, bend[1])
        return line_stiffness(self.length, half_width, self.effective_modulus, self._profile)

    def indentation(self, force: float, bend: Bend) -> float:
        """Return the indentation of the middle [m]; on a flat chip F/(pi*L*E)*(2*ln(2*L/b) + c)."""
        return self.line_load(force, bend).indentation if force > 0 else 0.0

    def force(self, indentation: float, bend: Bend) -> float:
        """Return the force [N] for an indentation [m], by the secant method on the logarithms of both."""
        if indentation <= 0:
            return 0.0
        target = math.log(indentation)
        before, force = 0.5 * self.effective_modulus * self.length * indentation, 0.0
        at_before = math.log(self.indentation(before, bend)) - target
        force = before * math.exp(-at_before)
        for _ in range(_MAX_STEPS):
            at_force = math.log(self.indentation(force, bend)) - target
            if abs(at_force) < _TOLERANCE or at_force == at_before:
                break
            slope = (at_force - at_before) / math.log(force / before)
            before, at_before, force = force, at_force, force * math.exp(-at_force / slope)
        return force

    def area(self, force: float, bend: Bend) -> float:
        """Return the contact area [m2], between those of a strip and of an ellipse."""
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
            profile = np.maximum(1 - load.fall * load.half_length**2 * u[: order // 2] ** 2, 0.0)
            weight = weight * profile
            weight *= 0.5 / weight.sum()
            widths = [self.half_width(load.middle * value, bend[1]) / middle_width for value in profile.tolist()]
            v = np.multiply.outer(widths, across)
        return [Footprint(load.half_length, middle_width, u, weight, v, across_weight, True)]


@dataclass(frozen=True)
class Cylinder(LineShape):
    """A cylinder with its axis along u: Hertz theory across. A chip bent across adds its curvature (exact).

    On a chip bent along the axis, length and indentation of the contact are those of the Hertz ellipse until it reaches
    the ends; further force is uniform along the length (assumed). The width is at most 13 % too large, where the
    ellipse is a circle.
    """

    radius: float
    """Radius R [m]."""
    _profile: ClassVar[float] = 1.0

    @property
    def height(self) -> float:
        """Height of the middle of the axis, which is the reference point [m]."""
        return self.radius

    @property
    def max_force(self) -> float:
        """Force at which the contact is as wide as the cylinder, or half as wide as long [N]."""
        half_width = min(self.radius, self._max_aspect * self.length)
        return math.pi * self.effective_modulus * self.length * half_width**2 / (4 * self.radius)

    def line_load(self, force: float, bend: Bend) -> LineLoad:
        """Return the distribution of a force [N] above 0 along the cylinder.

        Parameters
        ----------
        force : float
            Normal force [N], above 0.
        bend : Bend
            Curvatures of the chip along and across the object [1/m].
        """
        across = 1 / self.radius + bend[1]
        if bend[0] < _FLAT * across:
            return super().line_load(force, (0.0, bend[1]))
        ellipse = ellipse_shape(bend[0], across, self.effective_modulus)
        closing = (self.length / 2 / ellipse.along) ** 3
        rounded = min(force, closing)
        half_length = ellipse.along * math.pow(rounded, 1 / 3)
        elliptic_load, uniform_load = 0.75 * rounded / half_length, (force - rounded) / self.length
        depth = ellipse.depth * math.pow(rounded, 2 / 3)
        if uniform_load > 0:
            depth += uniform_load / self._stiffness(force, bend)
        middle = elliptic_load + uniform_load
        return LineLoad(half_length, middle, elliptic_load / middle / half_length**2, depth)

    def half_width(self, line_load: float, curvature: float) -> float:
        """Return the half-width [m] by Hertz theory."""
        return cylinder_half_width(line_load, 1 / (1 / self.radius + curvature), self.effective_modulus)

    def _across(self, order: int) -> Line:
        return half_ellipse(order)


@dataclass(frozen=True)
class Edge(LineShape):
    """A straight wedge edge along u. The curvature of the chip across is neglected.

    On a chip bent along the edge, independent slices make the contact too long: compared with Hertz theory for a
    cylinder of 1 to 10 mm radius on a chip bent to 10 to 100 mm, by 17 % to 108 %.
    """

    slope: float
    """Tangent of the angle between flank and surface [1]."""
    _profile: ClassVar[float] = 2.0
    height: ClassVar[float] = 0.0

    @property
    def max_force(self) -> float:
        """Force at which the contact is half as wide as long [N]."""
        return self.effective_modulus * self.slope * self._max_aspect * self.length**2

    def half_width(self, line_load: float, curvature: float) -> float:
        """Return the half-width [m] of a wedge's contact."""
        return wedge_half_width(line_load, self.slope, self.effective_modulus)

    def _across(self, order: int) -> Line:
        return wedge(order)
