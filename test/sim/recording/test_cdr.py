# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Messages as bytes, against bytes by hand and, where there is ROS, against its own."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from posfet_sim.recording.cdr import ENCODING, serialise

ALL_TYPES = """\
uint8 LIMIT = 5  # a constant is no field
bool flag
float64 large
char letter
int16 small
byte raw
uint32 count
int8 tiny
int64 wide
string name
uint64 huge
float32 single
"""
SEQUENCES = """\
uint8[] bytes
float64[] numbers
string[] names
Inner[] inner
uint16 last
"""
INNER = "uint8 key\nfloat64 value"
PACKAGE = "cdr_by_hand_msgs"


@pytest.fixture(autouse=True)
def definitions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "share" / PACKAGE / "msg"
    folder.mkdir(parents=True)
    for name, text in {"AllTypes": ALL_TYPES, "Sequences": SEQUENCES, "Inner": INNER}.items():
        (folder / f"{name}.msg").write_text(text, encoding="utf-8")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))


def test_every_type_is_aligned_to_its_size() -> None:
    values = {
        "flag": True,
        "large": 1.0,
        "letter": 65,
        "small": -2,
        "raw": 255,
        "count": 1,
        "tiny": -1,
        "wide": -3,
        "name": "ab",
        "huge": 2**64 - 1,
        "single": -0.5,
    }
    expected = (
        "00 01 00 00"  # little-endian CDR; alignment counts from here
        "01 00000000000000"  # a byte, then up to 8
        "000000000000f03f"
        "41 00 feff"
        "ff 000000"
        "01000000"
        "ff 000000"
        "fdffffffffffffff"
        "03000000 616200 00"
        "ffffffffffffffff"
        "000000bf"
    )
    assert serialise(f"{PACKAGE}/AllTypes", values).hex(" ") == bytes.fromhex(expected).hex(" ")


def test_sequences_start_with_their_length_and_align_their_elements() -> None:
    values: dict[str, Any] = {
        "bytes": [1, 2, 3],
        "numbers": [1.0, -2.0],
        "names": ["", "é"],
        "inner": [{"key": 7, "value": 1.0}, {"value": 0.5, "key": 8}],
        "last": 513,
    }
    expected = (
        "00010000"
        "03000000 010203 00"
        "02000000 00000000"
        "000000000000f03f 00000000000000c0"
        "02000000 01000000 00 000000 03000000 c3a900 00"
        "02000000"
        "07 00000000000000 000000000000f03f"
        "08 00000000000000 000000000000e03f"
        "0102"
    )
    assert serialise(f"{PACKAGE}/Sequences", values).hex(" ") == bytes.fromhex(expected).hex(" ")


def test_empty_sequences_have_no_padding_for_elements() -> None:
    values = {"bytes": [9], "numbers": np.zeros((0, 3)), "names": [], "inner": [], "last": 1}
    expected = struct.pack("<IBxxxIIIH", 1, 9, 0, 0, 0, 1)
    assert serialise(f"{PACKAGE}/Sequences", values) == ENCODING + expected


def test_an_array_of_any_shape_is_written_row_by_row() -> None:
    numbers = np.arange(6.0).reshape(2, 3).T
    values = {"bytes": [], "numbers": numbers, "names": [], "inner": [], "last": 1}
    data = serialise(f"{PACKAGE}/Sequences", values)
    assert struct.unpack_from("<I6d", data, 8) == (6, 0.0, 3.0, 1.0, 4.0, 2.0, 5.0)


HEADER = {"stamp": {"sec": -1, "nanosec": 123}, "frame_id": "tactile array"}


def test_a_header_by_hand() -> None:
    expected = struct.pack("<iII14s", -1, 123, 14, b"tactile array\0")
    assert serialise("std_msgs/Header", HEADER) == ENCODING + expected


def test_a_header_is_that_of_ros() -> None:
    serialization = pytest.importorskip("rclpy.serialization", reason="needs ROS 2")
    messages = pytest.importorskip("std_msgs.msg", reason="needs std_msgs")
    message = messages.Header(frame_id=HEADER["frame_id"])
    message.stamp.sec, message.stamp.nanosec = -1, 123
    ours = serialise("std_msgs/Header", HEADER)
    theirs = serialization.serialize_message(message)
    assert serialization.deserialize_message(ours, messages.Header) == message
    assert theirs[: len(ours)] == ours
    assert not any(theirs[len(ours) :])  # padding to four bytes, which a reader ignores


@pytest.mark.parametrize(
    "values",
    [{"sec": 1}, {"sec": 1, "nanosec": 2, "hours": 3}, {}, {"sec": 1, "nano": 2}],
)
def test_a_missing_or_unknown_field_is_refused(values: dict[str, int]) -> None:
    with pytest.raises(ValueError, match="builtin_interfaces/Time must have the fields sec, nanosec, got"):
        serialise("builtin_interfaces/Time", values)


@pytest.mark.parametrize("values", [{"sec": 2**31, "nanosec": 0}, {"sec": 0, "nanosec": -1}])
def test_a_number_out_of_the_range_of_its_type_is_refused(values: dict[str, int]) -> None:
    with pytest.raises(struct.error):
        serialise("builtin_interfaces/Time", values)
