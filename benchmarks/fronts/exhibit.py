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

from benchmarks.fronts.front import Check, FrontError
from benchmarks.outcome import Cell, shown


@dataclass(frozen=True)
class Exhibit:
    """A figure, its table, and the checks that make both trustworthy."""

    name: str
    """File name without suffix."""
    title: str
    reading: str
    columns: tuple[str, ...]
    rows: Sequence[Sequence[Cell]]
    draw: Callable[[], Figure]
    checks: tuple[Check, ...]

    def verify(self) -> None:
        """Raise FrontError unless all checks pass."""
        wrong = [str(check) for check in self.checks if not check.passed]
        if wrong or not self.checks:
            raise FrontError(f"{self.name}: " + ("; ".join(wrong) or "no check"))

    @property
    def section(self) -> str:
        """The section of the document."""
        lines = [f"| {' | '.join(self.columns)} |", "|---" * len(self.columns) + "|"]
        lines += [f"| {' | '.join(shown(cell) for cell in row)} |" for row in self.rows]
        parts = [
            f"## {self.title}",
            self.reading,
            f"![{self.title}](figures/{self.name}.svg)",
            "\n".join(lines),
            "Checked in this run: " + "; ".join(map(str, self.checks)) + ".",
        ]
        return "\n\n".join(parts)
