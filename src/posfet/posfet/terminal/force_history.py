# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The total force of the last seconds as a bar chart of characters."""

from __future__ import annotations

import math
from collections import deque
from typing import Final

from posfet.colour_scale import nice_scale

SPAN: Final = 30.0
"""Time that is shown [s]."""
LINES: Final = 3
_EIGHTHS: Final = " ▁▂▃▄▅▆▇█"
LEAST_SCALE: Final = 0.2
"""Smallest full scale [N], so that noise stays low."""


class ForceHistory:
    """Total forces of the last `SPAN` seconds; unknown ones stay unknown."""

    def __init__(self) -> None:
        self._points: deque[tuple[float, float]] = deque()

    def add(self, time: float, force: float) -> None:
        """Add a force [N] at a monotonic time [s]; NaN: unknown."""
        self._points.append((time, force))
        while self._points[0][0] <= time - SPAN:
            self._points.popleft()

    @property
    def full_scale(self) -> float:
        """Force of the highest bar [N]."""
        return nice_scale(max([LEAST_SCALE, *(force for _, force in self._points if not math.isnan(force))]))

    def bars(self, width: int) -> list[str]:
        """Return the chart, the newest force at its right end: the largest force of each column, ``?`` if unknown.

        Parameters
        ----------
        width : int
            Number of columns.
        """
        columns: list[list[float]] = [[] for _ in range(width)]
        now = self._points[-1][0] if self._points else 0.0
        for time, force in self._points:
            columns[width - 1 - min(int((now - time) / SPAN * width), width - 1)].append(force)
        chart = [self._column(column) for column in columns]
        return ["".join(column[LINES - 1 - line] for column in chart) for line in range(LINES)]

    def _column(self, forces: list[float]) -> str:
        """Return the characters of a column from the bottom up."""
        known = [force for force in forces if not math.isnan(force)]
        if not known:
            return ("?" if forces else " ") + " " * (LINES - 1)
        eighths = round(min(max(max(known) / self.full_scale, 0.0), 1.0) * 8 * LINES)
        return "".join(_EIGHTHS[min(max(eighths - 8 * line, 0), 8)] for line in range(LINES))
