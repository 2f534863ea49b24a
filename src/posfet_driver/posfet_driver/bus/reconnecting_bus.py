"""A bus that comes and goes: opened with a growing pause, given up when it fails, opened at once when it is back."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Final

import can

from posfet_driver.bus.frame import Frame
from posfet_driver.bus.frame_bus import FrameBus
from posfet_driver.clock import Clock
from posfet_model._lib.units import NANOSECONDS

BACK_OFF_FIRST: Final = 0.1
BACK_OFF_LAST: Final = 5.0
"""Time between two attempts to open the bus [s]: doubled from the first to the last."""
PRESENCE_PERIOD: Final = 0.1
"""Time between two looks whether an adapter has come back [s]."""


class BusLink:
    """Holds the bus while it is open."""

    def __init__(self, open_bus: Callable[[], FrameBus], presence: Callable[[], object] | None, clock: Clock) -> None:
        """Take what opens the bus, and what returns something else when an adapter came back."""
        self.opened = 0
        """How often the bus was opened."""
        self.failed = 0
        """How often an open bus failed."""
        self._open_bus = open_bus
        self._presence = presence
        self._clock = clock
        self._bus: FrameBus | None = None
        self._seen: object = None
        self._pause = BACK_OFF_FIRST
        self._malformed_before = 0

    @property
    def malformed_lines(self) -> int:
        """What adapters sent that was no frame and no reply, also by those that are gone."""
        bus = self._bus
        return self._malformed_before + (bus.malformed_lines if bus else 0)

    @property
    def is_open(self) -> bool:
        """Whether there is a bus to read."""
        return self._bus is not None

    def connect(self) -> None:
        """Open the bus. Raises can.CanError when that cannot be now, ConfigError when never."""
        if self._presence is not None:
            self._seen = self._presence()
        self._bus = self._open_bus()
        self.opened += 1

    def drop(self) -> None:
        """Close the bus, which may not work any more."""
        bus, self._bus = self._bus, None
        if bus:
            self._malformed_before += bus.malformed_lines
            with contextlib.suppress(can.CanError, OSError):
                bus.shutdown()

    def fail(self) -> float:
        """Give the bus up; return how long to wait [s] until the next attempt."""
        self.failed += self.is_open
        self.drop()
        pause, self._pause = self._pause, min(2 * self._pause, BACK_OFF_LAST)
        return pause

    def settle(self) -> None:
        """Take note that all is well: the next pause is the shortest again."""
        self._pause = BACK_OFF_FIRST

    def rest(self, duration: int) -> bool:
        """Let up to `duration` [ns] pass without a bus; return True when an adapter came or went meanwhile."""
        seconds = duration / NANOSECONDS
        if self._presence is None:
            self._clock.sleep(seconds)
            return False
        self._clock.sleep(min(seconds, PRESENCE_PERIOD))
        if self._presence() == self._seen:
            return False
        self.settle()
        return True

    def read(self, timeout: float) -> list[Frame]:
        """Return the frames that are there or come within `timeout` [s]. Raises can.CanError or OSError."""
        return self._bus.read_frames(timeout) if self._bus else []

    def write(self, frame: Frame) -> None:
        """Send a frame, or nothing when the bus is not open. Raises can.CanError or OSError."""
        if self._bus:
            self._bus.write_frame(frame)

    def ask_state(self) -> None:
        """Ask the adapter what it knows of errors, as error frames to be read. Raises can.CanError or OSError."""
        if self._bus:
            self._bus.ask_state()
