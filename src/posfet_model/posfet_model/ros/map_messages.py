# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""One value of each taxel: TactileImage, TactileVibration, Image, PointCloud2."""

from __future__ import annotations

from array import array

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import Image, PointCloud2, PointField

from posfet_model.contacts.slip import CORNER_FREQUENCY, POWER_TIME_CONSTANT
from posfet_model.reconstruction.force_image import ForceImage
from posfet_model.reconstruction.reconstructor import Reconstruction
from posfet_model.ros.message_fields import Floats, set_stamp
from posfet_model.sensor.description import Layout
from posfet_model.sensor.surface import taxel_points
from posfet_msgs.msg import TactileImage, TactileVibration


class ImageMessage:
    """A TactileImage."""

    def __init__(self, layout: Layout, frame_id: str) -> None:
        self._message = TactileImage(layout_id=layout.id, rows=layout.rows, cols=layout.cols)
        self._message.header.frame_id = frame_id
        self._force, self._deviation = Floats(layout.taxels), Floats(layout.taxels)
        self._status = array("B", bytes(layout.taxels))

    def fill(self, result: Reconstruction, image: ForceImage) -> TactileImage:
        """Return the message; the next call overwrites it.

        Parameters
        ----------
        result : Reconstruction
            Result of the scan.
        image : ForceImage
            Force image of the scan.
        """
        message = self._message
        set_stamp(message.header.stamp, result.stamp)
        message.sequence = result.sequence
        message.force = self._force.fill(image.force)
        message.standard_deviation = self._deviation.fill(image.standard_deviation)
        memoryview(self._status)[:] = image.status.data
        message.status = self._status
        message.total_force = image.total
        message.total_force_standard_deviation = image.total_standard_deviation
        message.data_valid = result.valid
        return message


class VibrationMessage:
    """A TactileVibration."""

    def __init__(self, layout: Layout, frame_id: str) -> None:
        self._message = TactileVibration(layout_id=layout.id, rows=layout.rows, cols=layout.cols)
        self._message.header.frame_id = frame_id
        self._message.band_low, self._message.averaging_time = CORNER_FREQUENCY, POWER_TIME_CONSTANT
        self._vibration = Floats(layout.taxels)

    def fill(self, result: Reconstruction, vibration: NDArray[np.float32]) -> TactileVibration:
        """Return the message; the next call overwrites it.

        Parameters
        ----------
        result : Reconstruction
            Result of the scan.
        vibration : ndarray of float32, shape [taxels]
            RMS of the dynamic channel [N].
        """
        message = self._message
        set_stamp(message.header.stamp, result.stamp)
        message.sequence = result.sequence
        message.vibration = self._vibration.fill(vibration)
        message.data_valid = result.valid
        return message


class ForceImageMessage:
    """The force map [N] as sensor_msgs/Image with encoding 32FC1; the first line is row 0, with the smallest y."""

    def __init__(self, layout: Layout, frame_id: str) -> None:
        self._message = Image(height=layout.rows, width=layout.cols, encoding="32FC1", step=4 * layout.cols)
        self._message.header.frame_id = frame_id
        self._data = array("B", bytes(4 * layout.taxels))

    def fill(self, result: Reconstruction, image: ForceImage) -> Image:
        """Return the message; the next call overwrites it. NaN where the force is unknown.

        Parameters
        ----------
        result : Reconstruction
            Result of the scan.
        image : ForceImage
            Force image of the scan.
        """
        set_stamp(self._message.header.stamp, result.stamp)
        memoryview(self._data)[:] = image.force.data.cast("B")
        self._message.data = self._data
        return self._message


class PointsMessage:
    """The taxels as PointCloud2 with fields x, y, z [m] and force [N]; each row of the cloud is a row of the array."""

    def __init__(self, layout: Layout, frame_id: str) -> None:
        fields = [
            PointField(name=name, offset=4 * index, datatype=PointField.FLOAT32, count=1)
            for index, name in enumerate(("x", "y", "z", "force"))
        ]
        self._message = PointCloud2(height=layout.rows, width=layout.cols, fields=fields, point_step=16)
        self._message.header.frame_id = frame_id
        self._message.row_step = 16 * layout.cols
        self._data = array("B", bytes(16 * layout.taxels))
        self._points = np.frombuffer(self._data, np.float32).reshape(layout.taxels, 4)
        self._points[:, :3] = taxel_points(layout)

    def fill(self, result: Reconstruction, image: ForceImage) -> PointCloud2:
        """Return the message; the next call overwrites it. `is_dense` is false where a force is NaN.

        Parameters
        ----------
        result : Reconstruction
            Result of the scan.
        image : ForceImage
            Force image of the scan.
        """
        message = self._message
        set_stamp(message.header.stamp, result.stamp)
        self._points[:, 3] = image.force
        message.data = self._data
        message.is_dense = not bool(np.isnan(image.force).any())
        return message
