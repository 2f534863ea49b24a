"""Time as everything here sees it, so that a test can put its own clock in the place of the system's."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """Time as the sources see it, so that a test can put its own in the place."""

    def monotonic(self) -> int:
        """Time that never jumps [ns], from an arbitrary start."""
        ...

    def wall(self) -> int:
        """Time since the Unix epoch [ns]; jumps when somebody sets it."""
        ...

    def sleep(self, seconds: float) -> None:
        """Let `seconds` [s] pass."""
        ...


class SystemClock:
    """The clock of this machine; called several times a scan, so without anything in between."""

    monotonic = staticmethod(time.monotonic_ns)
    wall = staticmethod(time.time_ns)
    sleep = staticmethod(time.sleep)
