"""A board on a wire that does as it is told: every fault between the array and the adapter, one at a time."""

from __future__ import annotations

import random
from collections.abc import Callable
from enum import Enum
from itertools import groupby
from typing import Final

from posfet_driver.bus.error_frame import BUS_OFF, CONTROLLER, NO_ACKNOWLEDGE, OVERFLOW, PROTOCOL, error_frame
from posfet_driver.bus.frame import CLASSIC, FD, Frame
from posfet_driver.protocol.messages import COMMAND_OFFSET, STATUS_OFFSET
from posfet_sim.emulation.firmware import BoardFirmware

FOREIGN_PERIOD: Final = 111_000
"""Time from one foreign frame to the next [ns]: a classic frame of 8 bytes without stuff bits fills 1 Mbit/s so."""
LOW_SUPPLY: Final = 3.9
"""Supply in a brown-out [V]."""
_SHORTER: Final = {True: 48, False: 7}
CHANCE: Final = 0.1
"""Share of frames that a fault of single frames strikes."""


class Trouble(Enum):
    """What can be wrong."""

    NONE = "none"
    LOST = "lost scans"
    TORN = "torn scans"
    REPEATED = "repeated frames"
    LATE = "late frames"
    REORDERED = "reordered frames"
    MALFORMED = "malformed frames"
    STUCK = "stuck counter"
    CLOCK = "stuck clock"
    """Of CAN FD frames: classic ones carry no time."""
    FOREIGN = "foreign traffic"
    ERRORS = "error frames"
    UNACKNOWLEDGED = "unacknowledged"
    OVERFLOW = "receive overflows"
    UNREADABLE = "bus unreadable"
    BUS_OFF = "bus off"
    CABLE_OUT = "cable out"
    BOARD_OUT = "board missing"
    DEAF = "board deaf"
    RESET = "board resets"
    BROWN_OUT = "brown-outs"


