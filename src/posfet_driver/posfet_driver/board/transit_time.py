# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Time that the frames of a scan occupy the bus: part of the delay of its stamp."""

from __future__ import annotations

from typing import Final

from posfet_driver.bus.frame_timing import classic_time, fd_time
from posfet_driver.protocol.decoder import TransitTimes
from posfet_driver.protocol.frame_tables import FrameTables
from posfet_driver.protocol.scan_codec import CLASSIC_LENGTH, FD_LENGTH
from posfet_model.sensor.description import CanLink

_EXTENDED_BITS: Final = 25  # of an identifier of 29 bits more than of one of 11, with stuff bits


def scan_transit_times(link: CanLink, blocks: int) -> TransitTimes:
    """Return the longest time that the frames of one scan occupy the bus.

    Parameters
    ----------
    link : CanLink
        Frame format and bit rates.
    blocks : int
        Number of scan frames of a scan.

    Returns
    -------
    TransitTimes
        Transit times with as many stuff bits as there can be [s]; of classic frames, with the header.
    """
    if link.fd:
        return TransitTimes(*(blocks * _fd_time(link, FD_LENGTH, rate_switch) for rate_switch in (True, False)))
    classic = (blocks + 1) * classic_time(CLASSIC_LENGTH, link.bitrate).most
    return TransitTimes(classic, classic)


def mapped_transit_times(link: CanLink, tables: FrameTables) -> TransitTimes:
    """Return the longest time that the frames of one scan of a board with frames of its own occupy the bus.

    Parameters
    ----------
    link : CanLink
        Frame format and bit rates.
    tables : FrameTables
        Lengths of the frames; those that fit into classic frames may come as such.

    Returns
    -------
    TransitTimes
        Transit times with as many stuff bits as there can be [s].
    """

    def together(rate_switch: bool) -> float:
        return sum(
            _longest(link, length, rate_switch) + extended * _EXTENDED_BITS / link.bitrate
            for length, extended in tables.sent
        )

    return TransitTimes(together(True), together(False))


def _longest(link: CanLink, length: int, rate_switch: bool) -> float:
    classic = classic_time(length, link.bitrate).most if length <= CLASSIC_LENGTH else 0.0
    return max(classic, _fd_time(link, length, rate_switch)) if link.fd else classic


def _fd_time(link: CanLink, length: int, rate_switch: bool) -> float:
    return fd_time(length, link.bitrate, link.data_bitrate if rate_switch else link.bitrate).most
