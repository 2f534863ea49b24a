# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""What the elastomer skin must let the neighbours of a pressed taxel feel.

The skin spreads every point load like a Gaussian of standard deviation s (`contact_spread_mm`). A cell of pitch p under
the load gets the share q0 = erf(u) of it along an axis, each of its two neighbours there q1 = (erf(3*u) - erf(u))/2,
with u = p/(2*sqrt(2)*s). Of all positions of the load, the centre of the cell gives both neighbours together the least
for what the cell itself gets: 2*q1/q0. A pressure is a sum of point loads, so that this holds for every touch, the
sharpest tip included. At the edge of the array one of the two neighbours is missing, and a load beyond the centre of an
outermost cell gives the other one almost nothing.

Compiled: `posfet_core`, skin_response.hpp.
"""

from __future__ import annotations

import math
from typing import Final

from posfet_core import scan_path
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.grid import compiled_layout

LEAST_SPREAD: Final = 0.3
"""Spread of the elastomer skin from which a neighbour responds to every touch [pitch]."""


def neighbour_share(pitch: float, spread: float) -> float:
    """Return q1/q0, the force on a neighbour over that on the cell under a point load at its centre [1].

    Parameters
    ----------
    pitch : float
        Distance of the cells [m], > 0.
    spread : float
        Standard deviation of the spread by the skin [m], >= 0.

    Examples
    --------
    >>> round(neighbour_share(1.5e-3, 0.6e-3), 4)
    0.1338
    """
    if spread == 0.0:
        return 0.0
    reach = 0.5 * pitch / (math.sqrt(2.0) * spread)
    own = math.erf(reach)
    return 0.5 * (math.erf(3.0 * reach) - own) / own if own > 0.0 else 1.0


class SkinResponse(scan_path.SkinResponse):
    """Tests whether the neighbours of taxels feel what the skin must let them feel of a touch.

    `contradicts` takes the forces of all taxels or their changes, of either sign and in any unit, the variance of each,
    the taxels whose forces are known, and the standard deviations by which the neighbours must miss what they had to
    feel; and whether a single neighbour along an axis counts, too: for loads up to the centre of an outermost cell. It
    returns the mask of the taxels whose neighbours feel clearly less than they must along some axis, and that of those
    with neighbours enough along some axis. Along an axis on which a neighbour is not known, nothing is tested.

    Parameters
    ----------
    sensor : Sensor
        Description of the sensor.
    """

    def __init__(self, sensor: Sensor) -> None:
        layout, spread = sensor.layout, sensor.device.contact_spread
        share_x, share_y = (
            neighbour_share(pitch, spread) if spread >= LEAST_SPREAD * pitch else math.nan
            for pitch in (layout.pitch_x, layout.pitch_y)
        )
        super().__init__(compiled_layout(layout), share_x, share_y)
