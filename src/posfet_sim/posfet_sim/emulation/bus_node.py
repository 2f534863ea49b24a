# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Interface of a node that an emulated adapter or a bus server connects to the bus."""

from __future__ import annotations

from typing import Protocol

from posfet_driver.bus.frame import Frame


class Node(Protocol):
    """A node on the bus behind the adapter, such as a `BoardFirmware`. Times are monotonic [ns]."""

    def next_due(self) -> int:
        """Return when the next frame is due [ns]."""
        ...

    def due(self, now: int, until: int | None = None) -> list[Frame]:
        """Return the frames that are due at `now` [ns].

        Parameters
        ----------
        now : int
            Monotonic time [ns].
        until : int, optional
            Time before `now` [ns]: what is due later is not returned yet, unless what is due by then is missed.
        """
        ...

    def receive(self, frame: Frame, now: int) -> list[Frame]:
        """Process a frame from the bus at `now` [ns] and return the frames that answer it.

        Parameters
        ----------
        frame : Frame
            Frame from the bus.
        now : int
            Monotonic time [ns].
        """
        ...
