# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Figures of the fronts: one that contradicts its table, or whose texts overlap, fails the run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("matplotlib", reason="fronts are drawn")

from matplotlib.figure import Figure
from matplotlib.text import Text

from benchmarks.fronts import __main__ as command
from benchmarks.fronts import chart, page
from benchmarks.fronts.exhibit import Exhibit
from benchmarks.fronts.front import Effort, Front, FrontError
from benchmarks.fronts.legibility import check_texts
from benchmarks.fronts.palette import LIGHT, PALETTES, Palette
from posfet_model.figures import style
from support.long_cases import long_cases
from support.made_up_fronts import FAST, GOOD
from support.made_up_fronts import choice as _choice
from support.made_up_fronts import front as _front

SHORT = Effort(2, True)


def test_a_figure_that_contradicts_the_table_is_refused() -> None:
    front = _front(FAST, GOOD, _choice("fast", "5 us", 0.05, 5e-6))
    with style.style():
        figure = chart.draw(front)
        page.check_figure(front, figure)
        for wrong in (replace(FAST, error=0.4), replace(FAST, series="other"), _choice("fast", "1 us", 0.1, 3e-6)):
            changed = replace(front, choices=(*front.choices[1:], wrong), shipped=GOOD.name)
            with pytest.raises(FrontError):
                page.check_figure(changed, figure)


def _draw_wrongly(front: Front, palette: Palette = LIGHT) -> Figure:
    """Return the figure of a front with a point of every series a tenth too low."""
    figure = chart.draw(front, palette)
    for line in figure.axes[0].get_lines():
        if str(line.get_gid()).startswith("series "):
            line.set_ydata(0.9 * np.asarray(line.get_ydata()))
    return figure


def test_a_wrong_figure_fails_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(command, "stage", lambda name: lambda effort: [_front(FAST, GOOD)])
    assert command.main(["--only", "charge", "--out", str(tmp_path)]) == 0
    monkeypatch.setattr(command, "drawn", _draw_wrongly)
    assert command.main(["--only", "charge", "--out", str(tmp_path)]) == 1
    assert "name, fast: (1, 0.09) in the figure, (1, 0.1) in the table" in capsys.readouterr().err


def test_a_wrong_line_of_an_exhibit_fails_the_run() -> None:
    (front,) = command.verified("stability", SHORT)
    assert isinstance(front, Exhibit)
    with style.style():
        figure = front.draw(LIGHT)
        for line in figure.axes[0].get_lines():
            line.set_ydata(0.9 * np.asarray(line.get_ydata()))
        with pytest.raises(FrontError, match="in the figure"):
            page.check_figure(front, figure)


@pytest.mark.parametrize("palette", long_cases(PALETTES, PALETTES[:1]))
def test_overlapping_covering_and_cut_texts_are_refused(palette: Palette) -> None:
    def figure() -> Figure:
        return chart.draw(_front(FAST, GOOD), palette)

    with style.style(palette.settings):
        check_texts(figure(), "name")
        for x, y, why in ((0.0, 1.02, "'more' overlaps 'Title'"), (0.99, 0.5, "no room for 'more")):
            wrong = figure()
            wrong.axes[0].text(x, y, "more" if x == 0.0 else "more" * 9, transform=wrong.axes[0].transAxes)
            with pytest.raises(FrontError, match=why):
                check_texts(wrong, "name")
        covering = figure()
        covering.axes[0].text(1.0, 0.1, "on it", ha="center", va="center")
        with pytest.raises(FrontError, match="'on it' covers a point"):
            check_texts(covering, "name")


def test_labels_do_not_overlap_each_other_or_points() -> None:
    crowd = [_choice("a series", f"value {k}", 0.1 / (1 + 0.05 * k), 1e-6 * (1 + 0.05 * k), 0.0) for k in range(12)]
    with style.style():
        figure = chart.draw(_front(*crowd))
        figure.canvas.draw()
        boxes = [Text.get_window_extent(text) for text in figure.axes[0].texts]  # without its leader line
    assert len(boxes) == 12
    for index, box in enumerate(boxes):
        assert not any(box.overlaps(other) for other in boxes[:index])


def test_labels_without_a_place_fail_the_front() -> None:
    crowd = [
        _choice("a series", f"a long value {k}" * 3, 1.0 / (1 + 0.1 * k), 1e-6 * (1 + 0.1 * k), 0.0) for k in range(60)
    ]
    with style.style(), pytest.raises(FrontError, match="no place for the label"):
        chart.draw(_front(*crowd))


@pytest.mark.slow
def test_equal_fronts_are_equal_files(tmp_path: Path) -> None:
    for folder in ("one", "other"):
        command.publish([_front(FAST, GOOD)], {}, tmp_path / folder, "a test")
    figures = sorted(each.name for each in (tmp_path / "one" / "docs" / "figures").iterdir())
    assert figures == [f"front_name{dark}.{suffix}" for dark in ("", "_dark") for suffix in ("png", "svg")]
    for name in figures:
        one, other = ((tmp_path / folder / "docs" / "figures" / name).read_bytes() for folder in ("one", "other"))
        assert one == other
