# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Colours of the fronts differ in grey and with colour vision deficiencies, and are seen on their page, by numbers."""

from __future__ import annotations

import pytest

pytest.importorskip("matplotlib", reason="fronts are drawn")

from benchmarks.fronts import chart
from benchmarks.fronts.front import Check, Choice, Front
from benchmarks.fronts.palette import PALETTES, Palette
from posfet_model.figures import style
from support.colour_vision import DEFICIENCIES, contrast, lab, least_distance, least_grey_distance, linear
from support.long_cases import long_cases

GREY, COLOUR, TRITAN = 6.0, 25.0, 15.0
"""Least distances in CIELAB: of lightness, of colours, and of colours with tritanopia, which is rare; 2.3 is barely
seen."""

TEXT, GRAPHIC = 4.5, 3.0
"""Contrast ratios that WCAG 2.1 demands of text and of graphical objects (1.4.3, 1.4.11)."""


def colours_drawn(palette: Palette) -> tuple[str, ...]:
    """Return the colours of the series in a figure with as many series as are allowed."""
    choices = tuple(Choice(f"series {k}", "", 10.0**-k, (10.0**k,) * 3) for k in range(7))
    front = Front(
        "name", "Title", "work", "error [1]", "truth", 0.0, choices, choices[0].name,
        (Check("a quantity", 1.0, 0.0, 2.0),), "It is so. Choose it.",
    )  # fmt: skip
    with style.style(palette.settings):
        lines = chart.draw(front, palette).axes[0].get_lines()
    return tuple(str(line.get_color()) for line in lines if str(line.get_gid()).startswith("series "))


@pytest.mark.parametrize("palette", long_cases(PALETTES, PALETTES[:1]))
def test_series_differ_in_grey_and_with_colour_vision_deficiencies(palette: Palette) -> None:
    colours = colours_drawn(palette)
    assert len(set(colours)) == 7
    assert least_grey_distance(colours) >= GREY
    assert least_distance(colours) >= COLOUR
    for name, matrix in DEFICIENCIES.items():
        assert least_distance(colours, matrix) >= (TRITAN if name == "tritanopia" else COLOUR), name


@pytest.mark.parametrize("palette", PALETTES)
def test_text_and_points_stand_out_from_their_page(palette: Palette) -> None:
    assert min(contrast(each, palette.ground) for each in (palette.ink, palette.faint)) >= TEXT
    assert min(contrast(each, palette.ground) for each in (*palette.series, palette.grey)) >= GRAPHIC


def test_a_palette_of_equal_lightness_or_of_red_and_green_would_be_refused() -> None:
    assert least_grey_distance(("#d62728", "#2c7d2c")) < GREY
    red, green = "#a06a00", "#6b8000"
    assert least_distance((red, green)) > COLOUR > least_distance((red, green), DEFICIENCIES["deuteranopia"])


def test_colours_are_those_of_the_standards() -> None:
    assert contrast("#000000", "#ffffff") == pytest.approx(21.0)
    assert lab(linear("#ff0000")) == pytest.approx([53.24, 80.09, 67.20], abs=0.02)
    for matrix in DEFICIENCIES.values():  # grey stays grey
        assert matrix.sum(axis=1) == pytest.approx([1, 1, 1], abs=1e-5)
