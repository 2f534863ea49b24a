# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""What a session yields: contacts, force images, wrenches and ground truth of one scan, as NumPy arrays in SI units.

All vectors are in the frame of the array: origin in the middle of the array, x along the columns, y along the rows, z
out of the sensor. Each object is independent of the session: later scans do not change it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, overload

import numpy as np
from numpy.typing import NDArray

from posfet_model.contacts.tracker import ContactState
from posfet_model.reconstruction.reconstructor import InvalidReason
from posfet_model.sensor.scan import Scan
from posfet_sim.loads import ObjectsState

CONTACT_DTYPE: Final = np.dtype(
    [
        ("time", np.float64),
        ("sequence", np.int64),
        ("id", np.uint32),
        ("state", np.uint8),
        *((name, np.float64) for name in ("x", "y", "z", "force", "force_std", "area", "peak_pressure")),
        *((name, np.float64) for name in ("vx", "vy", "vz", "age", "vibration")),
        ("slipping", np.bool_),
    ]
)
"""Fields of contacts as a structured array: SI units as in `Contact`; `state` has the values of `ContactState`."""


@dataclass(frozen=True, slots=True, eq=False)
class Contact:
    """One tracked contact."""

    id: int
    """Track id, which persists while the contact moves."""
    state: ContactState
    """NEW, HELD, MOVING, or, once, RELEASED."""
    position: NDArray[np.float64]
    """Centre of pressure [m], shape [3]."""
    normal: NDArray[np.float64]
    """Outward unit normal of the surface there, shape [3]."""
    force: float
    """Normal force [N], positive when pushed; NaN: unknown."""
    force_std: float
    """Standard uncertainty of the force [N]; NaN: unknown, the force is a lower bound."""
    area: float
    """Area of the taxels in contact [m2]."""
    peak_pressure: float
    """Greatest pressure on a taxel [Pa]; NaN: unknown."""
    velocity: NDArray[np.float64]
    """Velocity of the centre of pressure [m/s], shape [3]; NaN in the first scan."""
    age: float
    """Time since the contact began [s]."""
    slipping: bool
    """Whether the contact slips."""
    vibration: float
    """Root mean square of the force above the corner frequency of the dynamic channel [N]."""
    taxels: NDArray[np.intp]
    """Indices of the taxels in contact, row by row from 0, shape [k]."""

    def __repr__(self) -> str:
        x, y, _ = self.position * 1e3
        return f"<Contact #{self.id} {self.state.name.lower()} {self.force:.3f} N at ({x:+.2f}, {y:+.2f}) mm>"


@dataclass(frozen=True, slots=True, eq=False)
class Stamped:
    """What every result of a scan has."""

    time: float
    """Acquisition time [s] since the first scan of the session."""
    stamp: int
    """Acquisition time [ns] since the Unix epoch; of a simulated board since its start."""
    sequence: int
    """Sequence of the scan."""
    valid: bool
    """False: not fit for control."""


@dataclass(frozen=True, slots=True, eq=False)
class Contacts(Stamped, Sequence[Contact]):
    """The contacts of one scan, ascending by id: a sequence of `Contact`; released ones once."""

    items: tuple[Contact, ...]
    """The contacts."""
    reasons: InvalidReason
    """Why they are not valid; NONE if they are."""

    @overload
    def __getitem__(self, index: int) -> Contact: ...

    @overload
    def __getitem__(self, index: slice) -> Sequence[Contact]: ...

    def __getitem__(self, index: int | slice) -> Contact | Sequence[Contact]:
        return self.items[index]

    def __len__(self) -> int:
        return len(self.items)

    def __iter__(self) -> Iterator[Contact]:
        return iter(self.items)

    def array(self) -> NDArray[np.void]:
        """Return the contacts as a structured array with the fields of `CONTACT_DTYPE`, shape [contacts]."""
        return np.array([row(self, contact) for contact in self.items], CONTACT_DTYPE)


def row(scan: Stamped, contact: Contact) -> tuple[object, ...]:
    """Return a contact as one row of `CONTACT_DTYPE`.

    Parameters
    ----------
    scan : Stamped
        Time and sequence.
    contact : Contact
        The contact.
    """
    return (
        scan.time, scan.sequence, contact.id, contact.state, *contact.position, contact.force, contact.force_std,
        contact.area, contact.peak_pressure, *contact.velocity, contact.age, contact.vibration, contact.slipping,
    )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Image(Stamped):
    """Force image of one scan."""

    force: NDArray[np.float32]
    """Force on each taxel [N], shape [rows, cols], positive when pushed; NaN: unknown."""
    standard_deviation: NDArray[np.float32]
    """Standard uncertainty of each force [N], shape [rows, cols]; NaN: unknown."""
    status: NDArray[np.uint8]
    """Values of `posfet_model.TaxelStatus`, shape [rows, cols]."""
    total: float
    """Total force [N]; NaN: unknown."""
    total_std: float
    """Standard uncertainty of the total force [N]; NaN: unknown."""


@dataclass(frozen=True, slots=True, eq=False)
class Wrench(Stamped):
    """Total force on the sensor, normal forces only, and its torque about the middle of the array."""

    force: NDArray[np.float64]
    """Force on the sensor [N], shape [3]: a push has a negative z component; NaN while not valid."""
    torque: NDArray[np.float64]
    """Torque [N m], shape [3]; NaN while not valid."""
    covariance: NDArray[np.float64]
    """Covariance of force and torque [N2, N2 m, N2 m2], shape [6, 6]; NaN while not valid."""


@dataclass(frozen=True, slots=True, eq=False)
class GroundTruth:
    """What really acts on a simulated sensor at the time of a scan."""

    sequence: int
    """Sequence of the scan."""
    force: NDArray[np.float64]
    """Force on each taxel [N], shape [rows, cols], positive when pushed."""
    chip_temperature: float
    """Temperature of the chip [degC]."""
    film_temperature: float
    """Temperature of the film [degC]."""
    taxel_status: NDArray[np.uint8]
    """Fault of each taxel, values of `posfet_model.TaxelStatus`, shape [rows, cols]."""
    objects: ObjectsState
    """Poses [m] and contacts [m, N] of the objects."""


@dataclass(frozen=True, slots=True, eq=False)
class Frame(Stamped):
    """Everything about one scan."""

    scan: Scan
    """The scan as acquired; its `counts` have shape [rows * cols]."""
    contacts: Contacts
    """Contacts."""
    image: Image
    """Force image."""
    wrench: Wrench
    """Total force and torque."""
    truth: GroundTruth | None
    """Ground truth; None: not simulated, or not recorded."""
