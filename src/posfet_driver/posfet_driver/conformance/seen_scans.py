# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Scans as they were seen on the bus: frames put together for judging, right or wrong ones."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final

from posfet_driver.conformance.description import Message

COUNTERS: Final = 16
"""A classic block carries the sequence modulo this."""
SEQUENCES: Final = 1 << 32
_BOOTS: Final = {"Status": "Boot", "Response": "ResponseBoot", "ScanBlockFd": "BlockBoot", "ScanHeader": "HeaderBoot"}


@dataclass(frozen=True)
class SeenFrame:
    """A frame of the board."""

    index: int
    """Number among the frames of the board."""
    time: int
    """Host's clock at arrival [ns]."""
    identifier: int
    kind: int
    data: bytes
    message: Message | None
    """None: at an identifier without a message."""
    values: dict[str, int]
    """Signals of the message without their scales."""
    block: int = 0
    """Number of a block within its scan."""

    @property
    def name(self) -> str:
        """Name of the message; '' when there is none. All classic blocks are ScanBlock0."""
        return self.message.name if self.message else ""

    @property
    def boot(self) -> int | None:
        """Number of the power-on; None where it is not sent."""
        return self.values.get(_BOOTS.get(self.name, ""))


@dataclass
class SeenScan:
    """A scan."""

    sequence: int
    """-1: not known, since no header was seen."""
    time: int | None
    """Device time [us]; None: not sent with this scan."""
    frames: list[SeenFrame] = field(default_factory=list)
    """Its blocks in the order of arrival."""
    header: SeenFrame | None = None

    @property
    def first(self) -> int:
        """Index of its first frame."""
        begin = self.frames[0].index
        return min(begin, self.header.index) if self.header else begin

    @property
    def arrival(self) -> int:
        """Host's clock at the arrival of its last block [ns]."""
        return self.frames[-1].time

    @property
    def blocks(self) -> list[int]:
        """Numbers of its blocks in the order of arrival."""
        return [frame.block for frame in self.frames]

    @property
    def status(self) -> int:
        """Flags; 0 for classic scans, which carry none."""
        return self.frames[0].values.get("BlockStatus", 0)


def fd_scans(frames: Iterable[SeenFrame]) -> list[SeenScan]:
    """Return the scans of FD blocks, in the order of their first blocks.

    Parameters
    ----------
    frames : iterable of SeenFrame
        Frames of the board.
    """
    scans: dict[int, SeenScan] = {}
    for frame in frames:
        if frame.name == "ScanBlockFd":
            sequence = frame.values["Sequence"]
            scans.setdefault(sequence, SeenScan(sequence, frame.values["DeviceTime"])).frames.append(frame)
    return list(scans.values())


def classic_scans(frames: Iterable[SeenFrame]) -> list[SeenScan]:
    """Return the scans of classic blocks, numbered from the headers among them in both directions.

    Parameters
    ----------
    frames : iterable of SeenFrame
        Frames of the board.
    """
    scans: list[SeenScan] = []
    header: SeenFrame | None = None
    for frame in frames:
        if frame.name == "ScanHeader":
            header = frame
        elif frame.name == "ScanBlock0":
            counter = frame.values["ScanCounter0"]
            if not scans or _counter(scans[-1]) != counter or frame.block in scans[-1].blocks:
                scans.append(SeenScan(-1, None))
            scans[-1].frames.append(frame)
            if header and header.values["HeaderSequence"] % COUNTERS == counter:
                scan = scans[-1]
                scan.header, scan.sequence, scan.time = header, *_stated(header)
                header = None
    _number(scans)
    return scans


def _counter(scan: SeenScan) -> int:
    return scan.frames[0].values["ScanCounter0"]


def _stated(header: SeenFrame) -> tuple[int, int]:
    return header.values["HeaderSequence"], header.values["HeaderTime"]


def _number(scans: list[SeenScan]) -> None:
    """Give numbers to the scans without a header.

    They count on from the header before them, but after the longest pause between two headers back from the next one.
    """
    stated = [index for index, scan in enumerate(scans) if scan.sequence >= 0]
    for begin, end in pairwise(stated):
        pauses = [scans[index].arrival - scans[index - 1].arrival for index in range(begin + 1, end + 1)]
        resumed = begin + 1 + pauses.index(max(pauses))
        _count(scans, range(begin + 1, resumed), -1)
        _count(scans, range(end - 1, resumed - 1, -1), 1)
    if stated:
        _count(scans, range(stated[-1] + 1, len(scans)), -1)
        _count(scans, range(stated[0] - 1, -1, -1), 1)


def _count(scans: list[SeenScan], indices: range, neighbour: int) -> None:
    """Give numbers to scans in turn, each from its neighbour before (-1) or after (1) it."""
    for index in indices:
        known = scans[index + neighbour].sequence
        step = (neighbour * (known - _counter(scans[index])) - 1) % COUNTERS + 1
        scans[index].sequence = (known - neighbour * step) % SEQUENCES
