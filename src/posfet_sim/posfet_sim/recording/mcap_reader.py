# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Reading of MCAP files with ROS messages: those of this stack, of rosbag2, damaged and hostile ones."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, BinaryIO, Final

from posfet_model.config import ConfigError
from posfet_sim.recording.cdr_reader import MessageReader
from posfet_sim.recording.ros2msg import parse_schema, short_name

MAGIC: Final = b"\x89MCAP0\r\n"
LARGEST_RECORD: Final = 256 << 20
"""Limit for a record, and for a chunk as decompressed [byte]."""
LARGEST_INDEX: Final = 64 << 20
"""Limit for the records after the messages [byte]; a file with a larger index is read from its beginning."""

_RECORD: Final = struct.Struct("<BQ")
_MESSAGE: Final = struct.Struct("<HIQQ")
_FOOTER: Final = struct.Struct("<QQI")
_FOOTER_OPCODE, _SCHEMA, _CHANNEL, _MESSAGE_OPCODE, _CHUNK, _STATISTICS, _DATA_END = (
    0x02,
    0x03,
    0x04,
    0x05,
    0x06,
    0x0B,
    0x0F,
)
_END: Final = _RECORD.size + _FOOTER.size + len(MAGIC)


class Damaged(ValueError):
    """A record cannot be read; the message says in a few words why."""


@dataclass(eq=False)
class Topic:
    """One topic of a recording."""

    name: str
    """Full name of the topic."""
    type: str
    """Type of its messages, package/Name."""
    encoding: str
    """Encoding of its messages; `cdr` can be read."""
    schema: str
    """Definitions of the type and of all types in it."""
    schema_encoding: str
    """Encoding of the schema; `ros2msg` can be read."""

    @cached_property
    def reader(self) -> MessageReader:
        """Reader of its messages; ValueError, one line, if there can be none."""
        if self.encoding != "cdr" or self.schema_encoding != "ros2msg":
            raise ValueError(
                f"{self.name}: is {self.encoding} with a schema in {self.schema_encoding or 'no language'}"
            )
        return MessageReader(parse_schema(self.type, self.schema), self.type)


@dataclass(slots=True)
class Message:
    """One message of a recording."""

    topic: Topic
    time: int
    """Time at which it was recorded [ns] since the Unix epoch."""
    data: bytes
    """The message, serialised."""


@dataclass
class Overview:
    """What a recording contains."""

    topics: dict[str, Topic] = field(default_factory=dict)
    """Topics by name."""
    counts: dict[str, int] = field(default_factory=dict)
    """Number of messages by topic."""
    begin: int = 0
    """Time of the first message [ns] since the Unix epoch."""
    end: int = 0
    """Time of the last message [ns] since the Unix epoch."""

    @property
    def messages(self) -> int:
        """Number of messages."""
        return sum(self.counts.values())


