# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Recordings, adapter lines and frames that nobody meant: each is read, or refused in one line."""

from __future__ import annotations

import contextlib
import struct
import tracemalloc
import zlib
from pathlib import Path

import can
import pytest
from can.io import BLFWriter
from hypothesis import given
from hypothesis import strategies as st

from posfet_driver.bus.frame import CLASSIC, ERROR, EXTENDED, FD, RATE_SWITCH, REMOTE
from posfet_driver.bus.message_conversion import frame_of
from posfet_driver.bus.recording import FORMATS, messages, recording
from posfet_driver.bus.recording_readers import LARGEST_CONTAINER, LARGEST_OBJECT
from posfet_driver.bus.slcan_codec import LineReader
from posfet_driver.protocol.decoder import Decoder
from posfet_model.config import ConfigError
from posfet_model.sensor.description import load_sensor
from posfet_sim.device.simulated_board import SimulatedBoard
from posfet_sim.emulation.firmware import BoardFirmware
from posfet_sim.scene import SceneLoads, load_scene
from support.fuzzing import COUNTS, assert_one_line, examples, mutated

SENSOR = load_sensor()
BASE = SENSOR.can.base_id

FRAMES = st.tuples(
    st.one_of(st.integers(BASE, BASE + 40), st.integers(0, 0x1FFF_FFFF)),
    st.sampled_from([CLASSIC, EXTENDED, REMOTE, ERROR, FD, FD | RATE_SWITCH, FD | EXTENDED]),
    st.binary(max_size=64),
)


def recorded(path: Path) -> bytes:
    """Record frames of every length; `.plain.blf` is not compressed, so that damage reaches its objects."""
    with BLFWriter(str(path), compression_level=0) if ".plain" in path.suffixes else recording(path) as write:
        for index in range(12):
            write(can.Message(1.7e9 + index * 1e-3, BASE + index, False, data=bytes(range(index % 9))))
            write(can.Message(1.7e9 + index * 1e-3, BASE + index, False, is_fd=True, data=bytes(48)))
    return path.read_bytes()


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("suffix", [*FORMATS, ".plain.blf"])
def test_any_recording_is_read_or_refused(tmp_path: Path, suffix: str, count: int) -> None:
    path = tmp_path / f"bus{suffix}"

    @examples(count // 2)
    @given(mutated(recorded(path)))
    def check(content: bytes) -> None:
        path.write_bytes(content)
        try:
            for number, message in enumerate(messages(path)):
                assert number < len(content), "it never ends"
                with contextlib.suppress(ValueError):
                    frame_of(message)
        except ConfigError as error:
            assert_one_line(error, path, limit=5_000)  # it quotes what python-can says

    check()


def test_an_object_without_length_does_not_repeat_for_ever(tmp_path: Path) -> None:
    path = tmp_path / "bus.plain.blf"
    content = recorded(path)
    first, second = [place for place in range(len(content)) if content.startswith(b"LOBJ", place)][1:3]
    for place in (first, second):  # within the container
        path.write_bytes(content[: place + 8] + bytes(4) + content[place + 12 :])
        with pytest.raises(ConfigError, match="an object is 0 bytes long"):
            list(messages(path))


def blf_with(path: Path, *containers: bytes, length: int = 0) -> None:
    """Write a BLF file with these packed containers, each of which may state another length."""
    recorded(path)
    header = path.read_bytes()[:144]
    with path.open("wb") as file:
        file.write(header)
        for packed in containers:
            size = 32 + len(packed)
            file.write(struct.pack("<4sHHLLH14x", b"LOBJ", 16, 1, length or size, 10, 2) + packed + bytes(size % 4))


def peak_memory(path: Path, expected: str) -> int:
    """Return the memory that refusing a recording in one line takes [byte]."""
    tracemalloc.start()
    try:
        with pytest.raises(ConfigError, match=expected) as caught:
            list(messages(path))
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
        assert_one_line(caught.value, path)


def test_a_small_recording_cannot_unpack_to_a_large_one(tmp_path: Path) -> None:
    bomb = tmp_path / "bomb.blf"
    blf_with(bomb, zlib.compress(bytes(8 * LARGEST_CONTAINER), 9))
    assert bomb.stat().st_size < 200_000
    assert peak_memory(bomb, "a container unpacks to more than 16 MiB") < 4 * LARGEST_CONTAINER


def test_an_object_cannot_go_on_through_all_containers(tmp_path: Path) -> None:
    endless = tmp_path / "endless.blf"
    begin = struct.pack("<4sHHLL", b"LOBJ", 16, 1, 0x7FFF_FFFF, 1)
    blf_with(endless, *(zlib.compress(begin + bytes(LARGEST_CONTAINER - 16)) for _ in range(4)))
    assert peak_memory(endless, "an object is 2147483647 bytes long: it must be 16 to 1048576") < 4 * LARGEST_CONTAINER


def test_a_container_of_any_length_is_not_read_at_once(tmp_path: Path) -> None:
    large = tmp_path / "large.blf"
    blf_with(large, b"", length=0x7FFF_FFFF)
    with large.open("ab") as file:
        file.truncate(1 << 30)  # without contents, on the disk as well
    assert peak_memory(large, "an object is 2147483647 bytes long: it must be 16 to 16777216") < LARGEST_OBJECT


@pytest.mark.parametrize("suffix", [".log", ".asc"])
def test_a_line_of_any_length_is_not_read_at_once(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"bus{suffix}"
    recorded(path)
    with path.open("ab") as file:
        file.truncate(1 << 30)
    assert peak_memory(path, "a line is longer than 65536 characters") < LARGEST_OBJECT


@pytest.mark.parametrize("count", COUNTS)
def test_any_line_of_an_adapter_is_read(count: int) -> None:
    lines = st.one_of(
        st.binary(max_size=12), st.sampled_from([b"t1238", b"d1239" + b"0" * 20, b"F04", b"\r", b"\a", b"z\r", b"T0"])
    )

    @examples(count)
    @given(st.lists(lines, max_size=30))
    def check(pieces: list[bytes]) -> None:
        reader = LineReader()
        for piece in pieces:
            for identifier, _, data in reader.frames(piece):
                assert 0 <= identifier < 1 << 29
                assert len(data) <= 64

    check()


@pytest.mark.parametrize("count", COUNTS)
def test_any_frames_are_decoded(count: int) -> None:
    @examples(count)
    @given(st.lists(FRAMES, max_size=20))
    def check(frames: list[tuple[int, int, bytes]]) -> None:
        decoder = Decoder(SENSOR)
        decoder.receiving = True
        for index, frame in enumerate(frames):
            list(decoder.decode([frame], index * 10**6, index * 10**6))

    check()


@pytest.mark.parametrize("count", COUNTS)
def test_any_frames_are_received_by_the_simulated_board(count: int) -> None:
    @examples(count // 4)
    @given(st.lists(FRAMES, max_size=20))
    def check(frames: list[tuple[int, int, bytes]]) -> None:
        board = SimulatedBoard(SENSOR, SceneLoads(load_scene("idle", SENSOR), SENSOR), 0)
        firmware = BoardFirmware(SENSOR, board, 0)
        for index, frame in enumerate(frames):
            assert len(firmware.receive(frame, index * 10**6)) <= 1

    check()
