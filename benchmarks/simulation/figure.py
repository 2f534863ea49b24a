# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Draw the figure of docs/simulation.md from stored measurements: `python -m benchmarks.simulation.figure`.

The only module of this package that needs matplotlib.
"""

from __future__ import annotations

import argparse
import csv
import sys
from collections import defaultdict
from pathlib import Path
from typing import Final

from matplotlib.figure import Figure

from posfet_model.figures.style import (
    BLACK,
    BLUE,
    DASH_DOT,
    DASHED,
    DOTTED,
    GREEN,
    GREY,
    PURPLE,
    SOLID,
    VERMILION,
    label,
    new_figure,
    save,
)

NAME: Final = "simulation_schemes"
TARGET: Final = 0.1
"""Maximum error of the simulation [% of full scale]."""

LOOKS: Final = {
    "first-order hold": (BLUE, SOLID, "o"),
    "trapezoidal rule": (GREEN, DASHED, "s"),
    "zero-order hold": (VERMILION, SOLID, "^"),
    "forward Euler": (PURPLE, DOTTED, "v"),
    "backward Euler": (BLACK, DASH_DOT, "x"),
    "whole board": (GREY, DASHED, "D"),
}
"""Colour, dashes and marker of each scheme."""

Points = list[tuple[float, float, float]]


def read(path: Path) -> dict[tuple[str, str], Points]:
    """Return step [s], run time for a second [s] and error [%] by scheme and float width."""
    points: dict[tuple[str, str], Points] = defaultdict(list)
    with path.open(encoding="ascii", newline="") as stream:
        for row in csv.DictReader(stream):
            values = float(row["step_s"]), float(row["run_time_per_second_s"]), float(row["error_percent"])
            points[row["scheme"], row["width"]].append(values)
    return dict(points)


def draw(points: dict[tuple[str, str], Points]) -> Figure:
    """Return run time against error, one panel for each float width, a point for each step."""
    widths = sorted({width for _, width in points}, reverse=True)
    figure, panels = new_figure(3.6, 1, len(widths))
    for axes, width in zip(panels, widths, strict=True):
        for (scheme, series_width), values in points.items():
            if series_width == width:
                colour, dashes, marker = LOOKS[scheme]
                axes.loglog(
                    [error for _, _, error in values],
                    [1e3 * cost for _, cost, _ in values],
                    color=colour, linestyle=dashes, marker=marker, markersize=4, label=scheme,
                )  # fmt: skip
        for step, cost, error in points["first-order hold", width]:
            axes.annotate(
                f"{step * 1e3:g} ms", (error, 1e3 * cost), xytext=(5, 3), textcoords="offset points", fontsize=7
            )
        axes.axvline(TARGET, color="#8a8a8a", linewidth=1)
        axes.set_title(width)
        axes.set_xlabel("largest error [% of full scale]")
        axes.margins(x=0.12)
    label(panels[0], 0.8 * TARGET, panels[0].get_ylim()[1] * 0.7, "limit", "#555555", ha="right")
    panels[0].set_ylabel("run time of 1 s, 4096 taxels [ms]")
    panels[-1].legend(fontsize=7, frameon=False)
    return figure


def main(words: list[str] | None = None) -> int:
    """Draw the figure and name the files written."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.simulation.figure", description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("docs/figures"), help="folder (default: %(default)s)")
    parser.add_argument("--data", type=Path, help="measured points (default: simulation_schemes.csv in that folder)")
    options = parser.parse_args(words)
    data = options.data or options.out / f"{NAME}.csv"
    for path in save(lambda: draw(read(data)), options.out / NAME):
        print(path)
    return 0


if __name__ == "__main__":
    sys.exit(main())
