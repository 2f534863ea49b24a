# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Messages of bytes by the schema of their file."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from posfet_sim.recording.cdr import serialise
from posfet_sim.recording.cdr_reader import MessageReader
from posfet_sim.recording.message_definitions import schema_text
from posfet_sim.recording.ros2msg import DEEPEST, Field, fields, parse_schema

NAME = "demo_msgs/All"
SCHEMA = """\
# a comment
uint8 LIMIT = 5
bool flag
int64 wide -3  # with a default
string<=20 name "x"
uint16[] counts
float64[3] fixed
bool[<=4] flags
string[] words
Inner[] inner
builtin_interfaces/Time stamp
================================================================================
MSG: demo_msgs/Inner
uint8 key
float32 value
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""


def packed(order: str) -> bytes:
    """The message by hand: every field aligned to its size, counted from after the header."""
    name = b"\0\1\0\0" if order == "<" else b"\0\0\0\0"
    body = struct.pack(f"{order}?7xqI3sxI2H3dI2s2xI", True, -5, 3, b"ab\0", 2, 1, 65535, 1.0, 2.0, 3.0, 2, b"\1\2", 1)
    body += struct.pack(f"{order}I2s2xIB3xfB3xfiI", 2, b"c\0", 2, 7, 0.5, 8, -0.5, -1, 9)
    return name + body


@pytest.mark.parametrize("order", ["<", ">"])
def test_every_kind_of_field_is_read(order: str) -> None:
    values = MessageReader(parse_schema(NAME, SCHEMA), NAME).read(packed(order))
    assert values["counts"].tolist() == [1, 65535]
    assert values["counts"].dtype == np.uint16
    assert values["fixed"].tolist() == [1.0, 2.0, 3.0]
    assert values["flags"].tolist() == [True, True]
    assert (values["flag"], values["wide"], values["name"], values["words"]) == (True, -5, "ab", ["c"])
    assert values["inner"] == [{"key": 7, "value": 0.5}, {"key": 8, "value": -0.5}]
    assert values["stamp"] == {"sec": -1, "nanosec": 9}


@pytest.mark.parametrize("order", ["<", ">"])
def test_a_message_cut_anywhere_or_with_wrong_bytes_is_read_or_refused(order: str) -> None:
    reader, whole = MessageReader(parse_schema(NAME, SCHEMA), NAME), packed(order)
    for size in range(len(whole)):
        with pytest.raises(ValueError, match=r"demo_msgs/All: [^\n]+$"):
            reader.read(whole[:size])
    refused = 0
    for position in range(len(whole)):
        for byte in (0, 0x7F, 0xFF):
            try:
                reader.read(whole[:position] + bytes([byte]) + whole[position + 1 :])
            except ValueError:
                refused += 1
    assert refused > 20


def test_what_is_serialised_is_read() -> None:
    name = "posfet_msgs/TactileWrench"
    values = {
        "header": {"stamp": {"sec": 1, "nanosec": 2}, "frame_id": "frame"},
        "layout_id": 3,
        "sequence": 4,
        "wrench": {key: dict.fromkeys("xyz", 1.5) for key in ("force", "torque")},
        "covariance": np.arange(36.0),
        "data_valid": True,
        "reasons": 5,
    }
    found = MessageReader(parse_schema(name, schema_text(name)), name).read(serialise(name, values))
    assert found.pop("covariance").tolist() == values.pop("covariance").tolist()
    assert found == values
    with pytest.raises(ValueError, match="covariance: must have 36 elements, got 2"):
        serialise(name, {**values, "covariance": [1.0, 2.0]})


def test_fields_are_those_of_the_definition() -> None:
    assert fields("a/B", "Header header\nfloat32[9] c\nbyte LOW=1\nc/msg/D[] d") == (
        Field("header", "a/Header", many=False),
        Field("c", "float32", many=True, length=9),
        Field("d", "c/D", many=True),
    )


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "has no fields"),
        ("Other other", "demo_msgs/Other: is not defined"),
        ("All all", "contains itself"),
        ("wstring text", "unsupported type"),
        ("uint8[[]] text", "unsupported type"),
        ("Empty empty\n=====\nMSG: demo_msgs/Empty\n# nothing", "demo_msgs/Empty: has no fields"),
        (
            "L0 a\n" + "".join(f"=====\nMSG: demo_msgs/L{n}\nL{n + 1} a\n" for n in range(DEEPEST)),
            f"nested more than {DEEPEST} times",
        ),
    ],
)
def test_a_schema_that_cannot_be_read_is_refused(text: str, reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        parse_schema(NAME, text)


def test_a_schema_whose_types_multiply_is_checked_at_once() -> None:
    levels = 30
    text = "A0 a\nB0 b\n" + "".join(
        f"=====\nMSG: demo_msgs/{kind}{n}\n" + (f"A{n + 1} a\nB{n + 1} b\n" if n < levels - 1 else "uint8 x\n")
        for n in range(levels)
        for kind in "AB"
    )
    assert len(parse_schema(NAME, text)) == 2 * levels + 1
