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


def _text(text: str) -> bytes:
    data = text.encode() + b"\0"
    return _LENGTH.pack(len(data)) + data


def _gap(data: bytes, alignment: int) -> bytes:
    """Return data that begin aligned, with the zeros up to what comes next."""
    return data + bytes(-len(data) % alignment)


@lru_cache(maxsize=256)
def _body(taxels: int) -> struct.Struct:
    """Return the form of a contact's fields from the centre of pressure on, which is aligned to 8, to its taxels."""
    return struct.Struct(f"<21d3f4x9d?3xfiII{taxels}H")
