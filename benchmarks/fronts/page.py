# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""docs/runtime_accuracy.md and the results as JSON and CSV, all from the fronts of one run."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from benchmarks.fronts.chart import plotted
from benchmarks.fronts.exhibit import Exhibit
from benchmarks.fronts.front import Choice, Front, FrontError
from benchmarks.outcome import shown

HEAD = """\
# Run time against error

What each method costs and how wrong it is, on the same input, for every stage of this stack and for the whole pipeline
beside methods that are common elsewhere. Written by `make fronts`, which fails where a figure, a table or a sentence
contradicts the measurement; do not edit.

**Reading a figure.** Left is faster, down is more accurate, both axes are logarithmic. Run times are processor times
in units of the shipped choice (the circled point), or of the fastest where a stage has no single shipped choice:
medians of interleaved repetitions, so that other load disturbs all choices alike. The grey staircase is the Pareto set:
no other choice is both faster and more accurate. Points of a series are joined only where one parameter changes on the
same scene. Below the dotted line the reference itself is not known better, and errors are not separated. A choice
counts as faster where the quartiles of the repetitions do not overlap.

**Raw data.** [fronts.json](../benchmarks/results/fronts.json) has every repetition, median, minimum and quartiles,
[fronts.csv](../benchmarks/results/fronts.csv) one line for each repetition; times in both are absolute, for the machine
stated below."""


def table(front: Front) -> str:
    """Return a front as a Markdown table, fastest first."""
    columns = ("method", "parameter", "run time", front.error_label, *front.columns, "")
    lines = [f"| {' | '.join(columns)} |", "|---" * len(columns) + "|"]
    for choice in sorted(front.choices, key=lambda each: each.median):
        marks = ["**shipped**"] * (choice is front.shipped_choice) + ["Pareto"] * (choice in front.pareto)
        cells = (choice.series, choice.parameter, shown(front.ratio(choice)), _error(front, choice))
        lines.append(f"| {' | '.join((*cells, *(_more(each) for each in choice.more), ', '.join(marks)))} |")
    return "\n".join(lines)


def _error(front: Front, choice: Choice) -> str:
    return f"< {shown(front.uncertainty)}" if choice.error < front.uncertainty else shown(choice.error)


def _more(value: float) -> str:
    return "-" if math.isnan(value) else shown(value)


def check_figure(front: Front, figure: Figure) -> None:
    """Raise FrontError where a figure and the table of the same front contradict each other."""
    points = plotted(figure)
    listed: dict[str, list[tuple[float, str]]] = {}
    for line in table(front).splitlines()[2:]:
        series, _, ratio, error = (cell.strip() for cell in line.strip("|").split("|")[:4])
        listed.setdefault(series, []).append((float(ratio), error.removeprefix("< ")))
    if points.keys() != listed.keys():
        raise FrontError(f"{front.name}: the figure has the series {sorted(points)}, the table {sorted(listed)}")
    for series, rows in listed.items():
        drawn = sorted(points[series])
        if len(drawn) != len(rows):
            raise FrontError(f"{front.name}, {series}: {len(drawn)} points drawn, {len(rows)} rows listed")
        for (x, y), (ratio, error) in zip(drawn, sorted(rows, key=lambda row: row[0]), strict=True):
            same_time = abs(x - ratio) <= 0.006 * ratio
            same_error = float(error) == 0.0 or any(
                abs(other - float(error)) <= 0.006 * float(error)
                for other in [y, *(b for a, b in drawn if abs(a - x) <= 0.006 * x)]
            )
            if not (same_time and same_error):
                raise FrontError(
                    f"{front.name}, {series}: ({x:g}, {y:g}) in the figure, ({ratio:g}, {error}) in the table"
                )


