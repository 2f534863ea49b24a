# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Frames that are read by the compiled path agree with those that are read in Python, from any bytes."""

from __future__ import annotations

import random
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from posfet_core.protocol import LineReader, parse_kernel_frame, parse_line
from posfet_driver.bus.frame import EXTENDED, FD, RATE_SWITCH, REMOTE, Frame
from posfet_driver.bus.slcan_codec import FD_LENGTHS, encode_line
from reference.protocol import kernel_frames, slcan_lines

LONGEST = 142
"""Length of the longest line of a frame [byte]; of a longer one the compiled reader keeps one byte more."""


def random_frame(noise: random.Random) -> Frame:
    kind = noise.choice([0, REMOTE, FD, FD | RATE_SWITCH])
    extended = EXTENDED * (noise.random() < 0.3)
    length = noise.choice(FD_LENGTHS if kind & FD else FD_LENGTHS[:9])
    data = bytes(length) if kind & REMOTE else noise.randbytes(length)
    return noise.randrange(0x2000_0000 if extended else 0x800), kind | extended, data


def random_bytes(noise: random.Random) -> bytes:
    """Return lines, of which some are replies, some stamped, cut, too long, or spoilt in a byte."""
    stream = bytearray()
    for _ in range(noise.randrange(12)):
        line = bytearray(encode_line(random_frame(noise))[:-1])
        match noise.randrange(12):
            case 0:
                line = bytearray(noise.choice([b"", b"z", b"Z", b"\a", b"F04", b"F8", b"Fg0", b"V1010", b"t10\a"]))
            case 1:
                line += noise.choice([b"12AB", b"    ", b"0", b"1234567"])
            case 2:
                del line[noise.randrange(len(line)) :]
            case 3:
                line[noise.randrange(len(line))] = noise.choice(b"gG \a\x00\xff+-_:xX0")
            case 4:
                line += b"0" * noise.choice([60, 130, 141, 142, 143, 400])
            case 5:
                line = bytearray(bytes(line).lower())
                line[:1] = noise.choice([line[:1], bytes(line[:1]).upper()])
        stream += line + noise.choice([b"\r"] * 9 + [b"", b"\a", b"\r\r"])
    return bytes(stream)


def compare(pieces: list[bytes]) -> LineReader:
    """Give pieces of a stream to both readers, and return ours."""
    ours, theirs = LineReader(), slcan_lines.LineReader()
    for piece in pieces:
        assert ours.frames(piece) == theirs.frames(piece)
        assert (ours.malformed, ours.refusals, ours.flags) == (theirs.malformed, theirs.refusals, theirs.flags)
        if len(piece) % 5 == 0:
            ours.flags = theirs.flags = None
    return ours


def test_lines_in_any_pieces_give_the_same_frames_and_counters() -> None:
    noise = random.Random(1)
    malformed = refusals = 0
    for _ in range(1500):
        stream = random_bytes(noise)
        cuts = sorted(noise.randrange(len(stream) + 1) for _ in range(noise.randrange(9)))
        reader = compare([stream[start:end] for start, end in zip([0, *cuts], [*cuts, len(stream)], strict=True)])
        malformed, refusals = malformed + reader.malformed, refusals + reader.refusals
    assert malformed > 1000
    assert refusals > 50


@given(st.lists(st.binary(max_size=300), max_size=12))
def test_arbitrary_bytes_give_the_same_frames_and_counters(pieces: list[bytes]) -> None:
    compare(pieces)


@given(st.lists(st.text("tTrRdDbBF0189aAfFz\r\a", max_size=200), max_size=12))
def test_bytes_like_those_of_lines_give_the_same_frames_and_counters(pieces: list[str]) -> None:
    compare([piece.encode() for piece in pieces])


@given(st.lists(st.binary(max_size=300).map(lambda data: data.replace(b"x", b"\r")), max_size=12))
def test_the_lines_are_the_same(pieces: list[bytes]) -> None:
    ours, theirs = LineReader(), slcan_lines.LineReader()
    for piece in pieces:
        assert ours.lines(piece) == [line[: LONGEST + 1] for line in theirs.lines(piece)]


@given(st.one_of(st.binary(max_size=160), st.text("tTrRdDbB0189aAfF", max_size=150).map(str.encode)))
def test_a_line_is_the_same_frame(line: bytes) -> None:
    assert parse_line(line) == slcan_lines.parse_line(line)


def test_an_unfinished_line_can_be_discarded() -> None:
    reader = LineReader()
    assert reader.frames(b"t1002AB") == []
    reader.clear()
    assert reader.frames(b"CD\rt1001AB\r") == [(0x100, 0, b"\xab")]
    assert reader.malformed == 1


@given(
    head=st.tuples(st.integers(0, 0xFFFF_FFFF), st.integers(0, 255), st.integers(0, 255)),
    data=st.sampled_from([8, 64, 0, 5]).flatmap(lambda size: st.binary(min_size=size, max_size=size)),
)
def test_a_frame_of_the_kernel_is_the_same(head: tuple[int, int, int], data: bytes) -> None:
    read = struct.pack("=IBB2x", *head) + data
    assert parse_kernel_frame(read) == kernel_frames.parse_kernel_frame(read)


@pytest.mark.parametrize("size", range(8))
def test_too_few_bytes_are_no_frame_of_the_kernel(size: int) -> None:
    with pytest.raises(ValueError, match=f"at least 8 bytes, got {size}"):
        parse_kernel_frame(bytes(size))
