# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.


"""All topics of the model but `contacts`: description, maps, wrench, vibration, and what is for displays."""

from __future__ import annotations

import time
from collections.abc import Callable, Set
from typing import Any, Final

from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import Image, PointCloud2
from visualization_msgs.msg import MarkerArray

from posfet_model.reconstruction.force_image import ForceImage
from posfet_model.reconstruction.reconstructor import Reconstruction, Reconstructor
from posfet_model.ros.display_scans import DisplayScans
from posfet_model.ros.info_message import info_message
from posfet_model.ros.map_messages import ForceImageMessage, ImageMessage, PointsMessage, VibrationMessage
from posfet_model.ros.markers_message import MarkersMessage
from posfet_model.ros.wrench_messages import WrenchEstimateMessage, WrenchMessage
from posfet_model.sensor.description import Sensor
from posfet_msgs.msg import TactileContacts, TactileImage, TactileInfo, TactileVibration, TactileWrench


class MapOutputs:
    """Publishes `info`, and what is computed from a reconstruction for its subscribers; before `describe` nothing.

    Parameters
    ----------
    node : Node
        Node that publishes.
    simulated : bool
        Whether the signals come from a simulated board.
    qos : QoSProfile
        Quality of service of all topics but `info`, whose newest message late subscribers get, too.
    display : DisplayScans
        Scans of the topics that are for display only.
    """

    def __init__(self, node: Node, simulated: bool, qos: QoSProfile, display: DisplayScans) -> None:
        self._simulated, self._display = simulated, display
        transient_local = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._info = node.create_publisher(TactileInfo, "info", transient_local)
        self._markers = node.create_publisher(MarkerArray, "markers", qos)
        self.view_contacts: Final[Publisher] = node.create_publisher(TactileContacts, "view/contacts", qos)
        """Publisher of the contacts for displays."""
        self._view_image = node.create_publisher(TactileImage, "view/image", qos)
        self._displayed = {self._markers, self.view_contacts, self._view_image}
        self._map_publishers = [
            node.create_publisher(TactileImage, "image", qos),
            node.create_publisher(WrenchStamped, "wrench", qos),
            node.create_publisher(Image, "force_image", qos),
            node.create_publisher(PointCloud2, "points", qos),
        ]
        self._maps: tuple[tuple[Publisher, Callable[[Reconstruction, ForceImage], Any]], ...] = ()
        self._wrench_estimate = node.create_publisher(TactileWrench, "wrench_estimate", qos)
        self.vibration: Final[Publisher] = node.create_publisher(TactileVibration, "vibration", qos)
        """Publisher of the vibration."""
        self.publishers: Final = (self.vibration, self._wrench_estimate, *self._displayed, *self._map_publishers)
        """All publishers."""

    def describe(self, sensor: Sensor, frame_id: str) -> None:
        """Publish `info`, and use a layout and a frame in all further messages.

        Parameters
        ----------
        sensor : Sensor
            Sensor description, with the contact thresholds in use.
        frame_id : str
            Frame of the array.
        """
        layout = sensor.layout
        self._info.publish(info_message(sensor, frame_id, self._simulated, time.time_ns()))
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

    def publish(
        self,
        reconstructor: Reconstructor,
        result: Reconstruction,
        subscribed: Set[Any],
        fill_contacts: Callable[[Reconstruction], Any],
    ) -> None:
        """Publish the messages of a scan.

        Parameters
        ----------
        reconstructor : Reconstructor
            Source of the maps that have subscribers.
        result : Reconstruction
            Its result.
        subscribed : set
            Publishers with subscribers.
        fill_contacts : callable
            Returns the message with the contacts of a result.
        """
        maps = [entry for entry in self._maps if entry[0] in subscribed]
        estimate_wanted = self._wrench_estimate in subscribed
        if maps or estimate_wanted:
            image = reconstructor.image()
            for publisher, fill in maps:
                publisher.publish(fill(result, image))
            if estimate_wanted:
                self._wrench_estimate.publish(self._wrench_estimate_message.fill(result, image, reconstructor))
        if self.vibration in subscribed:
            self.vibration.publish(self._vibration_message.fill(result, reconstructor.vibration()))
        if self._displayed.isdisjoint(subscribed) or not self._display.due(result.stamp):
            return
        if self.view_contacts in subscribed:
            self.view_contacts.publish(fill_contacts(result))
        if self._view_image in subscribed:
            self._view_image.publish(self._image_message.fill(result, reconstructor.image()))
        if self._markers in subscribed:
            self._markers.publish(self._markers_message.fill(result))
