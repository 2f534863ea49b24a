"""Short messages of the protocol (commands, responses, status) and all CAN identifiers; see docs/protocol.md."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from enum import IntEnum
from typing import Final, TypeAlias

from posfet_driver.bus.frame import CLASSIC
from posfet_model.config import ConfigError
from posfet_model.sensor.scan import ScanStatus

COMMAND_OFFSET: Final = 0
RESPONSE_OFFSET: Final = 1
STATUS_OFFSET: Final = 2
FD_BLOCK_OFFSET: Final = 3
CLASSIC_BLOCK_OFFSET: Final = 8
"""Identifier of each frame less the board's base identifier; classic block k has this offset plus k."""

HIGHEST_IDENTIFIER: Final = 0x7FF
SHORT_LENGTH: Final = 8
"""Length of commands, responses and status [byte]."""

PROTOCOL_VERSION: Final = 0
"""Major firmware version that implements this protocol."""
STATUS_PERIOD: Final = 0.1
"""Time between two status frames [s]."""

_COMMAND = struct.Struct("<BBxxI")
_RESPONSE = struct.Struct("<BBBBI")
_STATUS = struct.Struct("<hhBBH")
_KELVIN_STEPS: Final = 256
_TEMPERATURE_UNKNOWN: Final = -0x8000
_SUPPLY_STEPS: Final = 20  # per volt: 0.05 V each
_SUPPLY_UNKNOWN: Final = 0xFF
_PAGE_SHIFT: Final = 6
_FLAGS: Final = (
    ScanStatus.SUPPLY_LOW
    | ScanStatus.ADC_FAULT
    | ScanStatus.OVERTEMPERATURE
    | ScanStatus.SCAN_OVERRUN
    | ScanStatus.BOARD_RESET
)
_RESET: Final = 1


class Command(IntEnum):
    """Commands of a board."""

    START = 1
    """Send scans; the response holds the sequence of the first one, low 32 bits."""
    STOP = 2
    """Send no more scans."""
    SET_RATE = 3
    """Argument: scan period [us]; the response holds the period that was set [us]."""
    IDENTIFY = 4
    """The response holds the layout id in the low 16 bits and the firmware version in the high 16."""
    SELF_TEST = 5
    """The response holds the flags of ScanStatus that were found; 0 when the board is healthy."""


class Result(IntEnum):
    """Results of a command."""

    OK = 0
    UNKNOWN_COMMAND = 1
    BAD_ARGUMENT = 2
    BUSY = 3
    FAILED = 4


class Page(IntEnum):
    """Meaning of the value in a status frame; boards send the pages in turn."""

    LAYOUT = 0
    FIRMWARE = 1
    SCAN = 2
    """Sequence of the newest scan, low 16 bits."""


@dataclass(frozen=True)
class Request:
    """Command to a board."""

    command: int
    tag: int
    """Number in [0, 255] that the response repeats."""
    argument: int = 0

    def pack(self) -> bytes:
        """Return the data of the frame."""
        return _COMMAND.pack(self.command, self.tag, self.argument)

    @classmethod
    def unpack(cls, data: bytes) -> Request | None:
        """Return the request, or None when the length is wrong."""
        return cls(*_COMMAND.unpack(data)) if len(data) == SHORT_LENGTH else None


@dataclass(frozen=True)
class Response:
    """Response of a board to a command."""

    command: int
    tag: int
    result: int
    value: int = 0
    reset: bool = False
    """Whether the board was powered on and not started since, or started by this very command for the first time."""

    def pack(self) -> bytes:
        """Return the data of the frame."""
        return _RESPONSE.pack(self.command, self.tag, self.result, self.reset * _RESET, self.value)

    @classmethod
    def unpack(cls, data: bytes) -> Response | None:
        """Return the response, or None when the length is wrong."""
        if len(data) != SHORT_LENGTH:
            return None
        command, tag, result, flags, value = _RESPONSE.unpack(data)
        return cls(command, tag, result, value, bool(flags & _RESET))

    @property
    def reason(self) -> str:
        """Result in words, with the value that explains it where there is one."""
        known = self.result in Result.__members__.values()
        words = Result(self.result).name.lower().replace("_", " ") if known else f"result {self.result}"
        return f"{words} (value {self.value})" if self.value else words


