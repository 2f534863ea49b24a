"""The short messages of the protocol: commands, answers, status, and the identifiers of all (docs/protocol.md)."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING, Final

from posfet_model.config import ConfigError
from posfet_model.sensor.scan import ScanStatus

if TYPE_CHECKING:
    pass

COMMAND_OFFSET: Final = 0
RESPONSE_OFFSET: Final = 1
STATUS_OFFSET: Final = 2
FD_BLOCK_OFFSET: Final = 3
CLASSIC_BLOCK_OFFSET: Final = 8
"""Identifier of each frame less the board's base identifier; classic block k follows k places later."""

HIGHEST_IDENTIFIER: Final = 0x7FF
SHORT_LENGTH: Final = 8
"""Length of commands, answers and status [byte]."""

PROTOCOL_VERSION: Final = 0
"""Major version of the firmware that speaks this protocol."""
STATUS_PERIOD: Final = 0.1
"""Time between two status frames [s]."""

_COMMAND = struct.Struct("<BBxxI")
_RESPONSE = struct.Struct("<BBBBI")
_STATUS = struct.Struct("<hhBBH")
_KELVIN_STEPS: Final = 256
_TEMPERATURE_UNKNOWN: Final = -0x8000
_SUPPLY_STEPS: Final = 20  # a volt: 0.05 V each
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
    """What a board can be told."""

    START = 1
    """Send scans; the answer's value is the number of the first, low 32 bits."""
    STOP = 2
    """Send no more scans."""
    SET_RATE = 3
    """Argument: time between two scans [us]; the answer's value is the time set [us]."""
    IDENTIFY = 4
    """The answer's value: layout id in the low 16 bits, firmware version in the high 16."""
    SELF_TEST = 5
    """The answer's value: the flags of ScanStatus that were found; 0 when all is well."""


class Result(IntEnum):
    """How a board answers a command."""

    OK = 0
    UNKNOWN_COMMAND = 1
    BAD_ARGUMENT = 2
    BUSY = 3
    FAILED = 4


class Page(IntEnum):
    """What the value of a status frame means; boards send the pages in turn."""

    LAYOUT = 0
    FIRMWARE = 1
    SCAN = 2
    """Number of the newest scan, low 16 bits."""


@dataclass(frozen=True)
class Request:
    """A command to a board."""

    command: int
    tag: int
    """Number in [0, 255] that the answer repeats."""
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
    """A board's answer to a command."""

    command: int
    tag: int
    result: int
    value: int = 0
    reset: bool = False
    """Whether the board was switched on and not started since, or by this very command for the first time."""

    def pack(self) -> bytes:
        """Return the data of the frame."""
        return _RESPONSE.pack(self.command, self.tag, self.result, self.reset * _RESET, self.value)

    @classmethod
    def unpack(cls, data: bytes) -> Response | None:
        """Return the answer, or None when the length is wrong."""
        if len(data) != SHORT_LENGTH:
            return None
        command, tag, result, flags, value = _RESPONSE.unpack(data)
        return cls(command, tag, result, value, bool(flags & _RESET))

    @property
    def reason(self) -> str:
        """The result in words, with the value that explains it where there is one."""
        known = self.result in Result.__members__.values()
        words = Result(self.result).name.lower().replace("_", " ") if known else f"result {self.result}"
        return f"{words} (value {self.value})" if self.value else words


@dataclass(frozen=True)
class Status:
    """State of a board, sent ten times a second."""

    temperatures: tuple[float, float]
    """Temperature sensors of the chip [degC], in [-127.99, 127.99]; NaN: not known."""
    supply: float
    """Supply of the board [V], in [0, 12.7]; NaN: not known."""
    flags: int
    """Bits of ScanStatus; the reset stands for a board that was switched on and not started since."""
    page: int
    """What `value` is: one of Page."""
    value: int

    def pack(self) -> bytes:
        """Return the data of the frame; a temperature or a supply out of range is sent as its nearest end."""
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


def _temperature_code(temperature: float) -> int:
    if math.isnan(temperature):
        return _TEMPERATURE_UNKNOWN
    return round(min(max(temperature * _KELVIN_STEPS, -0x7FFF), 0x7FFF))


def _temperature(code: int) -> float:
    return math.nan if code == _TEMPERATURE_UNKNOWN else code / _KELVIN_STEPS


def check_identifiers(base: int, classic_blocks: int) -> None:
    """Raise ConfigError when the classic blocks of a board with this base identifier do not fit 11 bits."""
    highest = base + CLASSIC_BLOCK_OFFSET + classic_blocks - 1
    if highest > HIGHEST_IDENTIFIER:
        last = HIGHEST_IDENTIFIER - CLASSIC_BLOCK_OFFSET - classic_blocks + 1
        allowed = f"must be in [0, 0x{last:X}]" if last >= 0 else "cannot be any"
        raise ConfigError(
            f"can.base_id: {allowed} for {classic_blocks} classic scan blocks, got 0x{base:X}; CAN FD needs only one"
        )


def version(firmware: int) -> str:
    """Return a firmware version as people write it."""
    return f"{firmware >> 8}.{firmware & 0xFF}"
