"""What an emulated adapter or bus serves."""

from __future__ import annotations

from typing import Protocol

from posfet_driver.bus.frame import Frame


class Node(Protocol):
    """What is on the bus behind the adapter, such as a BoardFirmware. Times are monotonic [ns]."""

    def next_due(self) -> int:
        """Return when the next frame is due."""
        ...

    def due(self, now: int) -> list[Frame]:
        """Return the frames that are due."""
        ...

    def receive(self, frame: Frame, now: int) -> list[Frame]:
        """Take a frame and return those that answer it."""
        ...
