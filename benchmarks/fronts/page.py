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
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from benchmarks.fronts.chart import plotted
from benchmarks.fronts.exhibit import Exhibit, picture
from benchmarks.fronts.front import Choice, Front, FrontError
from benchmarks.outcome import shown

HEAD = """\
# Run time against error

Which method to use for what, what it costs, and how wrong it is: this stack beside methods that are common elsewhere,
on the same input. The next table is the short answer. Each row leads to a section with figure and measurements.
`make fronts` writes this page; do not edit. It fails where a figure, a table or a check contradicts the measurement."""

HOW_TO_READ = """\
**Reading a figure.** Left is faster, down is more accurate; both axes are logarithmic.

| in a figure | meaning |
|---|---|
| run time | processor time in units of the shipped choice, or of the fastest where no single one is shipped |
| circle | the shipped choice |
| grey staircase | the Pareto set: no other choice is both faster and more accurate |
| joined points | one parameter changes, on the same scene |
| dotted line | below it the reference itself is not known better, and errors are not separated |
| a point far below all others | an error of 0, drawn a decade below the smallest other one |

Run times are medians of interleaved repetitions, so that other load disturbs all choices alike. A choice counts as
faster where the quartiles of the repetitions do not overlap.

**Raw data.** [fronts.json](../benchmarks/results/fronts.json) has every repetition, median, minimum and quartiles;
[fronts.csv](../benchmarks/results/fronts.csv) has one line for each repetition. Times in both are absolute, for the
machine stated below."""


MOST = 1e6
"""Largest ratio of errors that is stated as a number [1]: beyond, the smaller one is rounding."""


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


def figure_name(front: Front | Exhibit) -> str:
    """Return the name of the files of a figure on a light page, without suffix."""
    return front.name if isinstance(front, Exhibit) else f"front_{front.name}"


def check_figure(front: Front | Exhibit, figure: Figure) -> None:
    """Raise FrontError where a figure and the table of the same front contradict each other."""
    if isinstance(front, Exhibit):
        front.check_figure(figure)
        return
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
        front.reading,
        *filter(None, [front.verdict]),
        picture(figure_name(front), f"{front.title}: run time against error"),
        f"Reference: {front.reference} ({exact}, in the unit of the error). Run time: {front.work}.",
        table(front),
        "Checked in this run: " + "; ".join(map(str, front.checks)) + ".",
    ]
    return "\n\n".join(parts)


def document(fronts: Sequence[Front | Exhibit], machine: str, missing: Mapping[str, str], how: str) -> str:
    """Return docs/runtime_accuracy.md."""
    parts = [HEAD, "## What to choose", summary(fronts), HOW_TO_READ, f"Made by {how}. {machine}"]
    parts += [section(front) for front in fronts]
    parts += ["## All stages", glance(fronts)]
    if missing:
        lines = [f"- {name}: {why}" for name, why in missing.items()]
        parts += ["## Not measured", "\n".join(lines)]
    return "\n\n".join(parts) + "\n"


def summary(fronts: Sequence[Front | Exhibit]) -> str:
    """Return the table at the top: question, choice, its error, and what the alternative costs and errs."""
    columns = ("for", "choose", "error", "instead of", "run time of the choice", "error of the alternative")
    lines = [f"| {' | '.join(columns)} |", "|---" * len(columns) + "|"]
    for front in fronts:
        cells = front.answer if isinstance(front, Exhibit) else _answer(front)
        if cells:
            link = re.sub(r"[^a-z0-9 -]", "", front.title.lower()).replace(" ", "-")
            lines.append(f"| {' | '.join((f'[{cells[0]}](#{link})', *cells[1:]))} |")
    note = (
        "Run time: that of the choice in units of the alternative's. Error of the alternative: in units of the "
        "choice's; above 1 the choice is ahead."
    )
    return "\n".join([*_lead(fronts), *lines, "", note])


def _lead(fronts: Sequence[Front | Exhibit]) -> list[str]:
    """Return the sentence above the table: how far the whole pipeline is ahead of the best peer, and at what cost."""
    ahead, cost = [], []
    for front in fronts:
        if isinstance(front, Front) and front.name.startswith("pipeline_") and front.shipped_choice is not None:
            own, rival = front.shipped_choice, next(each for each in front.choices if each.name == front.rival)
            ahead.append(rival.error / own.error)
            cost.append(own.median / rival.median)
    if not ahead:
        return []
    return [
        "Forces and contacts of the whole pipeline: the error of the best other method is "
        f"{shown(min(ahead))} to {shown(max(ahead))} times that of this stack, which takes {shown(min(cost))} to "
        f"{shown(max(cost))} times as long. Stage by stage:",
        "",
    ]


def _answer(front: Front) -> tuple[str, ...]:
    shipped = front.shipped_choice
    if not front.question or shipped is None:
        return ()
    rival = next(choice for choice in front.choices if choice.name == front.rival)
    own, other = front.counted(shipped), front.counted(rival)
    over = f"{shown(other / own)} x" if own > 0 else "both exact" if other == 0 else f"{shown(other)}, choice exact"
    if own > 0 and (other == 0 or other > MOST * own):
        over = "none" if other == 0 else f"> {MOST:g} x"
    return (
        front.question,
        shipped.name,
        f"{_error(front, shipped)}: {front.error_label}",
        rival.name,
        f"{shown(shipped.median / rival.median)} x",
        over,
    )


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
            ("yes" if shipped in front.pareto else "no, the section says why") if shipped else "-",
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
