"""Time that passes only when it is let pass, and a bus in it."""

from __future__ import annotations

import can

from posfet_driver.bus.frame import Frame
from posfet_sim.emulation.bus_node import Node


class SteppedClock:
    """Time that passes only in sleep; notes the pauses."""

    def __init__(self) -> None:
        self.now = 0
        self.sleeps: list[float] = []

    def monotonic(self) -> int:
        return self.now

    def wall(self) -> int:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.sleeps.append(seconds)
        self.now += round(seconds * 1e9)


class SteppedBus:
    """A bus in stepped time with a board on it, which can break, and hold back what the board sends.

    Frames come in batches, `cadence` [ns] apart, as those of a USB adapter do.
    """

    malformed_lines = 0

    def __init__(self, clock: SteppedClock, firmware: Node, cadence: int = 0) -> None:
        self.clock = clock
        self.firmware = firmware
        self.broken = False
        self.closed = False
        self.held_back = False
        self._answers: list[Frame] = []
        self._cadence = cadence
        self._read = 0

    def read_frames(self, timeout: float) -> list[Frame]:
        if self.broken:
            raise can.CanOperationError("cable out")
        end = self.clock.now + round(timeout * 1e9)
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
        return frames

    def _due(self) -> list[Frame]:
        frames, self._answers = self._answers, []
        return frames + self.firmware.due(self.clock.now)

    def write_frame(self, frame: Frame) -> None:
        if self.broken:
            raise can.CanOperationError("cable out")
        self._answers += self.firmware.receive(frame, self.clock.now)

    def ask_state(self) -> None:
        if self.broken:
            raise can.CanOperationError("cable out")

    def shutdown(self) -> None:
        self.closed = True
