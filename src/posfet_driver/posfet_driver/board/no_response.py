"""Why a board may not answer, from what else is heard."""

from __future__ import annotations

from typing import Final

from posfet_driver.protocol.decoder import Receiver
from posfet_model._lib.units import NANOSECONDS

REOPEN_FIRST: Final = 1.0
REOPEN_LAST: Final = 5.0
"""Time [s] without an answer after which the bus is opened anew: doubled from the first to the last."""


class Silence:
    """What was heard since a board was first asked in vain."""

    def __init__(self, receiver: Receiver) -> None:
        self._receiver = receiver
        self._patience = REOPEN_FIRST
        self._since = 0
        self._before = self._totals()

    def begin(self, now: int) -> None:
        """Begin to listen at `now` [ns]: the board is being asked, or the bus was opened anew."""
        self._since = now
        self._before = self._totals()

    def broken(self) -> None:
        """Take note that the board answered."""
        self._patience = REOPEN_FIRST

    def cause(self) -> str:
        """Return the name of the fault that fits what was heard."""
        heard, foreign, unreadable = (now - then for now, then in zip(self._totals(), self._before, strict=True))
        if heard > foreign:
            return "board deaf"
        if foreign:
            return "board missing"
        return "bus unreadable" if unreadable else "bus silent"

    def too_long(self, now: int) -> bool:
        """Return whether to open the bus anew at `now` [ns]; the next time it takes twice as long."""
        if now - self._since < self._patience * NANOSECONDS:
            return False
        self._patience = min(2 * self._patience, REOPEN_LAST)
        return True

    def _totals(self) -> tuple[int, int, int]:
        """Return frames heard, those of others, and errors of bits and form."""
        traffic, errors = self._receiver.traffic, self._receiver.errors
        return traffic.frames - errors.frames, traffic.foreign, errors.unreadable
