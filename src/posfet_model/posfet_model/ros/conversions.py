# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Conversion between ROS messages and scans or reconstructions. Each message object is reused for every scan."""

from __future__ import annotations

import math
from array import array
from collections.abc import Sequence
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Pose
from numpy.typing import NDArray
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import Image, PointCloud2, PointField
from visualization_msgs.msg import Marker, MarkerArray

from posfet_model._lib.units import NANOSECONDS
from posfet_model.contacts.detection import Region
from posfet_model.contacts.placement import Placed, placement_on
from posfet_model.contacts.slip import CORNER_FREQUENCY, POWER_TIME_CONSTANT, Motion
from posfet_model.contacts.tracker import Contact, ContactState, Merged
from posfet_model.reconstruction.force_image import ForceImage
from posfet_model.reconstruction.reconstructor import Reconstruction
from posfet_model.ros.contacts_cdr import AT_REST, ContactsBytes
from posfet_model.sensor.description import Layout, Sensor
from posfet_model.sensor.scan import Scan
from posfet_model.sensor.signal_chain import InverseSignalChain, charge_per_newton, volts_per_count
from posfet_model.sensor.surface import Surface, taxel_points
from posfet_msgs.msg import (
    TactileContact,
    TactileContacts,
    TactileImage,
    TactileInfo,
    TactileRaw,
    TactileVibration,
)

FOREIGN_LAYOUT = 0
"""Layout id that no sensor has: theirs begin at 1."""

LARGEST_INT32 = 0x7FFF_FFFF


def set_stamp(stamp: Time, nanoseconds: int) -> None:
    """Set the time of a message to `nanoseconds` since the Unix epoch.

    Parameters
    ----------
    stamp : Time
        Field to set.
    nanoseconds : int
        Time since the Unix epoch [ns].
    """
    stamp.sec, stamp.nanosec = divmod(nanoseconds, NANOSECONDS)


class ScanReader:
    """Reads TactileRaw messages as scans."""

    def __init__(self, layout: Layout) -> None:
        self._shape = layout.rows, layout.cols
        self._scan = Scan.empty(layout.id, layout.taxels)

    def read(self, message: TactileRaw) -> Scan:
        """Return the message as a scan, which shares the arrays of the message and is overwritten by the next call."""
        scan = self._scan
        stamp = message.header.stamp
        # Nanoseconds beyond a second are not allowed, and could lead out of the range of the seconds.
        scan.stamp = stamp.sec * NANOSECONDS + min(stamp.nanosec, NANOSECONDS - 1)
        # A scan has no rows and columns of its own: a message with others is treated as of another layout.
        fits = (message.rows, message.cols) == self._shape
        scan.layout_id = message.layout_id if fits else FOREIGN_LAYOUT
        scan.sequence = message.sequence
        scan.device_time = message.device_time
        scan.counts = np.asarray(message.counts)
        scan.temperatures = np.asarray(message.temperatures)
        scan.status = message.status
        scan.frames_lost = message.frames_lost
        scan.stamp_uncertainty = message.stamp_uncertainty
        return scan


class _Floats:
    """A float32[] field, filled from an array without creating Python numbers."""

    def __init__(self, size: int) -> None:
        self.values = array("f", bytes(4 * size))
        self._view = np.frombuffer(self.values, np.float32)

    def fill(self, source: NDArray[np.float32]) -> array[float]:
        """Return the values of `source`."""
        self._view[:] = source
        return self.values


class ImageMessage:
    """A TactileImage."""

    def __init__(self, layout: Layout, frame_id: str) -> None:
        self._message = TactileImage(layout_id=layout.id, rows=layout.rows, cols=layout.cols)
        self._message.header.frame_id = frame_id
        self._force, self._deviation = _Floats(layout.taxels), _Floats(layout.taxels)
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


class ContactsMessage:
    """A TactileContacts; the message objects of the contacts are reused as well."""

    def __init__(self, sensor: Sensor, frame_id: str) -> None:
        self._message = TactileContacts(layout_id=sensor.layout.id, name=sensor.name)
        self._message.header.frame_id = frame_id
        self._message.threshold = sensor.contact.threshold
        self._message.deadband = sensor.contact.deadband
        self._place = placement_on(Surface.of(sensor.layout))
        self._pool: list[TactileContact] = []

    def fill(self, result: Reconstruction) -> TactileContacts:
        """Return the message; the next call overwrites it."""
        message, contacts = self._message, result.contacts
        while len(self._pool) < len(contacts):
            self._pool.append(TactileContact())
        set_stamp(message.header.stamp, result.stamp)
        message.sequence = result.sequence
        message.data_valid = result.valid
        message.contacts = self._pool[: len(contacts)]
        for slot, contact in zip(self._pool, contacts, strict=False):
            _fill_contact(slot, contact, self._place(contact), result.motions.get(contact.id, AT_REST))
        return message


