# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A front as a figure, in the style of the documents: scatter of choices, Pareto set, shipped choice, reference."""

from __future__ import annotations

import itertools
import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Annotation
from matplotlib.transforms import Bbox

from benchmarks.fronts.front import Choice, Front, FrontError
from benchmarks.fronts.palette import LIGHT, Palette
from posfet_model.figures import style

HEIGHT = 4.4
FONT = 7.5
NEAR = 7
"""Half the distance of points with the same parameter that share a label [points]."""

GAP = 2.5
"""Distance between labels, and from points [points]."""


def draw(front: Front, palette: Palette = LIGHT) -> Figure:
    """Return the figure of a front; FrontError where labels cannot be separated."""
    figure, (axes,) = style.new_figure(HEIGHT)
    floor = _floor(front)
    series = list(dict.fromkeys(choice.series for choice in front.choices))
    for name, (colour, marker) in zip(series, palette.looks, strict=False):
        own = [choice for choice in front.choices if choice.series == name]
        x, y = [front.ratio(each) for each in own], [max(front.counted(each), floor) for each in own]
        if front.swept and len(own) > 1:
            axes.plot(x, y, color=colour, linewidth=0.8, alpha=0.6, zorder=2)
        axes.plot(
            x, y, linestyle="", marker=marker, color=colour, markersize=6.5, label=name, gid=f"series {name}", zorder=4
        )
    _staircase(axes, front, floor, palette)
    shipped = front.shipped_choice
    if shipped is not None:
        axes.plot(
            front.ratio(shipped), max(front.counted(shipped), floor), "o", markersize=14, markerfacecolor="none",
            color=palette.ink, markeredgewidth=1.4, zorder=3, label="shipped",
        )  # fmt: skip
    if front.uncertainty > 0:
        axes.axhline(front.uncertainty, color=palette.grey, linewidth=1, linestyle=style.DOTTED, label="reference")
    axes.set(xscale="log", yscale="log", ylabel=front.error_label)
    axes.set_xlabel(f"run time [{'shipped' if shipped is not None else 'fastest'} = 1]")
    axes.set_title(front.title)
    axes.margins(0.14)
    _decades(axes)
    figure.legend(
        *axes.get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=FONT, frameon=False,
        handlelength=2.2,
    )  # fmt: skip
    _label(figure, axes, front, floor, palette)
    return figure


def _floor(front: Front) -> float:
    """Return where an error of 0 is drawn: a decade below the smallest other one."""
    positive = [front.counted(each) for each in front.choices if front.counted(each) > 0]
    return min(positive, default=1.0) / 10 if any(front.counted(each) == 0 for each in front.choices) else 0.0


def _decades(axes: Axes) -> None:
    """Widen an axis that spans less than a factor of 3, whose ticks would have no number."""
    for get, put in ((axes.get_xlim, axes.set_xlim), (axes.get_ylim, axes.set_ylim)):
        low, high = get()
        if high / low < 12:
            middle = math.sqrt(low * high)
            put(middle / math.sqrt(12), middle * math.sqrt(12))


def _staircase(axes: Axes, front: Front, floor: float, palette: Palette) -> None:
    points = [(front.ratio(each), max(front.counted(each), floor)) for each in front.pareto]
    x, y = zip(*points, strict=True)
    axes.step(x, y, where="post", color=palette.grey, linewidth=2.5, alpha=0.45, zorder=1, label="Pareto set")


def _label(figure: Figure, axes: Axes, front: Front, floor: float, palette: Palette) -> None:
    """Label the choices of the Pareto set, the shipped one, and the ends of each swept series, where there is room.

    Series with the same parameters need their labels once.
    """
    wanted = {choice.name: choice for choice in (*front.pareto, *filter(None, [front.shipped_choice]))}
    seen = set()
    for name in dict.fromkeys(choice.series for choice in (*filter(None, [front.shipped_choice]), *front.choices)):
        own = [choice for choice in front.choices if choice.series == name]
        parameters = tuple(choice.parameter for choice in own)
        if parameters not in seen:
            wanted |= {choice.name: choice for choice in ((own[0], own[-1]) if front.swept else own)}
        seen.add(parameters)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    figure.set_layout_engine("none")  # what is placed now stays
    renderer = canvas.get_renderer()
    scale = figure.dpi / 72
    marks = [_box(axes, front, each, floor, 4.5 * scale) for each in front.choices]
    if front.shipped_choice is not None:
        marks.append(_box(axes, front, front.shipped_choice, floor, 7.5 * scale))
    placed: list[Bbox] = []
    named: list[tuple[str, Bbox]] = []
    inside = axes.get_window_extent(renderer)
    for choice in filter(lambda choice: choice.parameter, wanted.values()):
        near = _box(axes, front, choice, floor, NEAR * scale)
        if any(choice.parameter == text and near.overlaps(other) for text, other in named):
            continue  # one label for points of several series
        named.append((choice.parameter, near))
        note = axes.annotate(
            choice.parameter, (front.ratio(choice), max(front.counted(choice), floor)), textcoords="offset points",
            xytext=(0, 0), fontsize=FONT, ha="center", va="center", zorder=6, color=palette.ink,
            arrowprops={"arrowstyle": "-", "linewidth": 0.5, "color": palette.grey, "shrinkA": 0, "shrinkB": 3},
        )  # fmt: skip
        placed.append(_place(note, placed, marks, inside, renderer, scale))


def _box(axes: Axes, front: Front, choice: Choice, floor: float, half: float) -> Bbox:
    x, y = axes.transData.transform((front.ratio(choice), max(front.counted(choice), floor)))
    return Bbox.from_extents(x - half, y - half, x + half, y + half)


def _place(note: Annotation, placed: list[Bbox], marks: list[Bbox], inside: Bbox, renderer, scale: float) -> Bbox:  # type: ignore[no-untyped-def]
    """Move a label to the nearest free place; return its box."""
    note.update_positions(renderer)
    own = super(Annotation, note).get_window_extent(renderer)
    centre = np.array([(own.x0 + own.x1) / 2, (own.y0 + own.y1) / 2])
    for radius, angle in itertools.product(range(9, 130, 4), range(0, 360, 20)):
        away = np.array([radius * math.cos(math.radians(angle)) * 1.5, radius * math.sin(math.radians(angle))])
        box = Bbox.from_bounds(own.x0 + away[0] * scale, own.y0 + away[1] * scale, own.width, own.height)
        wide = box.padded(GAP * scale)
        if any(wide.overlaps(other) for other in (*placed, *marks)):
            continue
        if inside.x0 <= wide.x0 and wide.x1 <= inside.x1 and inside.y0 <= wide.y0 and wide.y1 <= inside.y1:
            note.set_position(tuple(away))
            return box
    raise FrontError(f"no place for the label {note.get_text()!r} near {centre}")


def plotted(figure: Figure) -> dict[str, list[tuple[float, float]]]:
    """Return the points of each series that a figure shows."""
    (axes,) = figure.axes
    found = {}
    for line in axes.get_lines():
        name = str(line.get_gid() or "")
        if name.startswith("series "):
            x, y = np.asarray(line.get_xdata(), float), np.asarray(line.get_ydata(), float)
            found[name.removeprefix("series ")] = list(zip(x.tolist(), y.tolist(), strict=True))
    return found
