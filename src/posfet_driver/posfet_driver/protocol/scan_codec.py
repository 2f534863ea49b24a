# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Encoding of scans as CAN frames: five taxels of 12 bits in a classic frame, 26 of 16 bits in a CAN FD frame."""

from __future__ import annotations

import binascii
import struct
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Final

import numpy as np

from posfet_driver.bus.frame import CLASSIC, FD, RATE_SWITCH, Frame
from posfet_driver.protocol.messages import (
    BOARD_FLAGS,
    CLASSIC_BLOCK_OFFSET,
    FD_BLOCK_OFFSET,
    HEADER_OFFSET,
    check_identifiers,
)
from posfet_model._lib.validation import whole_number
from posfet_model.config import ConfigError
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import Scan

CLASSIC_TAXELS: Final = 5
CLASSIC_LENGTH: Final = 8
CLASSIC_COUNTER: Final = 0xF
HEADER_SCANS: Final = CLASSIC_COUNTER + 1
"""A header precedes a classic scan at least once in this number of scans."""
HEADER_CLOCK: Final = 0xFFF_FFFF
FD_TAXELS: Final = 26
FD_LENGTH: Final = 64
FD_CLOCK: Final = 0xFFFF_FFFF
SEQUENCE: Final = 0xFFFF_FFFF
"""Sequence and device time are sent modulo these plus one."""
MAX_BLOCKS: Final = 256
"""The block index of an FD frame has 8 bits."""

_FD_HEADER: Final = struct.Struct("<IIBBH")
_FD_COVERED: Final = 10  # bytes before the checksum
_FD_COUNTS: Final = 12
_SCAN_HEADER: Final = struct.Struct("<II")
_CRC_INITIAL: Final = 0xFFFF


def checksum(data: bytes) -> int:
    """Return the CRC-16/CCITT-FALSE of an FD block, which leaves out its own two bytes.

    Parameters
    ----------
    data : bytes
        Data of the frame, 64 bytes.
    """
    return binascii.crc_hqx(data[_FD_COUNTS:], binascii.crc_hqx(data[:_FD_COVERED], _CRC_INITIAL))


@dataclass(frozen=True, slots=True)
class ScanHeader:
    """Header of a classic scan: the scan whose blocks follow it."""

    boot: int
    """Number of the power-on, modulo 16."""
    sequence: int
    """Sequence of the scan, low 32 bits."""
    time: int
    """Device time [us], low 28 bits."""

    def pack(self) -> bytes:
        """Return the data of the frame."""
        return _SCAN_HEADER.pack(self.sequence & SEQUENCE, self.time & HEADER_CLOCK | self.boot << 28)

    @classmethod
    def unpack(cls, kind: int, data: bytes) -> ScanHeader | None:
        """Return the header, or None when the frame is none.

        Parameters
        ----------
        kind : int
            Kind of the frame.
        data : bytes
            Data of the frame.
        """
        if kind != CLASSIC or len(data) != CLASSIC_LENGTH:
            return None
        sequence, time = _SCAN_HEADER.unpack(data)
        return cls(time >> 28, sequence, time & HEADER_CLOCK)


