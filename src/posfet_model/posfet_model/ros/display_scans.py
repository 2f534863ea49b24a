# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Which scans are for displays: few, and the same ones on every topic."""

from __future__ import annotations

from posfet_model._lib.units import NANOSECONDS


class DisplayScans:
    """Chooses the first scan of each period of a rate. It goes by stamps, so that all nodes choose the same scans.

    Parameters
    ----------
    rate : float
        Rate [Hz].
    """

    def __init__(self, rate: float) -> None:
        self._number = -1  # of the period of the last scan
        self.period = 0
        """Length of a period [ns]."""
        self.change(rate)

    def change(self, rate: float) -> None:
        """Use another rate [Hz]."""
        self.period = max(round(NANOSECONDS / rate), 1)

    def due(self, stamp: int) -> bool:
        """Return whether a scan is for displays.

        Parameters
        ----------
        stamp : int
            Its stamp [ns].
        """
        number = stamp // self.period
        if number == self._number:
            return False
        self._number = number
        return True
