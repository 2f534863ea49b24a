# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Frames of a board under test: every one is kept."""

from __future__ import annotations

from posfet_driver.bus.frame import ERROR, EXTENDED, REMOTE
from posfet_driver.bus.frame_bus import FrameBus
from posfet_driver.clock import Clock
from posfet_driver.conformance.description import load_description
from posfet_driver.conformance.records import LONGEST_WAIT, SECOND, Board, NoBoardError
from posfet_driver.conformance.seen_scans import SeenFrame, SeenScan, classic_scans, fd_scans


class Listener:
    """Keeps all frames of a board.

    Parameters
    ----------
    bus : FrameBus
        The open bus.
    clock : Clock
        Clock of the host.
    board : Board
        What is known about the board.
    """

    def __init__(self, bus: FrameBus, clock: Clock, board: Board) -> None:
        self.bus = bus
        self.clock = clock
        self.board = board
        self.description = load_description()
        self.frames: list[SeenFrame] = []
        """All frames of the board."""

    def read(self, seconds: float) -> None:
        """Keep the frames that are waiting; when there is none, wait up to `seconds` [s] for the first.

        Parameters
        ----------
        seconds : float
            Longest time to wait [s].
        """
        received = self.bus.read_frames(seconds)
        now = self.clock.monotonic()
        for identifier, kind, data in received:
            offset = identifier - self.board.base
            if not kind & ERROR and 1 <= offset <= self.board.highest_offset:
                self.frames.append(self._seen(now, identifier, kind, data))

    def listen(self, seconds: float) -> None:
        """Keep the frames of `seconds` [s].

        Parameters
        ----------
        seconds : float
            Duration [s].
        """
        end = self.clock.monotonic() + round(seconds * SECOND)
        while (left := end - self.clock.monotonic()) > 0:
            self.read(left / SECOND)

    def named(self, name: str, first: int = 0, last: int | None = None) -> list[SeenFrame]:
        """Return the frames of one message.

        Parameters
        ----------
        name : str
            Name of the message.
        first : int, default 0
            Index of the first frame.
        last : int, optional
            Index after the last one.
        """
        return [frame for frame in self.frames[first:last] if frame.name == name]

    def scans(self, first: int = 0, last: int | None = None) -> list[SeenScan]:
        """Return the scans of some of the frames.

        Parameters
        ----------
        first : int, default 0
            Index of the first frame.
        last : int, optional
            Index after the last one.
        """
        return (fd_scans if self.board.fd else classic_scans)(self.frames[first:last])

    def expect(self, name: str, first: int = 0) -> None:
        """Wait until a message was received.

        Parameters
        ----------
        name : str
            Name of the message.
        first : int, default 0
            Index of the first frame that counts.

        Raises
        ------
        NoBoardError
            When none arrives.
        """
        end = self.clock.monotonic() + round(LONGEST_WAIT * SECOND)
        while not self.named(name, first):
            if self.clock.monotonic() >= end:
                raise NoBoardError(
                    f"no {name} frame within {LONGEST_WAIT:g} s at base identifier 0x{self.board.base:X}"
                )
            self.read(max((end - self.clock.monotonic()) / SECOND, 0.0))

    def _seen(self, now: int, identifier: int, kind: int, data: bytes) -> SeenFrame:
        """Return a frame with its signals, also when kind or length are wrong: rule F4 judges those."""
        messages, offset = self.description.messages, identifier - self.board.base
        message = next((message for message in messages.values() if message.offset == offset), None)
        first = messages["ScanBlock0"]
        if offset >= first.offset:
            message = first
        if kind & (EXTENDED | REMOTE) or message is None:
            return SeenFrame(len(self.frames), now, identifier, kind, data, None, {})
        values = message.decode(data.ljust(message.length, b"\0")[: message.length])
        block = values["BlockIndex"] if message.name == "ScanBlockFd" else offset - first.offset
        return SeenFrame(len(self.frames), now, identifier, kind, data, message, values, block)
