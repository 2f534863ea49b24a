"""Style of the figures, and reproducible files.

Lines differ in dash pattern and are labelled directly, so the figures can be read without colour. The colours are those
of Okabe and Ito (2008), which also differ in lightness.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
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
def style() -> Iterator[None]:
    """Apply the settings of the figures within the block, whatever the user's own settings are."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_SETTINGS)
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


def label(axes: Axes, x: float, y: float, text: str, colour: str, **options: Any) -> None:
    """Label a line, on a white background that hides the grid.

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


def save(draw: Callable[[], Figure], stem: Path) -> list[Path]:
    """Draw a figure and write it as SVG and PNG, without date and version so that equal figures are equal files.

    Parameters
    ----------
    draw : callable
        Function that draws the figure.
    stem : Path
        Path of the files without suffix.

    Returns
    -------
    list of Path
        Files written.
    """
    paths = [stem.with_suffix(".svg"), stem.with_suffix(".png")]
    with style():
        figure = draw()
        figure.savefig(paths[0], metadata={"Date": None, "Creator": None})
        figure.savefig(paths[1], dpi=200, metadata={"Software": None})
    return paths
