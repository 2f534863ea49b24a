"""Encoding of scans as CAN frames: five taxels of 12 bits in a classic frame, 28 of 16 bits in a CAN FD frame."""

from __future__ import annotations

import struct
from abc import ABC, abstractmethod
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from posfet_driver.bus.frame import CLASSIC, FD, RATE_SWITCH, Frame
from posfet_driver.protocol.messages import CLASSIC_BLOCK_OFFSET, FD_BLOCK_OFFSET, check_identifiers
from posfet_model._lib.validation import whole_number
from posfet_model.config import ConfigError
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import Scan, ScanStatus

Counts: TypeAlias = NDArray[np.uint16]
Header: TypeAlias = tuple[int, int, int, int]
"""Device time [us] (0 in classic frames), scan counter, block index, status of the board."""

CLASSIC_TAXELS: Final = 5
CLASSIC_LENGTH: Final = 8
CLASSIC_COUNTER: Final = 0xF
FD_TAXELS: Final = 28
FD_LENGTH: Final = 64
FD_COUNTER: Final = 0xFFFF
FD_CLOCK: Final = 0xFFFF_FFFF
FD_STATUS: Final = 0xFF & ~ScanStatus.TIME_ESTIMATED
MAX_BLOCKS: Final = 256
"""The block index of an FD frame has 8 bits."""

_FD_HEADER: Final = struct.Struct("<IHBB")
_FD_BLOCK: Final = np.dtype([("header", "V8"), ("counts", "<u2", FD_TAXELS)])


