# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Contact tracking from scan to scan: track ids that persist through motion, merge and split; state, velocity, age.

Where two contacts merge into one region the older one continues and stores the other; when the region splits again
close to the merge, the stored contact is restored with its id and age. A contact that splits off and was never stored
gets a new id, and refers to the one that it split off from.

Compiled: `posfet_core`, tracker.hpp.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from posfet_core import scan_path
from posfet_core.contact import Contact, ContactState, Merged
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.signal_chain import force_noise_rms

__all__ = ["LAST_ID", "Contact", "ContactState", "ContactTracker", "Merged", "TrackerSettings"]

LAST_ID: Final = scan_path.LAST_ID
"""Greatest id; the next one is 1."""


@dataclass(frozen=True)
class TrackerSettings:
    """Settings of data association and motion detection. All values are assumed."""

    gate: float = 1.5
    """Greatest distance of the centre of pressure from one scan to the next for the same contact [pitch]."""
    smoothing: float = 0.02
    """Time constant of the velocity's low-pass [s]."""
    start_speed: float = 2e-3
    """A contact moves from this speed on [m/s]."""
    stop_speed: float = 1e-3
    """A moving contact is held again below this speed [m/s]."""


class ContactTracker(scan_path.ContactTracker):
    """Data association of regions with contacts by the least sum of squared distances of the centres of pressure.

    Parameters
    ----------
    sensor : Sensor
        Description of the sensor.
    settings : TrackerSettings, optional
        Settings; None: the defaults.
    first_id : int, optional
        Id of the first contact, in [1, `LAST_ID`].
    """

    def __init__(self, sensor: Sensor, settings: TrackerSettings | None = None, first_id: int = 1) -> None:
        settings = settings or TrackerSettings()
        super().__init__(
            gate=settings.gate,
            smoothing=settings.smoothing,
            start_speed=settings.start_speed,
            stop_speed=settings.stop_speed,
            pitch=max(sensor.layout.pitch_x, sensor.layout.pitch_y),
            threshold=sensor.contact.threshold,
            noise=force_noise_rms(sensor),
            first_id=first_id,
        )
