# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Topics of the model node: each message computed only if it has subscribers."""

from __future__ import annotations

import time
from collections.abc import Callable, Set
from typing import Any

from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import Image, PointCloud2
from visualization_msgs.msg import MarkerArray

from posfet_model.reconstruction.contacts_writer import ContactsWriter
from posfet_model.reconstruction.force_image import ForceImage
from posfet_model.reconstruction.reconstructor import Reconstruction, Reconstructor
from posfet_model.ros.contacts_cdr import ContactsBytes
from posfet_model.ros.conversions import (
    ContactsMessage,
    ForceImageMessage,
    ImageMessage,
    MarkersMessage,
    PointsMessage,
    VibrationMessage,
    contacts_writer,
    info_message,
)
from posfet_model.ros.display_scans import DisplayScans
from posfet_model.ros.subscriptions import SubscriptionCache
from posfet_model.ros.wrench_messages import WrenchEstimateMessage, WrenchMessage
from posfet_model.sensor.description import Sensor
from posfet_msgs.msg import TactileContacts, TactileImage, TactileInfo, TactileVibration, TactileWrench


class ModelOutputs:
    """Publishes reconstructions; before `describe` nothing.

    Parameters
    ----------
    node : Node
        Node that publishes.
    as_bytes : bool
        Whether contacts are serialised here instead of by the middleware.
    simulated : bool
        Whether the signals come from a simulated board.
    qos : QoSProfile
        Quality of service of all topics but `info`.
    display_rate : float
        Rate of the topics that are for display only [Hz].
    """

    def __init__(self, node: Node, as_bytes: bool, simulated: bool, qos: QoSProfile, display_rate: float) -> None:
        self.frame_id = ""
        """Frame of the array; '' before `describe`."""
        self.display = DisplayScans(display_rate)
        """Scans of the topics that are for display only."""
        self._as_bytes, self._simulated = as_bytes, simulated
        self.contacts: Publisher = node.create_publisher(TactileContacts, "contacts", qos)
        """Publisher of the contacts of each scan."""
        self._markers = node.create_publisher(MarkerArray, "markers", qos)
        self._view_contacts = node.create_publisher(TactileContacts, "view/contacts", qos)
        self._view_image = node.create_publisher(TactileImage, "view/image", qos)
        self._displayed = {self._markers, self._view_contacts, self._view_image}
        self._map_publishers = [
            node.create_publisher(TactileImage, "image", qos),
            node.create_publisher(WrenchStamped, "wrench", qos),
            node.create_publisher(Image, "force_image", qos),
            node.create_publisher(PointCloud2, "points", qos),
        ]
        self._maps: tuple[tuple[Publisher, Callable[[Reconstruction, ForceImage], Any]], ...] = ()
        self._wrench_estimate = node.create_publisher(TactileWrench, "wrench_estimate", qos)
        self._vibration = node.create_publisher(TactileVibration, "vibration", qos)
        self._subscriptions = SubscriptionCache(
            self.contacts, self._vibration, self._wrench_estimate, *self._displayed, *self._map_publishers
        )
        self._only_contacts = {self.contacts}
        transient_local = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._info = node.create_publisher(TactileInfo, "info", transient_local)

    def describe(self, sensor: Sensor, frame_id: str) -> None:
        """Publish `info`, and use frame and thresholds in all further messages.

        Parameters
        ----------
        sensor : Sensor
            Sensor description, with the contact thresholds in use.
        frame_id : str
            Frame of the array.
        """
        self.frame_id, layout = frame_id, sensor.layout
        writer = contacts_writer(sensor, frame_id) if self._as_bytes else ContactsMessage(sensor, frame_id)
        self._contacts_message: ContactsMessage | ContactsBytes = writer
        if isinstance(writer, ContactsBytes):
            # Publish without the checks of the message type in rclpy, which cost twice as much as publishing itself.
            for publisher in (self.contacts, self._view_contacts):
                publisher.publish = publisher.handle.publish_raw
        self._image_message = ImageMessage(layout, frame_id)
        fills: tuple[Callable[[Reconstruction, ForceImage], Any], ...] = (
            self._image_message.fill,
            WrenchMessage(layout, frame_id).fill,
            ForceImageMessage(layout, frame_id).fill,
            PointsMessage(layout, frame_id).fill,
        )
        self._maps = tuple(zip(self._map_publishers, fills, strict=True))
        self._markers_message = MarkersMessage(layout, frame_id)
        self._wrench_estimate_message = WrenchEstimateMessage(layout, frame_id)
        self._vibration_message = VibrationMessage(layout, frame_id)
        self._info.publish(info_message(sensor, frame_id, self._simulated, time.time_ns()))

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
        return self._vibration in subscribed

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
        if subscribed == self._only_contacts:
            return
        maps = [entry for entry in self._maps if entry[0] in subscribed]
        estimate_wanted = self._wrench_estimate in subscribed
        if maps or estimate_wanted:
            image = reconstructor.image()
            for publisher, fill in maps:
                publisher.publish(fill(result, image))
            if estimate_wanted:
                self._wrench_estimate.publish(self._wrench_estimate_message.fill(result, image, reconstructor))
        if self._vibration in subscribed:
            self._vibration.publish(self._vibration_message.fill(result, reconstructor.vibration()))
        if not self._displayed.isdisjoint(subscribed) and self.display.due(result.stamp):
            self._publish_displayed(reconstructor, result, subscribed)

    def _publish_displayed(self, reconstructor: Reconstructor, result: Reconstruction, subscribed: Set[Any]) -> None:
        if self._view_contacts in subscribed:
            self._view_contacts.publish(self._contacts_message.fill(result))
        if self._view_image in subscribed:
            self._view_image.publish(self._image_message.fill(result, reconstructor.image()))
        if self._markers in subscribed:
            self._markers.publish(self._markers_message.fill(result))
