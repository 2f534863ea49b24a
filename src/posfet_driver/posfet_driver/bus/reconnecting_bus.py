# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A bus that reconnects with back-off."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Final

from posfet_core.protocol import FramePort
from posfet_driver.bus.bus_error import bus_failure
from posfet_driver.bus.error_frame import ErrorCounts
from posfet_driver.bus.frame import ERROR, Frame
from posfet_driver.bus.frame_bus import FrameBus
from posfet_driver.clock import Clock
from posfet_model._lib.units import NANOSECONDS
from posfet_model.config import ConfigError

BACK_OFF_FIRST: Final = 0.1
BACK_OFF_LAST: Final = 0.25
"""Pause between two attempts to open the bus [s]: doubled from the first to the last. The last is as short because only
an attempt tells of many adapters that they were connected again, and data has to flow 0.5 s later."""
PAUSE_PER_ATTEMPT: Final = 4.0
"""Shortest pause in durations of the attempt before it: at most a fifth of the time is spent on attempts; assumed."""
SLOW_BACK_OFF_LAST: Final = 5.0
"""Longest pause after an attempt that took long [s]; assumed."""
PRESENCE_PERIOD: Final = 0.1
"""Period at which the presence of the adapter is checked [s]."""
SETTLE_TIME: Final = 1.0
"""Time that a reopened bus has to work [s] until its loss is over, when no frame arrives earlier; assumed.
A network device that is down can be opened, and fails at once."""
BUS_OFF_MEMORY: Final = 2 * SLOW_BACK_OFF_LAST
"""Time after the last report of bus-off [s] after which that bus-off is over, when no frame arrives earlier; assumed.
A controller that stays bus-off is asked more often."""


class _Event:
    """One event from its beginning to its end, however many reports of it there are."""

    def __init__(self) -> None:
        self.count = 0
        self.present = False

    def begin(self) -> None:
        self.count += not self.present
        self.present = True


class ReconnectingBus:
    """Holds the bus while it is open; counts its losses, and its error frames.

    A loss is one event from the failure of an open bus until it works again: until a frame arrives, or it has worked
    for `SETTLE_TIME`. Attempts in between count as `opened` and `open_failures`. Bus-off is one event until a frame
    arrives, or until it was not reported for `BUS_OFF_MEMORY`. Whatever a backend raises becomes can.CanError with one
    line of text.

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
        self.open_failures = 0
        """Number of attempts to open the bus that failed."""
        self.errors = ErrorCounts()
        """Error frames received."""
        self._open_bus = open_bus
        self._presence = presence
        self._clock = clock
        self._bus: FrameBus | None = None
        self._last_presence: object = None
        self._delay = BACK_OFF_FIRST
        self._attempt_duration = 0.0  # [s]; 0 once the bus has worked
        self._unreadable_before = 0  # of buses that are closed
        self._loss = _Event()
        self._bus_off = _Event()
        self._opened_at = self._bus_off_at = 0

    @property
    def failed(self) -> int:
        """Number of times the bus was lost."""
        return self._loss.count

    @property
    def bus_offs(self) -> int:
        """Number of times the controller went bus-off."""
        return self._bus_off.count

    @property
    def is_bus_off(self) -> bool:
        """Whether the controller is bus-off, as far as it reports it."""
        return self._bus_off.present

    @property
    def unreadable(self) -> int:
        """Lines or frames from the adapter that could not be parsed, those of closed buses included."""
        bus = self._bus
        return self._unreadable_before + (bus.unreadable if bus else 0)

    @property
    def arrival_stamp(self) -> int:
        """Wall time at which the newest frame of the last read arrived [ns], by the kernel; 0: unknown."""
        return self._bus.arrival_stamp if self._bus else 0

    @property
    def port(self) -> FramePort | None:
        """Compiled port of the open bus; None: it has none."""
        return self._bus.port if self._bus else None

    @property
    def read_by_port(self) -> bool:
        """Whether all frames can be read from the port now, and none is needed to follow an event."""
        return bool(self._bus and self._bus.read_by_port) and not (self._loss.present or self._bus_off.present)

    @property
    def must_be_asked(self) -> bool:
        """Whether the adapter tells its error state only when asked, and answers that while frames flow."""
        return bool(self._bus and self._bus.must_be_asked)

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
        begin = self._clock.monotonic()
        try:
            if self._presence is not None:
                self._last_presence = self._presence()
            self._bus = self._open_bus()
        except Exception as error:
            self.open_failures += 1
            if isinstance(error, ConfigError):
                raise
            raise bus_failure(error) from error
        finally:
            self._attempt_duration = (self._clock.monotonic() - begin) / NANOSECONDS
        self.opened += 1
        self._opened_at = self._clock.monotonic()

    def close(self) -> None:
        """Close the bus, even if it has failed."""
        bus, self._bus = self._bus, None
        if bus:
            self._unreadable_before += bus.unreadable
            with contextlib.suppress(Exception):  # it has failed, or is no longer needed
                bus.shutdown()

    def fail(self) -> float:
        """Close a bus that has failed; return the pause until the next attempt [s]."""
        if self.is_open:
            self._loss.begin()
        self.close()
        pause, self._delay = self._delay, min(2 * self._delay, BACK_OFF_LAST)
        return max(pause, min(PAUSE_PER_ATTEMPT * self._attempt_duration, SLOW_BACK_OFF_LAST))

    def reset_backoff(self) -> None:
        """Reset the back-off: the bus works, or its adapter was connected again."""
        self._delay = BACK_OFF_FIRST
        self._attempt_duration = 0.0

    def wait_for_device(self, duration: int) -> bool:
        """Wait up to `duration` [ns] without a bus; return True when an adapter was connected or removed meanwhile."""
        seconds = duration / NANOSECONDS
        if self._presence is None:
            self._clock.sleep(seconds)
            return False
        self._clock.sleep(min(seconds, PRESENCE_PERIOD))
        try:
            if self._presence() == self._last_presence:
                return False
        except Exception:  # the next attempt to open the bus reports it
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
        can.CanError
            When the bus fails, whatever its backend raised.
        """
        if self._bus is None:
            return []
        try:
            frames = self._bus.read_frames(timeout)
        except Exception as error:
            raise bus_failure(error) from error
        before = self.errors.bus_off
        self.errors.count(frames)
        if self._loss.present or self._bus_off.present or self.errors.bus_off != before:
            self._follow_events(frames, self.errors.bus_off != before)
        return frames

    def _follow_events(self, frames: list[Frame], bus_off: bool) -> None:
        """Begin and end the events after a read that returned `frames`."""
        now = self._clock.monotonic()
        traffic = any(not kind & ERROR for _, kind, _ in frames)
        if bus_off:
            self._bus_off.begin()
            self._bus_off_at = now
        elif traffic or now - self._bus_off_at >= BUS_OFF_MEMORY * NANOSECONDS:
            self._bus_off.present = False
        if not bus_off and (traffic or now - self._opened_at >= SETTLE_TIME * NANOSECONDS):
            self._loss.present = False

    def write(self, frame: Frame) -> None:
        """Send a frame, or nothing when the bus is not open. Raises can.CanError."""
        try:
            if self._bus:
                self._bus.write_frame(frame)
        except Exception as error:
            raise bus_failure(error) from error

    def ask_state(self) -> None:
        """Request the adapter's error state, which arrives as error frames. Raises can.CanError."""
        try:
            if self._bus:
                self._bus.ask_state()
        except Exception as error:
            raise bus_failure(error) from error
