# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Description of an array for display, from the message `info`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class ArrayView:
    """Geometry and range of one array."""

    name: str
    serial: str
    """Serial number; '': unknown."""
    simulated: bool
    rows: int
    cols: int
    pitch: tuple[float, float]
    """Distance between neighbouring taxels along x and y [m]."""
    bend_radius: float
    """Radius of the cylinder that the chip is bent to [m]; inf: flat."""
    bend_axis: str
    """Direction of the cylinder's axis, x or y."""
    force_max: float
    """Upper end of the measuring range of a taxel [N]."""
    threshold: float
    """Force at which a taxel enters a contact [N]."""
    scan_rate: float
    """Nominal rate of scans [Hz]."""

    def on_surface(self, x: float, y: float, z: float) -> tuple[float, float]:
        """Return the coordinates along the surface [m] of a point of the surface in the frame of the array [m]."""
        if math.isinf(self.bend_radius):
            return x, y
        height = self.bend_radius + z
        if self.bend_axis == "x":
            return x, self.bend_radius * math.atan2(y, height)
        return self.bend_radius * math.atan2(x, height), y


def array_view(info: Any) -> ArrayView:
    """Return the description in a message posfet_msgs/TactileInfo.

    Parameters
    ----------
    info : TactileInfo
        The message.
    """
    axis, radius = _bend(info)
    return ArrayView(
        name=info.name,
        serial=info.serial,
        simulated=info.simulated,
        rows=info.rows,
        cols=info.cols,
        pitch=(float(info.pitch[0]), float(info.pitch[1])),
        bend_radius=radius,
        bend_axis=axis,
        force_max=info.force_max,
        threshold=info.contact_threshold,
        scan_rate=info.scan_rate,
    )


def _bend(info: Any) -> tuple[str, float]:
    """Return axis and radius of the cylinder: the first taxel's normal is tilted by half the array's width."""
    turned = info.taxel_poses[0].orientation
    half_width = 0.5 * (info.cols - 1) * float(info.pitch[0]), 0.5 * (info.rows - 1) * float(info.pitch[1])
    if turned.x:
        return "x", half_width[1] / abs(2.0 * math.asin(turned.x))
    if turned.y:
        return "y", half_width[0] / abs(2.0 * math.asin(turned.y))
    return "x", math.inf
