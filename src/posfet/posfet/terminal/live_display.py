# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The live display in a terminal: force map, contacts and history in a layout that depends on sizes alone."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from rich.console import Group
from rich.text import Text

from posfet.number_text import counted, fixed, signed
from posfet.snapshot import ContactView, Snapshot, old_text, position_errors
from posfet.terminal.force_history import SPAN, ForceHistory
from posfet.terminal.force_map import KINDS, fitting, map_lines

CONTACTS = 6
"""Contacts that are listed; of more, the number is shown."""
NARROW, WIDE = 41, 56
"""Columns of the list of contacts without and with area and age."""
BESIDE = CONTACTS + 10
"""Lines beside the map: total, contacts, history."""
AROUND = 5
"""Lines above and below the map."""


@dataclass(frozen=True)
class Shown:
    """What is displayed."""

    snapshot: Snapshot
    scan_rate: float
    """[Hz]."""
    full_scale: float
    """Force with the lightest colour [N]."""
    history: ForceHistory = field(default_factory=ForceHistory)
    """Total force of the last seconds."""
    pitch: tuple[float, float] | None = None
    """Distance of the taxels along x and y [m]; None: not known yet."""
    name: str = ""
    """Namespace of the sensor."""
    age: float = 0.0
    """Time since the newest scan [s]."""
    advice: str = ""
    """What the model says about its state, with what to do."""
    message: str = ""
    """Answer to a key, or the newest line of the log."""
    paused: bool = False
    """Whether map and contacts are frozen."""
    keys: str = ""
    """Hints about keys."""
    link: str = ""
    """Link to the browser view."""


def render(shown: Shown, width: int, height: int, colours: bool = True) -> Group:
    """Return the display for a terminal.

    Parameters
    ----------
    shown : Shown
        What to display.
    width, height : int
        Columns and lines of the terminal.
    colours : bool, optional
        Whether it has colours.
    """
    snapshot = shown.snapshot
    cells, with_more = (
        fitting(snapshot.rows, snapshot.cols, width - panel - 2, height - AROUND, colours) for panel in (NARROW, WIDE)
    )
    panel = WIDE if cells is with_more else NARROW  # a larger map first, then area and age
    if cells is None or height < AROUND + BESIDE:
        lines = _small(shown, width, height, colours)
    else:
        picture = map_lines(snapshot, cells, shown.full_scale, shown.pitch)
        columns = cells.size(snapshot.rows, snapshot.cols)[0]
        beside = _beside(shown, panel)
        lines = [*_head(shown, width), Text("")]
        for index in range(max(len(picture), len(beside))):
            line = picture[index].copy() if index < len(picture) else Text("")
            line.pad_right(columns + 2 - line.cell_len)
            lines.append(line + beside[index] if index < len(beside) else line)
        lines += _foot(shown)
    for line in lines:
        line.no_wrap, line.overflow = True, "crop"
        line.truncate(width, overflow="ellipsis")
    return Group(*lines[:height])


def _head(shown: Shown, width: int) -> list[Text]:
    """Return two lines: state and losses; what is wrong. Where they do not fit, name and rate give way to losses."""
    snapshot = shown.snapshot
    state, style = ("forces valid", "green") if snapshot.data_valid else ("forces unknown", "yellow")
    lost = bool(snapshot.frames_lost or snapshot.scans_lost)
    frames, scans = counted(snapshot.frames_lost, "frame"), counted(snapshot.scans_lost, "scan")
    losses = (f"{frames} lost, {scans} missing", "yellow" if lost else "dim")
    name, rate = f"{shown.name}  " if shown.name else "", f"{fixed(shown.scan_rate, 0):>5} scans/s  "
    valid = (f"{state:14}  ", style)
    texts = (
        Text.assemble((name, "bold"), valid, rate, losses),
        Text.assemble(valid, rate, losses),
        Text.assemble((f"{state}  ", style), losses if lost else rate),
    )
    return [next((text for text in texts if text.cell_len <= width), texts[-1]), _trouble(shown)]


def _trouble(shown: Shown) -> Text:
    """Return the most important thing to know, '' if there is none."""
    if shown.paused:
        return Text("paused: map and contacts are frozen, the stack goes on", style="bold yellow")
    if old := old_text(shown.snapshot, shown.age):
        return Text(old, style="bold red")
    if not shown.snapshot.data_valid:
        return Text(shown.advice or "forces unknown: leave the sensor untouched for a moment", style="yellow")
    return Text(shown.snapshot.calibration if shown.snapshot.uncalibrated else "", style="yellow")