@dataclass(frozen=True)
class Status:
    """State of a board, sent ten times per second."""

    temperatures: tuple[float, float]
    """Temperature sensors of the chip [degC], in [-127.99, 127.99]; NaN: unknown."""
    supply: float
    """Supply voltage of the board [V], in [0, 12.7]; NaN: unknown."""
    flags: int
    """Bits of ScanStatus; BOARD_RESET means that the board was powered on and not started since."""
    page: int
    """Meaning of `value`: one of Page."""
    value: int

    def pack(self) -> bytes:
        """Return the data of the frame; a temperature or a supply voltage out of range is clipped."""
        first, second = (_temperature_code(temperature) for temperature in self.temperatures)
        supply = _SUPPLY_UNKNOWN
        if not math.isnan(self.supply):
            supply = round(min(max(self.supply, 0.0) * _SUPPLY_STEPS, _SUPPLY_UNKNOWN - 1))
        return _STATUS.pack(first, second, supply, (self.flags & _FLAGS) | self.page << _PAGE_SHIFT, self.value)

    @classmethod
    def unpack(cls, data: bytes) -> Status | None:
        """Return the status, or None when the length is wrong."""
        if len(data) != SHORT_LENGTH:
            return None
        first, second, supply, flags, value = _STATUS.unpack(data)
        return cls(
            temperatures=(_temperature(first), _temperature(second)),
            supply=math.nan if supply == _SUPPLY_UNKNOWN else supply / _SUPPLY_STEPS,
            flags=flags & _FLAGS,
            page=flags >> _PAGE_SHIFT,
            value=value,
        )


Message: TypeAlias = Status | Response
"""What a board sends besides scans."""


def parse_message(offset: int, kind: int, data: bytes) -> Message | None:
    """Parse a short message of a board.

    Parameters
    ----------
    offset : int
        Identifier less the board's base identifier.
    kind : int
        Kind of the frame.
    data : bytes
        Data of the frame.

    Returns
    -------
    Status or Response or None
        None for another identifier, and for a frame of the wrong kind or length.
    """
    if kind != CLASSIC:
        return None
    if offset == STATUS_OFFSET:
        return Status.unpack(data)
    return Response.unpack(data) if offset == RESPONSE_OFFSET else None


def _temperature_code(temperature: float) -> int:
    if math.isnan(temperature):
        return _TEMPERATURE_UNKNOWN
    return round(min(max(temperature * _KELVIN_STEPS, -0x7FFF), 0x7FFF))


def _temperature(code: int) -> float:
    return math.nan if code == _TEMPERATURE_UNKNOWN else code / _KELVIN_STEPS


def check_identifiers(base: int, classic_blocks: int) -> None:
    """Check that the identifiers of a board's classic blocks fit 11 bits.

    Parameters
    ----------
    base : int
        The board's base identifier.
    classic_blocks : int
        Number of classic blocks of a scan.

    Raises
    ------
    ConfigError
        When they do not fit.
    """
    highest = base + CLASSIC_BLOCK_OFFSET + classic_blocks - 1
    if highest > HIGHEST_IDENTIFIER:
        last = HIGHEST_IDENTIFIER - CLASSIC_BLOCK_OFFSET - classic_blocks + 1
        allowed = f"must be in [0, 0x{last:X}]" if last >= 0 else "cannot be any"
        raise ConfigError(
            f"can.base_id: {allowed} for {classic_blocks} classic scan blocks, got 0x{base:X}; CAN FD needs only one"
        )


def version(firmware: int) -> str:
    """Return a firmware version as "major.minor".

    Parameters
    ----------
    firmware : int
        Version as in the protocol: major in the high byte, minor in the low.

    Examples
    --------
    >>> version(0x0203)
    '2.3'
    """
    return f"{firmware >> 8}.{firmware & 0xFF}"
