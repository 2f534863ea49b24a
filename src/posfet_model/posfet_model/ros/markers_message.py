# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Contacts as markers for RViz."""

from __future__ import annotations

import math
from typing import Any

from visualization_msgs.msg import Marker, MarkerArray

from posfet_model.contacts.tracker import Contact, ContactState
from posfet_model.reconstruction.reconstructor import Reconstruction
from posfet_model.ros.message_fields import LARGEST_INT32, set_stamp, set_vector
from posfet_model.sensor.description import Layout
from posfet_model.sensor.surface import Surface


class MarkersMessage:
    """Contacts for RViz: a disc with the area of the contact and an arrow along the force, with the contact's id.

    Scans may be skipped: markers of contacts that have ended since the last message are deleted by the next one.

    Parameters
    ----------
    layout : Layout
        Layout of the array.
    frame_id : str
        Frame of the array.
    """

    ARROW_PER_NEWTON = 5e-3
    """Length of the arrow [m/N]."""

    def __init__(self, layout: Layout, frame_id: str) -> None:
        self._surface = Surface.of(layout)
        self._frame_id = frame_id
        self._shown: set[int] = set()

    def fill(self, result: Reconstruction) -> MarkerArray:
        """Return the markers of the contacts of a scan."""
        live = [contact for contact in result.contacts if contact.state is not ContactState.RELEASED]
        ids = {contact.id for contact in live}
        markers = []
        for gone in sorted(self._shown - ids):
            markers += [self._marker(result, name, gone, action=Marker.DELETE) for name in ("contact", "force")]
        for contact in live:
            unknown = math.isnan(contact.region.force)
            markers.append(self._sphere(result, contact))
            markers.append(
                self._marker(result, "force", contact.id, action=Marker.DELETE)
                if unknown
                else self._arrow(result, contact)
            )
        self._shown = ids
        return MarkerArray(markers=markers)

    def _marker(self, result: Reconstruction, name: str, number: int, **fields: Any) -> Marker:
        marker = Marker(ns=name, id=number & LARGEST_INT32, **fields)
        marker.header.frame_id = self._frame_id
        set_stamp(marker.header.stamp, result.stamp)
        marker.color.r, marker.color.g, marker.color.b, marker.color.a = 0.95, 0.35, 0.1, 0.9
        marker.pose.orientation.w = 1.0
        return marker

    def _sphere(self, result: Reconstruction, contact: Contact) -> Marker:
        marker = self._marker(result, "contact", contact.id, type=Marker.SPHERE)
        x, y = contact.region.centre_of_pressure
        set_vector(marker.pose.position, self._surface.point(x, y))
        turned = marker.pose.orientation
        turned.x, turned.y, turned.z, turned.w = self._surface.orientation(x, y)
        marker.scale.x = marker.scale.y = 2.0 * math.sqrt(contact.region.area / math.pi)
        marker.scale.z = 0.1 * marker.scale.x
        marker.color.a = 0.5
        return marker

    def _arrow(self, result: Reconstruction, contact: Contact) -> Marker:
        marker = self._marker(result, "force", contact.id, type=Marker.ARROW)
        x, y = contact.region.centre_of_pressure
        length = self.ARROW_PER_NEWTON * contact.region.force
        point, normal = self._surface.point(x, y), self._surface.normal(x, y)
        set_vector(
            marker.pose.position, tuple(place + length * part for place, part in zip(point, normal, strict=True))
        )
        # Turn the x axis of the arrow to the inward normal: half a turn about the bisector of the two.
        turned, side = marker.pose.orientation, math.sqrt(2.0 * max(1.0 - normal[0], 1e-12))
        turned.x, turned.y = (1.0 - normal[0]) / side, -normal[1] / side
        turned.z, turned.w = -normal[2] / side, 0.0
        marker.scale.x = max(length, 1e-6)
        marker.scale.y = marker.scale.z = 0.4e-3
        return marker
