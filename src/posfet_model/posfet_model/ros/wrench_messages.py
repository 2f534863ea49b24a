# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The total force and torque as messages: the standard one, and one with sequence, validity and covariance."""

from __future__ import annotations

import math

import numpy as np
from geometry_msgs.msg import Wrench, WrenchStamped
from numpy.typing import NDArray

from posfet_model.reconstruction.force_image import ForceImage
from posfet_model.reconstruction.reconstructor import Reconstruction, Reconstructor, total_reasons
from posfet_model.ros.message_fields import set_stamp, set_vector
from posfet_model.sensor.description import Layout
from posfet_model.sensor.surface import wrench_per_newton
from posfet_msgs.msg import TactileWrench

UNKNOWN_WRENCH = [math.nan] * 6
"""Force and torque of a scan whose forces are not fit for control."""

UNKNOWN_COVARIANCE = np.zeros((6, 6))
"""As in sensor_msgs/Imu."""


class WrenchMessage:
    """The total force on the sensor and its torque about the origin of the frame of the array.

    Each taxel measures the force along its normal only: tangential forces are not included, which does not mean that
    they are zero.

    Parameters
    ----------
    layout : Layout
        Layout of the array.
    frame_id : str
        Frame of the array.
    """

    def __init__(self, layout: Layout, frame_id: str) -> None:
        self._message = WrenchStamped()
        self._message.header.frame_id = frame_id
        self._per_newton = wrench_per_newton(layout)

    def fill(self, result: Reconstruction, image: ForceImage) -> WrenchStamped:
        """Return the message; the next call overwrites it. All NaN if the result is not valid: it has no other flag.

        Parameters
        ----------
        result : Reconstruction
            Result of the scan.
        image : ForceImage
            Force image of the scan.
        """
        message = self._message
        set_stamp(message.header.stamp, result.stamp)
        _set_wrench(message.wrench, self._per_newton, image, result.valid and math.isfinite(image.total))
        return message


class WrenchEstimateMessage:
    """A TactileWrench: the wrench with its sequence, validity and covariance.

    Parameters
    ----------
    layout : Layout
        Layout of the array.
    frame_id : str
        Frame of the array.
    """

    def __init__(self, layout: Layout, frame_id: str) -> None:
        self._message = TactileWrench(layout_id=layout.id)
        self._message.header.frame_id = frame_id
        self._per_newton = wrench_per_newton(layout)

    def fill(self, result: Reconstruction, image: ForceImage, reconstructor: Reconstructor) -> TactileWrench:
        """Return the message; the next call overwrites it.

        Parameters
        ----------
        result : Reconstruction
            Result of the scan.
        image : ForceImage
            Force image of the scan.
        reconstructor : Reconstructor
            Source of both, for the covariance.
        """
        message, reasons = self._message, total_reasons(result, image)
        set_stamp(message.header.stamp, result.stamp)
        message.sequence = result.sequence
        message.data_valid, message.reasons = not reasons, int(reasons)
        _set_wrench(message.wrench, self._per_newton, image, message.data_valid)
        covariance = reconstructor.covariance(self._per_newton) if message.data_valid else UNKNOWN_COVARIANCE
        message.covariance[:] = np.nan_to_num(covariance).ravel()
        return message


def _set_wrench(wrench: Wrench, per_newton: NDArray[np.float64], image: ForceImage, known: bool) -> None:
    """Set a wrench to the sum of the loads, or to NaN."""
    whole = (per_newton @ image.load).tolist() if known else UNKNOWN_WRENCH
    set_vector(wrench.force, whole[:3])
    set_vector(wrench.torque, whole[3:])
