# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Power-ons of a board: their numbers, and what each of them has reset."""

from __future__ import annotations

from typing import Final

from posfet_driver.protocol.messages import Status
from posfet_model.sensor.scan import ScanStatus

_BOARD_RESET: Final = int(ScanStatus.BOARD_RESET)  # a flag is ten times as slow as a number
_CHARGE_RESET: Final = int(ScanStatus.CHARGE_RESET)


class PowerOns:
    """Follows the number of the power-on that scans, status and responses of a board state."""

    def __init__(self) -> None:
        self.resets = 0
        """Number of times that the board was reset."""
        self._boot: int | None = None  # newest number
        self._previous: int | None = None  # the one before
        self._scan_boot: int | None = None  # of the newest scan
        self._status: Status | None = None  # the newest one
        self._charge_reset = False  # the first status says so, of a board that an earlier driver may have received

    def note(self, boot: int) -> bool:
        """Note the number that a message or a scan states.

        Parameters
        ----------
        boot : int
            Number of the power-on, modulo 16.

        Returns
        -------
        bool
            Whether the board was reset since the one before.
        """
        if boot == self._boot:
            return False
        self._previous, self._boot = self._boot, boot
        if self._previous is None:
            return False
        self.resets += 1
        return True

    def note_status(self, status: Status) -> bool:
        """Note the number and the charge that a status states; return whether the board was reset before it."""
        self._charge_reset |= self._status is None and status.charge_reset
        self._status = status
        return self.note(status.boot)

    def is_over(self, boot: int) -> bool:
        """Return whether what states a number is late: the board was reset since."""
        return boot == self._previous

    def flags(self, boot: int, restarted: bool) -> int:
        """Return the bits of ScanStatus that say what was reset before the next scan.

        Parameters
        ----------
        boot : int
            Number of the power-on that the scan states.
        restarted : bool
            Whether the sequence began again with it.
        """
        flags = 0
        if restarted:
            flags = _BOARD_RESET if self._keeps_charge(boot) else _BOARD_RESET | _CHARGE_RESET
            self.resets += boot == self._scan_boot  # else the new number tells
        if self._charge_reset:
            self._charge_reset = False
            flags |= _CHARGE_RESET
        if boot != self._scan_boot:
            self._scan_boot = boot
            self.note(boot)
        return flags

    def _keeps_charge(self, boot: int) -> bool:
        """Return whether the board, since its newest power-on, has said that charges continue those from before."""
        status = self._status
        return status is not None and status.boot == boot and not status.charge_reset
