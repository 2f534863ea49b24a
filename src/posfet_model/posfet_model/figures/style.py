# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Style of the figures, and reproducible files.

Lines differ in dash pattern or marker and are labelled directly, so the figures can be read without colour. The colours
are blue, vermilion and green of Okabe and Ito (2008) and purple of Tol (2021), which also differ in lightness. Axes are
labelled "quantity [unit]"; the unit of a ratio is 1.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, Literal

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

BLACK: Final = "#1a1a1a"
BLUE: Final = "#0072b2"
VERMILION: Final = "#d55e00"
GREEN: Final = "#009e73"
PURPLE: Final = "#aa4499"
GREY: Final = "#8a8a8a"

SOLID: Final = "-"
DASHED: Final = (0, (6, 2.5))
DOTTED: Final = (0, (1.2, 1.6))
DASH_DOT: Final = (0, (7, 2, 1.2, 2))

WIDTH: Final = 6.4
"""Width of a figure [inch]."""

_SETTINGS: Final[dict[Any, Any]] = {
    "axes.edgecolor": "#555555",
    "axes.grid": True,
    "axes.labelcolor": BLACK,
    "axes.labelsize": 9.5,
    "axes.linewidth": 0.8,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlelocation": "left",
    "axes.titlesize": 9.5,
    "axes.titlepad": 8,
    "axes.unicode_minus": True,
    "figure.constrained_layout.h_pad": 0.08,
    "figure.constrained_layout.w_pad": 0.08,
    "font.family": "DejaVu Sans",
    "font.size": 9,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.7,
    "legend.handlelength": 3.4,
    "lines.linewidth": 1.8,
    "lines.solid_capstyle": "round",
    "mathtext.fontset": "dejavusans",
    "svg.fonttype": "path",
    "svg.hashsalt": "posfet_model",
    "xtick.color": "#555555",
    "xtick.labelsize": 8.5,
    "ytick.color": "#555555",
    "ytick.labelsize": 8.5,
}


@contextmanager
def style(more: Mapping[str, str] | None = None) -> Iterator[None]:
    """Apply the settings of the figures within the block, whatever the user's own settings are.

    Parameters
    ----------
    more : mapping of str to str, optional
        Further settings of matplotlib, such as the colours of a dark page.
    """
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_SETTINGS)
        mpl.rcParams.update(dict[Any, Any](more or {}))
        yield


def new_figure(height: float, rows: int = 1, columns: int = 1) -> tuple[Figure, list[Axes]]:
    """Return an empty figure and its panels, row by row.

    Parameters
    ----------
    height : float
        Height of the figure [inch].
    rows, columns : int, default 1
        Number of panels.

    Returns
    -------
    tuple of Figure and list of Axes
        Figure and panels.
    """
    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    return figure, list(figure.subplots(rows, columns, squeeze=False).flat)


def new_mosaic(
    height: float, panels: list[list[str]], width_ratios: list[float], height_ratios: list[float]
) -> tuple[Figure, dict[str, Axes]]:
    """Return an empty figure and its panels by name, of different sizes.

    Parameters
    ----------
    height : float
        Height of the figure [inch].
    panels : list of list of str
        Names of the panels, row by row; a name that is repeated extends over rows or columns.
    width_ratios, height_ratios : list of float
        Widths of the columns and heights of the rows, relative to each other.

    Returns
    -------
    tuple of Figure and dict of str to Axes
        Figure and panels.
    """
    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    mosaic: Any = panels  # a list is no list of its protocol to mypy
    return figure, figure.subplot_mosaic(mosaic, width_ratios=width_ratios, height_ratios=height_ratios)


def label(axes: Axes, x: float, y: float, text: str, colour: str, **options: Any) -> None:
    """Label a line, on a white background that hides the grid; without one where ``bbox=None``.

    Parameters
    ----------
    axes : Axes
        Panel.
    x, y : float
        Position in data coordinates.
    text, colour : str
        Text and its colour.
    **options
        Further options of `Axes.text`.
    """
    ground = {"boxstyle": "square,pad=0.15", "facecolor": "white", "edgecolor": "none", "alpha": 0.85}
    axes.text(x, y, text, color=colour, **{"fontsize": 8.5, "bbox": ground, "zorder": 5, **options})


def dimension(axes: Axes, start: tuple[float, float], end: tuple[float, float], text: str, **options: Any) -> None:
    """Draw a dimension line with arrows at both ends and its text in the middle.

    Parameters
    ----------
    axes : Axes
        Panel.
    start, end : tuple of float
        Ends in data coordinates.
    text : str
        Length with its unit.
    **options
        Further options of `Axes.text`.
    """
    arrows = {"arrowstyle": "<|-|>", "color": BLACK, "linewidth": 0.8, "shrinkA": 0, "shrinkB": 0, "mutation_scale": 7}
    axes.annotate("", start, end, arrowprops=arrows)
    middle = ((start[0] + end[0]) / 2, (start[1] + end[1]) / 2)
    ground = {"boxstyle": "square,pad=0.1", "facecolor": "white", "edgecolor": "none"}
    label(axes, *middle, text, BLACK, **{"ha": "center", "va": "center", "bbox": ground, **options})


def second_axis(axes: Axes, side: Literal["top", "right"], factor: float, text: str) -> None:
    """Add a second scale on the other side of the panel.

    Parameters
    ----------
    axes : Axes
        Panel.
    side : {"top", "right"}
        Side of the second scale.
    factor : float
        Second scale over first.
    text : str
        Label of the second scale.
    """

    def forward(value: Any) -> Any:
        return value * factor

    def back(value: Any) -> Any:
        return value / factor

    if side == "top":
        scale = axes.secondary_xaxis("top", functions=(forward, back))
        scale.set_xlabel(text)
    else:
        scale = axes.secondary_yaxis("right", functions=(forward, back))
        scale.set_ylabel(text)
    scale.spines[side].set_visible(True)


def save(draw: Callable[[], Figure], stem: Path, more: Mapping[str, str] | None = None) -> list[Path]:
    """Draw a figure and write it as SVG and PNG, without date and version so that equal figures are equal files.

    Parameters
    ----------
    draw : callable
        Function that draws the figure.
    stem : Path
        Path of the files without suffix.
    more : mapping of str to str, optional
        Further settings, as in `style`.

    Returns
    -------
    list of Path
        Files written.
    """
    paths = [stem.with_suffix(".svg"), stem.with_suffix(".png")]
    with style(more):
        figure = draw()
        figure.savefig(paths[0], metadata={"Date": None, "Creator": None})
        figure.savefig(paths[1], dpi=200, metadata={"Software": None})
    return paths
