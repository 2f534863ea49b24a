"""Source of time, which tests replace by their own."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """Source of time."""

    def monotonic(self) -> int:
        """Return monotonic time [ns], from an arbitrary origin."""
        ...

    def wall(self) -> int:
        """Return the time since the Unix epoch [ns]; jumps when it is set."""
        ...

    def sleep(self, seconds: float) -> None:
        """Wait for `seconds` [s]."""
        ...


class SystemClock:
    """Clock of this machine. Called several times per scan, therefore without wrappers."""

    monotonic = staticmethod(time.monotonic_ns)
    wall = staticmethod(time.time_ns)
    sleep = staticmethod(time.sleep)
