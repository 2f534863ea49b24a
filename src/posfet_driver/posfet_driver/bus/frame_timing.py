# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Duration of frames on the bus, from the frame formats of ISO 11898-1:2015 with 11-bit identifiers.

Durations range from no stuff bit to the largest possible number: one after the first five equal bits, then one for
every four bits.
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
    """Duration of a frame on the bus [s], including the intermission after it."""

    least: float
    """Without stuff bits."""
    most: float
    """With the largest possible number of stuff bits."""


def classic_time(length: int, bitrate: float) -> BusTime:
    """Return the duration of a classic frame.

    Parameters
    ----------
    length : int
        Data length [byte], in [0, 8].
    bitrate : float
        Bit rate [bit/s], above 0.

    Returns
    -------
    BusTime
        Smallest and largest duration [s].

    Examples
    --------
    >>> round(classic_time(8, 1e6).most * 1e6, 1)
    135.0
    """
    whole_number("length", length, 0, 8)
    real_number("bitrate", bitrate, 0, exclusive=True)
    stuffed = _CLASSIC_STUFFED + 8 * length
    bits = stuffed + _CLASSIC_FIXED
    return BusTime(bits / bitrate, (bits + (stuffed - 1) // 4) / bitrate)


def fd_time(length: int, bitrate: float, data_bitrate: float) -> BusTime:
    """Return the duration of a CAN FD frame with rate switch.

    The bits in which the rate changes are counted at the nominal rate: exact to one bit.

    Parameters
    ----------
    length : int
        Data length [byte], in [0, 64].
    bitrate : float
        Nominal bit rate [bit/s], above 0.
    data_bitrate : float
        Bit rate of the data phase [bit/s], above 0.

    Returns
    -------
    BusTime
        Smallest and largest duration [s].

    Examples
    --------
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
