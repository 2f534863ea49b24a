"""A bus that reconnects with exponential back-off."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Final

import can

from posfet_driver.bus.error_frame import ErrorCounts
from posfet_driver.bus.frame import Frame
from posfet_driver.bus.frame_bus import FrameBus
from posfet_driver.clock import Clock
from posfet_model._lib.units import NANOSECONDS

BACK_OFF_FIRST: Final = 0.1
BACK_OFF_LAST: Final = 5.0
"""Delay between two attempts to open the bus [s]: doubled from the first to the last."""
PRESENCE_PERIOD: Final = 0.1
"""Period at which the presence of the adapter is checked [s]."""


class ReconnectingBus:
    """Holds the bus while it is open and counts its failures and error frames.

    Parameters
    ----------
    open_bus : callable
        Opens the bus; raises can.CanError or ConfigError.
    presence : callable or None
        Returns a value that changes when the adapter is connected again: then the bus is opened without further delay.
    clock : Clock
        Source of time.
    """

    def __init__(self, open_bus: Callable[[], FrameBus], presence: Callable[[], object] | None, clock: Clock) -> None:
        self.opened = 0
        """Number of times the bus was opened."""
        self.failed = 0
        """Number of times an open bus failed."""
        self.errors = ErrorCounts()
        """Error frames received."""
        self._open_bus = open_bus
        self._presence = presence
        self._clock = clock
        self._bus: FrameBus | None = None
        self._last_presence: object = None
        self._delay = BACK_OFF_FIRST
        self._malformed_before = 0  # of buses that are closed

    @property
    def malformed_lines(self) -> int:
        """Lines from serial adapters that are no frame and no reply, those of closed adapters included."""
        bus = self._bus
        return self._malformed_before + (bus.malformed_lines if bus else 0)

    @property
    def arrival_stamp(self) -> int:
        """Wall time at which the newest frame of the last read arrived [ns], by the kernel; 0: unknown."""
        return self._bus.arrival_stamp if self._bus else 0

    @property
    def is_open(self) -> bool:
        """Whether the bus is open."""
        return self._bus is not None

    def connect(self) -> None:
        """Open the bus.

        Raises
        ------
        can.CanError
            When it cannot be opened now.
        ConfigError
            When it can never be opened with these arguments.
        """
        if self._presence is not None:
            self._last_presence = self._presence()
        self._bus = self._open_bus()
        self.opened += 1

    def close(self) -> None:
        """Close the bus, even if it has failed."""
        bus, self._bus = self._bus, None
        if bus:
            self._malformed_before += bus.malformed_lines
            with contextlib.suppress(can.CanError, OSError):
                bus.shutdown()

    def fail(self) -> float:
        """Close a bus that has failed; return the delay until the next attempt [s]."""
        self.failed += self.is_open
        self.close()
        delay, self._delay = self._delay, min(2 * self._delay, BACK_OFF_LAST)
        return delay

    def reset_backoff(self) -> None:
        """Reset the back-off."""
        self._delay = BACK_OFF_FIRST

    def wait_for_device(self, duration: int) -> bool:
        """Wait up to `duration` [ns] without a bus; return True when an adapter was connected or removed meanwhile."""
        seconds = duration / NANOSECONDS
        if self._presence is None:
            self._clock.sleep(seconds)
            return False
        self._clock.sleep(min(seconds, PRESENCE_PERIOD))
        if self._presence() == self._last_presence:
            return False
        self.reset_backoff()
        return True

    def read(self, timeout: float) -> list[Frame]:
        """Return the frames that are waiting or arrive within `timeout` [s]; error frames among them are counted.

        Parameters
        ----------
        timeout : float
            Longest time to wait for the first frame [s].

        Returns
        -------
        list of Frame
            Frames, error frames included; none when the bus is not open.

        Raises
        ------
        can.CanError or OSError
            When the bus fails.
        """
        if self._bus is None:
            return []
        frames = self._bus.read_frames(timeout)
        self.errors.count(frames)
        return frames

    def write(self, frame: Frame) -> None:
        """Send a frame, or nothing when the bus is not open. Raises can.CanError or OSError."""
        if self._bus:
            self._bus.write_frame(frame)

    def ask_state(self) -> None:
        """Request the adapter's error state, which arrives as error frames. Raises can.CanError or OSError."""
        if self._bus:
            self._bus.ask_state()
