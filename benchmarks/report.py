"""Tables on the screen and RESULTS.md; every number comes from the run."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from rich.console import Console
from rich.table import Table as RichTable

from benchmarks.outcome import Outcome, Table, shown
from benchmarks.targets import TARGETS

NOTES = Path(__file__).with_name("NOTES.md")
"""Written by hand: what falls short, why, and what was tried."""


def show(outcome: Outcome, console: Console) -> None:
    """Print the tables of one benchmark, then its numbers; why there are none where it was skipped."""
    if outcome.skipped:
        console.print(f"skipped: {outcome.skipped}", style="yellow")
    for table in outcome.tables:
        console.print(printed(table))
    for name, value in outcome.values.items():
        console.print(f"{name:34} {shown(value)}", highlight=False)


def printed(table: Table) -> RichTable:
    """Return a table for the screen."""
    made = RichTable(title=table.title, caption=table.note or None, title_justify="left")
    for number, column in enumerate(table.columns):
        made.add_column(column, justify="right" if number else "left")
    for row in table.rows:
        made.add_row(*(shown(cell) for cell in row))
    return made


def targets_table(outcomes: Mapping[str, Outcome]) -> Table:
    """Return the targets with what was reached; a name that was not measured says so, and why it was skipped."""
    values = {name: value for outcome in outcomes.values() for name, value in outcome.values.items()}
    skipped = {name: f"skipped: {outcome.skipped}" for name, outcome in outcomes.items() if outcome.skipped}
    rows = []
    for target in TARGETS:
        value = values.get(target.name)
        if value is not None:
            verdict = target.verdict(value)
        else:  # names of numbers begin with that of their benchmark where it can be skipped
            verdict = next((why for name, why in skipped.items() if target.name.startswith(name)), "not measured")
        rows.append(
            (target.name, target.what, target.text(0), target.text(1), value if value is not None else "-", verdict)
        )
    return Table("Targets", ("name", "what", "pass", "stretch", "reached", "verdict"), rows)


def markdown(table: Table) -> str:
    """Return a table as Markdown."""
    lines = [f"### {table.title}", "", f"| {' | '.join(table.columns)} |", "|---" * len(table.columns) + "|"]
    lines += [f"| {' | '.join(shown(cell) for cell in row)} |" for row in table.rows]
    if table.note:
        lines += ["", table.note]
    return "\n".join(lines)


def results(
    facts: Mapping[str, str | float], outcomes: Mapping[str, Outcome], failed: Mapping[str, str], full: bool
) -> str:
    """Return RESULTS.md."""
    machine = ", ".join(f"{name.replace('_', ' ')} {shown(value)}" for name, value in facts.items())
    parts = [
        "# Results of the benchmarks",
        f"Written by `make bench{' FULL=1' if full else ''}`; do not edit. One subject: `make bench ONLY=name`, "
        "named in the headings. Numbers by name: `results/latest.json`. Times differ from machine to machine: read "
        "ratios.",
        f"Machine: {machine}.",
        markdown(targets_table(outcomes)).replace("### ", "## "),
        NOTES.read_text(encoding="utf-8").strip(),
    ]
    for name, outcome in outcomes.items():
        parts.append(f"## {name}")
        parts += [f"Skipped: {outcome.skipped}"] if outcome.skipped else []
        parts += [markdown(table) for table in outcome.tables]
        parts += [f"![{chart.title}](results/{chart.name}.svg)" for chart in outcome.charts]
    parts += [f"## {name}\n\nFailed: {reason}" for name, reason in failed.items()]
    return "\n\n".join(parts) + "\n"
