"""Clocks of the tests: time that is moved by hand, and time that waits for every thread that reads it."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

STUCK = 120.0
"""Time stands still for no longer than this [s]: then a thread has stopped looking at it, and the test fails."""
POLL = 0.005
"""Longest wait of a thread that takes part [s]: time waits for it meanwhile."""
EPOCH = 1_700_000_000_000_000_000
"""Wall time of a clock's zero [ns]."""


class SteppedClock:
    """For one thread: time passes only in `sleep` and where a test adds to `now`; notes the pauses."""

    def __init__(self, now: int = 0, epoch: int = 0) -> None:
        self.now = now
        self.sleeps: list[float] = []
        self._epoch = epoch

    def monotonic(self) -> int:
        return self.now

    def wall(self) -> int:
        return self._epoch + self.now

    def sleep(self, seconds: float) -> None:
        self.sleeps.append(seconds)
        self.now += round(seconds * 1e9)


class PacedClock:
    """For several threads: time passes as usual, but stands still while any thread that reads this clock is behind.

    So a board never runs away from its reader, nor a reader's time-outs from its board, however long the machine holds
    one of them up: such a test takes longer, and nothing else. A thread takes part from its first look at the clock
    until it ends; the main thread only with `main`, or within `taking_part`. Whoever takes part looks every POLL or so.
    """

    def __init__(self, main: bool = True, lead: float = 0.005) -> None:
        """Let time be at most `lead` [s] ahead of what the slowest thread has seen.

        What comes in that time has to be less than a reader takes at one look: 4 KiB on a terminal.
        """
        self._lead = round(lead * 1e9)
        self._lock = threading.Lock()
        self._seen: dict[threading.Thread, int] = {}
        self._main = main
        self._now = 1_000_000_000
        self._looked = self._moved = time.monotonic_ns()

    def monotonic(self) -> int:
        thread = threading.current_thread()
        with self._lock:
            looked = time.monotonic_ns()
            passed, self._looked = looked - self._looked, looked
            others = [seen for other, seen in self._seen.items() if other is not thread and other.is_alive()]
            now = max(self._now, min([self._now + passed, *(seen + self._lead for seen in others)]))
            self._moved = looked if now > self._now else self._moved
            assert looked - self._moved < STUCK * 1e9, f"time stands still for {[thread.name for thread in self._seen]}"
            self._now = now
            if self._main or thread is not threading.main_thread():
                self._seen[thread] = self._now
            return self._now

    def wall(self) -> int:
        return EPOCH + self.monotonic()

    def sleep(self, seconds: float) -> None:
        end = self.monotonic() + round(seconds * 1e9)
        while (left := end - self.monotonic()) > 0:
            time.sleep(min(left / 1e9, 1e-3))

    def jump(self, seconds: float) -> None:
        """Let `seconds` [s] pass at once, as for threads that were all held up."""
        with self._lock:
            self._now += round(seconds * 1e9)

    @contextmanager
    def taking_part(self) -> Iterator[None]:
        """Have time wait for the main thread, too, which then has to look at the clock."""
        before, self._main = self._main, True
        try:
            self.monotonic()
            yield
        finally:
            self._main = before
            with self._lock:
                self._seen.pop(threading.main_thread(), None)
