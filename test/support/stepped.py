# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A bus in stepped time."""

from __future__ import annotations

import can

from posfet_driver.bus.frame import Frame
from posfet_sim.emulation.bus_node import Node
from support.clocks import SteppedClock

STEP = 50_000_000
"""Time between two looks at a board that sends while nobody reads [ns]."""


class SteppedBus:
    """A bus in stepped time with a board on it, which can fail and hold back the frames of the board.

    Frames arrive in batches, `cadence` [ns] apart, as from a USB adapter. Until `stands_until` [ns] the adapter is
    stalled: nothing is received or sent; then all frames arrive, at most `room` at a time.
    """

    unreadable = 0
    arrival_stamp = 0
    must_be_asked = False
    port, read_by_port = None, False

    def __init__(self, clock: SteppedClock, firmware: Node, cadence: int = 0) -> None:
        self.clock = clock
        self.firmware = firmware
        self.broken = False
        self.closed = False
        self.held_back = False
        self.stands_until = 0
        self.room = 1 << 30
        self._answers: list[Frame] = []
        self._orders: list[Frame] = []
        self._cadence = cadence
        self._read = 0

    def read_frames(self, timeout: float) -> list[Frame]:
        if self.broken:
            raise can.CanOperationError("cable out")
        end = self.clock.now + round(timeout * 1e9)
        if self.clock.now < self.stands_until:
            self.clock.now = min(end, self.stands_until)
            return []
        orders, self._orders = self._orders, []
        for order in orders:
            self.write_frame(order)
        if self.held_back:
            frames, self._answers = self._answers, []
            self.clock.now = self.clock.now if frames else end
            return frames
        self.clock.now = min(max(self.clock.now, self._read + self._cadence), end)
        frames = self._due()
        while not frames and self.clock.now < end:
            self.clock.now = min(max(self.firmware.next_due(), self.clock.now), end)
            frames = self._due()
            if not frames and self.clock.now < end:
                self.clock.now = min(self.clock.now + 100_000, end)
        self._read = self.clock.now
        self._answers = frames[self.room :] + self._answers
        return frames[: self.room]

    def _due(self) -> list[Frame]:
        frames, self._answers = self._answers, []
        return frames + self._sent()

    def _sent(self) -> list[Frame]:
        """Return what the board has sent by now, in its time: it is not late when the reader is."""
        frames: list[Frame] = []
        while (end := self.firmware.next_due() + STEP) < self.clock.now:
            frames += self.firmware.due(end)
        return frames + self.firmware.due(self.clock.now)

    def write_frame(self, frame: Frame) -> None:
        if self.broken:
            raise can.CanOperationError("cable out")
        if self.clock.now < self.stands_until:
            self._orders.append(frame)
            return
        if not self.held_back:  # a board has sent all due frames before it receives a command
            self._answers += self._sent()
        self._answers += self.firmware.receive(frame, self.clock.now)

    def ask_state(self) -> None:
        if self.broken:
            raise can.CanOperationError("cable out")

    def shutdown(self) -> None:
        self.closed = True