def _total(snapshot: Snapshot) -> str:
    if not snapshot.data_valid or math.isnan(snapshot.total_force):
        return "unknown"
    deviation = snapshot.total_standard_deviation
    known = "" if math.isnan(deviation) else f" ± {fixed(deviation, 3)}"
    return f"{fixed(snapshot.total_force, 3)}{known} N"


def _beside(shown: Shown, width: int) -> list[Text]:
    """Return the lines beside the map, always as many."""
    snapshot = shown.snapshot
    wide = width >= WIDE
    heading = f"{'id':>5} {'state':8} {'x [mm]':>6} {'y [mm]':>6} {'force [N]':12}"
    lines = [
        Text.assemble(("total force  ", "dim"), (_total(snapshot), "bold")),
        Text(""),
        Text("contacts", style="bold"),
        Text(heading + (f" {'[mm²]':>6} {'age [s]':>7}" if wide else ""), style="dim"),
    ]
    rows = [Text(_contact(contact, wide)) for contact in snapshot.contacts[:CONTACTS]]
    if not rows:
        rows = [Text("  no contact" if snapshot.data_valid else "  unknown until forces are valid", style="dim")]
    lines += rows + [Text("")] * (CONTACTS - len(rows))
    more = len(snapshot.contacts) - CONTACTS
    errors = position_errors(snapshot)
    off = f"CoP error against truth: {max(errors) * 1e3:.2f} mm max" if errors and snapshot.contacts else ""
    lines.append(Text(f"and {more} more" if more > 0 else off, style="dim"))
    top, columns = f"{shown.history.full_scale:g} N", width - 8
    labels = [top, "", "0"]
    bars = shown.history.bars(columns)
    lines += [Text.assemble((f"{label:>6} ", "dim"), (bar, "cyan")) for label, bar in zip(labels, bars, strict=True)]
    ago = f"−{SPAN:.0f} s"
    lines.append(Text(f"{'':7}{ago}{'total force':^{columns - len(ago) - 3}}now", style="dim"))
    return lines


def _contact(contact: ContactView, wide: bool) -> str:
    place = f"{signed(contact.x * 1e3, 2):>6} {signed(contact.y * 1e3, 2):>6}"
    force = f"{fixed(contact.force, 3):>6}±{fixed(contact.standard_deviation, 3):<5}"
    text = f"{'#' + str(contact.id):>5} {contact.state:8} {place} {force}"
    return text + (f" {fixed(contact.area * 1e6, 1):>6} {fixed(contact.age, 1):>7}" if wide else "")


def _foot(shown: Shown) -> list[Text]:
    """Return two lines: state or answer; keys and link."""
    keys = "  ".join(filter(None, (shown.keys, shown.link)))
    return [Text(shown.message or shown.snapshot.state, style="dim"), Text(keys, style="dim")]


def _small(shown: Shown, width: int, height: int, colours: bool) -> list[Text]:
    """Return the smaller view, and a word on what a larger terminal shows."""
    snapshot = shown.snapshot
    listed = [Text(_contact(contact, False).strip()) for contact in snapshot.contacts]
    head = [*_head(shown, width), Text(f"total force {_total(snapshot)}", style="bold")]
    columns, lines = _needed(snapshot, colours)
    foot = [Text(f"small terminal: {columns} × {lines} or more shows it all", style="dim"), _foot(shown)[1]]
    cells = fitting(snapshot.rows, snapshot.cols, width, height - len(head) - len(foot) - 2, colours)
    picture = map_lines(snapshot, cells, shown.full_scale, shown.pitch) if cells else []
    room = max(height - len(head) - len(foot) - len(picture), 0)
    if len(listed) > room:
        listed = [*listed[: max(room - 1, 0)], Text(f"and {len(listed) - max(room - 1, 0)} more")][:room]
    return [*head, *picture, *listed, *foot]


def _needed(snapshot: Snapshot, colours: bool) -> tuple[int, int]:
    """Return columns and lines of the smallest terminal with the whole display."""
    sizes = [cells.size(snapshot.rows, snapshot.cols) for cells in (KINDS if colours else KINDS[:2])]
    width, height = min(sizes)
    return width + 2 + NARROW, AROUND + max(height, BESIDE)
