# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Odd bytes of an adapter and odd values of a backend: each is a frame, or counted as unreadable."""

from __future__ import annotations

import math
import os
import tty
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from posfet_driver.bus.bus_load import BusLoad
from posfet_driver.bus.frame import ERROR, EXTENDED, FD, Frame
from posfet_driver.bus.message_conversion import frame_of, message_of
from posfet_driver.bus.python_can_bus import PythonCanFrameBus
from posfet_driver.bus.slcan_bus import SlcanBus
from posfet_driver.bus.slcan_codec import encode_line
from support.frame_examples import FRAMES
from support.fuzzing import COUNTS, assert_one_line, examples

VALID: Frame = (0x123, 0, b"\x01\x02")


def assert_valid(frame: Frame) -> None:
    """Assert that a frame is one that CAN allows, and that the load of the bus can be computed from it."""
    identifier, kind, data = frame
    assert 0 <= identifier <= (0x1FFF_FFFF if kind & (EXTENDED | ERROR) else 0x7FF)
    assert len(data) <= (64 if kind & FD else 8)
    load = BusLoad(1_000_000, 5_000_000)
    load.add([], 2_000_000_000)
    load.add([frame], 4_000_000_000)
    assert 0 < load.load < math.inf


@pytest.fixture(scope="module")
def port() -> Iterator[tuple[SlcanBus, int]]:
    """A bus on a terminal, and the descriptor of its far end."""
    master, slave = os.openpty()
    tty.setraw(slave)
    bus = SlcanBus(os.ttyname(slave), fd=True)
    yield bus, master
    bus.shutdown()
    os.close(master)
    os.close(slave)


PIECES = st.lists(
    st.one_of(
        st.binary(max_size=60),
        st.text("tTrRdDbBzZFVNxq0123456789ABCDEFabcdef\r\a \n", max_size=60).map(str.encode),
        st.sampled_from([encode_line(frame) for frame in FRAMES]).flatmap(
            lambda line: st.integers(0, len(line)).map(lambda length: line[:length])
        ),
    ),
    max_size=8,
)


@pytest.mark.parametrize("count", COUNTS)
def test_any_bytes_of_an_adapter_are_read(port: tuple[SlcanBus, int], count: int) -> None:
    bus, master = port

    @examples(count)
    @given(PIECES)
    def check(pieces: list[bytes]) -> None:
        before, received = bus.unreadable, []
        for piece in [*pieces, b"\r", encode_line(VALID)]:
            if piece:
                os.write(master, piece)
                received += bus.read_frames(1.0)
        while received[-1:] != [VALID]:
            received += bus.read_frames(1.0)
        for frame in received:
            assert_valid(frame)
        assert bus.unreadable - before <= sum(map(len, pieces))

    check()


ODD = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.integers(-1, 70),
    st.floats(),
    st.text(max_size=3),
    st.binary(max_size=70),
)
MESSAGES = st.builds(
    SimpleNamespace,
    timestamp=ODD,
    arbitration_id=st.one_of(st.integers(0, 0x7FF), ODD),
    is_extended_id=st.one_of(st.booleans(), ODD),
    is_remote_frame=st.one_of(st.just(False), ODD),
    is_error_frame=st.one_of(st.just(False), ODD),
    is_fd=st.one_of(st.booleans(), ODD),
    bitrate_switch=st.one_of(st.booleans(), ODD),
    dlc=st.one_of(st.integers(0, 8), ODD),
    data=st.one_of(
        st.binary(max_size=8), st.binary(max_size=70).map(bytearray), st.lists(st.integers(), max_size=3), ODD
    ),
)


@pytest.mark.parametrize("count", COUNTS)
def test_any_message_of_a_backend_is_a_frame_or_unreadable(count: int) -> None:
    @examples(count)
    @given(st.lists(MESSAGES, max_size=5))
    def check(odd: list[Any]) -> None:
        waiting = [*odd, message_of(VALID)]
        bus = PythonCanFrameBus(SimpleNamespace(recv=lambda timeout: waiting.pop(0) if waiting else None))
        frames = bus.read_frames(0.0)
        assert frames[-1] == VALID
        assert len(frames) + bus.unreadable == len(odd) + 1
        for frame in frames:
            assert_valid(frame)
        for message in odd:
            try:
                assert frame_of(message) in frames
            except ValueError as error:
                assert_one_line(error)

    check()
