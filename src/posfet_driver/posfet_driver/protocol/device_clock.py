"""The clock of a board: device time without wraps, and whether the clock is frozen."""

from __future__ import annotations

from typing import Final

from posfet_driver.protocol.clock_sync import ClockSync

FROZEN_READINGS: Final = 3
"""Consecutive readings of the same device time from which on the clock is not used."""


class DeviceClock:
    """Unwraps the device time of a board.

    Parameters
    ----------
    bits : int
        Number of bits of a reading.
    sync : ClockSync
        Mapping of this clock; it is reset when the clock starts again, is frozen, and runs again.
    """

    def __init__(self, bits: int, sync: ClockSync) -> None:
        self.time = 0
        """Newest reading, unwrapped [us]."""
        self.frozen = False
        """Whether the clock stands still while scans go on."""
        self.repeated = 0
        """Readings that repeat the one before; never falls."""
        self._modulus = 1 << bits
        self._sync = sync
        self._in_a_row = 0
        self._known = False

    def reset(self) -> None:
        """Forget the newest reading: the clock has started again."""
        self._known = False
        self._sync.reset()

    @property
    def stalled(self) -> bool:
        """Whether the newest reading repeats the one before."""
        return self._in_a_row > 0

    def between(self, earlier: int, later: int) -> int:
        """Return the time from one reading to another, modulo the range of readings [us]."""
        return (later - earlier) % self._modulus

    def ahead(self, reading: int) -> int:
        """Return how far a reading is ahead of the newest one, modulo the range of readings [us]; 0 if unknown."""
        return (reading - self.time) % self._modulus if self._known else 0

    def elapsed(self, reading: int, expected: float) -> int:
        """Return the time since the newest reading [us].

        Parameters
        ----------
        reading : int
            Device time as sent [us].
        expected : float
            The same by the sequence [us]: it tells how often the clock has wrapped meanwhile.
        """
        elapsed = (reading - self.time) % self._modulus
        if expected > self._modulus // 2:
            elapsed += max(round((expected - elapsed) / self._modulus), 0) * self._modulus
        return elapsed

    def advance(self, reading: int, expected: float) -> None:
        """Take a reading of a later scan.

        Parameters
        ----------
        reading : int
            Device time as sent [us].
        expected : float
            Time since the previous reading by the sequence [us].
        """
        if not self._known:
            self._known = True
            self.time, self._in_a_row = reading, 0
            self._set_frozen(False)
            return
        elapsed = self.elapsed(reading, expected)
        if elapsed == 0:
            self.repeated += 1
            self._in_a_row += 1
            self._set_frozen(self._in_a_row >= FROZEN_READINGS)
            return
        self.time += elapsed
        if self._in_a_row:
            self._in_a_row = 0
            self._set_frozen(False)

    def _set_frozen(self, frozen: bool) -> None:
        if frozen != self.frozen:
            self.frozen = frozen
            self._sync.reset()
