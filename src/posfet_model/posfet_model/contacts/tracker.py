"""Contacts followed from scan to scan: ids that persist through motion, merging and splitting; state, velocity, age.

Where two contacts become one region the older one goes on and remembers the other; when the region splits again, near
where it did, the remembered one comes back with its id and age. A contact that splits off and was never seen before
gets a new id, and names the one it came from.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Final, NamedTuple

from posfet_model.contacts.assignment import cheapest_pairs
from posfet_model.contacts.detection import Region
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.signal_chain import force_noise_rms

LAST_ID: Final = 0xFFFF_FFFF
"""Greatest id; the next one is 1 again."""

NOISE_GUARD: Final = 4.0
"""Standard deviations of the velocity's noise that do not count as motion [1]."""

TAXELS_ACROSS: Final = 3.0
"""Taxels whose noise adds up in one coordinate of the centre of pressure of a fingertip [1], assumed."""


LIFTED: Final = 2.0
"""A contact weaker than this when it ends has lifted, and has not merged with another [threshold]."""


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


class Contact(NamedTuple):
    """One contact at the time of a scan."""

    id: int
    state: ContactState
    region: Region
    """Where it touches and how hard; of a released contact the last geometry, with force 0."""
    velocity: tuple[float, float]
    """Velocity (x, y) of the centre of pressure [m/s], low-passed; NaN in the first scan."""
    age: float
    """Time since the contact began [s]."""
    merged: tuple[Merged, ...] = ()
    """Contacts that became one with this one, in order; they come back when it splits, and end when it ends."""
    split_from: int = 0
    """Id of the contact this one split off from, 0 for none."""

    @property
    def merged_ids(self) -> tuple[int, ...]:
        """Ids of `merged`."""
        return tuple(past.id for past in self.merged)


class Merged(NamedTuple):
    """A contact that became one with another."""

    id: int
    age: float
    """Its age then [s], less that of the contact it merged with."""
    offset: tuple[float, float]
    """Its centre of pressure then, from that of the contact it merged with (x, y) [m]."""
    split_from: int


