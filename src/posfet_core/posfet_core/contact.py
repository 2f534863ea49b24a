# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Contacts: what is reported of each in a scan."""

from __future__ import annotations

import math
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class ContactState(IntEnum):
    """State of a contact; the values are those of STATE_* in posfet_msgs/TactileContact."""

    NEW = 0
    HELD = 1
    MOVING = 2
    RELEASED = 3


class Region(NamedTuple):
    """One connected region in contact, in the frame of the array."""

    touched: NDArray[np.intp]
    """Indices of the taxels in contact, ascending."""
    taxels: NDArray[np.intp]
    """Indices of the taxels that it lists, ascending: those in contact, or the neighbours of a noisy one."""
    centre_of_pressure: tuple[float, float]
    """(x, y) [m]."""
    geometric_centre: tuple[float, float]
    """(x, y) [m], mean position of the taxels that it lists."""
    force: float
    """Normal force, positive when pushed [N]; NaN when a taxel's force is unknown."""
    force_variance: float
    """Variance of the force [N2]; NaN with a saturated taxel, whose force is a lower bound."""
    area: float
    """Area of the cells of the taxels that it lists [m2]."""
    peak_pressure: float
    """Greatest force of a taxel over the area of a taxel [Pa]; NaN with a saturated taxel, or where that taxel is
    interpolated."""
    major_axis: tuple[float, float]
    """Major principal axis (x, y) of the force distribution, one standard deviation long [m]."""
    minor_axis: tuple[float, float]
    """Minor principal axis (x, y) of the force distribution, one standard deviation long [m]."""
    separated: bool = False
    """Whether a saddle separated it from others in the same connected region."""


class Merged(NamedTuple):
    """A contact that merged into another."""

    id: int
    """Track id."""
    age: float
    """Its age at the merge, less that of the contact that it merged into [s]."""
    offset: tuple[float, float]
    """Its centre of pressure at the merge, from that of the contact that it merged into (x, y) [m]."""
    split_from: int
    """Id of the contact that it split off from, 0 for none."""


class Contact(NamedTuple):
    """One contact at the time of a scan."""

    id: int
    """Track id, in [1, 2**32 - 1]."""
    state: ContactState
    """State of the contact."""
    region: Region
    """Geometry and force; of a released contact the last geometry, with force 0."""
    velocity: tuple[float, float]
    """Velocity (x, y) of the centre of pressure [m/s], low-pass filtered; NaN in the first scan."""
    age: float
    """Time since the contact began [s]."""
    merged: tuple[Merged, ...] = ()
    """Contacts that merged into this one, in order; they are restored when it splits, and end when it ends."""
    split_from: int = 0
    """Id of the contact that this one split off from, 0 for none."""

    @property
    def merged_ids(self) -> tuple[int, ...]:
        """Ids of the merged contacts."""
        return tuple(past.id for past in self.merged)


class Motion(NamedTuple):
    """Vibration and slip state of one contact."""

    power: float = 0.0
    """Mean square of its high-passed force [N2]."""
    slipping: bool = False
    """Whether the contact slips."""
    still: float = 0.0
    """Time below the end speed of a slip [s]."""

    @property
    def vibration(self) -> float:
        """Root mean square of the contact's force above the corner frequency [N]."""
        return math.sqrt(self.power)
