# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Adapts any python-can bus to read many frames at once."""

from __future__ import annotations

from typing import Final

import can

from posfet_driver.bus.bus_error import bus_failure
from posfet_driver.bus.error_frame import BUS_OFF, CONTROLLER, PASSIVE, error_frame
from posfet_driver.bus.frame import Frame
from posfet_driver.bus.message_conversion import frame_of, message_of

READ_LIMIT: Final = 1024
"""Largest number of messages read at once."""


class PythonCanFrameBus:
    """Adapts any python-can bus to the interface FrameBus.

    Parameters
    ----------
    bus : can.BusABC
        The open bus.
    """

    arrival_stamp = 0
    port, read_by_port = None, False
    must_be_asked = False

    def __init__(self, bus: can.BusABC) -> None:
        self.unreadable = 0
        """Number of messages that are no valid CAN frame."""
        self._bus = bus
        self._waiting: list[Frame] = []

    def read_frames(self, timeout: float) -> list[Frame]:
        """Return the frames that are waiting; when there is none, wait up to `timeout` [s] for the first."""
        frames, self._waiting = self._waiting, []
        try:
            message = self._bus.recv(0 if frames else timeout)
            for _ in range(READ_LIMIT - 1):
                if message is None:
                    return frames
                self._add(message, frames)
                message = self._bus.recv(0)
        except Exception as error:
            raise bus_failure(error) from error
        if message is not None:
            self._add(message, frames)
        return frames

    def _add(self, message: can.Message, frames: list[Frame]) -> None:
        try:
            frames.append(frame_of(message))
        except ValueError:
            self.unreadable += 1

    def write_frame(self, frame: Frame) -> bool:
        """Send one frame."""
        try:
            self._bus.send(message_of(frame), timeout=0.1)
        except Exception as error:
            raise bus_failure(error) from error
        return True

    def ask_state(self) -> None:
        """Queue the state of the controller as an error frame, where the adapter reports it."""
        try:
            frame = _STATES.get(self._bus.state)
        except NotImplementedError:
            return
        except Exception as error:
            raise bus_failure(error) from error
        if frame is not None and frame not in self._waiting:
            self._waiting.append(frame)

    def shutdown(self) -> None:
        """Close the bus."""
        self._bus.shutdown()


_STATES: Final = {
    can.BusState.PASSIVE: error_frame(CONTROLLER, PASSIVE),
    can.BusState.ERROR: error_frame(BUS_OFF),
}
