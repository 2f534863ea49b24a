# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Lines of slcan: round trips, arbitrary chunks, and garbage between lines."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from posfet_driver.bus.frame import CLASSIC, ERROR, EXTENDED, FD, RATE_SWITCH, REMOTE, Frame
from posfet_driver.bus.slcan_codec import FD_LENGTHS, LineReader, encode_line, parse_line

KINDS = st.sampled_from([CLASSIC, REMOTE, FD, FD | RATE_SWITCH])


@st.composite
def frames(draw: st.DrawFn) -> Frame:
    kind, extended = draw(KINDS), draw(st.booleans())
    identifier = draw(st.integers(0, 0x1FFF_FFFF if extended else 0x7FF))
    length = draw(st.sampled_from(FD_LENGTHS if kind & FD else FD_LENGTHS[:9]))
    data = bytes(length) if kind & REMOTE else draw(st.binary(min_size=length, max_size=length))
    return identifier, kind | EXTENDED * extended, data


@given(sent=st.lists(frames(), max_size=30), cuts=st.lists(st.integers(0, 3000), max_size=10))
def test_frames_are_decoded_from_arbitrary_chunks(sent: list[Frame], cuts: list[int]) -> None:
    stream = b"".join(encode_line(frame) for frame in sent * 2)
    reader = LineReader()
    received = []
    for start, end in zip([0, *sorted(cuts)], [*sorted(cuts), len(stream)], strict=True):
        received += reader.frames(stream[start:end])
    assert received == sent * 2
    assert reader.malformed == 0


@given(sent=st.lists(frames(), min_size=1, max_size=10), garbage=st.binary(max_size=300))
def test_the_line_after_garbage_is_decoded(sent: list[Frame], garbage: bytes) -> None:
    reader = LineReader()
    reader.frames(garbage + b"\r")
    assert reader.frames(b"".join(encode_line(frame) for frame in sent)) == sent


@given(st.lists(st.binary(max_size=400), max_size=20))
def test_arbitrary_bytes_raise_no_error(pieces: list[bytes]) -> None:
    reader = LineReader()
    for piece in pieces:
        for identifier, kind, data in reader.frames(piece):
            assert identifier <= (0x1FFF_FFFF if kind & EXTENDED else 0x7FF)
            assert len(data) in FD_LENGTHS
            assert kind & FD or len(data) <= 8


@given(frame=frames(), data=st.data())
def test_a_line_of_wrong_length_is_rejected(frame: Frame, data: st.DataObject) -> None:
    line = encode_line(frame)[:-1]
    reader = LineReader()
    reader.frames(line + b"\r")
    short = line[: data.draw(st.integers(1, len(line) - 1))]
    for wrong in (short, line + b"0", line + b"00000"):
        assert parse_line(wrong) is None or len(wrong) != len(line)
        assert frame not in reader.frames(wrong + b"\r") or frame[2] == b""


def test_time_stamps_at_the_end_are_dropped() -> None:
    reader = LineReader()
    assert reader.frames(b"t10021122ABCD\rt10021122ABCD\r") == [(0x100, CLASSIC, b"\x11\x22")] * 2


def test_replies_are_not_decoded_as_frames() -> None:
    reader = LineReader()
    assert reader.frames(b"\rz\rZ\r\a\r\a") == []
    assert (reader.malformed, reader.refusals) == (0, 2)


@pytest.mark.parametrize(
    "line", [b"t80000", b"T200000000", b"t1009" + b"00" * 9, b"t 1020000", b"t+012FFFF", b"x1000", b"t10", b"t1001G0"]
)
def test_malformed_lines_are_rejected(line: bytes) -> None:
    reader = LineReader()
    assert reader.frames(line + b"\r") == []
    assert reader.malformed == 1


def test_an_endless_line_uses_bounded_memory() -> None:
    reader = LineReader()
    for _ in range(1000):
        assert reader.frames(b"0" * 1000) == []
    assert reader.malformed <= 1001
    assert reader.frames(b"\rt1000\r") == [(0x100, CLASSIC, b"")]


@pytest.mark.parametrize("frame", [(1, ERROR, b""), (1, CLASSIC, bytes(12)), (1, FD, bytes(9))])
def test_frames_that_slcan_cannot_carry_are_rejected(frame: Frame) -> None:
    with pytest.raises(ValueError, match="slcan has no line for a frame of kind"):
        encode_line(frame)
