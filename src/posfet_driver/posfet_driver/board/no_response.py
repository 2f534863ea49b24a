# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Diagnosis of a board that does not respond, from the other traffic on the bus."""

from __future__ import annotations

from typing import Final

from posfet_driver.board.faults import FaultKind
from posfet_driver.bus.error_frame import ErrorCounts
from posfet_driver.protocol.decoded import Traffic
from posfet_model._lib.units import NANOSECONDS

REOPEN_FIRST: Final = 1.0
REOPEN_LAST: Final = 5.0
"""Time without a response after which the bus is reopened [s]: doubled from the first to the last."""


class NoResponseMonitor:
    """Compares the traffic since the first unanswered command with the time before.

    Parameters
    ----------
    traffic : Traffic
        Frames that the decoder counts.
    errors : ErrorCounts
        Error frames that the bus counts.
    """

    def __init__(self, traffic: Traffic, errors: ErrorCounts) -> None:
        self._traffic = traffic
        self._errors = errors
        self._reopen_after = REOPEN_FIRST
        self._since = 0
        self._before = self._totals()

    def begin(self, now: int) -> None:
        """Begin to observe at `now` [ns]: a command was sent, or the bus was reopened."""
        self._since = now
        self._before = self._totals()

    def board_responded(self) -> None:
        """Reset the time after which the bus is reopened."""
        self._reopen_after = REOPEN_FIRST

    def cause(self) -> FaultKind:
        """Return the fault that fits the traffic."""
        received, unrelated, errors = (now - before for now, before in zip(self._totals(), self._before, strict=True))
        if received > unrelated:
            return FaultKind.NOT_RESPONDING
        if unrelated:
            return FaultKind.BOARD_NOT_DETECTED
        return FaultKind.BUS_ERRORS if errors else FaultKind.NO_TRAFFIC

    def reopen_due(self, now: int) -> bool:
        """Return whether to reopen the bus at `now` [ns]; the next time it takes twice as long."""
        if now - self._since < self._reopen_after * NANOSECONDS:
            return False
        self._reopen_after = min(2 * self._reopen_after, REOPEN_LAST)
        return True

    def _totals(self) -> tuple[int, int, int]:
        """Return frames received, those of other nodes, and bit and format errors."""
        traffic, errors = self._traffic, self._errors
        return traffic.frames - errors.frames, traffic.unrelated + traffic.commands, errors.bit_errors