def _fill_contact(message: TactileContact, contact: Contact, placed: Placed, motion: Motion) -> None:
    region, (head, tail) = contact.region, placed
    message.id = contact.id
    message.state = int(contact.state)
    message.merged_ids = array("I", contact.merged_ids)
    message.split_from = contact.split_from
    set_vector(message.centre_of_pressure, head[:3])
    set_vector(message.geometric_centre, head[3:6])
    set_vector(message.normal, head[6:9])
    set_vector(message.force, head[9:12])
    message.force_covariance[:] = head[12:]
    message.normal_force_deviation = math.sqrt(region.force_variance)
    message.area = region.area
    message.peak_pressure = region.peak_pressure
    set_vector(message.major_axis, tail[:3])
    set_vector(message.minor_axis, tail[3:6])
    set_vector(message.velocity, tail[6:])
    message.slipping = motion.slipping
    message.vibration = motion.vibration
    message.age.sec, message.age.nanosec = divmod(round(contact.age * NANOSECONDS), NANOSECONDS)
    message.taxels = array("H", region.taxels.tolist())


def set_vector(vector: Any, values: Sequence[float]) -> None:
    """Set x, y and z.

    Parameters
    ----------
    vector : Point or Vector3
        Field to set.
    values : sequence of float
        The three values.
    """
    vector.x, vector.y, vector.z = values


def contacts_writer(sensor: Sensor, frame_id: str) -> ContactsMessage | ContactsBytes:
    """Return the fastest way to serialise contacts that gives the same bytes as the middleware.

    Parameters
    ----------
    sensor : Sensor
        Sensor description.
    frame_id : str
        Frame of the array.

    Returns
    -------
    ContactsMessage or ContactsBytes
        ContactsBytes if its bytes for examples with one, two and three taxels, which cover every alignment, are those
        of the middleware, otherwise ContactsMessage.
    """
    region = Region(
        np.arange(1), np.arange(1), (1e-3, 2e-3), (3e-3, 4e-3), 0.5, 0.25, 5e-6, 6.0, (7e-3, 8e-3), (9e-3, 1e-2)
    )
    first = Contact(LARGEST_INT32, ContactState.MOVING, region, (0.1, -0.2), 12.75)
    past = tuple(Merged(number, 0.0, (0.0, 0.0), 0) for number in (5, 6, 7))
    second = first._replace(id=2, region=region._replace(taxels=np.arange(2)), merged=past, split_from=8)
    third = first._replace(id=3, region=region._replace(taxels=np.arange(3)), merged=past[:1], velocity=(math.nan,) * 2)
    message, writer = ContactsMessage(sensor, frame_id), ContactsBytes(sensor, frame_id)
    for contacts in ((), (first, second, third), (second, first)):
        valid, motions = bool(contacts), {2: Motion(power=0.25, slipping=True)}
        example = Reconstruction(True, False, 1_700_000_000_123_456_789, 1 << 40, valid, contacts, motions, 0)
        theirs, ours = serialize_message(message.fill(example)), writer.fill(example)
        if theirs != ours and (len(theirs) != len(ours) or _read(theirs) != _read(ours)):  # padding bytes may differ
            return message
    return writer


def _read(data: bytes) -> str:
    """Return serialised contacts as text, so that NaN compares equal to NaN."""
    return str(deserialize_message(data, TactileContacts))


class VibrationMessage:
    """A TactileVibration."""

    def __init__(self, layout: Layout, frame_id: str) -> None:
        self._message = TactileVibration(layout_id=layout.id, rows=layout.rows, cols=layout.cols)
        self._message.header.frame_id = frame_id
        self._message.band_low, self._message.averaging_time = CORNER_FREQUENCY, POWER_TIME_CONSTANT
        self._vibration = _Floats(layout.taxels)

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
            markers += [self._sphere(result, contact), self._arrow(result, contact)]
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


def info_message(sensor: Sensor, frame_id: str, simulated: bool, stamp: int) -> TactileInfo:
    """Return the description of `sensor`, valid from `stamp` on [ns since the Unix epoch].

    Parameters
    ----------
    sensor : Sensor
        Sensor description.
    frame_id : str
        Frame of the array.
    simulated : bool
        Whether the signals come from a simulated board.
    stamp : int
        Time from which the description is valid [ns] since the Unix epoch.
    """
    layout = sensor.layout
    low, high = (limit / charge_per_newton(sensor) for limit in InverseSignalChain(sensor).charge_range)
    message = TactileInfo(layout_id=layout.id, name=sensor.name, serial=sensor.serial, simulated=simulated)
    message.header.frame_id = frame_id
    set_stamp(message.header.stamp, stamp)
    message.rows, message.cols = layout.rows, layout.cols
    message.pitch[:] = layout.pitch_x, layout.pitch_y
    message.taxel_area = layout.taxel_area
    message.taxel_poses = [_taxel_pose(Surface.of(layout), x, y) for x, y in layout.positions.tolist()]
    message.force_min, message.force_max = low, high
    steps_per_count = 0xFFFF / ((1 << sensor.adc.bits) - 1)
    message.force_resolution = volts_per_count(sensor) * steps_per_count / sensor.volts_per_newton
    message.contact_threshold = sensor.contact.threshold
    message.contact_deadband = sensor.contact.deadband
    message.leak_time_constant = sensor.device.leak_time_constant
    message.scan_rate = sensor.can.scan_rate
    message.adc_range[:] = sensor.adc.low, sensor.adc.high
    message.adc_bits = sensor.adc.bits
    message.force_unit, message.length_unit = "N", "m"
    return message


def _taxel_pose(surface: Surface, x: float, y: float) -> Pose:
    pose = Pose()
    set_vector(pose.position, surface.point(x, y))
    turned = pose.orientation
    turned.x, turned.y, turned.z, turned.w = surface.orientation(x, y)
    return pose