class ContactTracker:
    """Gives regions the ids of the contacts they continue, so that all centres of pressure together move least."""

    def __init__(self, sensor: Sensor, settings: TrackerSettings | None = None) -> None:
        self._settings = settings or TrackerSettings()
        self._pitch = max(sensor.layout.pitch_x, sensor.layout.pitch_y)
        self._reach = self._settings.reach * self._pitch
        self._threshold = sensor.contact.threshold
        self._noise = NOISE_GUARD * TAXELS_ACROSS * self._pitch * force_noise_rms(sensor) / self._settings.smoothing
        self._contacts: tuple[Contact, ...] = ()
        self._next_id = 1

    @property
    def idle(self) -> bool:
        """Whether there is no contact that could go on or be released."""
        return not self._contacts

    @property
    def regions(self) -> list[Region]:
        """Where the contacts were in the last scan."""
        return [contact.region for contact in self._contacts]

    def update(self, regions: list[Region], step: float) -> tuple[Contact, ...]:
        """Return the contacts of a scan a step [s] after the last one, ascending by id, released ones among them."""
        if len(regions) == len(self._contacts) == 1 and self._distance(self._contacts[0], regions[0]) <= self._reach:
            self._contacts = (self._follow(self._contacts[0], regions[0], step),)
            return self._contacts
        pairs = self._pairs(regions)
        if len(pairs) == len(regions) == len(self._contacts):
            pairing = enumerate(self._contacts)
            self._contacts = tuple([self._follow(contact, regions[pairs[track]], step) for track, contact in pairing])
            return self._contacts
        followed, ended = self._change(pairs, regions, step)
        self._contacts = tuple(sorted(followed, key=_id))
        return tuple(sorted((*followed, *ended), key=_id)) if ended else self._contacts

    def _change(self, pairs: dict[int, int], regions: list[Region], step: float) -> tuple[list[Contact], list[Contact]]:
        """Follow contacts of which some begin, end, merge or split; return those that go on, and those that ended."""
        before = list(self._contacts)
        merging = self._merging(pairs, regions)
        for track, into in merging.items():
            # The older one goes on, wherever the centre of both is.
            if before[track].age > before[into].age:
                pairs[track] = pairs.pop(into)
        joined: dict[int, list[Contact]] = {}
        for track, into in merging.items():
            stays, goes = (track, into) if track in pairs else (into, track)
            joined.setdefault(stays, []).append(before[goes])
        followed = {index: self._follow(before[track], regions[index], step) for track, index in pairs.items()}
        for track, others in joined.items():
            index = pairs[track]
            now = _unmoved(followed[index], before[track])
            followed[index] = now._replace(merged=now.merged + _merged(before[track], others))
        gone = [contact for track, contact in enumerate(before) if track not in pairs]
        absorbed = {contact.id for others in joined.values() for contact in others}
        ended = [self._release(contact, step) for contact in gone if contact.id not in absorbed]
        for index in range(len(regions)):
            if index not in followed:
                self._split(index, regions, pairs, followed)
        return list(followed.values()), ended

    def _merging(self, pairs: dict[int, int], regions: list[Region]) -> dict[int, int]:
        """Return which contacts without a region lie in that of which other one."""
        found: dict[int, int] = {}
        owner = {index: track for track, index in pairs.items()}
        for track, contact in enumerate(self._contacts):
            if track in pairs or contact.region.force < LIFTED * self._threshold:
                continue
            for index, region in enumerate(regions):
                into = owner.get(index, -1)
                if into >= 0 and contact.region.bits & region.bits and into not in found.values():
                    # The force of both is there; else one has lifted from beside the other.
                    if region.force >= self._contacts[into].region.force + 0.5 * contact.region.force:
                        found[track] = into
                    break
        return found

    def _split(self, index: int, regions: list[Region], pairs: dict[int, int], followed: dict[int, Contact]) -> None:
        """Add the contact of a region that no contact goes on in: one that comes back, splits off, or is new."""
        for track, other in pairs.items():
            if not self._contacts[track].region.bits & regions[index].bits:
                continue
            parent = followed[other]
            if not parent.merged:
                followed[other] = _unmoved(parent, self._contacts[track])
                followed[index] = self._begin(regions[index], parent.id)
                return
            there, here = regions[index].centre_of_pressure, regions[other].centre_of_pressure
            way = there[0] - here[0], there[1] - here[1]
            back = max(parent.merged, key=lambda past: past.offset[0] * way[0] + past.offset[1] * way[1])
            places = (other, index)
            if back.offset[0] * way[0] + back.offset[1] * way[1] < 0.0:
                places = (index, other)
                way = -way[0], -way[1]
            rest = tuple(past for past in parent.merged if past is not back)
            stays = _unmoved(parent._replace(region=regions[places[0]], merged=rest), self._contacts[track])
            followed[places[0]] = stays
            followed[places[1]] = Contact(
                back.id,
                ContactState.HELD,
                regions[places[1]],
                (0.0, 0.0),
                stays.age + back.age,
                split_from=back.split_from,
            )
            return
        followed[index] = self._begin(regions[index])

    def _pairs(self, regions: list[Region]) -> dict[int, int]:
        """Return which contact goes on in which region, by their indices, so that all together move the least."""
        places = [region.centre_of_pressure for region in regions]
        ways = [[math.dist(contact.region.centre_of_pressure, place) for place in places] for contact in self._contacts]
        pairs: dict[int, int] = {}
        for track, row in enumerate(ways):
            nearest = min(row, default=math.inf)
            if nearest <= self._reach:
                pairs[track] = row.index(nearest)
        if len(set(pairs.values())) == len(pairs):
            return pairs
        # To end and begin anew counts as much as the longest way that is still the same contact's.
        return cheapest_pairs([[way * way for way in row] for row in ways], self._reach**2)

    def _distance(self, contact: Contact, region: Region) -> float:
        return math.dist(contact.region.centre_of_pressure, region.centre_of_pressure)

    def _begin(self, region: Region, split_from: int = 0) -> Contact:
        contact = Contact(self._next_id, ContactState.NEW, region, (math.nan, math.nan), 0.0, split_from=split_from)
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
        return Contact(contact.id, state, region, (x, y), contact.age + step, contact.merged, contact.split_from)

    def _release(self, contact: Contact, step: float) -> Contact:
        region = contact.region._replace(force=0.0, peak_pressure=0.0)
        return contact._replace(state=ContactState.RELEASED, region=region, age=contact.age + step)


def _id(contact: Contact) -> int:
    return contact.id


def _unmoved(contact: Contact, before: Contact) -> Contact:
    """Return a contact whose centre jumped, as its region merged or split, with the motion it had before."""
    if before.state is ContactState.NEW:
        return contact._replace(state=ContactState.HELD, velocity=(0.0, 0.0))
    return contact._replace(state=before.state, velocity=before.velocity)


def _merged(contact: Contact, others: list[Contact]) -> tuple[Merged, ...]:
    """Return what a contact has to remember of others that became one with it, and of those that had with them."""
    here = contact.region.centre_of_pressure
    found: list[Merged] = []
    for other in others:
        there = other.region.centre_of_pressure
        offset = there[0] - here[0], there[1] - here[1]
        later = other.age - contact.age
        found.append(Merged(other.id, later, offset, other.split_from))
        found += [past._replace(age=past.age + later, offset=offset) for past in other.merged]
    return tuple(found)
