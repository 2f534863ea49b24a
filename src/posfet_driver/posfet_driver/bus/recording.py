"""Recordings of a bus, in every format that python-can writes and reads."""

from __future__ import annotations

import contextlib
import struct
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

import can
from can.io.blf import BLFParseError

from posfet_driver.bus.open_bus import one_line
from posfet_model.config import ConfigError

FORMATS: Final = (".log", ".asc", ".blf")
"""candump, Vector's text, Vector's binary."""


_BROKEN: Final = (
    ValueError,
    LookupError,
    ArithmeticError,
    EOFError,
    TypeError,
    can.CanError,
    BLFParseError,
    struct.error,
    zlib.error,
)
"""What python-can's readers let out when a file is not what it seems."""


_BLF: Final = b"LOGG"


LATEST: Final = 1e11
"""Latest time of a frame [s], after 1970 or after the begin of the recording."""


def check_name(file: Path) -> None:
    """Raise ConfigError, one line, for a file whose name tells no format that can be used."""
    if file.suffix.lower() not in FORMATS:
        raise ConfigError(f"{file}: must end with one of {', '.join(FORMATS)}")


@contextlib.contextmanager
def recording(file: Path) -> Iterator[Callable[[can.Message], None]]:
    """Yield what writes a frame. Raises ConfigError, one line, for a file that cannot be written, or no longer."""
    try:
        log = can.Logger(str(file))
        try:
            with log:
                yield log
        finally:
            log.file.close()  # python-can's writers leave it open when they cannot finish it
    except OSError as error:
        raise ConfigError(f"{file}: cannot be written: {error.strerror or one_line(error)}") from error


def messages(file: Path) -> Iterator[can.Message]:
    """Yield what was recorded. Raises ConfigError, one line, for a file that cannot be read."""
    check_name(file)
    try:
        if file.suffix.lower() == ".blf":  # python-can's reader would leave another file open
            with file.open("rb") as start:
                if start.read(len(_BLF)) != _BLF:
                    raise ConfigError(f"{file}: not a recording of its format")
        with can.LogReader(str(file)) as reader:
            for message in reader:
                if not 0 <= message.timestamp <= LATEST:
                    raise ConfigError(f"{file}: times must be in [0, {LATEST:g}] s, got {message.timestamp:g}")
                yield message
            wanted = getattr(reader, "file_size", 0)  # what a BLF file says of itself
            if file.stat().st_size < wanted:
                raise ConfigError(f"{file}: cut off after {file.stat().st_size} of {wanted} bytes")
    except OSError as error:
        raise ConfigError(f"{file}: {error.strerror or one_line(error)}") from error
    except ConfigError:
        raise
    except _BROKEN as error:
        raise ConfigError(f"{file}: not a recording of its format: {one_line(error)}") from error
