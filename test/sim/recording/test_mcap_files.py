# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Recordings as files: what is written is read; what is damaged or hostile is read as far as it is whole."""

from __future__ import annotations

import errno
import io
import random
from collections.abc import Callable
from pathlib import Path

import pytest

pytest.importorskip("mcap", reason="recordings need the package mcap")

from mcap.data_stream import RecordBuilder
from mcap.records import Channel, Chunk, Schema
from mcap.records import Message as MessageRecord

from posfet_model.config import ConfigError
from posfet_sim.recording import mcap_file, mcap_reader
from posfet_sim.recording.mcap_file import DiskFull, MessageFile
from posfet_sim.recording.mcap_reader import MAGIC, Recording
from posfet_sim.recording.whole_writes import WholeWrites

NUMBER = "demo_msgs/Number"
SCHEMA = "uint32 value"


def data(value: int) -> bytes:
    return b"\0\1\0\0" + value.to_bytes(4, "little")


def written(path: Path, count: int = 50) -> list[tuple[str, int]]:
    """Write a recording with two topics and return topic and value of its messages."""
    file = MessageFile(path, "test")
    topics = {name: file.add_topic(name, NUMBER, SCHEMA) for name in ("/a", "/b")}
    messages = [(name, value) for value in range(count) for name in topics]
    for name, value in messages:
        file.add(topics[name], 1000 + value, data(value))
    file.close()
    return messages


def read(recording: Recording) -> list[tuple[str, int]]:
    return [(each.topic.name, each.topic.reader.read(each.data)["value"]) for each in recording.messages()]


def record(write: Callable[[RecordBuilder], object]) -> bytes:
    builder = RecordBuilder()
    write(builder)
    return bytes(builder.end())


def chunk(content: bytes, compression: str = "", size: int | None = None) -> bytes:
    size = len(content) if size is None else size
    return record(Chunk(compression, content, 0, 0, 0, size).write)


HEAD = record(Schema(1, SCHEMA.encode(), "ros2msg", "demo_msgs/msg/Number").write)
HEAD += record(Channel(1, "/a", "cdr", {}, 1).write)


def test_what_is_written_is_read(tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    messages = written(path)
    recording = Recording(path)
    assert read(recording) == messages
    assert recording.missing == ""
    overview = recording.overview()
    assert (overview.counts, overview.begin, overview.end) == ({"/a": 50, "/b": 50}, 1000, 1049)


def test_a_file_cut_anywhere_is_read_as_far_as_it_is_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mcap_file, "CHUNK_SIZE", 300)
    path, cut = tmp_path / "x.mcap", tmp_path / "cut.mcap"
    messages = written(path)
    whole = path.read_bytes()
    counts = []
    for size in range(len(MAGIC), len(whole), 41):
        cut.write_bytes(whole[:size])
        recording = Recording(cut)
        found = read(recording)
        assert found == messages[: len(found)]
        assert recording.missing.count("\n") == 0
        if len(found) < len(messages):
            assert recording.missing.startswith(f"{cut}: it ")
            assert f"{len(found)} messages up to byte " in recording.missing
        assert sum(recording.overview().counts.values()) == len(found)
        counts.append(len(found))
    assert counts == sorted(counts)
    assert counts[0] == 0
    assert counts[-1] == len(messages)