class ScanCodec(ABC):
    """Encodes the scans of one layout in one frame format; `posfet_core.protocol` decodes them.

    Parameters
    ----------
    taxels : int
        Number of taxels, in [1, 6656].
    """

    fd: bool
    """Whether frames are CAN FD."""
    block_length: int
    """Data length of a frame [byte]."""
    taxels_per_block: int

    def __init__(self, taxels: int) -> None:
        self.taxels = whole_number("taxels", taxels, 1, MAX_BLOCKS * FD_TAXELS)
        self.blocks = -(-taxels // self.taxels_per_block)

    @abstractmethod
    def offset(self, block: int) -> int:
        """Return the identifier of a block less the board's base identifier."""

    @abstractmethod
    def encode(self, scan: Scan, base: int, boot: int = 0, header: bool = True) -> list[Frame]:
        """Return the frames of a scan in the order of transmission; `base` is the board's base identifier.

        Parameters
        ----------
        scan : Scan
            Scan to encode.
        base : int
            Base identifier of the board.
        boot : int, default 0
            Number of the power-on, modulo 16.
        header : bool, default True
            Whether a classic scan has a header; each FD block has one.
        """


class FdCodec(ScanCodec):
    """CAN FD: 12 bytes of header, then 26 counts, little-endian; the last block is padded with zeros."""

    fd = True
    block_length = FD_LENGTH
    taxels_per_block = FD_TAXELS

    def __init__(self, taxels: int) -> None:
        super().__init__(taxels)
        self._padded = np.zeros((self.blocks, FD_TAXELS), np.uint16)
        self._counts = self._padded.reshape(-1)[:taxels]

    def offset(self, block: int) -> int:
        """Return the identifier of a block less the board's base identifier: all blocks share one."""
        return FD_BLOCK_OFFSET

    @staticmethod
    def header(data: bytes) -> tuple[int, int, int, int, int]:
        """Return the header of a block.

        Parameters
        ----------
        data : bytes
            Data of the frame, 64 bytes.

        Returns
        -------
        tuple of int
            Sequence, device time [us], block index, status in the low and boot in the high 4 bits, checksum.
        """
        header: tuple[int, int, int, int, int] = _FD_HEADER.unpack_from(data)
        return header

    def encode(self, scan: Scan, base: int, boot: int = 0, header: bool = True) -> list[Frame]:
        """Return the frames of a scan in the order of transmission; `base` is the board's base identifier."""
        self._counts[:] = scan.counts
        data = self._padded.astype("<u2", copy=False).tobytes()
        size = 2 * FD_TAXELS
        sequence, time = scan.sequence & SEQUENCE, scan.device_time & FD_CLOCK
        state = scan.status & BOARD_FLAGS | boot << 4
        frames: list[Frame] = []
        for block in range(self.blocks):
            counts = data[block * size : (block + 1) * size]
            crc = checksum(_FD_HEADER.pack(sequence, time, block, state, 0) + counts)
            frames.append(
                (
                    base + FD_BLOCK_OFFSET,
                    FD | RATE_SWITCH,
                    _FD_HEADER.pack(sequence, time, block, state, crc) + counts,
                )
            )
        return frames


class ClassicCodec(ScanCodec):
    """Classic CAN: one 64-bit little-endian number per block: counter in bits 0-3, taxel i of five from bit 4 + 12 i.

    The 12 bits are the high ones of a count. On extension to 16 bits the high four are repeated below them, so that
    both ends of the scale are preserved.

    Parameters
    ----------
    taxels : int
        Number of taxels of the layout.
    """

    fd = False
    block_length = CLASSIC_LENGTH
    taxels_per_block = CLASSIC_TAXELS

    def __init__(self, taxels: int) -> None:
        super().__init__(taxels)
        self._shifts = np.arange(4, 64, 12, dtype=np.uint64)
        self._padded = np.zeros((self.blocks, CLASSIC_TAXELS), np.uint16)
        self._counts = self._padded.reshape(-1)[:taxels]

    def offset(self, block: int) -> int:
        """Return the identifier of a block less the board's base identifier."""
        return CLASSIC_BLOCK_OFFSET + block

    def encode(self, scan: Scan, base: int, boot: int = 0, header: bool = True) -> list[Frame]:
        """Return the frames of a scan in the order of transmission; `base` is the board's base identifier."""
        self._counts[:] = scan.counts
        words = ((self._padded >> 4).astype(np.uint64) << self._shifts).sum(axis=1, dtype=np.uint64)
        words |= np.uint64(scan.sequence & CLASSIC_COUNTER)
        data = words.astype("<u8").tobytes()
        first = base + CLASSIC_BLOCK_OFFSET
        frames = [(first + block, CLASSIC, data[8 * block : 8 * block + 8]) for block in range(self.blocks)]
        if header:
            frames.insert(0, (base + HEADER_OFFSET, CLASSIC, ScanHeader(boot, scan.sequence, scan.device_time).pack()))
        return frames


def make_codec(sensor: Sensor) -> ScanCodec:
    """Return the codec for a sensor.

    Parameters
    ----------
    sensor : Sensor
        Layout, frame format and base identifier.

    Returns
    -------
    ScanCodec
        The codec.

    Raises
    ------
    ConfigError
        When the layout has more taxels than the frames can address, or the board has frames of its own.
    """
    if sensor.mapping:
        raise ConfigError(
            f"{sensor.name}: the board has frames of its own; with commands and emulator use protocol: posfet"
        )
    limit = MAX_BLOCKS * FD_TAXELS
    if sensor.layout.taxels > limit:
        raise ConfigError(f"layout: rows * cols must be in [1, {limit}] on CAN, got {sensor.layout.taxels}")
    if sensor.can.fd:
        return FdCodec(sensor.layout.taxels)
    codec = ClassicCodec(sensor.layout.taxels)
    check_identifiers(sensor.can.base_id, codec.blocks)
    return codec
