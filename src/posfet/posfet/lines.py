# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Display snapshots without a terminal: one line per second."""

from __future__ import annotations

import math
import os
import sys
import time
from types import TracebackType
from typing import Final, TextIO

from posfet.snapshot import Record, Snapshot, SnapshotSource, line
from posfet_model.config import ConfigError

PERIOD: Final = 0.1
"""Period at which snapshots are taken [s]."""
LINE_PERIOD: Final = 1.0
"""Period of the lines [s]."""
RATE_WINDOW: Final = 10
"""Number of snapshots over which the displayed scan rate is averaged."""


class Lines:
    """One line per second; a context manager. `posfet.terminal.screen.Screen` is the same as a live display.

    Parameters
    ----------
    source : SnapshotSource
        Source of the snapshots.
    stream : TextIO, optional
        Where to; default: standard output.
    outlived : bool, optional
        Whether the process goes on when its output cannot be written: it then prints nothing more.
    """

    def __init__(self, source: SnapshotSource, stream: TextIO | None = None, outlived: bool = False) -> None:
        self._source, self._stream, self._outlived = source, stream, outlived
        self.problem = ""
        """Why nothing more is printed, in one line; '' while the output can be written."""
        self._next = 0.0
        self._next_line = LINE_PERIOD
        self._rates: list[float] = []
        self._newest = ((-1, -1), 0.0)  # sequence and number of the newest scan, and when it was seen [s]
        self._interval = 0.0  # between the two newest scans that were seen [s]: long on a slow board
        self.quit = False
        """Whether the user wants to quit."""
        self.record = Record()

    def __enter__(self) -> Lines:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> None:
        self.close()

    def waits(self, text: str) -> None:
        """Say, once, what is waited for, in one line."""
        print(f"posfet: {text}", file=sys.stderr, flush=True)

    def close(self) -> None:
        """End the display; may be called twice."""
        self.print("", end="")

    def print(self, text: str, end: str = "\n") -> None:
        """Print a text; ConfigError, one line, or BrokenPipeError if that fails and the process is to end with it."""
        stream = self._stream or sys.stdout
        try:
            print(text, end=end, file=stream, flush=True)
        except OSError as error:  # a full disk, or a reader that has ended
            self.problem = f"the output cannot be written: {error.strerror}"
            with open(os.devnull, "wb") as nowhere:  # what the stream still holds would fail again at the end
                os.dup2(nowhere.fileno(), stream.fileno())
            if not self._outlived:
                raise error if isinstance(error, BrokenPipeError) else ConfigError(self.problem) from error

    def update(self, now: float | None = None) -> None:
        """Update the display if it is due; `now` is a monotonic time [s]. Cheap to call often."""
        now = time.monotonic() if now is None else now
        if now < self._next:
            return
        self._next = now + PERIOD
        self._react()
        snapshot = self._source.snapshot()
        if snapshot is None:
            self._wait()
            return
        scan_rate = self.record.add(snapshot)
        self._rates = [*self._rates, scan_rate][-RATE_WINDOW:]
        known = [value for value in self._rates if not math.isnan(value)]
        if (snapshot.sequence, snapshot.scans) != self._newest[0]:
            self._interval = snapshot.time - self._newest[1] if self._newest[1] else 0.0
            self._newest = (snapshot.sequence, snapshot.scans), snapshot.time
        self._show(snapshot, sum(known) / len(known) if known else math.nan)

    def _age(self, snapshot: Snapshot) -> float:
        """Return the time since the scan of the newest snapshot was new [s]; 0 while the next one is not overdue."""
        age = snapshot.time - self._newest[1]
        return age if age > 2 * self._interval else 0.0

    def _react(self) -> None:
        """Do what the user asks for."""

    def _wait(self) -> None:
        """Show that no scan has arrived yet."""

    def _show(self, snapshot: Snapshot, scan_rate: float) -> None:
        """Show a snapshot and the mean scan rate [Hz]."""
        elapsed = snapshot.time - self.record.first.time if self.record.first else 0.0
        if elapsed >= self._next_line:
            self._next_line = (math.floor(elapsed / LINE_PERIOD) + 1) * LINE_PERIOD
            self.print(line(snapshot, elapsed, scan_rate, self._age(snapshot)))