class ScanCodec(ABC):
    """Encodes and decodes the scans of one layout in one frame format.

    `wire` holds the data of all blocks of a scan, `block_length` bytes each.

    Parameters
    ----------
    taxels : int
        Number of taxels, in [1, 7168].
    """

    fd: bool
    """Whether frames are CAN FD."""
    block_length: int
    """Data length of a frame [byte]."""
    taxels_per_block: int
    counter_mask: int
    """The scan counter counts modulo this plus one."""

    def __init__(self, taxels: int) -> None:
        self.taxels = whole_number("taxels", taxels, 1, MAX_BLOCKS * FD_TAXELS)
        self.blocks = -(-taxels // self.taxels_per_block)
        self.wire = bytearray(self.blocks * self.block_length)

    @abstractmethod
    def offset(self, block: int) -> int:
        """Return the identifier of a block less the board's base identifier."""

    @abstractmethod
    def header(self, offset: int, kind: int, data: bytes) -> Header | None:
        """Return the header of a block, or None when the frame is no block of this layout.

        Parameters
        ----------
        offset : int
            Identifier of the frame less the board's base identifier.
        kind : int
            Kind of the frame, a sum of constants of `posfet_driver.bus.frame`.
        data : bytes
            Data of the frame.
        """

    @abstractmethod
    def decode(self, out: Counts) -> None:
        """Write the counts in `wire` to `out`, shape [taxels]."""

    @abstractmethod
    def encode(self, scan: Scan, base: int) -> list[Frame]:
        """Return the frames of a scan in the order of transmission; `base` is the board's base identifier.

        Parameters
        ----------
        scan : Scan
            Scan to encode.
        base : int
            Base identifier of the board.
        """


class FdCodec(ScanCodec):
    """CAN FD: time, counter, block and status in 8 bytes, then 28 counts, little-endian; the last block is padded."""

    fd = True
    block_length = FD_LENGTH
    taxels_per_block = FD_TAXELS
    counter_mask = FD_COUNTER

    def __init__(self, taxels: int) -> None:
        super().__init__(taxels)
        self._wire_counts = np.frombuffer(self.wire, _FD_BLOCK)["counts"]
        self._padded = np.zeros((self.blocks, FD_TAXELS), np.uint16)
        self._counts = self._padded.reshape(-1)[:taxels]
        self._only_block = self._wire_counts[0, :taxels] if self.blocks == 1 else None

    def offset(self, block: int) -> int:
        """Return the identifier of a block less the board's base identifier: all blocks share one."""
        return FD_BLOCK_OFFSET

    def header(self, offset: int, kind: int, data: bytes) -> Header | None:
        """Return the header of a block, or None when the frame is no block of this layout."""
        if len(data) != FD_LENGTH or offset != FD_BLOCK_OFFSET or kind & ~RATE_SWITCH != FD:
            return None
        header: Header = _FD_HEADER.unpack_from(data)
        return header if header[2] < self.blocks else None

    def decode(self, out: Counts) -> None:
        """Write the counts in `wire` to `out`, shape [taxels]."""
        if self._only_block is not None:
            out[...] = self._only_block
            return
        self._padded[:] = self._wire_counts
        out[:] = self._counts

    def encode(self, scan: Scan, base: int) -> list[Frame]:
        """Return the frames of a scan in the order of transmission; `base` is the board's base identifier."""
        self._counts[:] = scan.counts
        data = self._padded.astype("<u2", copy=False).tobytes()
        size = 2 * FD_TAXELS
        clock, counter, status = scan.device_time & FD_CLOCK, scan.sequence & FD_COUNTER, scan.status & FD_STATUS
        return [
            (
                base + FD_BLOCK_OFFSET,
                FD | RATE_SWITCH,
                _FD_HEADER.pack(clock, counter, block, status) + data[block * size : (block + 1) * size],
            )
            for block in range(self.blocks)
        ]


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
    counter_mask = CLASSIC_COUNTER

    def __init__(self, taxels: int) -> None:
        super().__init__(taxels)
        self._words = np.frombuffer(self.wire, "<u8").reshape(-1, 1)
        self._shifts = np.arange(4, 64, 12, dtype=np.uint64)
        self._codes = np.zeros((self.blocks, CLASSIC_TAXELS), np.uint64)
        self._padded = np.zeros((self.blocks, CLASSIC_TAXELS), np.uint16)
        self._counts = self._padded.reshape(-1)[:taxels]

    def offset(self, block: int) -> int:
        """Return the identifier of a block less the board's base identifier."""
        return CLASSIC_BLOCK_OFFSET + block

    def header(self, offset: int, kind: int, data: bytes) -> Header | None:
        """Return the header of a block, or None when the frame is no block of this layout."""
        block = offset - CLASSIC_BLOCK_OFFSET
        if len(data) != CLASSIC_LENGTH or kind != CLASSIC or not 0 <= block < self.blocks:
            return None
        return 0, data[0] & CLASSIC_COUNTER, block, 0

    def decode(self, out: Counts) -> None:
        """Write the counts in `wire` to `out`, shape [taxels]."""
        np.right_shift(self._words, self._shifts, out=self._codes)
        padded = self._padded
        padded[:] = self._codes  # keeps the low 16 bits: the code and, above it, 4 bits of its neighbour
        padded <<= 4
        padded |= padded >> 12
        out[:] = self._counts

    def encode(self, scan: Scan, base: int) -> list[Frame]:
        """Return the frames of a scan in the order of transmission; `base` is the board's base identifier."""
        self._counts[:] = scan.counts
        words = ((self._padded >> 4).astype(np.uint64) << self._shifts).sum(axis=1, dtype=np.uint64)
        words |= np.uint64(scan.sequence & CLASSIC_COUNTER)
        data = words.astype("<u8").tobytes()
        first = base + CLASSIC_BLOCK_OFFSET
        return [(first + block, CLASSIC, data[8 * block : 8 * block + 8]) for block in range(self.blocks)]


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
        When the layout has more taxels than the frames can address.
    """
    limit = MAX_BLOCKS * FD_TAXELS
    if sensor.layout.taxels > limit:
        raise ConfigError(f"layout: rows * cols must be in [1, {limit}] on CAN, got {sensor.layout.taxels}")
    if sensor.can.fd:
        return FdCodec(sensor.layout.taxels)
    codec = ClassicCodec(sensor.layout.taxels)
    check_identifiers(sensor.can.base_id, codec.blocks)
    return codec
