# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Serialise TactileContacts: constant parts are prepared once, variable parts are written into one buffer.

Little-endian CDR, encoding version 1 (OMG, DDS-XTypes 1.3, section 7.4.3), with alignment relative to the end of the
four-byte encapsulation header. Before it is used, the result is compared with that of the middleware for the same
contacts (`conversions.contacts_writer`).
"""

from __future__ import annotations

import math
import struct
from functools import lru_cache
from typing import Final

from posfet_model._lib.units import NANOSECONDS
from posfet_model.contacts.placement import placement_on
from posfet_model.contacts.slip import Motion
from posfet_model.contacts.tracker import Contact
from posfet_model.reconstruction.reconstructor import Reconstruction
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.surface import Surface

AT_REST: Final = Motion()
ENCODING: Final = b"\x00\x01\x00\x00"
_LENGTH: Final = struct.Struct("<I")
_END: Final = struct.Struct("<ff?")

_RESERVE: Final = 64
"""Bytes reserved after the last contact, enough for the rest of the message."""


class ContactsBytes:
    """Serialises the contacts of one array, with one buffer for all messages."""

    def __init__(self, sensor: Sensor, frame_id: str) -> None:
        self._place = placement_on(Surface.of(sensor.layout))
        self._limits = sensor.contact.threshold, sensor.contact.deadband
        frame, name = _text(frame_id), _text(sensor.name)
        # The stamp takes 8 bytes, so that alignment after it is the same as after the encapsulation header.
        self._before_sequence = _padded(frame, 4) + _LENGTH.pack(sensor.layout.id)
        self._before_sequence += bytes(-len(self._before_sequence) % 8)
        self._before_count = _padded(name, 4)
        begin = f"<4siI{len(self._before_sequence)}sQ{len(self._before_count)}sI"
        self._begin, self._empty = struct.Struct(begin), struct.Struct(begin + "ff?")
        self._buffer = bytearray(self._begin.size + _RESERVE)

    def fill(self, result: Reconstruction) -> bytes:
        """Return the serialised message for the contacts of a scan."""
        contacts, stamp = result.contacts, result.stamp
        begin = (
            ENCODING, stamp // NANOSECONDS, stamp % NANOSECONDS,
            self._before_sequence, result.sequence, self._before_count, len(contacts),
        )  # fmt: skip
        if not contacts:
            return self._empty.pack(*begin, *self._limits, result.valid)
        buffer, motions, at = self._buffer, result.motions, self._begin.size
        self._begin.pack_into(buffer, 0, *begin)
        for contact in contacts:
            at = self._write(at, contact, motions.get(contact.id, AT_REST))
        at += -at % 4
        _END.pack_into(buffer, at, *self._limits, result.valid)
        return bytes(buffer[: at + _END.size])

    def _write(self, at: int, contact: Contact, motion: Motion) -> int:
        """Write one contact at byte offset `at` and return the offset of its end."""
        region, buffer = contact.region, self._buffer
        taxels = region.taxels.tolist()
        merged = contact.merged_ids if contact.merged else ()
        layout = _layout((at - len(ENCODING)) % 8, len(merged), len(taxels))
        if at + layout.size + _RESERVE > len(buffer):
            buffer += bytes(at + layout.size + _RESERVE - len(buffer))
        head, tail = self._place(contact)
        age = round(contact.age * NANOSECONDS)
        layout.pack_into(
            buffer, at, contact.id, contact.state, len(merged), *merged, contact.split_from,
            *head, math.sqrt(region.force_variance), region.area, region.peak_pressure, *tail,
            motion.slipping, motion.vibration, age // NANOSECONDS, age % NANOSECONDS, len(taxels), *taxels,
        )  # fmt: skip
        return at + layout.size


def _text(text: str) -> bytes:
    data = text.encode() + b"\0"
    return _LENGTH.pack(len(data)) + data


def _padded(data: bytes, alignment: int) -> bytes:
    """Return data padded with zeros to a multiple of `alignment`."""
    return data + bytes(-len(data) % alignment)


@lru_cache(maxsize=256)
def _layout(at: int, merged: int, taxels: int) -> struct.Struct:
    """Return the layout of a contact at byte offset `at` modulo 8, with numbers of merged ids and of taxels."""
    first = -at % 4
    second = -(at + first + 16 + 4 * merged) % 8  # the centre of pressure is aligned to 8
    return struct.Struct(f"<{first}xIB3xI{merged}II{second}x21d3f4x9d?3xfiII{taxels}H")
