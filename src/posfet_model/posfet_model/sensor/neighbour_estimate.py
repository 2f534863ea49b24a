# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Interpolation of a taxel's force from its neighbours.

Pressure that has spread through the elastomer skin falls off like a Gaussian. On a grid along its axes a Gaussian obeys
``f00 = f01*f10/f11`` for every 2 x 2 square of taxels; one at an angle to it, as that of a bar, obeys
``f00*f11 = f01*f10*exp(twist)`` with the same twist for all. The four squares around a taxel combined (mean of the
logarithms, weighted by the smallest force in each), with the twist of the squares next to them, come close for other
contacts too. In a corner, or where few squares are known, this is an extrapolation: it is limited to what a point load
on the taxel would let its neighbours feel.

Compiled: `posfet_core`, neighbour_estimate.hpp.
"""

from __future__ import annotations

import math
from typing import Final

from posfet_core import scan_path
from posfet_model.sensor.description import Layout, Sensor
from posfet_model.sensor.grid import compiled_layout
from posfet_model.sensor.skin_response import neighbour_share

INTERPOLATION_UNCERTAINTY: Final = scan_path.INTERPOLATION_UNCERTAINTY
"""Relative standard uncertainty of a force interpolated from neighbours that are far above the floor [1]: 0.11 for
spheres of 1.5 to 6 mm radius anywhere on a 5 x 5 array, the rest for 5 % gain mismatch."""


def most_over_neighbours(sensor: Sensor) -> tuple[float, float]:
    """Return the force on a taxel over that on its neighbour, under a point load at its centre.

    Parameters
    ----------
    sensor : Sensor
        Description of the sensor.

    Returns
    -------
    tuple of float
        For neighbours along a row and along a column [1]; inf: the skin does not spread a force.
    """
    layout = sensor.layout
    shares = (neighbour_share(pitch, sensor.device.contact_spread) for pitch in (layout.pitch_x, layout.pitch_y))
    along_row, along_column = (1.0 / share if share > 0.0 else math.inf for share in shares)
    return along_row, along_column


class NeighbourInterpolation(scan_path.NeighbourInterpolation):
    """Interpolates forces from the 2 x 2 squares around each taxel of one array.

    `interpolate` returns the forces [N] of wanted taxels as their neighbours predict them, and their standard
    uncertainties [N]: smaller forces than `floor` count as this one, and no force is more than `most_x` times its known
    neighbours in the row and `most_y` times those in the column, of which the greatest counts; 0 where no known
    neighbour exceeds `floor`, NaN where every square of a taxel contains an `unknown` one or leaves the array. What
    the squares predict differently and an error by `floor` in each neighbour are in the uncertainty, which is the force
    itself where that is limited.

    `lower_bound` returns the smallest force [N] that any square of a taxel predicts; a square is informative when its
    other three taxels are known and at least `floor`, and all squares that lie on the array have to be, so that a taxel
    in a gap between two contacts is not expected to show a force: 0 otherwise. `max_neighbour` returns the largest
    value among the eight neighbours of each taxel, -inf where it has none.

    Parameters
    ----------
    layout : Layout
        The array.
    """

    def __init__(self, layout: Layout) -> None:
        super().__init__(compiled_layout(layout))