class FaultInjector:
    """A node behind an adapter, or on a bus: a board's frames, and what `trouble` does to them.

    Faults of whole scans and frames strike at random, the same for the same seed. RESET and BROWN_OUT happen once, when
    they begin. Error frames pass only where the bus carries them: slcan does not.
    """

    def __init__(self, make_firmware: Callable[[int], BoardFirmware], base: int, now: int, seed: int = 0) -> None:
        """Take what makes a board that is switched on at a time [ns], its base identifier, and the time."""
        self.firmware = make_firmware(now)
        self._trouble = Trouble.NONE
        self._busy = self._cut = False
        self._make_firmware = make_firmware
        self._base = base
        self._random = random.Random(seed)
        self._next_foreign = now
        self._begun = Trouble.NONE
        self._delayed: list[Frame] = []
        self._stuck: bytes | None = None

    @property
    def trouble(self) -> Trouble:
        """What is wrong now."""
        return self._trouble

    @trouble.setter
    def trouble(self, trouble: Trouble) -> None:
        self._trouble, self._busy, self._cut = trouble, trouble in _BUSY, trouble in _CUT

    def next_due(self) -> int:
        """Return when the next frame is due [ns]."""
        due = self.firmware.next_due()
        return min(due, self._next_foreign) if self._busy else due

    def due(self, now: int) -> list[Frame]:
        """Return the frames that are due at `now` [ns]."""
        self._begin(now)
        frames = self._struck(self.firmware.due(now))
        if self._busy:
            while self._next_foreign <= now:
                self._next_foreign += FOREIGN_PERIOD
                frames.append(self._strange_frame())
        else:
            self._next_foreign = now
        return frames

    def receive(self, frame: Frame, now: int) -> list[Frame]:
        """Take a frame and return those that answer it."""
        if self.trouble == Trouble.UNACKNOWLEDGED:
            return [error_frame(NO_ACKNOWLEDGE)]
        if self._cut or self.trouble == Trouble.DEAF:
            return []
        return self.firmware.receive(frame, now)

    def _begin(self, now: int) -> None:
        if self.trouble == self._begun:
            return
        self._begun = self.trouble
        self._stuck = None
        if self.trouble in {Trouble.RESET, Trouble.BROWN_OUT}:
            self.firmware = self._make_firmware(now)
        if self.trouble == Trouble.BROWN_OUT:
            self.firmware.supply = LOW_SUPPLY

    def _struck(self, frames: list[Frame]) -> list[Frame]:
        if self._cut:
            return []
        strike = _STRIKES.get(self.trouble)
        if strike is None:
            late, self._delayed = self._delayed, []
            return late + frames
        struck: list[Frame] = []
        size = self.firmware.blocks
        for short, group in groupby(frames, self._short):  # the status keeps its place among the scans
            run = list(group)
            if short:
                struck += run
            else:
                for begin in range(0, len(run), size):
                    struck += strike(self, run[begin : begin + size])
        return struck

    def _short(self, frame: Frame) -> bool:
        return self._base + COMMAND_OFFSET <= frame[0] <= self._base + STATUS_OFFSET

    def _strange_frame(self) -> Frame:
        if self.trouble == Trouble.ERRORS:
            return error_frame(CONTROLLER)
        if self.trouble in _ERROR_FRAMES:
            return _ERROR_FRAMES[self.trouble]
        return self._random.randrange(self._base), CLASSIC, self._random.randbytes(8)

    def _lucky(self) -> bool:
        return self._random.random() >= CHANCE

    def _lose(self, frames: list[Frame]) -> list[Frame]:
        return frames if self._lucky() else []

    def _tear(self, frames: list[Frame]) -> list[Frame]:
        return frames if self._lucky() else frames[: self._random.randrange(len(frames) + 1)]

    def _repeat(self, frames: list[Frame]) -> list[Frame]:
        return [frame for frame in frames for _ in range(1 if self._lucky() else 2)]

    def _delay(self, frames: list[Frame]) -> list[Frame]:
        if not frames:
            return frames
        late, self._delayed = self._delayed, []
        if not self._lucky():
            self._delayed = [frames.pop()]
        return frames + late

    def _reorder(self, frames: list[Frame]) -> list[Frame]:
        return frames if self._lucky() else frames[::-1]

    def _spoil(self, frames: list[Frame]) -> list[Frame]:
        """Cut frames short, to a length that there is."""
        return [
            (number, kind, data if self._lucky() else data[: _SHORTER[bool(kind & FD)]])
            for number, kind, data in frames
        ]

    def _stick(self, frames: list[Frame]) -> list[Frame]:
        """Give every frame the number of the first scan that is struck."""
        if frames and self._stuck is None:
            self._stuck = frames[0][2]
        old = self._stuck or b""
        return [(number, kind, _with_number(kind, data, old)) for number, kind, data in frames]

    def _stop_clock(self, frames: list[Frame]) -> list[Frame]:
        """Give every FD frame the time of the first that is struck."""
        if frames and self._stuck is None:
            self._stuck = frames[0][2]
        old = self._stuck or b""
        return [(number, kind, old[:4] + data[4:] if kind & FD else data) for number, kind, data in frames]


def _with_number(kind: int, data: bytes, old: bytes) -> bytes:
    """Return the data of a block with the scan counter of an older one."""
    if kind & FD:
        return data[:4] + old[4:6] + data[6:]
    return bytes([data[0] & 0xF0 | old[0] & 0x0F]) + data[1:]


_ERROR_FRAMES: Final = {
    Trouble.UNREADABLE: error_frame(PROTOCOL),
    Trouble.BUS_OFF: error_frame(BUS_OFF),
    Trouble.OVERFLOW: error_frame(CONTROLLER, OVERFLOW),
}
_BUSY: Final = {Trouble.FOREIGN, Trouble.BOARD_OUT, Trouble.ERRORS, *_ERROR_FRAMES}
_CUT: Final = {Trouble.CABLE_OUT, Trouble.BOARD_OUT, Trouble.UNREADABLE, Trouble.BUS_OFF, Trouble.UNACKNOWLEDGED}
_STRIKES: Final[dict[Trouble, Callable[[FaultInjector, list[Frame]], list[Frame]]]] = {
    Trouble.LOST: FaultInjector._lose,
    Trouble.TORN: FaultInjector._tear,
    Trouble.REPEATED: FaultInjector._repeat,
    Trouble.LATE: FaultInjector._delay,
    Trouble.REORDERED: FaultInjector._reorder,
    Trouble.MALFORMED: FaultInjector._spoil,
    Trouble.STUCK: FaultInjector._stick,
    Trouble.CLOCK: FaultInjector._stop_clock,
}
