# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The layout (the paper's Fig. 4): the array with its temperature sensors, and one taxel with its folded channel."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from posfet_model.device import paper
from posfet_model.figures.structure import DOPED, FILM, METAL, SILICON
from posfet_model.figures.style import BLACK, BLUE, VERMILION, dimension, label, new_figure
from posfet_model.sensor.description import load_sensor

FINGERS: Final = 4
"""Parts into which the channel is folded, assumed."""

CONTACT_WIDTH: Final = 30e-6
"""Width of the source and drain strips between them [m], assumed."""

_MILLI, _MICRO = 1e-3, 1e-6


def layout() -> Figure:
    """Draw Fig. 4: the array and one taxel from above, both to scale."""
    figure, (left, right) = new_figure(3.7, columns=2)
    _array(left)
    _taxel(right)
    for axes in (left, right):
        axes.set_aspect("equal")
        axes.grid(visible=False)
    return figure


def channels() -> list[tuple[float, float, float, float]]:
    """Return left edge, lower edge, length and width [m] of each finger of the channel, around the taxel's centre."""
    length, width = paper.CHANNEL_LENGTH.value, paper.CHANNEL_WIDTH.value / FINGERS
    pitch = length + CONTACT_WIDTH
    first = -((FINGERS - 1) * pitch + length) / 2
    return [(first + k * pitch, -width / 2, length, width) for k in range(FINGERS)]


def _array(axes: Axes) -> None:
    plan = load_sensor("posfet_5x5").layout
    side = paper.FORCE_AREA.value**0.5 / _MILLI
    pitch = plan.pitch_x / _MILLI
    for row in range(plan.rows):
        for column in range(plan.cols):
            corner = (column * pitch - side / 2, row * pitch - side / 2)
            axes.add_patch(Rectangle(corner, side, side, facecolor=FILM, edgecolor=BLACK, linewidth=0.7))
    end = (plan.cols - 1) * pitch
    for k, x in enumerate((0.5 * pitch, end - 0.5 * pitch), 1):
        axes.add_patch(Rectangle((x - 0.12, -1.22), 0.24, 0.24, facecolor=BLUE, edgecolor=BLACK, linewidth=0.7))
        label(axes, x + 0.25, -1.1, f"T{k}", BLUE, va="center", bbox=None)
    axes.add_patch(Rectangle((-1.5, -1.5), end + 3, end + 3, fill=False, edgecolor=BLACK, linewidth=1.0))
    dimension(axes, (0, end + 0.95), (pitch, end + 0.95), "")
    label(axes, pitch + 0.2, end + 0.95, "pitch 1.5 mm", BLACK, va="center", bbox=None)
    axes.set(xlim=(-1.9, end + 1.9), ylim=(-1.9, end + 1.9), xlabel="x [mm]", ylabel="y [mm]")
    axes.set_title("(a) 5 × 5 taxels of 1 mm²,\ntemperature sensors T1, T2")


def _taxel(axes: Axes) -> None:
    side = paper.FORCE_AREA.value**0.5 / _MICRO
    axes.add_patch(Rectangle((-side / 2, -side / 2), side, side, facecolor=FILM, edgecolor=BLACK, linewidth=0.8))
    fingers = [tuple(value / _MICRO for value in finger) for finger in channels()]
    strip = CONTACT_WIDTH / _MICRO
    edges = [left - strip for left, *_ in fingers] + [fingers[-1][0] + fingers[-1][2]]
    for k, left in enumerate(edges):
        hatch = "////" if k % 2 else None
        axes.add_patch(
            Rectangle(
                (left, fingers[0][1]),
                strip,
                fingers[0][3],
                facecolor=DOPED if k % 2 else SILICON,
                edgecolor=METAL,
                linewidth=0.5,
                hatch=hatch,
            )
        )
    for left, low, length, width in fingers:
        axes.add_patch(Rectangle((left, low), length, width, facecolor=VERMILION, edgecolor="none"))
    width = fingers[0][3]
    dimension(axes, (150, -width / 2), (150, width / 2), "")
    label(axes, 175, 60, f"$W$ =\n{FINGERS} × {width:.0f} µm", BLACK, va="center", bbox=None, fontsize=8)
    label(axes, -140, 330, "channel,\n$L$ = 12 µm", VERMILION, ha="right", va="center", bbox=None)
    label(axes, -140, 80, "drain\n(hatched)", BLACK, ha="right", va="center", bbox=None)
    label(axes, -140, -120, "source", BLACK, ha="right", va="center", bbox=None)
    label(axes, 0, -455, "film and electrode, 1 mm²", BLACK, ha="center", va="center", bbox=None)
    axes.set(xlim=(-560, 560), ylim=(-560, 560), xlabel="x [µm]", ylabel="y [µm]")
    axes.set_title("(b) one taxel: 1 mm² of film,\nchannel of 3276 µm × 12 µm")


FIGURES: Final[dict[str, Callable[[], Figure]]] = {"fig4_layout": layout}
