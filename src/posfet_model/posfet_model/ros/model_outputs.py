# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.


"""Publishes what the model node has reconstructed: contacts first, the rest only while it has subscribers."""

from __future__ import annotations

from collections.abc import Set
from typing import TYPE_CHECKING, Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile

from posfet_model.reconstruction.contacts_writer import ContactsWriter
from posfet_model.reconstruction.reconstructor import Reconstruction, Reconstructor
from posfet_model.ros.contacts_cdr import ContactsBytes
from posfet_model.ros.contacts_message import ContactsMessage, contacts_writer
from posfet_model.ros.display_scans import DisplayScans
from posfet_model.ros.subscriptions import SubscriptionCache
from posfet_model.sensor.description import Sensor
from posfet_msgs.msg import TactileContacts

if TYPE_CHECKING:
    from posfet_model.ros.map_outputs import MapOutputs


class ModelOutputs:
    """Publishes reconstructions; before `describe` nothing, and before `add` the contacts alone.

    Parameters
    ----------
    node : Node
        Node that publishes.
    as_bytes : bool
        Whether contacts are serialised here instead of by the middleware.
    qos : QoSProfile
        Quality of service of `contacts`.
    display_rate : float
        Rate of the topics that are for display only [Hz].
    """

    def __init__(self, node: Node, as_bytes: bool, qos: QoSProfile, display_rate: float) -> None:
        self.frame_id = ""
        """Frame of the array; '' before `describe`."""
        self.display = DisplayScans(display_rate)
        """Scans of the topics that are for display only."""
        self._as_bytes = as_bytes
        self.contacts: Publisher = node.create_publisher(TactileContacts, "contacts", qos)
        """Publisher of the contacts of each scan."""
        self._only_contacts = {self.contacts}
        self._maps: MapOutputs | None = None
        self._subscriptions = SubscriptionCache(self.contacts)

    def add(self, maps: MapOutputs) -> None:
        """Publish the other topics, too."""
        self._maps = maps
        self._subscriptions = SubscriptionCache(self.contacts, *maps.publishers)
        if self.frame_id:
            self._describe_maps(self._sensor, self.frame_id)

    def describe(self, sensor: Sensor, frame_id: str) -> None:
        """Use frame and thresholds in all further messages, and publish `info` with them once it is there.

        Parameters
        ----------
        sensor : Sensor
            Sensor description, with the contact thresholds in use.
        frame_id : str
            Frame of the array.
        """
        self.frame_id, self._sensor = frame_id, sensor
        writer = contacts_writer(sensor, frame_id) if self._as_bytes else ContactsMessage(sensor, frame_id)
        self._contacts_message: ContactsMessage | ContactsBytes = writer
        self._publish_bytes(self.contacts)
        self._describe_maps(sensor, frame_id)

    def _describe_maps(self, sensor: Sensor, frame_id: str) -> None:
        if self._maps is not None:
            self._publish_bytes(self._maps.view_contacts)
            self._maps.describe(sensor, frame_id)

    def _publish_bytes(self, publisher: Publisher) -> None:
        """Publish bytes without the checks of the message type in rclpy, which cost twice as much as publishing."""
        if isinstance(self._contacts_message, ContactsBytes):
            publisher.publish = publisher.handle.publish_raw

    @property
    def contacts_writer(self) -> ContactsWriter | None:
        """What serialises the contacts; None where the middleware does it, and before `describe`."""
        message = self._contacts_message if self.frame_id else None
        return message.writer if isinstance(message, ContactsBytes) else None

    def contacts_alone(self, subscribed: Set[Any]) -> bool:
        """Return whether no other topic than `contacts` is among the publishers with subscribers."""
        return subscribed <= self._only_contacts

    def subscribed(self, now: int) -> Set[Any]:
        """Return the publishers with subscribers; `now` is a monotonic time [ns]."""
        return self._subscriptions.subscribed(now)

    def vibration_wanted(self, subscribed: Set[Any]) -> bool:
        """Return whether `vibration` is among the publishers with subscribers."""
        return self._maps is not None and self._maps.vibration in subscribed

    def publish(self, reconstructor: Reconstructor, result: Reconstruction, subscribed: Set[Any]) -> None:
        """Publish the messages of a scan, contacts first.

        Parameters
        ----------
        reconstructor : Reconstructor
            Source of the maps that have subscribers.
        result : Reconstruction
            Its result.
        subscribed : set
            Publishers with subscribers.
        """
        if self.contacts in subscribed:
            self.contacts.publish(self._contacts_message.fill(result))
        if self._maps is not None and subscribed != self._only_contacts:
            self._maps.publish(reconstructor, result, subscribed, self._contacts_message.fill)
