# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Contacts as TactileContacts, by message objects or as bytes."""

from __future__ import annotations

import math
from array import array

import numpy as np
from rclpy.serialization import deserialize_message, serialize_message

from posfet_model._lib.units import NANOSECONDS
from posfet_model.contacts.detection import Region
from posfet_model.contacts.placement import Placed, placement_on
from posfet_model.contacts.slip import Motion
from posfet_model.contacts.tracker import Contact, ContactState, Merged
from posfet_model.reconstruction.reconstructor import Reconstruction
from posfet_model.ros.contacts_cdr import AT_REST, ContactsBytes
from posfet_model.ros.message_fields import LARGEST_INT32, set_stamp, set_vector
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.surface import Surface
from posfet_msgs.msg import TactileContact, TactileContacts


class ContactsMessage:
    """A TactileContacts; the message objects of the contacts are reused as well."""

    def __init__(self, sensor: Sensor, frame_id: str) -> None:
        self._message = TactileContacts(layout_id=sensor.layout.id, name=sensor.name)
        self._message.header.frame_id = frame_id
        self._message.threshold = sensor.contact.threshold
        self._message.deadband = sensor.contact.deadband
        self._place = placement_on(Surface.of(sensor.layout))
        self._pool: list[TactileContact] = []

    def fill(self, result: Reconstruction) -> TactileContacts:
        """Return the message; the next call overwrites it."""
        message, contacts = self._message, result.contacts
        while len(self._pool) < len(contacts):
            self._pool.append(TactileContact())
        set_stamp(message.header.stamp, result.stamp)
        message.sequence = result.sequence
        message.data_valid = result.valid
        message.contacts = self._pool[: len(contacts)]
        for slot, contact in zip(self._pool, contacts, strict=False):
            _fill_contact(slot, contact, self._place(contact), result.motions.get(contact.id, AT_REST))
        return message


def _fill_contact(message: TactileContact, contact: Contact, placed: Placed, motion: Motion) -> None:
    region, (head, tail) = contact.region, placed
    message.id = contact.id
    message.state = int(contact.state)
    message.merged_ids = array("I", contact.merged_ids)
    message.split_from = contact.split_from
    set_vector(message.centre_of_pressure, head[:3])
    set_vector(message.geometric_centre, head[3:6])
    set_vector(message.normal, head[6:9])
    set_vector(message.force, head[9:12])
    message.force_covariance[:] = head[12:]
    message.normal_force_deviation = math.sqrt(region.force_variance)
    message.area = region.area
    message.peak_pressure = region.peak_pressure
    set_vector(message.major_axis, tail[:3])
    set_vector(message.minor_axis, tail[3:6])
    set_vector(message.velocity, tail[6:])
    message.slipping = motion.slipping
    message.vibration = motion.vibration
    message.age.sec, message.age.nanosec = divmod(round(contact.age * NANOSECONDS), NANOSECONDS)
    message.taxels = array("H", region.taxels.tolist())


def contacts_writer(sensor: Sensor, frame_id: str) -> ContactsMessage | ContactsBytes:
    """Return the fastest way to serialise contacts that gives the same bytes as the middleware.

    Parameters
    ----------
    sensor : Sensor
        Sensor description.
    frame_id : str
        Frame of the array.

    Returns
    -------
    ContactsMessage or ContactsBytes
        ContactsBytes if its bytes for examples with one, two and three taxels, which cover every alignment, are those
        of the middleware, otherwise ContactsMessage.
    """
    region = Region(
        np.arange(1), np.arange(1), (1e-3, 2e-3), (3e-3, 4e-3), 0.5, 0.25, 5e-6, 6.0, (7e-3, 8e-3), (9e-3, 1e-2)
    )
    first = Contact(LARGEST_INT32, ContactState.MOVING, region, (0.1, -0.2), 12.75)
    past = tuple(Merged(number, 0.0, (0.0, 0.0), 0) for number in (5, 6, 7))
    second = first._replace(id=2, region=region._replace(taxels=np.arange(2)), merged=past, split_from=8)
    third = first._replace(id=3, region=region._replace(taxels=np.arange(3)), merged=past[:1], velocity=(-0.3, 0.4))
    message, writer = ContactsMessage(sensor, frame_id), ContactsBytes(sensor, frame_id)
    for contacts in ((), (first, second, third), (second, first)):
        valid, motions = bool(contacts), {each.id: Motion(power=0.25, slipping=each is second) for each in contacts}
        example = Reconstruction(True, False, 1_700_000_000_123_456_789, 1 << 40, valid, contacts, motions, 0)
        theirs, ours = serialize_message(message.fill(example)), writer.fill(example)
        if len(theirs) != len(ours) or _read(theirs) != _read(ours):  # as messages, since padding bytes may differ
            return message
    return writer


def _read(data: bytes) -> TactileContacts:
    return deserialize_message(data, TactileContacts)
