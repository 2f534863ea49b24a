# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Recordings of a bus in the formats of python-can."""

from __future__ import annotations

import contextlib
import struct
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO, Final

import can
from can.io.blf import BLFParseError

from posfet_driver.bus.bus_error import one_line
from posfet_driver.bus.recording_readers import BoundedBlfReader, BoundedLines
from posfet_model.config import ConfigError
from posfet_model.files import check_folder

FORMATS: Final = (".log", ".asc", ".blf")
"""candump, Vector ASC (text), Vector BLF (binary)."""

_DAMAGED: Final = (
    ValueError,
    LookupError,
    ArithmeticError,
    EOFError,
    MemoryError,
    TypeError,
    can.CanError,
    BLFParseError,
    struct.error,
    zlib.error,
)
"""Exceptions that python-can's readers raise for a damaged file."""

_BLF: Final = b"LOGG"
"""First bytes of a BLF file."""

LATEST: Final = 1e11
"""Latest time of a frame [s], since 1970 or since the beginning of the recording."""


def check_name(file: Path) -> None:
    """Raise ConfigError, one line, for a file whose suffix names no known format."""
    if file.suffix.lower() not in FORMATS:
        raise ConfigError(f"{file}: must end with one of {', '.join(FORMATS)}")


@contextlib.contextmanager
def recording(file: Path) -> Iterator[Callable[[can.Message], None]]:
    """Open a file for recording; when that fails before a message is in it, no file is left.

    Parameters
    ----------
    file : Path
        File to be written; its suffix selects the format.

    Yields
    ------
    callable
        Writes a message.

    Raises
    ------
    ConfigError
        When the file cannot be written; one line.
    """
    written = 0

    def write(message: can.Message) -> None:
        nonlocal written
        log(message)
        written += 1

    try:
        check_folder(file)
        log = can.Logger(str(file))
        try:
            with log:
                yield write
        finally:
            log.file.close()  # python-can's writers leave it open when they fail
    except BaseException as error:
        with contextlib.suppress(OSError):
            if file.is_file() and not (written and file.stat().st_size):
                file.unlink()
        if isinstance(error, OSError):
            raise ConfigError(f"{file}: cannot be written: {error.strerror or one_line(error)}") from error
        raise


def _reader(file: Path, content: BinaryIO) -> can.LogReader | can.io.generic.MessageReader:
    """Return the reader of the file's format."""
    match file.suffix.lower():
        case ".blf":
            if content.read(len(_BLF)) != _BLF:
                raise ConfigError(f"{file}: not a recording of its format")
            content.seek(0)
            return BoundedBlfReader(content)
        case ".asc":
            return can.ASCReader(BoundedLines(content))
        case _:
            return can.CanutilsLogReader(BoundedLines(content))


def messages(file: Path) -> Iterator[can.Message]:
    """Read a recording.

    Parameters
    ----------
    file : Path
        The recording; its suffix names the format.

    Yields
    ------
    can.Message
        The recorded messages, in order.

    Raises
    ------
    ConfigError
        For a file that cannot be read or is damaged; one line.
    """
    check_name(file)
    try:
        with contextlib.ExitStack() as stack:
            reader = _reader(file, stack.enter_context(file.open("rb")))
            for message in reader:
                if not 0 <= message.timestamp <= LATEST:
                    raise ConfigError(f"{file}: times must be in [0, {LATEST:g}] s, got {message.timestamp:g}")
                yield message
            wanted = getattr(reader, "file_size", 0)  # stated in a BLF file
            if file.stat().st_size < wanted:
                raise ConfigError(f"{file}: cut off after {file.stat().st_size} of {wanted} bytes")
    except OSError as error:
        raise ConfigError(f"{file}: {error.strerror or one_line(error)}") from error
    except ConfigError:
        raise
    except _DAMAGED as error:
        raise ConfigError(f"{file}: not a recording of its format: {one_line(error)}") from error
