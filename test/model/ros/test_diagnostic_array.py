# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The message of /diagnostics."""

from __future__ import annotations

import pytest

rclpy = pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("diagnostic_msgs", reason="needs diagnostic_msgs")

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.serialization import deserialize_message, serialize_message

from posfet_model.ros.diagnostic_array import diagnostic_array

pytestmark = pytest.mark.ros

STAMP = 1_700_000_000_123_456_789


def sent(level: int, values: dict[str, str], stamp: int = STAMP) -> DiagnosticArray:
    """Return the message as a subscriber receives it."""
    message = diagnostic_array(level, "/hand/driver_node: board", "no traffic", "posfet 0x123", values, stamp)
    return deserialize_message(serialize_message(message), DiagnosticArray)


@pytest.mark.parametrize(
    ("level", "constant"),
    [
        (0, DiagnosticStatus.OK),
        (1, DiagnosticStatus.WARN),
        (2, DiagnosticStatus.ERROR),
        (3, DiagnosticStatus.ERROR),  # what is stale only an aggregator knows
    ],
)
def test_the_message_has_one_status_with_the_level_of_ros(level: int, constant: bytes) -> None:
    (status,) = sent(level, {}).status
    assert status.level == constant
    assert (status.name, status.message, status.hardware_id) == (
        "hand/driver_node: board",
        "no traffic",
        "posfet 0x123",
    )
    assert list(status.values) == []


def test_keys_and_values_keep_their_order() -> None:
    values = {"scan rate": "1000.0", "frames lost": "0", "bus load": ""}
    (status,) = sent(0, values).status
    assert [(each.key, each.value) for each in status.values] == list(values.items())


@pytest.mark.parametrize(
    ("stamp", "sec", "nanosec"),
    [(STAMP, 1_700_000_000, 123_456_789), (0, 0, 0), (999_999_999, 0, 999_999_999), (10**9, 1, 0)],
)
def test_the_stamp_is_in_seconds_and_nanoseconds(stamp: int, sec: int, nanosec: int) -> None:
    found = sent(0, {}, stamp).header.stamp
    assert (found.sec, found.nanosec) == (sec, nanosec)