def test_a_file_with_wrong_bytes_is_read_or_said_to_be_damaged(tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    messages = written(path)
    whole = path.read_bytes()
    random_numbers = random.Random(3)
    damaged = 0
    for _ in range(300):
        bad = bytearray(whole)
        for _ in range(random_numbers.choice((1, 1, 4))):
            bad[random_numbers.randrange(len(MAGIC), len(bad))] = random_numbers.randrange(256)
        path.write_bytes(bad)
        recording = Recording(path)
        try:
            found = read(recording)
        except ValueError as error:
            assert "\n" not in str(error)
            continue
        recording.overview()
        assert recording.missing.count("\n") == 0
        assert len(found) <= len(messages)
        damaged += bool(recording.missing)
    assert damaged > 50


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"\x05" + (1 << 60).to_bytes(8, "little"), "it ends within a record"),
        (record(MessageRecord(7, 0, data(1), 0, 0).write), "a message of channel 7, which is not described"),
        (record(Channel(1, "/a", "cdr", {}, 9).write), "topic /a has no schema"),
        (chunk(b"x", "zip"), "a chunk is compressed in an unknown way"),
        (chunk(b"x", "zstd"), "a chunk cannot be decompressed"),
        (chunk(b"xxxxxxxxxxxxxxxxxxxx", "lz4"), "a chunk cannot be decompressed"),
        (chunk(b"", size=1 << 40), "a chunk of 1048576 MiB is above the limit of 256 MiB"),
        (chunk(HEAD, size=3), "the checksum of a chunk is wrong"),
        (chunk(HEAD[:-3]), "a chunk ends within a record"),
    ],
)
def test_a_hostile_record_ends_the_reading_in_one_line(tmp_path: Path, content: bytes, reason: str) -> None:
    path = tmp_path / "x.mcap"
    path.write_bytes(MAGIC + HEAD + record(MessageRecord(1, 0, data(5), 0, 0).write) + content)
    recording = Recording(path)
    assert read(recording) == [("/a", 5)]
    assert recording.missing.startswith(f"{path}: {reason}; 1 messages up to byte ")


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_a_small_chunk_does_not_become_a_large_one(
    tmp_path: Path, compression: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    lz4, zstandard = pytest.importorskip("lz4.frame"), pytest.importorskip("zstandard")
    bomb = (lz4 if compression == "lz4" else zstandard).compress(bytes(20_000_000))
    path = tmp_path / "x.mcap"
    path.write_bytes(MAGIC + chunk(bomb, compression, size=1000))
    seen: list[int] = []
    original = mcap_reader._DECOMPRESS[compression]

    def measured(content: bytes, size: int) -> bytes:
        result = original(content, size)
        seen.append(len(result))
        return result

    monkeypatch.setitem(mcap_reader._DECOMPRESS, compression, measured)
    recording = Recording(path)
    assert read(recording) == []
    assert seen == [1001]
    assert "the checksum of a chunk is wrong" in recording.missing


def test_a_record_above_the_limit_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mcap_reader, "LARGEST_RECORD", 1 << 20)
    path = tmp_path / "x.mcap"
    with path.open("wb") as stream:
        stream.write(MAGIC + b"\x05" + (2 << 20).to_bytes(8, "little"))
        stream.truncate(3 << 20)
    recording = Recording(path)
    assert read(recording) == []
    assert "a record of 2 MiB is above the limit of 1 MiB" in recording.missing


@pytest.mark.parametrize("content", [None, b"", b"SQLite format 3\0"])
def test_what_is_no_recording_is_refused_in_one_line(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "x.mcap"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ConfigError, match="no such file" if content is None else "not an MCAP file; those of") as error:
        Recording(path)
    assert "\n" not in str(error.value)
    with pytest.raises(ConfigError, match="not a file"):
        Recording(tmp_path)


class SmallDisk(io.RawIOBase):
    """A file on a disk with little space, some of which the reserve holds."""

    def __init__(self, path: Path, space: int) -> None:
        self.file = path.open("r+b", buffering=0)
        self.space = space

    def write(self, content: memoryview) -> int:
        room = self.space - self.file.tell()
        if room <= 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        return self.file.write(content[:room])

    def seek(self, to: int, whence: int = 0) -> int:
        return self.file.seek(to, whence)

    def truncate(self, size: int | None = None) -> int:
        return self.file.truncate(size)

    def close(self) -> None:
        self.file.close()


@pytest.mark.parametrize("reserve", [20_000, 0])
def test_a_full_disk_leaves_a_readable_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, reserve: int) -> None:
    monkeypatch.setattr(mcap_file, "CHUNK_SIZE", 2000)
    path = tmp_path / "x.mcap"
    file = MessageFile(path, "test")
    stream = file._stream
    assert isinstance(stream, WholeWrites)
    disk = SmallDisk(path, 10_000)
    disk.seek(stream.size)
    stream._file.close()
    monkeypatch.setattr(stream, "_file", disk)
    released: list[int] = []

    def release() -> bool:
        disk.space += reserve if not released else 0
        released.append(reserve)
        return reserve > 0 and len(released) == 1

    monkeypatch.setattr(file._reserve, "release", release)
    topic = file.add_topic("/a", NUMBER, SCHEMA)
    sent = random.Random(1)
    values = []
    with pytest.raises(DiskFull, match="No space left on device") as full:
        for _ in range(100_000):
            values.append(sent.randrange(1 << 32))
            file.add(topic, 1, data(values[-1]))
    assert "\n" not in str(full.value)
    recording = Recording(path)
    found = [value for _, value in read(recording)]
    assert found == values[: len(found)]
    if reserve:
        assert len(found) == len(values)
        assert recording.missing == ""
    else:
        assert 0 < len(found) < len(values)
        assert "it was not closed" in recording.missing


def test_a_recording_is_not_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    written(path)
    with pytest.raises(ConfigError, match="File exists; choose another name, or remove it"):
        MessageFile(path, "test")
    with pytest.raises(ConfigError, match=f"x.mcap: cannot be written: {tmp_path}/none is not a folder"):
        MessageFile(tmp_path / "none" / "x.mcap", "test")
