# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A round fingertip with ridges: Hertz pressure of a sphere, modulated by the ridges."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from posfet_sim.contact.indenters import Bend, Sphere
from posfet_sim.contact.quadrature import hertz_disc
from posfet_sim.contact.taxel_forces import Footprint, points_for


@dataclass(frozen=True)
class RidgedFingertip(Sphere):
    """A sphere with straight ridges along v, a crest in the middle.

    The pressure is that of the smooth sphere (Hertz; Johnson, Contact Mechanics, 1985, section 4.2) times
    ``1 + contrast*cos(2*pi*u/spacing)``, normalised to the force (assumed; the ridges neither change the contact area
    nor the indentation). Ridges closer than about four times the spread of the skin are blurred away: a Gaussian of
    standard deviation s leaves ``exp(-2*(pi*s/spacing)^2)`` of their contrast.
    """

    spacing: float
    """Distance from ridge to ridge [m]."""
    contrast: float
    """Modulation of the pressure [1], in [0, 1]; 1: no pressure in the middle of a groove."""
    depends_on_angle: ClassVar[bool] = True
    needs_flat_chip: ClassVar[bool] = False
    needs_force: ClassVar[bool] = False

    def footprints(self, force: float, spread: float, bend: Bend) -> list[Footprint]:
        """Return the modulated Hertz pressure."""
        (smooth,) = super().footprints(force, spread, bend)
        ridges = smooth.half_length / self.spacing
        widest = max(smooth.half_length, smooth.half_width)
        # Gauss points of order n integrate a cosine of k = 2*pi*ridges exactly, to rounding, once n exceeds about k.
        order = points_for(widest, spread, widest) + 2 * math.ceil(math.pi * ridges)
        disc = hertz_disc(order)
        weight = disc.x_weight * (1 + self.contrast * np.cos(2 * math.pi * ridges * disc.x))
        weight *= 0.5 / weight.sum()
        return [Footprint(smooth.half_length, smooth.half_width, disc.both, weight, disc.y, disc.y_weight, True)]
