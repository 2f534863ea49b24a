# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Clocks for tests: one advanced by the test, and one that waits for every thread that reads it."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

STUCK = 120.0
"""Maximum time that the clock stands still [s]: after that a thread no longer reads it, and the test fails."""
POLL = 0.005
"""Longest wait of a thread that takes part [s]; the clock waits for it."""
EPOCH = 1_700_000_000_000_000_000
"""Wall time at clock time 0 [ns]."""


class SteppedClock:
    """Clock for one thread: time advances only in `sleep` and when a test adds to `now`; records the pauses."""

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
    """Clock for several threads: time advances normally, but stands still while any thread that reads it is behind.

    So a board never gets ahead of its reader, nor the time-outs of a reader ahead of its board, however long the
    machine delays one of them: such a test only takes longer. A thread takes part from its first reading of the clock
    until it ends; the main thread only with `main`, or within `taking_part`. A thread
    that takes part reads the clock every POLL or so.
    """

    def __init__(self, main: bool = True, lead: float = 0.005) -> None:
        """Limit the time to `lead` [s] ahead of the last reading of the slowest thread.

        What is sent in that time must be less than one read of the reader: 4 KiB on a terminal.
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
        """Advance by `seconds` [s] at once, as if all threads had been delayed."""
        with self._lock:
            self._now += round(seconds * 1e9)

    @contextmanager
    def taking_part(self) -> Iterator[None]:
        """Make the clock wait for the main thread as well, which then has to read the clock."""
        before, self._main = self._main, True
        try:
            self.monotonic()
            yield
        finally:
            self._main = before
            with self._lock:
                self._seen.pop(threading.main_thread(), None)
