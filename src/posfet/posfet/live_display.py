# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The live display: the force map with a table of contacts."""

from __future__ import annotations

import math

from rich.columns import Columns
from rich.console import Group, RenderableType
from rich.markup import escape
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from posfet.snapshot import Snapshot, position_error

SHADES = " .:-=+*#%@"
"""Characters from no force to full scale, for terminals without colour."""
MAX_NUMBERED_COLUMNS = 10
"""Largest number of columns for which the force of each taxel is printed."""


def render(snapshot: Snapshot, scan_rate: float, full_scale: float) -> RenderableType:
    """Return the display of a snapshot.

    Parameters
    ----------
    snapshot : Snapshot
        What to display.
    scan_rate : float
        Scan rate [Hz].
    full_scale : float
        Force with the brightest colour [N].
    """
    map_title = r"force on each taxel \[mN]" if snapshot.cols <= MAX_NUMBERED_COLUMNS else "force"
    force_map = Panel(_force_map(snapshot, full_scale), title=map_title, expand=False)
    lost = "red" if snapshot.frames_lost or snapshot.scans_lost else "green"
    total = f"{snapshot.total_force:.3f} N" if snapshot.data_valid else "settling"
    head = Text.assemble(
        f"{scan_rate:6.0f} scans/s   total force {total}   ",
        (f"{snapshot.frames_lost} frames lost, {snapshot.scans_lost} scans missing", lost),
    )
    lines: list[RenderableType] = [head, Columns([force_map, _contacts(snapshot)]), Text(snapshot.state, style="dim")]
    if snapshot.uncalibrated:
        lines.insert(1, Text(snapshot.calibration, style="yellow"))
    return Group(*lines)


def _force_map(snapshot: Snapshot, full_scale: float) -> Text:
    """Return the force map, last row first, because y points up."""
    cell = _numbered_cell if snapshot.cols <= MAX_NUMBERED_COLUMNS else _small_cell
    force = snapshot.force.reshape(snapshot.rows, snapshot.cols)
    lines = []
    for row in range(snapshot.rows - 1, -1, -1):
        cells = [
            cell(float(value), _style(float(value), full_scale), _shade(float(value), full_scale))
            for value in force[row]
        ]
        lines += [Text.assemble(*parts) for parts in zip(*cells, strict=True)]
    return Text("\n").join(lines)


def _level(force: float, full_scale: float) -> float:
    return min(max(force / full_scale, 0.0), 1.0)


def _shade(force: float, full_scale: float) -> str:
    return "?" if math.isnan(force) else SHADES[round(_level(force, full_scale) * (len(SHADES) - 1))]


def _style(force: float, full_scale: float) -> str:
    if math.isnan(force):
        return "white on red"
    level = _level(force, full_scale)
    red, green, blue = round(255 * min(1.0, 2 * level)), round(200 * level), round(90 * (1 - level))
    return f"{'black' if level > 0.5 else 'white'} on rgb({red},{green},{blue})"


def _numbered_cell(force: float, style: str, shade: str) -> list[tuple[str, str]]:
    """Return the two lines of a taxel: its force, and a bar with its shade."""
    number = "   ?   " if math.isnan(force) else f"{force * 1e3:5.0f}  "
    return [(number, style), (f" {shade * 5} ", style)]


def _small_cell(force: float, style: str, shade: str) -> list[tuple[str, str]]:
    return [(2 * shade, style)]


def _contacts(snapshot: Snapshot) -> Table:
    table = Table(title="contacts", title_justify="left")
    for heading in ("id", "state", "x [mm]", "y [mm]", "force [N]", "area [mm2]", "age [s]"):
        table.add_column(escape(heading), justify="left" if heading == "state" else "right", min_width=len(heading))
    for contact in snapshot.contacts:
        table.add_row(
            str(contact.id),
            contact.state,
            f"{contact.x * 1e3:+.2f}",
            f"{contact.y * 1e3:+.2f}",
            f"{contact.force:.3f} ± {contact.standard_deviation:.3f}",
            f"{contact.area * 1e6:.1f}",
            f"{contact.age:.1f}",
        )
    errors = [position_error(snapshot, true) for true in snapshot.truth]
    if errors and snapshot.contacts:
        table.caption = f"CoP error against ground truth: {max(errors) * 1e3:.2f} mm max"
    return table
