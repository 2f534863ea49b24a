# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Contacts in space, as the numbers of the fields of posfet_msgs/TactileContact in sequence.

Only the normal force is measured. `force` is the normal force alone, which stays complete when the vector is
transformed into another frame; unknown components as NaN would spread to all of them. The covariance is that of this
vector, and all zeros where it is unknown, as in sensor_msgs/Imu.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, TypeAlias

from posfet_model.contacts.tracker import Contact
from posfet_model.sensor.surface import FLAT_NORMAL, Surface

Placed: TypeAlias = "tuple[tuple[float, ...], tuple[float, ...]]"
"""Centre of pressure, geometric centre, normal, force and covariance; then major axis, minor axis and velocity."""

_ZEROS: Final = (0.0,) * 8


def placement_on(surface: Surface) -> Callable[[Contact], Placed]:
    """Return the function that gives the placement of a contact on a surface.

    Parameters
    ----------
    surface : Surface
        Surface of the array, flat or bent.

    Returns
    -------
    callable
        Function of a `Contact` that returns its vectors in the frame of the array [m, N, N2, m/s].
    """
    return _place_flat if surface.flat else lambda contact: _place_bent(surface, contact)


def _place_flat(contact: Contact) -> Placed:
    region, (speed_x, speed_y) = contact.region, contact.velocity
    variance = region.force_variance
    head = (
        *region.centre_of_pressure, 0.0, *region.geometric_centre, 0.0, *FLAT_NORMAL,
        0.0, 0.0, -region.force, *_ZEROS, 0.0 if math.isnan(variance) else variance,
    )  # fmt: skip
    rest = math.nan if math.isnan(speed_x) else 0.0
    return head, (*region.major_axis, 0.0, *region.minor_axis, 0.0, speed_x, speed_y, rest)


def _place_bent(surface: Surface, contact: Contact) -> Placed:
    region = contact.region
    x, y = region.centre_of_pressure
    normal = surface.normal(x, y)
    variance = 0.0 if math.isnan(region.force_variance) else region.force_variance
    head = (
        *surface.point(x, y), *surface.point(*region.geometric_centre), *normal,
        *(-region.force * part for part in normal),
        *(variance * row * column for row in normal for column in normal),
    )  # fmt: skip
    in_surface = (region.major_axis, region.minor_axis, contact.velocity)
    return head, tuple(part for vector in in_surface for part in surface.along(x, y, vector))
