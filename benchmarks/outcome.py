# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Result of a benchmark: named values, tables, and points of charts."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

Cell = str | int | float
Point = tuple[float, float, str]
"""x, y, and the label of the point."""


@dataclass(frozen=True)
class Table:
    """A table with its heading; numbers are printed with three significant digits."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    note: str = ""


@dataclass(frozen=True)
class Chart:
    """Points of several series on two logarithmic axes."""

    name: str
    """File name without suffix."""
    title: str
    x_label: str
    y_label: str
    series: dict[str, list[Point]]


@dataclass
class Outcome:
    """All results of one benchmark."""

    values: dict[str, float] = field(default_factory=dict)
    tables: list[Table] = field(default_factory=list)
    charts: list[Chart] = field(default_factory=list)
    skipped: str = ""
    """Why nothing was measured, and what to install; empty after a measurement."""

    def write(self, path: Path) -> None:
        """Write to a JSON file."""
        path.write_text(json.dumps(asdict(self)), encoding="utf-8")

    @classmethod
    def read(cls, path: Path) -> Outcome:
        """Read a file written by `write`."""
        data = json.loads(path.read_text(encoding="utf-8"))
        tables = [Table(**table) for table in data["tables"]]
        charts = [Chart(**chart) for chart in data["charts"]]
        return cls(data["values"], tables, charts, data["skipped"])


def shown(cell: Cell) -> str:
    """Return a cell as text: integers unchanged, other numbers with three significant digits."""
    if isinstance(cell, str):
        return cell
    if isinstance(cell, int) or abs(cell) >= 1000:
        return f"{cell:.0f}"
    return f"{cell:.3g}"
