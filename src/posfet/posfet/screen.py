# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Display snapshots: a live display in a terminal, one line per second elsewhere."""

from __future__ import annotations

import math
import sys
import time
from contextlib import ExitStack
from typing import Any

from rich.console import Console
from rich.live import Live
from rich.text import Text

from posfet.live_display import render
from posfet.snapshot import Record, SnapshotSource, line

DISPLAY_PERIOD = 0.1
"""Period of the live display [s]."""
LINE_PERIOD = 1.0
"""Period of the lines [s]."""
RATE_WINDOW = 10
"""Number of snapshots over which the displayed scan rate is averaged."""
MIN_FULL_SCALE = 0.2
"""Smallest full scale of the colours [N], so that noise stays dark."""


class Screen:
    """Live display or lines; a context manager that restores the terminal."""

    def __init__(
        self, source: SnapshotSource, client: Any = None, link: str = "", console: Console | None = None
    ) -> None:
        self._source = source
        self._console = console or Console()
        self._live: Live | None = None
        self._stack = ExitStack()
        self._next = 0.0
        self._next_line = LINE_PERIOD
        self._rates: list[float] = []
        self._full_scale = MIN_FULL_SCALE
        self.record = Record()

    def __enter__(self) -> Screen:
        if self._console.is_terminal:
            waiting = Text("waiting for the first scan ...")
            self._live = Live(waiting, console=self._console, screen=True, auto_refresh=False)
            self._stack.enter_context(self._live)
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Restore the terminal; may be called twice."""
        self._stack.close()
        self._live = None
        sys.stdout.flush()

    def update(self, now: float | None = None) -> None:
        """Update the display if it is due; `now` is a monotonic time [s]. Cheap to call often."""
        now = time.monotonic() if now is None else now
        if now < self._next:
            return
        self._next = now + DISPLAY_PERIOD
        snapshot = self._source.snapshot()
        if snapshot is None:
            return
        scan_rate = self.record.add(snapshot)
        self._rates = [*self._rates, scan_rate][-RATE_WINDOW:]
        known = [value for value in self._rates if not math.isnan(value)]
        mean_rate = sum(known) / len(known) if known else math.nan
        if self._live:
            self._full_scale = max(self._full_scale, float(max(snapshot.force, default=0.0)))
            self._live.update(render(snapshot, mean_rate, self._full_scale), refresh=True)
        elif self.record.first and self._line_is_due(snapshot.time - self.record.first.time):
            self._console.print(
                line(snapshot, snapshot.time - self.record.first.time, mean_rate), soft_wrap=True, highlight=False
            )

    def _line_is_due(self, elapsed: float) -> bool:
        if elapsed < self._next_line:
            return False
        self._next_line = (math.floor(elapsed / LINE_PERIOD) + 1) * LINE_PERIOD
        return True
