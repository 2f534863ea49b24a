# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""MCAP files of ROS messages as rosbag2 writes them: profile ros2, CDR messages, ros2msg schemas."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from posfet_model.config import ConfigError
from posfet_model.files import check_folder
from posfet_sim.recording.whole_writes import SpaceReserve, WholeWrites

CHUNK_SIZE: Final = 1 << 20
"""Size at which a chunk is compressed and written [byte]: what the end of the process by force can take."""
MIN_RESERVE: Final = 4 << 20
"""Space kept for the last chunk and the index [byte]."""
INDEX_SHARE: Final = 256
"""Bytes of chunks for which one byte is kept for the index: an upper estimate of its size."""


class DiskFull(ConfigError):
    """A file got no more space and was closed. The message is one line."""


class MessageFile:
    """Writes messages of several topics.

    A disk that is full ends the file in good order: its index has space of its own.

    Parameters
    ----------
    path : Path
        Path of the file.
    library : str
        Name of the program, for the head of the file.
    overwrite : bool, optional
        Whether to overwrite a file.

    Raises
    ------
    ConfigError
        The package mcap is missing, or the file exists or cannot be created.
    """

    def __init__(self, path: Path, library: str, overwrite: bool = False) -> None:
        try:
            from mcap.writer import Writer  # noqa: PLC0415  # only MCAP files need the package
        except ImportError as error:
            raise ConfigError(f"{path}: needs the package mcap: pip install mcap") from error
        self.path = path
        self.messages = 0
        """Number of messages."""
        self._reserve = SpaceReserve(path.parent)
        try:
            check_folder(path)
            self._stream = WholeWrites(path, self._reserve, overwrite)
        except OSError as error:
            self._reserve.release()
            remedy = "; choose another name, or remove it" if isinstance(error, FileExistsError) else ""
            raise ConfigError(f"{path}: cannot be written: {error.strerror}{remedy}") from error
        stream: Any = self._stream
        self._writer = Writer(stream, chunk_size=CHUNK_SIZE)
        self._schemas: dict[str, int] = {}
        self._closed = False
        try:
            self._writer.start(profile="ros2", library=library)
        except OSError as error:
            self.close()
            raise self._full(error) from error
        self._keep_reserve()

    @property
    def size(self) -> int:
        """Bytes written so far; the last chunk is not yet among them."""
        return self._stream.size

    def add_topic(self, topic: str, name: str, schema: str, qos: str = "") -> int:
        """Add a topic and return its number.

        Parameters
        ----------
        topic : str
            Full name of the topic.
        name : str
            Type of its messages, package/Name.
        schema : str
            Definitions of the type and of all types in it.
        qos : str, optional
            Offered QoS profiles as rosbag2 writes them, for players; default: not known.
        """
        kind = name.replace("/", "/msg/")
        if kind not in self._schemas:
            self._schemas[kind] = self._writer.register_schema(kind, "ros2msg", schema.encode())
        return int(self._writer.register_channel(topic, "cdr", self._schemas[kind], {"offered_qos_profiles": qos}))

    def add(self, topic: int, time: int, data: bytes, sequence: int = 0) -> None:
        """Add a message.

        Parameters
        ----------
        topic : int
            Number of the topic.
        time : int
            Time at which it was sent or received [ns] since the Unix epoch.
        data : bytes
            The message, serialised.
        sequence : int, optional
            Number of the message.

        Raises
        ------
        DiskFull
            The disk is full; the file was closed.
        """
        before = self._stream.size
        self._written(lambda: self._writer.add_message(topic, time, data, time, sequence & 0xFFFF_FFFF))
        self.messages += 1
        if self._stream.size != before:
            self._keep_reserve()

    def flush(self) -> None:
        """Write the messages so far, so that the end of the process cannot take them. Raises DiskFull as `add` does."""
        if not self._closed:
            self._written(self._writer.flush)
            self._keep_reserve()

    def close(self) -> None:
        """Write the last chunk and the index; may be called twice. Raises DiskFull if there is no room for them."""
        if self._closed:
            return
        self._closed = True
        self._reserve.release()
        try:
            if not self._stream.broken:
                self._writer.finish()  # type: ignore[no-untyped-call]
        except OSError as error:
            raise self._full(error) from error
        finally:
            self._stream.close()

    def _written(self, write: Callable[[], object]) -> None:
        try:
            write()
        except OSError as error:
            self.close()
            raise self._full(error) from error

    def _keep_reserve(self) -> None:
        failure = self._stream.failure
        try:
            self._reserve.grow(MIN_RESERVE + self._stream.size // INDEX_SHARE)
        except OSError as error:
            failure = error
        if failure is not None:
            self.close()
            raise self._full(failure) from failure

    def _full(self, error: OSError) -> DiskFull:
        state = "without an index, what it has is read by posfet replay and export" if self._stream.broken else "whole"
        return DiskFull(
            f"{self.path}: cannot be written: {error.strerror}; it ends after {self._stream.size / 1e6:.1f} MB; "
            f"the file is {state}. Free space, or write to another disk"
        )
