# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Colours of the fronts on a light and on a dark page.

The seven colours of the series are seven steps of lightness, so that they differ in grey, and their hues were searched
for the greatest least distance of any two with and without colour vision deficiencies; a test computes both.
"""

from __future__ import annotations

from dataclasses import dataclass

MARKERS = ("o", "s", "^", "D", "x", "v", "P")
"""Markers of the series: a chart can be read by them alone."""


@dataclass(frozen=True)
class Palette:
    """Colours of a figure."""

    suffix: str
    """What is added to the file name."""
    ground: str
    ink: str
    """Text, and the ring of what is shipped."""
    faint: str
    """Axes and their numbers."""
    grid: str
    grey: str
    """Pareto set and reference."""
    shade: str
    """Area of a part of the chart."""
    series: tuple[str, ...]

    @property
    def looks(self) -> tuple[tuple[str, str], ...]:
        """Colour and marker of each series."""
        return tuple(zip(self.series, MARKERS, strict=True))

    @property
    def settings(self) -> dict[str, str]:
        """Settings of matplotlib, in addition to the style of the documents."""
        return {
            "figure.facecolor": self.ground,
            "axes.facecolor": self.ground,
            "savefig.facecolor": self.ground,
            "text.color": self.ink,
            "axes.labelcolor": self.ink,
            "axes.titlecolor": self.ink,
            "axes.edgecolor": self.faint,
            "xtick.color": self.faint,
            "ytick.color": self.faint,
            "grid.color": self.grid,
        }


LIGHT = Palette(
    suffix="", ground="#ffffff", ink="#1a1a1a", faint="#555555", grid="#e4e4e4", grey="#8a8a8a", shade="#eeeeee",
    series=("#4342cd", "#808403", "#217670", "#524111", "#8b8cd9", "#122f60", "#1e1d1b"),
)  # fmt: skip
DARK = Palette(
    suffix="_dark", ground="#0d1117", ink="#f0f0f0", faint="#b4b4b4", grid="#2b3036", grey="#8a8a8a", shade="#1c2127",
    series=("#e5c311", "#9762e7", "#a8ef93", "#50a67e", "#aea7e2", "#5f6f12", "#f7f2f4"),
)  # fmt: skip
PALETTES = (LIGHT, DARK)
