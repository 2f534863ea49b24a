# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The structure in cross-section (the paper's Fig. 1): the thinned chip, a transistor below the film, its oxide."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon, Rectangle

from posfet_model.device import paper
from posfet_model.device.mechanics import mask_opening
from posfet_model.figures.style import BLACK, VERMILION, dimension, label, new_mosaic

MEMBRANE_WIDTH: Final = 1e-2
"""Side of the membrane [m], assumed: that of the deflection figure."""

MEMBRANE_THICKNESS: Final = 50e-6
"""Thickness of the membrane [m], assumed."""

JUNCTION_DEPTH: Final = 1e-6
"""Depth of source and drain [m], assumed."""

ELECTRODE_THICKNESS: Final = 0.3e-6
"""Thickness of the top electrode [m], assumed."""

SILICON: Final = "#dedede"
DOPED: Final = "#b4b4b4"
OXIDE: Final = "#56b4e9"
FILM: Final = "#fbe9d7"
METAL: Final = "#555555"
GRAIN: Final = "#c9b8a6"

_MILLI, _MICRO, _NANO = 1e-3, 1e-6, 1e-9


def structure() -> Figure:
    """Draw Fig. 1: the chip, one transistor and the layers of its gate, each to scale in both directions."""
    figure, panels = new_mosaic(3.9, [["chip", "chip"], ["taxel", "gate"]], height_ratios=[1, 2], width_ratios=[3, 1])
    _chip(panels["chip"])
    _taxel(panels["taxel"])
    _gate(panels["gate"])
    for axes in panels.values():
        axes.set_aspect("equal")
        axes.grid(visible=False)
    return figure


def chip_outline() -> list[tuple[float, float]]:
    """Return the corners (x, z) [m] of the etched chip in cross-section, its front at z = 0."""
    wafer = paper.WAFER_THICKNESS.value
    edge = MEMBRANE_WIDTH / 2 + 1.2e-3
    opening = float(mask_opening(MEMBRANE_WIDTH, wafer - MEMBRANE_THICKNESS)) / 2
    inner = MEMBRANE_WIDTH / 2
    half = [(edge, 0.0), (edge, -wafer), (opening, -wafer), (inner, -MEMBRANE_THICKNESS)]
    return half + [(-x, z) for x, z in reversed(half)]


def _chip(axes: Axes) -> None:
    outline = [(x / _MILLI, z / _MILLI) for x, z in chip_outline()]
    axes.add_patch(Polygon(outline, facecolor=SILICON, edgecolor=BLACK, linewidth=0.8))
    axes.plot([outline[-1][0], outline[0][0]], [0, 0], color=VERMILION, linewidth=2)
    opening, bottom = 2 * outline[2][0], outline[2][1]
    dimension(
        axes, (-MEMBRANE_WIDTH / 2 / _MILLI, -0.25), (MEMBRANE_WIDTH / 2 / _MILLI, -0.25), "membrane $W_0$ = 10 mm"
    )
    dimension(
        axes,
        (-opening / 2, bottom - 0.23),
        (opening / 2, bottom - 0.23),
        f"mask opening $W$ = {opening:.2f} mm, eq. (11)",
    )
    label(axes, -6.1, 0.12, "oxide and film, see (b)", VERMILION, va="bottom", bbox=None)
    label(
        axes,
        6.1,
        0.12,
        "wafer 450 µm, membrane $h$ = 50 µm, walls at 54.74°",
        BLACK,
        ha="right",
        va="bottom",
        bbox=None,
    )
    axes.set(xlim=(-6.4, 6.4), ylim=(-1.05, 0.6), xlabel="x [mm]", ylabel="z [mm]", yticks=[-0.5, 0])
    axes.set_title("(a) the thinned chip")


def _taxel(axes: Axes) -> None:
    length = paper.CHANNEL_LENGTH.value / _MICRO
    oxide, film = paper.OXIDE_THICKNESS.value / _MICRO, paper.FILM_THICKNESS.value / _MICRO
    metal, edge, deep = ELECTRODE_THICKNESS / _MICRO, 11.0, -4.4
    axes.add_patch(Rectangle((-edge, deep), 2 * edge, -deep, facecolor=SILICON, edgecolor="none"))
    for side, name in ((-1, "source, n⁺"), (1, "drain, n⁺")):
        left = length / 2 if side > 0 else -edge
        depth = JUNCTION_DEPTH / _MICRO
        axes.add_patch(
            Rectangle(
                (left, -depth), edge - length / 2, depth, facecolor=DOPED, edgecolor=METAL, linewidth=0.7, hatch="////"
            )
        )
        label(axes, side * (edge + length / 2) / 2, -depth - 0.2, name, BLACK, ha="center", va="top", bbox=None)
    axes.add_patch(Rectangle((-edge, 0), 2 * edge, oxide, facecolor=OXIDE, edgecolor="none"))
    axes.add_patch(
        Rectangle((-edge, oxide), 2 * edge, film, facecolor=FILM, edgecolor=GRAIN, linewidth=0.7, hatch="..")
    )
    axes.add_patch(Rectangle((-edge, oxide + film), 2 * edge, metal, facecolor=METAL, edgecolor=BLACK, linewidth=0.7))
    for x in (-3.0, 0.0, 3.0):
        axes.annotate(
            "",
            (x, oxide + film + metal),
            (x, oxide + film + metal + 1.7),
            arrowprops={"arrowstyle": "-|>", "color": BLACK},
        )
    label(axes, 3.4, 4.1, "force $F$ on 1 mm²", BLACK, bbox=None)
    label(axes, -edge + 0.2, 3.0, "top electrode: gate", BLACK, bbox=None, va="bottom")
    label(axes, 0, 1.25, "film P(VDF-TrFE), 2.5 µm", BLACK, ha="center", va="center")
    dimension(axes, (-length / 2, -2.4), (length / 2, -2.4), "channel $L$ = 12 µm")
    label(axes, 0, -3.9, "p-type silicon", BLACK, ha="center", bbox=None)
    axes.set(xlim=(-edge, edge), ylim=(deep, 5.2), xlabel="x [µm]", ylabel="z [µm]", xticks=[-10, -5, 0, 5, 10])
    axes.set_title("(b) one transistor")


def _gate(axes: Axes) -> None:
    oxide = paper.OXIDE_THICKNESS.value / _NANO
    axes.add_patch(Rectangle((0, -40), 100, 40, facecolor=SILICON, edgecolor="none"))
    axes.add_patch(Rectangle((0, 0), 100, oxide, facecolor=OXIDE, edgecolor="none"))
    axes.add_patch(Rectangle((0, oxide), 100, 50, facecolor=FILM, edgecolor=GRAIN, linewidth=0.7, hatch=".."))
    axes.plot([0, 100], [oxide, oxide], color=VERMILION, linewidth=2.5)
    label(axes, 50, 82, "film", BLACK, ha="center", va="center")
    label(axes, 50, 60, "charge σ", VERMILION, ha="center", va="center")
    label(axes, 50, oxide / 2, "oxide 45 nm", BLACK, ha="center", va="center", bbox=None)
    label(axes, 50, -20, "silicon", BLACK, ha="center", va="center", bbox=None)
    axes.set(xlim=(0, 100), ylim=(-40, 95), xlabel="x [nm]", ylabel="z [nm]", xticks=[0, 50, 100])
    axes.set_title("(c) gate oxide")


FIGURES: Final[dict[str, Callable[[], Figure]]] = {"fig1_structure": structure}
