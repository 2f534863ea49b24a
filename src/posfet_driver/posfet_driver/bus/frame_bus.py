# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Interface of every bus: reads many frames at once."""

from __future__ import annotations

from typing import Protocol

from posfet_core.protocol import FramePort
from posfet_driver.bus.frame import Frame


class FrameBus(Protocol):
    """A bus that reads many frames at once. Every method raises can.CanError when the bus has failed."""

    @property
    def unreadable(self) -> int:
        """Lines or frames from the adapter that could not be parsed."""
        ...

    @property
    def arrival_stamp(self) -> int:
        """Wall time at which the newest frame of the last read arrived [ns], by the kernel; 0: unknown."""
        ...

    @property
    def port(self) -> FramePort | None:
        """Compiled port of the bus; None: it has none."""
        ...

    @property
    def read_by_port(self) -> bool:
        """Whether all frames can be read from the port now, without `read_frames`."""
        ...

    @property
    def must_be_asked(self) -> bool:
        """Whether the adapter tells its error state only when asked, and answers that while frames flow."""
        ...

    def read_frames(self, timeout: float) -> list[Frame]:
        """Return the frames that are waiting; when there is none, wait for the first.

        Parameters
        ----------
        timeout : float
            Longest time to wait [s].

        Returns
        -------
        list of Frame
            Frames and error frames in the order of their arrival; empty after the timeout.
        """
        ...

    def write_frame(self, frame: Frame) -> bool:
        """Send one frame; return whether there was room for it, else it is dropped."""
        ...

    def ask_state(self) -> None:
        """Request the adapter's error state, which is read as error frames if the adapter reports any."""
        ...

    def shutdown(self) -> None:
        """Close the bus."""
        ...