class Recording:
    """A recording on disk. Whatever its bytes are, what is whole is read, and `missing` says what is not.

    Parameters
    ----------
    path : Path
        Path of the file.

    Raises
    ------
    ConfigError
        The file cannot be read, or is no MCAP file; one line.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.missing = ""
        """After `messages`: what could not be read, in one line; '' if everything could."""
        try:
            import mcap.records  # noqa: F401, PLC0415  # only MCAP files need the package
        except ImportError as error:
            raise ConfigError(f"{path}: needs the package mcap: pip install mcap") from error
        try:
            regular, exists = path.is_file(), path.exists()
        except (OSError, ValueError) as error:
            raise ConfigError(f"{path}: not a file name") from error
        if not regular:
            raise ConfigError(f"{path}: {'not a file' if exists else 'no such file'}")
        try:
            self.size = path.stat().st_size
            """Size of the file [byte]."""
            with path.open("rb") as stream:
                start = stream.read(len(MAGIC))
        except OSError as error:
            raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
        if start != MAGIC:
            raise ConfigError(
                f"{path}: not an MCAP file; those of posfet record, posfet sim and ros2 bag record -s mcap can be read"
            )

    def messages(self, at: Callable[[int], object] = lambda _: None) -> Iterator[Message]:
        """Iterate over the messages in the order of the file.

        Parameters
        ----------
        at : callable, optional
            Called with the position in the file [byte] now and then.

        Yields
        ------
        Message
            A message.
        """
        self.missing = ""
        topics = _Topics()
        count = 0
        begin = position = len(MAGIC)
        try:
            with self.path.open("rb") as stream:
                stream.seek(position)
                for opcode, body in _records(stream, self.size - position):
                    begin, position = position, position + _RECORD.size + len(body)
                    if opcode == _DATA_END:
                        return
                    at(begin)
                    for message in _content(opcode, body, topics):
                        count += 1
                        yield message
                begin = position
                problem = "it was not closed" if self.size == position else "it ends within a record"
        except (Damaged, OSError, ValueError, struct.error, MemoryError) as error:
            problem = " ".join(str(error).split()) or "out of memory"
            if not isinstance(error, Damaged):
                problem = f"damaged: {problem}"
        self.missing = f"{self.path}: {problem}; {count} messages up to byte {begin} of {self.size} were read"

    def overview(self) -> Overview:
        """Return what the recording contains: by its index if there is one, otherwise by reading all of it."""
        try:
            found = self._index()
        except (ValueError, OSError, struct.error, MemoryError):
            found = None
        if found is None:
            found = Overview()
            for message in self.messages():
                name = message.topic.name
                found.topics.setdefault(name, message.topic)
                found.counts[name] = found.counts.get(name, 0) + 1
                found.begin = min(found.begin or message.time, message.time)
                found.end = max(found.end, message.time)
        return found

    def _index(self) -> Overview | None:
        """Return the content of the index, None if there is none."""
        if self.size < len(MAGIC) + _END:
            return None
        with self.path.open("rb") as stream:
            stream.seek(self.size - _END)
            last = stream.read(_END)
            opcode, length = _RECORD.unpack_from(last)
            begin, _, _ = _FOOTER.unpack_from(last, _RECORD.size)
            size = self.size - _END - begin
            if (opcode, length) != (_FOOTER_OPCODE, _FOOTER.size) or not last.endswith(MAGIC):
                return None
            if not begin or not 0 < size <= LARGEST_INDEX:
                return None
            stream.seek(begin)
            return _overview(stream, size)


def _overview(stream: BinaryIO, size: int) -> Overview | None:
    from mcap.records import Statistics  # noqa: PLC0415

    topics, statistics = _Topics(), None
    for opcode, body in _records(stream, size):
        if opcode == _STATISTICS:
            statistics = _parsed(Statistics, body)
        else:
            topics.add(opcode, body)
    if statistics is None:
        return None
    found = Overview(begin=statistics.message_start_time, end=statistics.message_end_time)
    for channel, count in statistics.channel_message_counts.items():
        topic = topics.channels.get(channel)
        if topic is None:
            return None
        if count:
            found.topics[topic.name] = topic
            found.counts[topic.name] = found.counts.get(topic.name, 0) + count
    return found


class _Topics:
    """The schemas and channels read so far."""

    def __init__(self) -> None:
        from mcap.records import Channel, Schema  # noqa: PLC0415

        self._channel: Any = Channel
        self._schema: Any = Schema
        self._schemas: dict[int, tuple[str, str, str]] = {0: ("", "", "")}
        self.channels: dict[int, Topic] = {}

    def add(self, opcode: int, body: bytes) -> None:
        """Read a record if it is a schema or a channel."""
        if opcode == _SCHEMA:
            schema = _parsed(self._schema, body)
            self._schemas[schema.id] = short_name(schema.name), schema.data.decode(), schema.encoding
        elif opcode == _CHANNEL:
            channel = _parsed(self._channel, body)
            if channel.schema_id not in self._schemas:
                raise Damaged(f"topic {channel.topic} has no schema")
            name, text, language = self._schemas[channel.schema_id]
            if channel.id not in self.channels:
                self.channels[channel.id] = Topic(channel.topic, name, channel.message_encoding, text, language)


def _parsed(kind: Any, body: bytes) -> Any:
    """Return a record of mcap's from its body; raise Damaged if it is too short."""
    from mcap.data_stream import ReadDataStream  # noqa: PLC0415
    from mcap.exceptions import McapError  # noqa: PLC0415

    try:
        return kind.read(ReadDataStream(io.BytesIO(body)))
    except McapError as error:
        raise Damaged(f"a record of the kind {kind.__name__} is too short") from error


