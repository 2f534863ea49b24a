# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""All messages of one scan agree on whether its forces are valid, and on what they are."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("posfet_msgs", reason="needs the built posfet_msgs")

from rclpy.serialization import deserialize_message

from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.reconstruction.reconstructor import InvalidReason, Reconstructor
from posfet_model.ros.contacts_cdr import ContactsBytes
from posfet_model.ros.contacts_message import ContactsMessage
from posfet_model.ros.map_messages import ImageMessage, VibrationMessage
from posfet_model.ros.wrench_messages import WrenchEstimateMessage, WrenchMessage
from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.scan import Scan, ScanStatus
from posfet_msgs.msg import TactileContacts, TactileWrench
from reference.dense_pressure import sphere_forces
from support.scan_player import press, scans

pytestmark = pytest.mark.ros

SENSOR = load_sensor()
LAYOUT = SENSOR.layout
FINGER = sphere_forces(0.6e-3, -0.4e-3, 1.0, 6e-3, 1e6, SENSOR.device.contact_spread, LAYOUT.pitch_x, LAYOUT.rows)
BEGIN = 700
"""Index of the scan in which a fault begins, under a touch."""

Edit = Callable[[int, Scan], "bool | None"]


def lost(index: int, scan: Scan) -> bool:
    return not BEGIN <= index < BEGIN + 800


def adc_fault(index: int, scan: Scan) -> None:
    scan.status = int(ScanStatus.ADC_FAULT) if BEGIN <= index < BEGIN + 5 else 0


def clock_jump(index: int, scan: Scan) -> None:
    scan.device_time += 10**9 if index >= BEGIN else 0


def stuck(index: int, scan: Scan) -> None:
    scan.counts[3] = 0x8000


def overload(index: int, scan: Scan) -> None:
    scan.counts[12] = 0xFFFF if BEGIN <= index < BEGIN + 20 else scan.counts[12]


def frozen(index: int, scan: Scan) -> None:
    """All taxels are stuck: none is left that says anything."""
    if index >= BEGIN:
        scan.counts[:] = 0x8100


def well(index: int, scan: Scan) -> None:
    """No fault: forces are unknown at the start."""


REASONS = {
    lost: TactileWrench.REASON_UNCERTAIN,
    adc_fault: TactileWrench.REASON_SCAN_UNUSABLE,
    clock_jump: TactileWrench.REASON_TIME_UNCERTAIN,
    # Taken for interference at first; what the clipped signal hid makes the total force uncertain.
    overload: TactileWrench.REASON_SCAN_UNUSABLE | TactileWrench.REASON_UNCERTAIN,
    frozen: TactileWrench.REASON_SCAN_UNUSABLE | TactileWrench.REASON_NO_TAXEL,
}
"""Reasons for which the wrench is not valid, besides the start."""


