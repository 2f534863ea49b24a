"""A TactileContacts as bytes: what never changes is written once, the rest is patched in place.

Little-endian CDR, encoding version 1 (OMG, DDS-XTypes 1.3, section 7.4.3), in which alignment counts from behind the
four bytes that tell the encoding. Before it is used it is compared with what the middleware makes of the same contacts
(`conversions.contacts_writer`).
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

_ROOM: Final = 64
"""Bytes behind the last contact that are enough for what follows."""


class ContactsBytes:
    """Serialises the contacts of one array, again and again into the same buffer."""

    def __init__(self, sensor: Sensor, frame_id: str) -> None:
        self._place = placement_on(Surface.of(sensor.layout))
        self._limits = sensor.contact.threshold, sensor.contact.deadband
        frame, name = _text(frame_id), _text(sensor.name)
        # Behind the stamp 8 bytes are aligned as they are behind the encoding, so gaps are of whole groups of 8.
        self._before_sequence = _gap(frame, 4) + _LENGTH.pack(sensor.layout.id)
        self._before_sequence += bytes(-len(self._before_sequence) % 8)
        self._before_count = _gap(name, 4)
        begin = f"<4siI{len(self._before_sequence)}sQ{len(self._before_count)}sI"
        self._begin, self._empty = struct.Struct(begin), struct.Struct(begin + "ff?")
        self._buffer = bytearray(self._begin.size + _ROOM)

    def fill(self, result: Reconstruction) -> bytes:
        """Return the message of the contacts of a scan."""
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
        """Write one contact from byte `at` on; return where it ends."""
        region, buffer = contact.region, self._buffer
        taxels = region.taxels.tolist()
        merged = contact.merged_ids if contact.merged else ()
        form = _form((at - len(ENCODING)) % 8, len(merged), len(taxels))
        if at + form.size + _ROOM > len(buffer):
            buffer += bytes(at + form.size + _ROOM - len(buffer))
        head, tail = self._place(contact)
        age = round(contact.age * NANOSECONDS)
        form.pack_into(
            buffer, at, contact.id, contact.state, len(merged), *merged, contact.split_from,
            *head, math.sqrt(region.force_variance), region.area, region.peak_pressure, *tail,
            motion.slipping, motion.vibration, age // NANOSECONDS, age % NANOSECONDS, len(taxels), *taxels,
        )  # fmt: skip
        return at + form.size


def _text(text: str) -> bytes:
    data = text.encode() + b"\0"
    return _LENGTH.pack(len(data)) + data


def _gap(data: bytes, alignment: int) -> bytes:
    """Return data that begin aligned, with the zeros up to what comes next."""
    return data + bytes(-len(data) % alignment)


@lru_cache(maxsize=256)
def _form(at: int, merged: int, taxels: int) -> struct.Struct:
    """Return the form of a contact with so many ids merged in it and so many taxels, from byte `at` of eight on."""
    first = -at % 4
    second = -(at + first + 16 + 4 * merged) % 8  # the centre of pressure is aligned to 8
    return struct.Struct(f"<{first}xIB3xI{merged}II{second}x21d3f4x9d?3xfiII{taxels}H")
