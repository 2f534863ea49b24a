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

from posfet_model.fast_channel import Motion
from posfet_model.placing import placing
from posfet_model.reconstruction import Reconstruction
from posfet_model.sensor import Sensor
from posfet_model.surface import Surface
from posfet_model.tracker import Contact

NANOSECONDS: Final = 1_000_000_000
AT_REST: Final = Motion()
ENCODING: Final = b"\x00\x01\x00\x00"
_STAMP: Final = struct.Struct("<iI")
_SEQUENCE: Final = struct.Struct("<Q")
_LENGTH: Final = struct.Struct("<I")
_END: Final = struct.Struct("<ff?")

_HEAD: Final = struct.Struct("<IB3xI")
"""Id and state of a contact, and number of ids merged in it."""
_ROOM: Final = 64
"""Bytes that a contact takes at most beside the ids merged in it and what follows them."""


class ContactsBytes:
    """Serialises the contacts of one array, again and again into the same buffer."""

    def __init__(self, sensor: Sensor, frame_id: str) -> None:
        self._place = placing(Surface.of(sensor.layout))
        self._buffer = bytearray(ENCODING)
        self._append(_STAMP.pack(0, 0), 4)
        self._append_text(frame_id)
        self._append(_LENGTH.pack(sensor.layout.id), 4)
        self._sequence = self._append(_SEQUENCE.pack(0), 8)
        self._append_text(sensor.name)
        self._count = self._append(_LENGTH.pack(0), 4)
        self._first = len(self._buffer)
        self._limits = sensor.contact.threshold, sensor.contact.deadband
        self._buffer += bytes(_ROOM)

    def fill(self, result: Reconstruction) -> bytes:
        """Return the message of the contacts of a scan."""
        buffer, contacts = self._buffer, result.contacts
        _STAMP.pack_into(buffer, len(ENCODING), *divmod(result.stamp, NANOSECONDS))
        _SEQUENCE.pack_into(buffer, self._sequence, result.sequence)
        _LENGTH.pack_into(buffer, self._count, len(contacts))
        at = self._first
        for contact in contacts:
            at = self._write(at, contact, result.motions.get(contact.id, AT_REST))
        at += -at % 4
        _END.pack_into(buffer, at, *self._limits, result.valid)
        return bytes(buffer[: at + _END.size])

    def _write(self, at: int, contact: Contact, motion: Motion) -> int:
        """Write one contact from byte `at` on; return where it ends."""
        region, buffer = contact.region, self._buffer
        taxels = region.taxels.tolist()
        body = _body(len(taxels))
        merged = contact.merged_ids if contact.merged else ()
        end = at + _ROOM + 4 * len(merged) + body.size
        if end > len(buffer):
            buffer += bytes(end + _ROOM - len(buffer))
        at += -at % 4
        _HEAD.pack_into(buffer, at, contact.id, contact.state, len(merged))
        at += _HEAD.size
        if merged:
            struct.pack_into(f"<{len(merged)}I", buffer, at, *merged)
            at += 4 * len(merged)
        _LENGTH.pack_into(buffer, at, contact.split_from)
        at += 4
        at += -(at - len(ENCODING)) % 8
        head, tail = self._place(contact)
        body.pack_into(
            buffer, at, *head, math.sqrt(region.force_variance), region.area, region.peak_pressure, *tail,
            motion.slipping, motion.vibration,
            *divmod(round(contact.age * NANOSECONDS), NANOSECONDS), len(taxels), *taxels,
        )  # fmt: skip
        return at + body.size

    def _append(self, data: bytes, alignment: int) -> int:
        """Append a number at its alignment; return where it is."""
        self._buffer += bytes(-(len(self._buffer) - len(ENCODING)) % alignment)
        at = len(self._buffer)
        self._buffer += data
        return at

    def _append_text(self, text: str) -> None:
        data = text.encode() + b"\0"
        self._append(_LENGTH.pack(len(data)), 4)
        self._buffer += data


@lru_cache(maxsize=256)
def _body(taxels: int) -> struct.Struct:
    """Return the form of a contact's fields from the centre of pressure on, which is aligned to 8, to its taxels."""
    return struct.Struct(f"<21d3f4x9d?3xfiII{taxels}H")
