"""Sequence numbers of scans: which boot of the board a scan belongs to, how many are missing, which cannot be."""

from __future__ import annotations

from typing import Final

from posfet_driver.protocol.scan_assembler import ScanStatistics
from posfet_driver.protocol.scan_codec import SEQUENCE

LATE: Final = 64
"""Scans by which a frame may be late [1]; one that is further behind belongs to another boot. Assumed."""
FASTEST: Final = 4.0
"""A sequence that runs this many times faster than all clocks is implausible [1]: the scan period may be unknown."""
SLACK: Final = 16.0
"""Scan periods by which it may run ahead besides [1]."""

_HALF: Final = (SEQUENCE + 1) // 2


class ScanNumbering:
    """Owner of boot and sequence of a board's scans.

    Parameters
    ----------
    statistics : ScanStatistics
        Counts what is late or implausible.
    """

    def __init__(self, statistics: ScanStatistics) -> None:
        self.boot = -1
        """Number of the power-on of the newest scan; -1 before the first."""
        self.sequence = -1
        """Sequence of the scan that was begun last, unwrapped; -1 before the first."""
        self.restarted = False
        """Whether the sequence began again with the newest scan; whoever has used it clears it."""
        self._statistics = statistics
        self._previous = (-1, -1)  # boot and last sequence before the newest restart
        self._open = True  # any sequence is possible
        self._gap_counts = True

    def open(self) -> None:
        """Accept any sequence next: the board was started."""
        self._open = True

    def forget_gap(self) -> None:
        """Count no scan as missing before the next one: the board was stopped on request."""
        self._gap_counts = False

    def missing(self, boot: int, low: int, period: float, elapsed: float) -> int | None:
        """Take the number of another scan, and return how many are missing before it.

        Parameters
        ----------
        boot : int
            Number of the power-on.
        low : int
            Low 32 bits of the sequence.
        period : float
            Scan period [us].
        elapsed : float
            Longest time since the previous scan that any clock shows [us].

        Returns
        -------
        int or None
            Number of missing scans; 0 when the sequence begins again, and -1 when the scan is the newest one.
            None when the scan is late or its number implausible, which is counted.
        """
        ahead = (low - self.sequence) & SEQUENCE
        behind = -ahead & SEQUENCE
        if self.boot != boot:
            previous, last = self._previous
            if boot == previous and (last - low) & SEQUENCE < LATE:
                self._statistics.late += 1
                return None
            return self._restart(boot, low)
        if ahead == 0:
            return -1
        if behind < LATE or (behind < _HALF and not self._open):
            self._statistics.late += 1
            return None
        if self._open and behind < _HALF:
            return self._restart(boot, low)
        if not self._open and ahead * period > FASTEST * elapsed + SLACK * period:
            self._statistics.implausible += 1
            return None
        self.sequence += ahead
        counts, self._gap_counts, self._open = self._gap_counts, True, False
        return ahead - 1 if counts else 0

    def _restart(self, boot: int, low: int) -> int:
        self.restarted = self.boot >= 0
        self._previous = self.boot, self.sequence
        self.boot, self.sequence = boot, low
        self._gap_counts, self._open = True, False
        return 0
