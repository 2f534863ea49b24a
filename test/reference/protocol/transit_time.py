# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Longest time that the frames of a scan occupy the bus, in Python."""

from __future__ import annotations

from posfet_core.protocol import TransitTimes
from posfet_driver.bus.frame import FD, RATE_SWITCH


class TransitTime:
    """Which of the two transit times holds: that without bit rate switch from the first such frame on."""

    def __init__(self) -> None:
        self.times = TransitTimes(0.0, 0.0)
        """Both."""
        self._unswitched = False

    def restart(self) -> None:
        """Forget the frames that have come: the board was started, or the bus opened."""
        self._unswitched = False

    def see(self, kind: int) -> None:
        """Note a frame of a scan."""
        self._unswitched |= kind & (FD | RATE_SWITCH) == FD

    @property
    def current(self) -> float:
        """The one that holds [s]."""
        return self.times.unswitched if self._unswitched else self.times.switched
