# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Short messages of the protocol (commands, responses, status, identity) and all identifiers; see docs/protocol.md."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
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
HEADER_OFFSET: Final = 4
IDENTITY_OFFSET: Final = 5
CLASSIC_BLOCK_OFFSET: Final = 8
"""Identifier of each frame less the board's base identifier; classic block k has this offset plus k."""

HIGHEST_IDENTIFIER: Final = 0x7FF
SHORT_LENGTH: Final = 8
"""Length of all frames but FD blocks [byte]."""

PROTOCOL_VERSION: Final = 2
"""Version of the protocol that this package implements."""
STATUS_PERIOD: Final = 0.1
"""Time between two status frames [s]."""
IDENTITY_PERIOD: Final = 1.0
"""Time between two identity frames [s]."""
LONGEST_PERIOD: Final = 10_000_000
"""Longest scan period [us]."""
BOOT_COUNTER: Final = 0xF
"""The number of the power-on counts modulo this plus one."""

_COMMAND = struct.Struct("<BBxxI")
_RESPONSE = struct.Struct("<BBBBI")
_STATUS = struct.Struct("<hhHBB")
_KELVIN_STEPS: Final = 256
_TEMPERATURE_UNKNOWN: Final = -0x8000
_MILLIVOLTS: Final = 1000
_SUPPLY_UNKNOWN: Final = 0xFFFF
_SCANNING: Final = 0x10
_CHARGE_RESET: Final = 0x20
BOARD_FLAGS: Final = int(
    ScanStatus.SUPPLY_LOW | ScanStatus.ADC_FAULT | ScanStatus.OVERTEMPERATURE | ScanStatus.SCAN_OVERRUN
)
"""Flags that a board sends, in 4 bits."""


class Command(IntEnum):
    """Commands of a board."""

    START = 1
    """Send scans; the response holds the sequence of the next one."""
    STOP = 2
    """Send no more scans; the response holds the sequence of the first one that is not sent."""
    SET_RATE = 3
    """Argument: scan period [us], which the response repeats."""
    IDENTIFY = 4
    """The response holds an `Identification`."""
    SELF_TEST = 5
    """The response holds the flags of ScanStatus that were found; 0 when the board is healthy."""


class Result(IntEnum):
    """Results of a command."""

    OK = 0
    UNKNOWN_COMMAND = 1
    BAD_ARGUMENT = 2
    BUSY = 3
    FAILED = 4


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
    boot: int = 0
    """Number of the power-on, modulo 16."""

    def pack(self) -> bytes:
        """Return the data of the frame."""
        return _RESPONSE.pack(self.command, self.tag, self.result, self.boot & BOOT_COUNTER, self.value)

    @classmethod
    def unpack(cls, data: bytes) -> Response | None:
        """Return the response, or None when the length is wrong."""
        if len(data) != SHORT_LENGTH:
            return None
        command, tag, result, boot, value = _RESPONSE.unpack(data)
        return cls(command, tag, result, value, boot & BOOT_COUNTER)

    def confirms(self, argument: int) -> bool:
        """Return whether the board has executed the command with this argument.

        SET_RATE is answered with it; no board can keep a period that the protocol does not have, whatever it answers.

        Parameters
        ----------
        argument : int
            Argument of the command.
        """
        if self.command == Command.SET_RATE and not (1 <= argument <= LONGEST_PERIOD and self.value == argument):
            return False
        return self.result == Result.OK

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
    """Supply voltage of the board [V], in [0, 65.534]; NaN: unknown."""
    flags: int
    """Bits of ScanStatus that a board sends."""
    scanning: bool
    """Whether scans are sent."""
    boot: int
    """Number of the power-on, modulo 16."""
    heartbeat: int
    """Number of the status frame, modulo 16."""
    charge_reset: bool = False
    """Whether the charge at the gates was reset at this power-on: it does not continue that from before."""

    def pack(self) -> bytes:
        """Return the data of the frame; a temperature or a supply voltage out of range is clipped."""
        first, second = (_temperature_code(temperature) for temperature in self.temperatures)
        supply = _SUPPLY_UNKNOWN
        if not math.isnan(self.supply):
            supply = round(min(max(self.supply, 0.0) * _MILLIVOLTS, _SUPPLY_UNKNOWN - 1))
        state = self.flags & BOARD_FLAGS | self.scanning * _SCANNING | self.charge_reset * _CHARGE_RESET
        return _STATUS.pack(first, second, supply, state, self.boot & 0xF | (self.heartbeat & 0xF) << 4)

    @classmethod
    def unpack(cls, data: bytes) -> Status | None:
        """Return the status, or None when the length is wrong."""
        if len(data) != SHORT_LENGTH:
            return None
        first, second, supply, state, counters = _STATUS.unpack(data)
        return cls(
            temperatures=(_temperature(first), _temperature(second)),
            supply=math.nan if supply == _SUPPLY_UNKNOWN else supply / _MILLIVOLTS,
            flags=state & BOARD_FLAGS,
            scanning=bool(state & _SCANNING),
            boot=counters & 0xF,
            heartbeat=counters >> 4,
            charge_reset=bool(state & _CHARGE_RESET),
        )


NO_STATUS: Final = Status((math.nan, math.nan), math.nan, 0, scanning=False, boot=0, heartbeat=0)
"""Stands for the status of a board while it is unknown."""


@dataclass(frozen=True)
class Identification:
    """What a board is: the value of the response to IDENTIFY, and the first half of `Identity`."""

    layout: int
    """Layout id."""
    protocol: int
    """Version of the protocol."""
    fd: bool
    """Whether scans are sent in CAN FD frames."""
    firmware_major: int

    def pack(self) -> int:
        """Return the 32 bits."""
        return self.layout | self.protocol << 16 | self.fd << 20 | self.firmware_major << 24

    @classmethod
    def unpack(cls, value: int) -> Identification:
        """Return the identification in 32 bits."""
        return cls(value & 0xFFFF, value >> 16 & 0xF, bool(value >> 20 & 0xF), value >> 24)


@dataclass(frozen=True)
class Identity:
    """What a board is and how fast it scans, sent once per second."""

    board: Identification
    firmware_minor: int
    period: int
    """Scan period in force [us]."""

    @property
    def firmware(self) -> str:  # numpydoc ignore=RT01
        """Version of the firmware as "major.minor"."""
        return f"{self.board.firmware_major}.{self.firmware_minor}"

    def pack(self) -> bytes:
        """Return the data of the frame."""
        whole = self.board.pack() | self.firmware_minor << 32 | self.period << 40
        return whole.to_bytes(SHORT_LENGTH, "little")

    @classmethod
    def unpack(cls, data: bytes) -> Identity | None:
        """Return the identity, or None when the length is wrong or the period impossible."""
        whole = int.from_bytes(data, "little")
        period = whole >> 40
        if len(data) != SHORT_LENGTH or not 1 <= period <= LONGEST_PERIOD:
            return None
        return cls(Identification.unpack(whole & 0xFFFF_FFFF), whole >> 32 & 0xFF, period)


Message: TypeAlias = Status | Response | Identity
"""What a board sends besides scans."""

_PARSERS: Final[dict[int, Callable[[bytes], Message | None]]] = {
    RESPONSE_OFFSET: Response.unpack,
    STATUS_OFFSET: Status.unpack,
    IDENTITY_OFFSET: Identity.unpack,
}


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
    Status or Identity or Response or None
        None for another identifier, and for a frame of the wrong kind, length or content.
    """
    parse = _PARSERS.get(offset)
    return parse(data) if parse and kind == CLASSIC else None


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
