"""Adapts any python-can bus to read many frames at once."""

from __future__ import annotations

import contextlib
from typing import Final

import can

from posfet_driver.bus.error_frame import BUS_OFF, CONTROLLER, PASSIVE, error_frame
from posfet_driver.bus.frame import Frame
from posfet_driver.bus.message_conversion import frame_of, message_of

READ_LIMIT: Final = 1024
"""Largest number of frames read at once."""


class PythonCanFrameBus:
    """Adapts any python-can bus to the interface FrameBus.

    Parameters
    ----------
    bus : can.BusABC
        The open bus.
    """

    malformed_lines = 0
    arrival_stamp = 0

    def __init__(self, bus: can.BusABC) -> None:
        self._bus = bus
        self._waiting: list[Frame] = []

    def read_frames(self, timeout: float) -> list[Frame]:
        """Return the frames that are waiting; when there is none, wait up to `timeout` [s] for the first."""
        frames, self._waiting = self._waiting, []
        message = self._bus.recv(0 if frames else timeout)
        while message is not None and len(frames) < READ_LIMIT:
            frames.append(frame_of(message))
            message = self._bus.recv(0)
        if message is not None:
            frames.append(frame_of(message))
        return frames

    def write_frame(self, frame: Frame) -> None:
        """Send one frame."""
        self._bus.send(message_of(frame), timeout=0.1)

    def ask_state(self) -> None:
        """Queue the state of the controller as an error frame, where the adapter reports it."""
        with contextlib.suppress(NotImplementedError):
            frame = _STATES.get(self._bus.state)
            if frame is not None:
                self._waiting.append(frame)

    def shutdown(self) -> None:
        """Close the bus."""
        self._bus.shutdown()


_STATES: Final = {
    can.BusState.PASSIVE: error_frame(CONTROLLER, PASSIVE),
    can.BusState.ERROR: error_frame(BUS_OFF),
}
