# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Checks of a drawn figure by the boxes of its texts: none overlaps another or a point, and none is cut off."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from benchmarks.fronts.front import FrontError

TOUCHING = 0.5
"""Overlap of two boxes that counts as none [pixels]: rounding."""

POINT = 2.0
"""Half the size of a point that no text may cover [points]."""


def check_texts(figure: Figure, name: str) -> None:
    """Raise FrontError where a text of the figure overlaps another one or a point, or leaves the figure."""
    boxes = list(_texts(figure))
    for index, (text, box) in enumerate(boxes):
        if not _inside(box, figure.bbox):
            raise FrontError(f"{name}: no room for {text!r}")
        for other_text, other in boxes[:index]:
            if _overlap(box, other):
                raise FrontError(f"{name}: {text!r} overlaps {other_text!r}")
    half = POINT * figure.dpi / 72
    for axes in figure.axes:
        for x, y in _points(axes):
            point = Bbox.from_extents(x - half, y - half, x + half, y + half)
            for text, box in boxes:
                if _overlap(box, point):
                    raise FrontError(f"{name}: {text!r} covers a point")


def _texts(figure: Figure) -> Iterator[tuple[str, Bbox]]:
    """Yield every visible text with its box [pixels], without the leader line of an annotation."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    renderer = canvas.get_renderer()
    for axes in figure.axes:
        ticks = [
            *_within(axes.get_xticklabels(), 0, axes.get_xlim()),
            *_within(axes.get_yticklabels(), 1, axes.get_ylim()),
        ]
        titles = [axes.xaxis.label, axes.yaxis.label, axes.title, axes._left_title]  # type: ignore[attr-defined]
        for text in (*ticks, *titles, *axes.texts):
            if text.get_visible() and text.get_text().strip():
                yield text.get_text(), Text.get_window_extent(text, renderer)
    for legend in figure.legends:
        for text in legend.get_texts():
            yield text.get_text(), text.get_window_extent(renderer)


def _within(labels: Sequence[Text], axis: int, limits: tuple[float, float]) -> list[Text]:
    """Return the labels of the ticks within the limits: those beyond are not drawn."""
    return [label for label in labels if min(limits) <= label.get_position()[axis] <= max(limits)]


def _points(axes: Axes) -> Iterator[tuple[float, float]]:
    """Yield the points of the series within the axes [pixels]."""
    for line in axes.get_lines():
        if str(line.get_gid() or "").startswith("series "):
            for x, y in axes.transData.transform(line.get_xydata()):
                if axes.bbox.contains(x, y):  # false for NaN
                    yield float(x), float(y)


def _overlap(one: Bbox, other: Bbox) -> bool:
    width = min(one.x1, other.x1) - max(one.x0, other.x0)
    height = min(one.y1, other.y1) - max(one.y0, other.y0)
    return width > TOUCHING and height > TOUCHING


def _inside(box: Bbox, whole: Bbox) -> bool:
    return box.x0 >= whole.x0 and box.x1 <= whole.x1 and box.y0 >= whole.y0 and box.y1 <= whole.y1