@pytest.mark.parametrize("edit", [well, lost, adc_fault, clock_jump, stuck, overload, frozen])
def test_the_messages_of_a_scan_agree(edit: Edit) -> None:
    reconstructor = Reconstructor(SENSOR)
    reconstructor.vibration_wanted = True
    image_message, wrench_message = ImageMessage(LAYOUT, "finger"), WrenchMessage(LAYOUT, "finger")
    estimate_message = WrenchEstimateMessage(LAYOUT, "finger")
    contacts_message, contacts_bytes = ContactsMessage(SENSOR, "finger"), ContactsBytes(SENSOR, "finger")
    vibration_message = VibrationMessage(LAYOUT, "finger")
    valid, reasons = [], 0
    for index, (_, original) in enumerate(scans(SENSOR, 1.7, force=press(1.5, 0.5, 9.0), shape=FINGER)):
        scan = copy.deepcopy(original)
        if edit(index, scan) is False:
            continue
        result = reconstructor.process(scan)
        if index % 10 and not 0 <= index - BEGIN < 25:
            continue
        picture = reconstructor.image()
        image, wrench = image_message.fill(result, picture), wrench_message.fill(result, picture)
        estimate = estimate_message.fill(result, picture, reconstructor)
        contacts = contacts_message.fill(result)
        serialised = deserialize_message(contacts_bytes.fill(result), TactileContacts)
        vibration = vibration_message.fill(result, reconstructor.vibration())
        stamps = {
            (message.header.stamp.sec, message.header.stamp.nanosec)
            for message in (image, wrench, estimate, contacts, serialised, vibration)
        }
        assert len(stamps) == 1
        assert (
            image.sequence
            == estimate.sequence
            == contacts.sequence
            == serialised.sequence
            == vibration.sequence
            == scan.sequence
        )
        assert (
            image.data_valid
            == estimate.data_valid
            == (not estimate.reasons)
            == contacts.data_valid
            == serialised.data_valid
            == vibration.data_valid
        )
        assert str(estimate.wrench) == str(wrench.wrench)  # NaN included
        if math.isfinite(image.total_force_standard_deviation) and image.data_valid:
            deviation = math.sqrt(estimate.covariance[14])  # of the force along z
            assert deviation == pytest.approx(image.total_force_standard_deviation, rel=1e-6)
        else:
            assert not any(estimate.covariance), "unknown"
        reasons |= estimate.reasons
        axes = [getattr(vector, axis) for vector in (wrench.wrench.force, wrench.wrench.torque) for axis in "xyz"]
        assert np.isfinite(axes).all() == image.data_valid
        assert np.isnan(axes).all() != image.data_valid
        if image.data_valid:
            interpolated = image.total_force - np.nansum(np.asarray(image.force, np.float64))
            assert (-1e-5 <= interpolated < 0.05) if edit is stuck else abs(interpolated) < 1e-5
            assert wrench.wrench.force.z == pytest.approx(-image.total_force, abs=1e-5)
            assert math.isfinite(image.total_force)
        valid.append(image.data_valid)
    assert not all(valid)
    assert reasons == TactileWrench.REASON_BASELINE_UNKNOWN | REASONS.get(edit, 0)
    # A force held through an interruption is a lower bound; what a clipped signal hid is half of the force.
    assert valid[-1] == (edit not in (lost, overload, frozen))


def test_a_contact_whose_force_is_unknown_leaves_no_total() -> None:
    """A taxel in the corner is dead, and so is that from which it would be interpolated: the rest is no total."""
    gain = np.ones(LAYOUT.taxels)
    gain[[0, LAYOUT.cols + 1]] = math.nan
    reconstructor = Reconstructor(SENSOR, replace(Calibration.nominal(SENSOR), gain=gain))
    corner = sphere_forces(
        -1.5 * LAYOUT.pitch_x,
        -2.0 * LAYOUT.pitch_y,
        1.0,
        6e-3,
        1e6,
        SENSOR.device.contact_spread,
        LAYOUT.pitch_x,
        LAYOUT.rows,
    )
    image_message, wrench_message = ImageMessage(LAYOUT, "finger"), WrenchMessage(LAYOUT, "finger")
    estimate_message, contacts_message = WrenchEstimateMessage(LAYOUT, "finger"), ContactsMessage(SENSOR, "finger")
    for _, scan in scans(SENSOR, 1.0, force=press(1.0, 0.5, 9.0), shape=corner):
        result = reconstructor.process(scan)
    picture = reconstructor.image()
    contacts = contacts_message.fill(result)
    assert contacts.data_valid
    (contact,) = contacts.contacts
    assert math.isnan(contact.force.z)
    assert math.isnan(contact.normal_force_deviation)
    image = image_message.fill(result, picture)
    assert math.isnan(image.total_force)
    assert math.isnan(image.total_force_standard_deviation)
    wrench, estimate = wrench_message.fill(result, picture), estimate_message.fill(result, picture, reconstructor)
    for each in (wrench.wrench, estimate.wrench):
        assert all(math.isnan(getattr(vector, axis)) for vector in (each.force, each.torque) for axis in "xyz")
    assert not estimate.data_valid
    assert estimate.reasons == InvalidReason.CONTACT_UNKNOWN
    assert not any(estimate.covariance)
