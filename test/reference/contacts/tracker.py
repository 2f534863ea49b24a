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
"""

from __future__ import annotations

import math
from typing import Final

from posfet_core.contact import Contact, ContactState, Merged
from posfet_model.contacts.tracker import TrackerSettings
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.signal_chain import force_noise_rms
from reference.contacts.assignment import minimum_cost_assignment
from reference.contacts.detection import Region

LAST_ID: Final = 0xFFFF_FFFF
"""Greatest id; the next one is 1."""

NOISE_DEVIATIONS: Final = 4.0
"""Standard deviations of the velocity's noise that do not count as motion [1]."""

TAXELS_ACROSS: Final = 3.0
"""Number of taxels whose noise contributes to one coordinate of a fingertip's centre of pressure [1], assumed."""

RELEASED_FORCE: Final = 2.0
"""A contact with less force than this when it ends was released, and did not merge with another [contact threshold]."""

MOST_MERGED: Final = 16
"""Greatest number of contacts that one stores [1]: of more, those that merged first have ended."""


class ContactTracker:
    """Data association of regions with contacts by the least sum of squared distances of the centres of pressure.

    Parameters
    ----------
    sensor : Sensor
        Description of the sensor.
    settings : TrackerSettings, optional
        Settings; None: the defaults.
    """

    def __init__(self, sensor: Sensor, settings: TrackerSettings | None = None) -> None:
        self._settings = settings or TrackerSettings()
        self._pitch = max(sensor.layout.pitch_x, sensor.layout.pitch_y)
        self._gate = self._settings.gate * self._pitch
        self._threshold = sensor.contact.threshold
        self._noise = (
            NOISE_DEVIATIONS * TAXELS_ACROSS * self._pitch * force_noise_rms(sensor) / self._settings.smoothing
        )
        self._contacts: tuple[Contact, ...] = ()
        self._next_id = 1

    @property
    def idle(self) -> bool:
        """Whether there is no contact that could continue or be released."""
        return not self._contacts

    @property
    def regions(self) -> list[Region]:
        """Regions of the contacts in the last scan."""
        return [contact.region for contact in self._contacts]

    def update(self, regions: list[Region], step: float) -> tuple[Contact, ...]:
        """Associate the regions of a scan with the contacts of the previous scan.

        Parameters
        ----------
        regions : list of Region
            Regions in contact.
        step : float
            Time since the previous scan [s], > 0.

        Returns
        -------
        tuple of Contact
            Contacts, ascending by id; those that ended in this scan are included once, as released.
        """
        if len(regions) == len(self._contacts) == 1 and self._distance(self._contacts[0], regions[0]) <= self._gate:
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
        """Update contacts of which some begin, end, merge or split; return the continuing ones and the ended ones."""
        before = list(self._contacts)
        merging = self._merging(pairs, regions)
        for track, into in merging.items():
            # The older one continues, wherever the common centre is.
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
            followed[index] = now._replace(merged=(now.merged + _merged(before[track], others))[-MOST_MERGED:])
        gone = [contact for track, contact in enumerate(before) if track not in pairs]
        absorbed = {contact.id for others in joined.values() for contact in others}
        ended = [self._release(contact, step) for contact in gone if contact.id not in absorbed]
        for index in range(len(regions)):
            if index not in followed:
                self._split(index, regions, pairs, followed)
        return list(followed.values()), ended

    def _merging(self, pairs: dict[int, int], regions: list[Region]) -> dict[int, int]:
        """Return for each contact without a region the contact whose region contains it."""
        found: dict[int, int] = {}
        owner = {index: track for track, index in pairs.items()}
        for track, contact in enumerate(self._contacts):
            if track in pairs or contact.region.force < RELEASED_FORCE * self._threshold:
                continue
            for index, region in enumerate(regions):
                into = owner.get(index, -1)
                if into >= 0 and contact.region.bits & region.bits and into not in found.values():
                    # The region carries the force of both; otherwise one was released beside the other.
                    if region.force >= self._contacts[into].region.force + 0.5 * contact.region.force:
                        found[track] = into
                    break
        return found

    def _split(self, index: int, regions: list[Region], pairs: dict[int, int], followed: dict[int, Contact]) -> None:
        """Add the contact of a region without association: one that is restored, splits off, or is new."""
        for track, other in pairs.items():
            if not self._contacts[track].region.bits & regions[index].bits:
                continue
            parent = followed[other]
            if not parent.merged:
                followed[other] = _unmoved(parent, self._contacts[track])
                followed[index] = self._begin(regions[index], parent.id)
                return
            there, here = regions[index].centre_of_pressure, regions[other].centre_of_pressure
            direction = there[0] - here[0], there[1] - here[1]
            back = max(parent.merged, key=lambda past: past.offset[0] * direction[0] + past.offset[1] * direction[1])
            targets = (other, index)
            if back.offset[0] * direction[0] + back.offset[1] * direction[1] < 0.0:
                targets = (index, other)
            rest = tuple(past for past in parent.merged if past is not back)
            stays = _unmoved(parent._replace(region=regions[targets[0]], merged=rest), self._contacts[track])
            followed[targets[0]] = stays
            followed[targets[1]] = Contact(
                back.id,
                ContactState.HELD,
                regions[targets[1]],
                (0.0, 0.0),
                stays.age + back.age,
                split_from=back.split_from,
            )
            return
        followed[index] = self._begin(regions[index])

    def _pairs(self, regions: list[Region]) -> dict[int, int]:
        """Return the index of the region of each contact that continues, by the least sum of squared distances."""
        centres = [region.centre_of_pressure for region in regions]
        distances = [
            [math.dist(contact.region.centre_of_pressure, centre) for centre in centres] for contact in self._contacts
        ]
        pairs: dict[int, int] = {}
        for track, row in enumerate(distances):
            nearest = min(row, default=math.inf)
            if nearest <= self._gate:
                pairs[track] = row.index(nearest)
        if len(set(pairs.values())) == len(pairs):
            return pairs
        # A contact that ends costs as much as the longest distance within the gate.
        squares = [[distance * distance for distance in row] for row in distances]
        return minimum_cost_assignment(squares, self._gate**2)

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
    """Return a contact whose centre jumped by a merge or split, with its previous state and velocity."""
    if before.state is ContactState.NEW:
        return contact._replace(state=ContactState.HELD, velocity=(0.0, 0.0))
    return contact._replace(state=before.state, velocity=before.velocity)


def _merged(contact: Contact, others: list[Contact]) -> tuple[Merged, ...]:
    """Return the records of others that merged into a contact, and of those that had merged into them."""
    here = contact.region.centre_of_pressure
    found: list[Merged] = []
    for other in others:
        there = other.region.centre_of_pressure
        offset = there[0] - here[0], there[1] - here[1]
        later = other.age - contact.age
        found.append(Merged(other.id, later, offset, other.split_from))
        found += [past._replace(age=past.age + later, offset=offset) for past in other.merged]
    return tuple(found)
