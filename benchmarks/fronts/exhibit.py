# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A figure with a table that is no front: errors over one variable, without run times."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from matplotlib.figure import Figure

from benchmarks.fronts.front import SENTENCES, Check, FrontError, sentences
from benchmarks.fronts.palette import Palette
from benchmarks.outcome import Cell, shown


def picture(name: str, title: str, folder: str = "figures") -> str:
    """Return a figure that follows the reader's light or dark page."""
    return (
        f'<picture><source media="(prefers-color-scheme: dark)" srcset="{folder}/{name}_dark.svg">'
        f'<img alt="{title}" src="{folder}/{name}.svg"></picture>'
    )


@dataclass(frozen=True)
class Exhibit:
    """A figure, its table, and the checks that make both trustworthy."""

    name: str
    """File name without suffix."""
    title: str
    reading: str
    columns: tuple[str, ...]
    rows: Sequence[Sequence[Cell]]
    draw: Callable[[Palette], Figure]
    checks: tuple[Check, ...]
    read_back: Callable[[Figure], Sequence[Sequence[Cell]]]
    """Returns from a figure the cells of the table that it shows, row by row: the first ones of each row."""
    answer: tuple[str, ...] = ()
    """Line of the table at the top of the document; empty: none."""

    def verify(self) -> None:
        """Raise FrontError unless all checks pass."""
        wrong = [str(check) for check in self.checks if not check.passed]
        if (found := sentences(self.reading)) not in SENTENCES:
            wrong.append(f"{found} sentences of reading, not {SENTENCES[0]} to {SENTENCES[-1]}")
        if wrong or not self.checks:
            raise FrontError(f"{self.name}: " + ("; ".join(wrong) or "no check"))

    def check_figure(self, figure: Figure) -> None:
        """Raise FrontError where a figure and the table contradict each other."""
        found = self.read_back(figure)
        if len(found) != len(self.rows):
            raise FrontError(f"{self.name}: {len(found)} lines in the figure, {len(self.rows)} rows in the table")
        for read, row in zip(found, self.rows, strict=True):
            cells = [[shown(cell) for cell in part] for part in (read, row[: len(read)])]
            if cells[0] != cells[1]:
                raise FrontError(f"{self.name}: {cells[0]} in the figure, {cells[1]} in the table")

    @property
    def section(self) -> str:
        """The section of the document."""
        lines = [f"| {' | '.join(self.columns)} |", "|---" * len(self.columns) + "|"]
        lines += [f"| {' | '.join(shown(cell) for cell in row)} |" for row in self.rows]
        parts = [
            f"## {self.title}",
            self.reading,
            picture(self.name, self.title),
            "\n".join(lines),
            "Checked in this run: " + "; ".join(map(str, self.checks)) + ".",
        ]
        return "\n\n".join(parts)
