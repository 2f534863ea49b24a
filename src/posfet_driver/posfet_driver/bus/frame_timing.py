"""Time that frames take on the bus, from the frame formats of ISO 11898-1:2015 with 11-bit identifiers.

Each length holds from no stuff bit at all to as many as there can be: one bit after the first five alike, then one for
each four bits.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from posfet_model._lib.validation import real_number, whole_number

_CLASSIC_STUFFED: Final = 1 + 11 + 1 + 1 + 1 + 4 + 15  # start, identifier, RTR, IDE, r0, length code, CRC
_CLASSIC_FIXED: Final = 1 + 2 + 7 + 3  # CRC delimiter, acknowledgement with delimiter, end, intermission
_FD_NOMINAL_STUFFED: Final = 1 + 11 + 1 + 1 + 1 + 1 + 1  # start, identifier, RRS, IDE, FDF, res, BRS
_FD_NOMINAL_FIXED: Final = _CLASSIC_FIXED
_FD_DATA_STUFFED: Final = 1 + 4  # ESI, length code
_FD_CRC_SHORT: Final = 4 + 17 + 6  # stuff count, CRC, fixed stuff bits; up to 16 bytes of data
_FD_CRC_LONG: Final = 4 + 21 + 7
_FD_SHORT: Final = 16


@dataclass(frozen=True)
class BusTime:
    """Time that a frame occupies the bus [s], the intermission after it included."""

    least: float
    """Without stuff bits."""
    most: float
    """With as many stuff bits as there can be."""


def classic_time(length: int, bitrate: float) -> BusTime:
    """Return the time of a classic frame with `length` bytes in [0, 8] at `bitrate` [bit/s].

    >>> round(classic_time(8, 1e6).most * 1e6, 1)
    135.0
    """
    whole_number("length", length, 0, 8)
    real_number("bitrate", bitrate, 0, exclusive=True)
    stuffed = _CLASSIC_STUFFED + 8 * length
    bits = stuffed + _CLASSIC_FIXED
    return BusTime(bits / bitrate, (bits + (stuffed - 1) // 4) / bitrate)


def fd_time(length: int, bitrate: float, data_bitrate: float) -> BusTime:
    """Return the time of a CAN FD frame with rate switch, `length` bytes in [0, 64].

    `bitrate` and `data_bitrate` [bit/s]. The bits in which the rate changes are counted as nominal: exact to one bit.

    >>> round(fd_time(64, 1e6, 5e6).most * 1e6, 1)
    169.6
    """
    whole_number("length", length, 0, 64)
    real_number("bitrate", bitrate, 0, exclusive=True)
    real_number("data_bitrate", data_bitrate, 0, exclusive=True)
    stuffed = _FD_DATA_STUFFED + 8 * length
    data = stuffed + (_FD_CRC_SHORT if length <= _FD_SHORT else _FD_CRC_LONG)
    nominal = _FD_NOMINAL_STUFFED + _FD_NOMINAL_FIXED
    nominal_stuff, data_stuff = (_FD_NOMINAL_STUFFED - 1) // 4, stuffed // 4
    return BusTime(
        nominal / bitrate + data / data_bitrate,
        (nominal + nominal_stuff) / bitrate + (data + data_stuff) / data_bitrate,
    )
