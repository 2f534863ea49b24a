# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The force map as lines of a terminal: cells with numbers, or smaller ones, with axes in mm and the colour scale."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from rich.text import Text

from posfet.colour_scale import colour
from posfet.number_text import fixed, signed
from posfet.snapshot import Snapshot
from posfet_model.reconstruction.taxel_faults import TaxelStatus

SHADES: Final = " .:-=+*#%@"
"""Characters from no force to full scale, for terminals without colour."""
MARGIN: Final = 7
"""Columns left of the map, for y."""
FRAME: Final = 5
"""Lines of the map besides its taxels: title, x, unit, colour scale."""
UNKNOWN: Final = "white on rgb(110,30,60)"
_SATURATED: Final = int(TaxelStatus.SATURATED)
Part = tuple[str, str]
"""Text and style."""


@dataclass(frozen=True)
class Cells:
    """How taxels are drawn."""

    width: int
    """Columns of a taxel."""
    lines: float
    """Lines of a taxel; a half: two rows of taxels share a line."""
    most: int
    """Greatest number of taxels along x."""

    def size(self, rows: int, cols: int) -> tuple[int, int]:
        """Return columns and lines of the map with axes and scale."""
        return MARGIN + self.width * cols, FRAME + math.ceil(self.lines * rows)


NUMBERS: Final = Cells(6, 2, 10)
SQUARES: Final = Cells(2, 1, 128)
HALVES: Final = Cells(1, 0.5, 128)
KINDS: Final = (NUMBERS, SQUARES, HALVES)
"""From the largest to the smallest."""


def fitting(rows: int, cols: int, width: int, height: int, colours: bool = True) -> Cells | None:
    """Return the largest cells with which a map fits into columns and lines; None if none does.

    Parameters
    ----------
    rows, cols : int
        Size of the array.
    width, height : int
        Columns and lines for the map with axes and scale.
    colours : bool, optional
        Whether the terminal has colours, without which two rows cannot share a line.
    """
    for cells in KINDS if colours else KINDS[:2]:
        wide, high = cells.size(rows, cols)
        if cols <= cells.most and wide <= width and high <= height:
            return cells
    return None


def map_lines(snapshot: Snapshot, cells: Cells, full_scale: float, pitch: tuple[float, float] | None) -> list[Text]:
    """Return the lines of the map.

    Parameters
    ----------
    snapshot : Snapshot
        What to draw.
    cells : Cells
        How.
    full_scale : float
        Force with the lightest colour [N].
    pitch : tuple of float, optional
        Distance of the taxels along x and y [m]; None: not known yet, axes without numbers.
    """
    unit = "mN" if cells is NUMBERS else "N"
    width = cells.width * snapshot.cols
    title = f"{'':{MARGIN}}{'force on each taxel' if width > 24 else 'force'} [{unit}]"
    along_y = _labels(snapshot.rows, pitch[1] if pitch else None)
    drawn = {NUMBERS: _numbered, SQUARES: _squares, HALVES: _halves}[cells]
    lines = [Text(title, style="bold"), *drawn(snapshot, full_scale, along_y)]
    lines.append(Text(f"{'':{MARGIN}}{_along_x(snapshot.cols, cells.width, pitch[0] if pitch else None)}", style="dim"))
    lines.append(Text(f"{'y':>{MARGIN - 1}} {'x [mm], y [mm]':^{width}}", style="dim"))
    return [*lines, *_scale(full_scale, width)]


def _labels(count: int, pitch: float | None) -> list[str]:
    """Return the coordinate of each row or column [mm]; texts without one where it is not known."""
    if pitch is None:
        return [""] * count
    return [signed((index - (count - 1) / 2) * pitch * 1e3, 1) for index in range(count)]


def _along_x(count: int, width: int, pitch: float | None) -> str:
    """Return the coordinates below the columns, as many as fit."""
    labels = _labels(count, pitch)
    if width >= 6:
        return "".join(f"{label:^{width}}" for label in labels)
    between = width * count - len(labels[0]) - len(labels[-1])
    return f"{labels[0]}{'':{between}}{labels[-1]}" if between > 0 else ""


def _level(force: float, full_scale: float) -> float:
    return min(max(force / full_scale, 0.0), 1.0)


def _shade(force: float, full_scale: float) -> str:
    return "?" if math.isnan(force) else SHADES[round(_level(force, full_scale) * (len(SHADES) - 1))]


def background(force: float, full_scale: float) -> str:
    """Return the style of a cell."""
    if math.isnan(force):
        return UNKNOWN
    level = _level(force, full_scale)
    red, green, blue = colour(level)
    return f"{'black' if level > 0.55 else 'white'} on rgb({red},{green},{blue})"


def _rows(snapshot: Snapshot) -> list[list[float]]:
    rows: list[list[float]] = snapshot.force.reshape(snapshot.rows, snapshot.cols).tolist()
    return rows


def _line(label: str, parts: Sequence[Part]) -> Text:
    return Text.assemble((f"{label:>{MARGIN - 1}} ", "dim"), *parts)


def _numbered(snapshot: Snapshot, full_scale: float, labels: Sequence[str]) -> list[Text]:
    lines = []
    for row in range(snapshot.rows - 1, -1, -1):  # y points up
        numbers, shades = [], []
        for col, force in enumerate(_rows(snapshot)[row]):
            status = 0 if snapshot.status is None else int(snapshot.status[row * snapshot.cols + col])
            style = background(force, full_scale)
            numbers.append((f"{_number(force, status):>5} ", style))
            shades.append((f" {_shade(force, full_scale) * 4} ", style))
        lines += [_line(labels[row], numbers), _line("", shades)]
    return lines


def _number(force: float, status: int) -> str:
    """Return the force [mN], or why there is none."""
    if math.isnan(force):
        return TaxelStatus(status).name.lower()[:5] if status else "?"
    return ("≥" if status == _SATURATED else "") + fixed(force * 1e3, 0)


def _squares(snapshot: Snapshot, full_scale: float, labels: Sequence[str]) -> list[Text]:
    lines = []
    for row in range(snapshot.rows - 1, -1, -1):
        parts = [(2 * _shade(force, full_scale), background(force, full_scale)) for force in _rows(snapshot)[row]]
        lines.append(_line(_some(labels, row), parts))
    return lines


def _halves(snapshot: Snapshot, full_scale: float, labels: Sequence[str]) -> list[Text]:
    forces = _rows(snapshot)

    def painted(force: float) -> str:
        return background(force, full_scale).split(" on ")[1]

    lines = []
    for row in range(snapshot.rows - 1, 0, -2):
        pairs = zip(forces[row], forces[row - 1], strict=True)
        parts = [("▀", f"{painted(upper)} on {painted(lower)}") for upper, lower in pairs]
        lines.append(_line(_some(labels, row), parts))
    if snapshot.rows % 2:
        lines.append(_line(labels[0], [("▀", painted(force)) for force in forces[0]]))
    return lines


def _some(labels: Sequence[str], row: int) -> str:
    """Return the label of a row if it is one of about five that are shown."""
    return labels[row] if (len(labels) - 1 - row) % (2 * max(len(labels) // 10, 1)) == 0 else ""


def _scale(full_scale: float, width: int) -> list[Text]:
    """Return the colour scale: colours, and forces at its ends."""
    forces = [full_scale * index / max(width - 1, 1) for index in range(width)]
    bar = [(_shade(force, full_scale), background(force, full_scale)) for force in forces]
    text = f"{full_scale:g} N"
    return [_line("", bar), Text(f"{'':{MARGIN}}{'0':<{max(width - len(text), 2)}}{text}", style="dim")]
