# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Injects faults between a simulated board and its adapter or bus, one kind at a time."""

from __future__ import annotations

import random
from collections.abc import Callable
from enum import Enum
from itertools import groupby
from typing import Final

from posfet_driver.bus.error_frame import BUS_OFF, CONTROLLER, NO_ACKNOWLEDGE, OVERFLOW, PASSIVE, PROTOCOL, error_frame
from posfet_driver.bus.frame import CLASSIC, FD, Frame
from posfet_driver.protocol.messages import HEADER_OFFSET, IDENTITY_OFFSET, RESPONSE_OFFSET, STATUS_OFFSET
from posfet_driver.protocol.scan_codec import CLASSIC_COUNTER, checksum
from posfet_sim.emulation.firmware import BoardFirmware

UNRELATED_PERIOD: Final = 111_000
"""Period of unrelated frames [ns]: classic frames of 8 bytes without stuff bits then occupy 1 Mbit/s completely."""
LOW_SUPPLY: Final = 3.9
"""Supply voltage in a brown-out [V]."""
_SHORTER: Final = {True: 48, False: 7}  # length of a truncated frame [byte], CAN FD and classic
PROBABILITY: Final = 0.1
"""Probability that a fault of single scans or frames affects one."""


class InjectedFault(Enum):
    """Faults that can be injected."""

    NONE = "none"
    LOST = "lost scans"
    INCOMPLETE = "incomplete scans"
    DUPLICATE = "duplicate frames"
    LATE = "late frames"
    REORDERED = "reordered frames"
    MALFORMED = "malformed frames"
    FROZEN_COUNTER = "frozen sequence counter"
    FROZEN_TIMESTAMP = "frozen timestamp"
    UNRELATED = "unrelated traffic"
    ERRORS = "error frames"
    UNACKNOWLEDGED = "unacknowledged"
    OVERFLOW = "receive overflows"
    ERROR_PASSIVE = "error passive"
    UNREADABLE = "bus unreadable"
    BUS_OFF = "bus off"
    CABLE_UNPLUGGED = "cable unplugged"
    BOARD_UNPLUGGED = "board unplugged, other traffic on the bus"
    NO_RESPONSE = "board not responding to commands"
    RESET = "board resets"
    BROWN_OUT = "brown-outs"


class FaultInjector:
    """A node behind an adapter or on a bus that applies `fault` to the frames of a board.

    Faults of whole scans and frames occur at random, the same for the same seed. RESET and BROWN_OUT occur once, when
    the fault is set. Error frames need a bus that carries them: slcan does not.
    """

    def __init__(self, make_firmware: Callable[[int], BoardFirmware], base: int, now: int, seed: int = 0) -> None:
        """Create the injector.

        Parameters
        ----------
        make_firmware : callable
            Returns the firmware of a board that is switched on at a monotonic time [ns].
        base : int
            Base identifier of the board.
        now : int
            Monotonic time [ns].
        seed : int
            Seed of the random faults.
        """
        self.firmware = make_firmware(now)
        self._fault = InjectedFault.NONE
        self._busy = self._cut = False
        self._make_firmware = make_firmware
        self._boots = 0
        self._base = base
        self._random = random.Random(seed)
        self._next_unrelated = now
        self._applied = InjectedFault.NONE
        self._delayed: list[Frame] = []
        self._frozen: bytes | None = None

    @property
    def fault(self) -> InjectedFault:
        """The fault that is injected now."""
        return self._fault

    @fault.setter
    def fault(self, fault: InjectedFault) -> None:
        self._fault, self._busy, self._cut = fault, fault in _BUSY, fault in _CUT

    def next_due(self) -> int:
        """Return when the next frame is due [ns]."""
        due = self.firmware.next_due()
        return min(due, self._next_unrelated) if self._busy else due

    def due(self, now: int, until: int | None = None) -> list[Frame]:
        """Return the frames that are due at `now` [ns], or `until` then."""
        self._apply(now)
        frames = self._with_fault(self.firmware.due(now, until))
        if self._busy:
            while self._next_unrelated <= now:
                self._next_unrelated += UNRELATED_PERIOD
                frames.append(self._other_frame())
        else:
            self._next_unrelated = now
        return frames

    def receive(self, frame: Frame, now: int) -> list[Frame]:
        """Process a frame and return the frames that answer it."""
        if self.fault == InjectedFault.UNACKNOWLEDGED:
            return [error_frame(NO_ACKNOWLEDGE)]
        if self._cut or self.fault == InjectedFault.NO_RESPONSE:
            return []
        return self.firmware.receive(frame, now)

    def _apply(self, now: int) -> None:
        if self.fault == self._applied:
            return
        self._applied = self.fault
        self._frozen = None
        if self.fault in {InjectedFault.RESET, InjectedFault.BROWN_OUT}:
            self.firmware = self._make_firmware(now)
            self._boots += 1
            self.firmware.boot = self._boots & 0xF
        if self.fault == InjectedFault.BROWN_OUT:
            self.firmware.supply = LOW_SUPPLY

    def _with_fault(self, frames: list[Frame]) -> list[Frame]:
        if self._cut:
            return []
        effect = _EFFECTS.get(self.fault)
        if effect is None:
            late, self._delayed = self._delayed, []
            return late + frames
        result: list[Frame] = []
        size = self.firmware.blocks
        for short, group in groupby(frames, self._is_short):  # status frames keep their position among the scans
            run = list(group)
            if short:
                result += run
                continue
            while run:
                count = size + (run[0][0] == self._base + HEADER_OFFSET)  # a header belongs to the scan behind it
                result += effect(self, run[:count])
                run = run[count:]
        return result

    def _is_short(self, frame: Frame) -> bool:
        return frame[0] - self._base in {RESPONSE_OFFSET, STATUS_OFFSET, IDENTITY_OFFSET}

    def _other_frame(self) -> Frame:
        if self.fault == InjectedFault.ERRORS:
            return error_frame(CONTROLLER)
        if self.fault in _ERROR_FRAMES:
            return _ERROR_FRAMES[self.fault]
        return self._random.randrange(self._base), CLASSIC, self._random.randbytes(8)

    def _unaffected(self) -> bool:
        return self._random.random() >= PROBABILITY

    def _lose(self, frames: list[Frame]) -> list[Frame]:
        return frames if self._unaffected() else []

    def _truncate_scan(self, frames: list[Frame]) -> list[Frame]:
        return frames if self._unaffected() else frames[: self._random.randrange(len(frames) + 1)]

    def _duplicate(self, frames: list[Frame]) -> list[Frame]:
        return [frame for frame in frames for _ in range(1 if self._unaffected() else 2)]

    def _delay(self, frames: list[Frame]) -> list[Frame]:
        if not frames:
            return frames
        late, self._delayed = self._delayed, []
        if not self._unaffected():
            self._delayed = [frames.pop()]
        return frames + late

    def _reorder(self, frames: list[Frame]) -> list[Frame]:
        return frames if self._unaffected() else frames[::-1]

    def _truncate_frames(self, frames: list[Frame]) -> list[Frame]:
        """Truncate frames, to a length that CAN allows."""
        return [
            (number, kind, data if self._unaffected() else data[: _SHORTER[bool(kind & FD)]])
            for number, kind, data in frames
        ]

    def _freeze_counter(self, frames: list[Frame]) -> list[Frame]:
        """Give every block the sequence of the first affected one; headers are sent no more."""
        frames = [frame for frame in frames if frame[0] != self._base + HEADER_OFFSET]
        if frames and self._frozen is None:
            self._frozen = frames[0][2]
        frozen = self._frozen or b""
        return [(number, kind, _with_counter(kind, data, frozen)) for number, kind, data in frames]

    def _freeze_timestamp(self, frames: list[Frame]) -> list[Frame]:
        """Give every FD block and every header the timestamp of the first affected one."""
        result = []
        for number, kind, data in frames:
            if kind & FD or number == self._base + HEADER_OFFSET:
                self._frozen = self._frozen or data
                result.append((number, kind, sealed(kind, data[:4] + self._frozen[4:8] + data[8:])))
            else:
                result.append((number, kind, data))
        return result


