"""Odd bytes of an adapter, odd values of a backend and damaged recordings give documented errors only, in one line."""

from __future__ import annotations

import math
import os
import tty
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import can
import pytest
from can.io import BLFWriter
from hypothesis import given, settings
from hypothesis import strategies as st

from posfet_driver.bus.bus_load import BusLoad
from posfet_driver.bus.frame import ERROR, EXTENDED, FD, Frame
from posfet_driver.bus.message_conversion import frame_of, message_of
from posfet_driver.bus.python_can_bus import PythonCanFrameBus
from posfet_driver.bus.recording import messages, recording
from posfet_driver.bus.slcan_bus import SlcanBus
from posfet_driver.bus.slcan_codec import encode_line
from posfet_model.config import ConfigError
from support.frame_examples import FRAMES

FEW = settings(max_examples=60)
MANY = settings(max_examples=5000)
"""Examples of the quick tests and of the slow ones."""
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


# Lines of an adapter ----------------------------------------------------------------------------------------------


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


def check_lines(port: tuple[SlcanBus, int], pieces: list[bytes]) -> None:
    bus, master = port
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


@FEW
@given(pieces=PIECES)
def test_any_bytes_of_an_adapter_are_read(port: tuple[SlcanBus, int], pieces: list[bytes]) -> None:
    check_lines(port, pieces)


@pytest.mark.slow
@MANY
@given(pieces=PIECES)
def test_many_bytes_of_an_adapter_are_read(port: tuple[SlcanBus, int], pieces: list[bytes]) -> None:
    check_lines(port, pieces)


# Messages of a backend ----------------------------------------------------------------------------------------------

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


def check_messages(odd: list[Any]) -> None:
    """Read messages through a bus; those that are no frames are counted."""
    valid = message_of(VALID)
    waiting = [*odd, valid]
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
            assert "\n" not in str(error)


@FEW
@given(odd=st.lists(MESSAGES, max_size=5))
def test_any_message_of_a_backend_is_a_frame_or_unreadable(odd: list[Any]) -> None:
    check_messages(odd)


@pytest.mark.slow
@MANY
@given(odd=st.lists(MESSAGES, max_size=5))
def test_many_messages_of_a_backend_are_frames_or_unreadable(odd: list[Any]) -> None:
    check_messages(odd)


# Recordings -------------------------------------------------------------------------------------------------------

KINDS = ("log", "asc", "blf", "plain.blf")
_EDIT = st.tuples(st.sampled_from(["cut", "set", "insert"]), st.integers(0, 1 << 20), st.binary(min_size=1, max_size=4))
EDITS = st.lists(_EDIT, min_size=1, max_size=4)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Recordings by kind; damage to `plain.blf`, which is not compressed, reaches its objects."""
    folder, files = tmp_path_factory.mktemp("recordings"), {}
    for kind in KINDS:
        files[kind] = folder / f"whole.{kind}"
        recorded = [message_of(frame, 1_700_000_000.0 + number) for number, frame in enumerate(FRAMES)]
        if kind == "plain.blf":
            with BLFWriter(str(files[kind]), compression_level=0) as writer:
                for message in recorded:
                    writer(message)
        else:
            with recording(files[kind]) as log:
                for message in recorded:
                    log(message)
    return files


def check_recording(whole: dict[str, Path], kind: str, edits: list[tuple[str, int, bytes]]) -> None:
    content = bytearray(whole[kind].read_bytes())
    for edit, where, data in edits:
        place = where % (len(content) + 1)
        if edit == "cut":
            del content[place:]
        elif edit == "set":
            content[place : place + len(data)] = data
        else:
            content[place:place] = data
    file = whole[kind].with_name(f"damaged.{kind}")
    file.write_bytes(content)
    count = 0
    try:
        for message in messages(file):
            count += 1
            assert count <= len(content), "it never ends"
            assert isinstance(message, can.Message)
    except ConfigError as error:
        assert str(error).startswith(f"{file}: ")
        assert "\n" not in str(error)


@FEW
@given(kind=st.sampled_from(KINDS), edits=EDITS)
def test_a_damaged_recording_is_read_up_to_the_damage(
    whole: dict[str, Path], kind: str, edits: list[tuple[str, int, bytes]]
) -> None:
    check_recording(whole, kind, edits)


@pytest.mark.slow
@MANY
@given(kind=st.sampled_from(KINDS), edits=EDITS)
def test_many_damaged_recordings_are_read_up_to_the_damage(
    whole: dict[str, Path], kind: str, edits: list[tuple[str, int, bytes]]
) -> None:
    check_recording(whole, kind, edits)


def test_an_object_without_length_does_not_repeat_for_ever(whole: dict[str, Path]) -> None:
    content = whole["plain.blf"].read_bytes()
    third = [place for place in range(len(content)) if content.startswith(b"LOBJ", place)][3]
    edits = [("set", third + 8, bytes(4))]  # the first is the container
    check_recording(whole, "plain.blf", edits)
    with pytest.raises(ConfigError, match="an object is 0 bytes long"):
        list(messages(whole["plain.blf"].with_name("damaged.plain.blf")))
