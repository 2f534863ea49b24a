# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Serialised contacts of one sensor. Compiled: `posfet_core`, contacts_cdr.hpp."""

from __future__ import annotations

from posfet_core import scan_path
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.surface import Surface


class ContactsWriter(scan_path.ContactsWriter):
    """Writes the message TactileContacts of one sensor, with one buffer for all messages.

    `write_scan` returns that of the last scan of a compiled path, `write_contacts` that of given contacts.

    Parameters
    ----------
    sensor : Sensor
        Description of the sensor.
    frame_id : str
        Frame of the array.
    """

    def __init__(self, sensor: Sensor, frame_id: str) -> None:
        surface, contact = Surface.of(sensor.layout), sensor.contact
        super().__init__(
            frame=frame_id,
            layout_id=sensor.layout.id,
            name=sensor.name,
            threshold=contact.threshold,
            deadband=contact.deadband,
            radius=surface.radius,
            axis_x=surface.axis_x,
        )