def _with_counter(kind: int, data: bytes, frozen: bytes) -> bytes:
    """Return the data of a block with the sequence of an earlier one."""
    if kind & FD:
        return sealed(kind, frozen[:4] + data[4:])
    return bytes([data[0] & ~CLASSIC_COUNTER & 0xFF | frozen[0] & CLASSIC_COUNTER]) + data[1:]


def sealed(kind: int, data: bytes) -> bytes:
    """Return the data of an FD block with the checksum that fits it."""
    return data[:10] + checksum(data).to_bytes(2, "little") + data[12:] if kind & FD else data


_ERROR_FRAMES: Final = {
    InjectedFault.UNREADABLE: error_frame(PROTOCOL),
    InjectedFault.BUS_OFF: error_frame(BUS_OFF),
    InjectedFault.OVERFLOW: error_frame(CONTROLLER, OVERFLOW),
    InjectedFault.ERROR_PASSIVE: error_frame(CONTROLLER, PASSIVE),
}
NEED_ERROR_FRAMES: Final = frozenset({InjectedFault.ERRORS, InjectedFault.UNACKNOWLEDGED, *_ERROR_FRAMES})
"""Faults that a bus without error frames, as slcan is, cannot show."""
_BUSY: Final = {InjectedFault.UNRELATED, InjectedFault.BOARD_UNPLUGGED, InjectedFault.ERRORS, *_ERROR_FRAMES}
_CUT: Final = {
    InjectedFault.CABLE_UNPLUGGED,
    InjectedFault.BOARD_UNPLUGGED,
    InjectedFault.UNREADABLE,
    InjectedFault.BUS_OFF,
    InjectedFault.UNACKNOWLEDGED,
}
_EFFECTS: Final[dict[InjectedFault, Callable[[FaultInjector, list[Frame]], list[Frame]]]] = {
    InjectedFault.LOST: FaultInjector._lose,
    InjectedFault.INCOMPLETE: FaultInjector._truncate_scan,
    InjectedFault.DUPLICATE: FaultInjector._duplicate,
    InjectedFault.LATE: FaultInjector._delay,
    InjectedFault.REORDERED: FaultInjector._reorder,
    InjectedFault.MALFORMED: FaultInjector._truncate_frames,
    InjectedFault.FROZEN_COUNTER: FaultInjector._freeze_counter,
    InjectedFault.FROZEN_TIMESTAMP: FaultInjector._freeze_timestamp,
}