def section(front: Front | Exhibit) -> str:
    """Return the section of a front or an exhibit."""
    if isinstance(front, Exhibit):
        return front.section
    exact = "exact" if front.uncertainty == 0 else f"known to {shown(front.uncertainty)}"
    parts = [
        f"## {front.title}",
        " ".join(filter(None, (front.reading, front.verdict))),
        f"![{front.title}: run time against error](figures/front_{front.name}.svg)",
        f"Reference: {front.reference} ({exact}, in the unit of the error). Run time: {front.work}.",
        table(front),
        "Checked in this run: " + "; ".join(map(str, front.checks)) + ".",
    ]
    return "\n\n".join(parts)


def document(fronts: Sequence[Front | Exhibit], machine: str, missing: Mapping[str, str], how: str) -> str:
    """Return docs/runtime_accuracy.md."""
    parts = [HEAD, f"Made by {how}. {machine}"]
    parts += ["## At a glance", glance(fronts)]
    parts += [section(front) for front in fronts]
    if missing:
        lines = [f"- {name}: {why}" for name, why in missing.items()]
        parts += ["## Not measured", "\n".join(lines)]
    return "\n\n".join(parts) + "\n"


def command(short: bool, repeats: int) -> str:
    """Return how the document was made, in the words of `document`."""
    if not short:
        return f"`make fronts`, {repeats} repetitions"
    return (
        "`make fronts ARGS=--short`: brief scenes on boards that are not calibrated, few repetitions and choices. The "
        "numbers show that everything works; for numbers to rely on, run `make fronts`"
    )


def glance(fronts: Sequence[Front | Exhibit]) -> str:
    """Return one line for each front: what is shipped, and the extremes of the Pareto set."""
    lines = ["| stage | shipped | error | on the Pareto set | fastest there | most accurate there |", "|---" * 6 + "|"]
    for front in fronts:
        if isinstance(front, Exhibit):
            continue
        shipped = front.shipped_choice
        first, last = front.pareto[0], front.pareto[-1]
        cells = (
            front.title,
            shipped.name if shipped else "several uses",
            f"{_error(front, shipped)} ({front.error_label})" if shipped else "-",
            ("yes" if shipped in front.pareto else "no, see there") if shipped else "-",
            _extreme(front, first),
            _extreme(front, last),
        )
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _extreme(front: Front, choice: Choice) -> str:
    if choice is front.shipped_choice:
        return "the shipped one"
    return f"{choice.name}: run time {shown(front.ratio(choice))}, error {_error(front, choice)}"


def write_results(fronts: Sequence[Front | Exhibit], facts: Mapping[str, Any], folder: Path) -> None:
    """Write fronts.json and fronts.csv."""
    folder.mkdir(parents=True, exist_ok=True)
    measured = [front for front in fronts if isinstance(front, Front)]
    exhibits = [{"name": each.name, "rows": each.rows} for each in fronts if isinstance(each, Exhibit)]
    data = {"machine": dict(facts), "fronts": [_described(front) for front in measured], "exhibits": exhibits}
    (folder / "fronts.json").write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
    with (folder / "fronts.csv").open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["front", "series", "parameter", "error", "error_unit", "repetition", "seconds"])
        for front in measured:
            for choice in front.choices:
                for number, seconds in enumerate(choice.seconds):
                    row = (front.name, choice.series, choice.parameter, f"{choice.error:.6g}", front.error_label)
                    writer.writerow([*row, number, f"{seconds:.6g}"])


def _described(front: Front) -> dict[str, Any]:
    choices = []
    for choice in front.choices:
        low, high = choice.quartiles
        figures = {
            "median": choice.median, "minimum": min(choice.seconds), "first_quartile": low, "third_quartile": high,
            "pareto": choice in front.pareto, "shipped": choice is front.shipped_choice,
            "more": {key: _finite(value) for key, value in zip(front.columns, choice.more, strict=True)},
        }  # fmt: skip
        kept = {name: value for name, value in asdict(choice).items() if name != "more"}
        choices.append(kept | figures)
    kept = {name: getattr(front, name) for name in ("name", "title", "work", "error_label", "reference", "uncertainty")}
    checks = [asdict(check) | {"low": _finite(check.low), "high": _finite(check.high)} for check in front.checks]
    return kept | {"checks": checks, "choices": choices}


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
