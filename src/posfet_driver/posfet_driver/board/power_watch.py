# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Resets of a board, and whether its supply was the cause, by its status frames."""

from __future__ import annotations

from typing import Final

from posfet_driver.protocol.messages import Status
from posfet_model._lib.units import NANOSECONDS
from posfet_model.sensor.scan import ScanStatus

LOW_SUPPLY_MEMORY: Final = 2.0
"""Time after a low supply was reported [s] within which a reset counts as a brown-out."""


class PowerWatch:
    """Follows power-ons and supply of a board."""

    def __init__(self) -> None:
        self.brown_outs = 0
        """Resets around which the supply voltage was low."""
        self._boot: int | None = None
        self._low_supply = -round(LOW_SUPPLY_MEMORY * NANOSECONDS)  # time of the newest report

    def was_reset(self, status: Status, now: int) -> bool:
        """Take the status that arrived at `now` [ns]; return whether the board was reset since the one before.

        Parameters
        ----------
        status : Status
            The status.
        now : int
            Monotonic time [ns].
        """
        if status.flags & ScanStatus.SUPPLY_LOW:
            self._low_supply = now
        reset = self._boot is not None and status.boot != self._boot
        self._boot = status.boot
        self.brown_outs += reset and now - self._low_supply < LOW_SUPPLY_MEMORY * NANOSECONDS
        return reset
