"""Contacts followed from scan to scan: ids that persist, state, velocity, age."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Final

from posfet_model.chain import noise_of_a_scan
from posfet_model.contacts import Region
from posfet_model.sensor import Sensor

LAST_ID: Final = 0xFFFF_FFFF
"""Greatest id; the next one is 1 again."""

NOISE_GUARD: Final = 4.0
"""Standard deviations of the velocity's noise that do not count as motion [1]."""

TAXELS_ACROSS: Final = 3.0
"""Taxels whose noise adds up in one coordinate of the centre of pressure of a fingertip [1], assumed."""


class ContactState(IntEnum):
    """State of a contact; the values are those of STATE_* in posfet_msgs/TactileContact."""

    NEW = 0
    HELD = 1
    MOVING = 2
    RELEASED = 3


@dataclass(frozen=True)
class TrackerSettings:
    """When a contact is the same and when it moves. All values are assumed."""

    reach: float = 1.5
    """A contact is the same when its centre of pressure moved by at most this from one scan to the next [pitch]."""
    smoothing: float = 0.02
    """Time constant of the velocity's low pass [s]."""
    start_speed: float = 2e-3
    """A contact moves from this speed on [m/s]."""
    stop_speed: float = 1e-3
    """A moving contact rests below this speed [m/s]."""


@dataclass(frozen=True, slots=True)
class Contact:
    """One contact at the time of a scan."""

    id: int
    state: ContactState
    region: Region
    """Where it touches and how hard; of a released contact the last geometry, with force 0."""
    velocity: tuple[float, float]
    """Velocity (x, y) of the centre of pressure [m/s], low-passed; NaN in the first scan."""
    age: float
    """Time since the contact began [s]."""


class ContactTracker:
    """Gives regions the ids of the contacts they continue: nearest centre of pressure first."""

    def __init__(self, sensor: Sensor, settings: TrackerSettings | None = None) -> None:
        self._settings = settings or TrackerSettings()
        self._pitch = max(sensor.layout.pitch_x, sensor.layout.pitch_y)
        self._noise = NOISE_GUARD * TAXELS_ACROSS * self._pitch * noise_of_a_scan(sensor) / self._settings.smoothing
        self._contacts: tuple[Contact, ...] = ()
        self._next_id = 1

    @property
    def idle(self) -> bool:
        """Whether there is no contact that could go on or be released."""
        return not self._contacts

    def update(self, regions: list[Region], step: float) -> tuple[Contact, ...]:
        """Return the contacts of a scan a step [s] after the last one, ascending by id, released ones among them."""
        free = list(range(len(regions)))
        followed = []
        for track, index in self._pairs(regions):
            free.remove(index)
            followed.append(self._follow(self._contacts[track], regions[index], step))
        ids = {contact.id for contact in followed}
        ended = [self._release(contact, step) for contact in self._contacts if contact.id not in ids]
        new = [self._begin(regions[index]) for index in free]
        self._contacts = tuple(sorted(followed + new, key=lambda contact: contact.id))
        if not ended:
            return self._contacts
        return tuple(sorted((*self._contacts, *ended), key=lambda contact: contact.id))

    def _pairs(self, regions: list[Region]) -> list[tuple[int, int]]:
        """Return which contact goes on in which region, as pairs of indices, the nearest pairs first."""
        reach = self._settings.reach * self._pitch
        distances = sorted(
            (distance, track, index)
            for track, contact in enumerate(self._contacts)
            for index, region in enumerate(regions)
            if (distance := math.dist(contact.region.centre_of_pressure, region.centre_of_pressure)) <= reach
        )
        pairs: list[tuple[int, int]] = []
        for _, track, index in distances:
            if all(track != other_track and index != other_index for other_track, other_index in pairs):
                pairs.append((track, index))
        return pairs

    def _begin(self, region: Region) -> Contact:
        contact = Contact(self._next_id, ContactState.NEW, region, (math.nan, math.nan), 0.0)
        self._next_id = self._next_id % LAST_ID + 1
        return contact

    def _follow(self, contact: Contact, region: Region, step: float) -> Contact:
        share = -math.expm1(-step / self._settings.smoothing)
        was, now = contact.region.centre_of_pressure, region.centre_of_pressure
        old_x, old_y = contact.velocity if contact.state is not ContactState.NEW else (0.0, 0.0)
        x = old_x + share * ((now[0] - was[0]) / step - old_x)
        y = old_y + share * ((now[1] - was[1]) / step - old_y)
        moved = contact.state is ContactState.MOVING
        limit = self._settings.stop_speed if moved else self._settings.start_speed
        limit = max(limit, self._noise / region.force) if region.force > 0 else math.inf
        state = ContactState.MOVING if math.hypot(x, y) > limit else ContactState.HELD
        return Contact(contact.id, state, region, (x, y), contact.age + step)

    def _release(self, contact: Contact, step: float) -> Contact:
        region = replace(contact.region, force=0.0, peak_pressure=0.0)
        return replace(contact, state=ContactState.RELEASED, region=region, age=contact.age + step)
