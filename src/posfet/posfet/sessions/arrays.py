# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Many scans of a session as arrays."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from posfet.sessions.frames import CONTACT_DTYPE, Frame, row
from posfet_model.sensor.scan import TEMPERATURE_SENSORS


@dataclass(frozen=True, eq=False, repr=False)
class Arrays:
    """Consecutive scans as arrays, one row for each; unknown values are NaN."""

    time: NDArray[np.float64]
    """Time since the first scan of the session [s], shape [scans]."""
    stamp: NDArray[np.int64]
    """Acquisition time [ns] since the Unix epoch; of a simulated board since its start, shape [scans]."""
    sequence: NDArray[np.int64]
    """Sequence, shape [scans]."""
    valid: NDArray[np.bool_]
    """Whether the forces are fit for control, shape [scans]."""
    counts: NDArray[np.uint16]
    """ADC codes on a 16-bit scale, shape [scans, rows, cols]."""
    temperatures: NDArray[np.float32]
    """Temperature sensors of the chip [degC], shape [scans, 2]."""
    force: NDArray[np.float32]
    """Force on each taxel [N], positive when pushed, shape [scans, rows, cols]."""
    standard_deviation: NDArray[np.float32]
    """Standard uncertainty of each force [N], shape [scans, rows, cols]."""
    status: NDArray[np.uint8]
    """Values of `posfet_model.TaxelStatus`, shape [scans, rows, cols]."""
    total: NDArray[np.float64]
    """Total force [N], shape [scans]."""
    total_std: NDArray[np.float64]
    """Standard uncertainty of the total force [N], shape [scans]."""
    wrench: NDArray[np.float64]
    """Force [N] on the sensor and torque [N m] about the middle of the array, shape [scans, 6]."""
    contacts: NDArray[np.void]
    """Contacts of all scans, one row for each contact in each scan, with the fields of
    `posfet.sessions.frames.CONTACT_DTYPE`; `pandas.DataFrame` takes it."""
    true_force: NDArray[np.float64]
    """True force on each taxel [N], shape [scans, rows, cols]; NaN without ground truth."""
    true_film_temperature: NDArray[np.float64]
    """True temperature of the film [degC], shape [scans]; NaN without ground truth."""

    def __len__(self) -> int:
        return len(self.time)

    def __repr__(self) -> str:
        shapes = ", ".join(f"{name}{list(array.shape)}" for name, array in self.as_dict().items())
        return f"<posfet.Arrays {shapes}>"

    def as_dict(self) -> dict[str, NDArray[np.generic]]:
        """Return the arrays by name, as for ``numpy.savez(path, **arrays.as_dict())``."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


def collect(frames: Iterable[Frame], rows: int, cols: int) -> Arrays:
    """Return frames as arrays.

    Parameters
    ----------
    frames : iterable of Frame
        The frames.
    rows : int
        Rows of the array.
    cols : int
        Columns of the array.
    """
    kept = list(frames)
    grid = len(kept), rows, cols
    unknown = np.full((rows, cols), np.nan)
    truths = [frame.truth for frame in kept]
    return Arrays(
        time=np.array([frame.time for frame in kept], np.float64),
        stamp=np.array([frame.stamp for frame in kept], np.int64),
        sequence=np.array([frame.sequence for frame in kept], np.int64),
        valid=np.array([frame.valid for frame in kept], np.bool_),
        counts=np.array([frame.scan.counts for frame in kept], np.uint16).reshape(grid),
        temperatures=np.array([frame.scan.temperatures for frame in kept], np.float32).reshape(-1, TEMPERATURE_SENSORS),
        force=np.array([frame.image.force for frame in kept], np.float32).reshape(grid),
        standard_deviation=np.array([frame.image.standard_deviation for frame in kept], np.float32).reshape(grid),
        status=np.array([frame.image.status for frame in kept], np.uint8).reshape(grid),
        total=np.array([frame.image.total for frame in kept], np.float64),
        total_std=np.array([frame.image.total_std for frame in kept], np.float64),
        wrench=np.array([(*frame.wrench.force, *frame.wrench.torque) for frame in kept], np.float64).reshape(-1, 6),
        contacts=np.array([row(frame, each) for frame in kept for each in frame.contacts], CONTACT_DTYPE),
        true_force=np.array([truth.force if truth else unknown for truth in truths], np.float64).reshape(grid),
        true_film_temperature=np.array([truth.film_temperature if truth else np.nan for truth in truths], np.float64),
    )
