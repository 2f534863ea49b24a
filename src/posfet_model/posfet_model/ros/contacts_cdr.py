# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Serialised TactileContacts.

Before it is used, the result is compared with that of the middleware for the same contacts
(`contacts_message.contacts_writer`).
"""

from __future__ import annotations

from typing import Final

from posfet_model.contacts.slip import Motion
from posfet_model.reconstruction.contacts_writer import ContactsWriter
from posfet_model.reconstruction.reconstructor import Reconstruction
from posfet_model.sensor.description import Sensor

AT_REST: Final = Motion()


class ContactsBytes:
    """Serialises the contacts of one array, with one buffer for all messages."""

    def __init__(self, sensor: Sensor, frame_id: str) -> None:
        self.writer: Final = ContactsWriter(sensor, frame_id)
        """Writes the messages."""

    def fill(self, result: Reconstruction) -> bytes:
        """Return the serialised message for the contacts of a scan."""
        return result.serialise(self.writer)