def _records(stream: BinaryIO, size: int) -> Iterator[tuple[int, bytes]]:
    """Iterate over the records in the next `size` bytes: opcode and body. A last one that is not whole is left out."""
    while size >= _RECORD.size:
        opcode, length = _RECORD.unpack(stream.read(_RECORD.size))
        size -= _RECORD.size
        if length > size:
            return
        if length > LARGEST_RECORD:
            raise Damaged(f"a record of {length >> 20} MiB is above the limit of {LARGEST_RECORD >> 20} MiB")
        body = stream.read(length)
        if len(body) != length:
            return
        size -= length
        yield opcode, body


def _content(opcode: int, body: bytes, topics: _Topics) -> Iterator[Message]:
    """Iterate over the messages of a record, which may be a chunk."""
    if opcode == _CHUNK:
        data = _decompressed(body)
        at = 0
        while at < len(data):
            kind, length = _RECORD.unpack_from(data, at)
            at += _RECORD.size
            if length > len(data) - at:
                raise Damaged("a chunk ends within a record")
            yield from _content_of_chunk(kind, data[at : at + length], topics)
            at += length
    else:
        yield from _content_of_chunk(opcode, body, topics)


def _content_of_chunk(opcode: int, body: bytes, topics: _Topics) -> Iterator[Message]:
    if opcode == _MESSAGE_OPCODE:
        channel, _, time, _ = _MESSAGE.unpack_from(body)
        topic = topics.channels.get(channel)
        if topic is None:
            raise Damaged(f"a message of channel {channel}, which is not described")
        yield Message(topic, time, body[_MESSAGE.size :])
    elif opcode in {_SCHEMA, _CHANNEL}:
        topics.add(opcode, body)


def _decompressed(body: bytes) -> bytes:
    """Return the records of a chunk; raise Damaged if they are not those that were written."""
    from mcap.records import Chunk  # noqa: PLC0415

    chunk = _parsed(Chunk, body)
    size = chunk.uncompressed_size
    if size > LARGEST_RECORD:
        raise Damaged(f"a chunk of {size >> 20} MiB is above the limit of {LARGEST_RECORD >> 20} MiB")
    data = _DECOMPRESS.get(chunk.compression, _unknown)(chunk.data, size)
    if len(data) != size or (chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc):
        raise Damaged("the checksum of a chunk is wrong")
    return data


def _zstd(data: bytes, size: int) -> bytes:
    import zstandard  # noqa: PLC0415

    try:
        with zstandard.ZstdDecompressor().stream_reader(data) as stream:
            return bytes(stream.read(size + 1))
    except zstandard.ZstdError as error:
        raise Damaged("a chunk cannot be decompressed") from error


def _lz4(data: bytes, size: int) -> bytes:
    import lz4.frame  # noqa: PLC0415

    try:
        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1))
    except RuntimeError as error:
        raise Damaged("a chunk cannot be decompressed") from error


def _plain(data: bytes, _size: int) -> bytes:
    return data


def _unknown(_data: bytes, _size: int) -> bytes:
    raise Damaged("a chunk is compressed in an unknown way")


_DECOMPRESS: Final[dict[str, Callable[[bytes, int], bytes]]] = {"": _plain, "zstd": _zstd, "lz4": _lz4}
