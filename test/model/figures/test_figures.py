# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The figures: drawn without errors, byte for byte the same, with units, legible, and readable without colour."""

import itertools
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from support.paths import DOCS

pytest.importorskip("matplotlib", reason="the figures need matplotlib")

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text

from posfet_model.figures import __main__ as command
from posfet_model.figures.registry import FIGURES
from posfet_model.figures.style import style
from support.long_cases import long_cases

STORED = DOCS / "figures"


@pytest.fixture(autouse=True)
def _root(monkeypatch: pytest.MonkeyPatch) -> None:
    """Recorded runs of ngspice are read from docs/figures."""
    monkeypatch.chdir(DOCS.parent)


@pytest.mark.slow
def test_another_process_draws_the_same_bytes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names = ["fig5_schematic", "fig7_gain_phase", "bending"]
    assert command.main([*names, "--out", str(tmp_path / "here")]) == 0
    assert capsys.readouterr().out.count("\n") == 2 * len(names)
    program = [sys.executable, "-m", "posfet_model.figures", *names, "--out", str(tmp_path / "there")]
    seed = {"PYTHONHASHSEED": "12345", "TZ": "Asia/Kathmandu"}
    subprocess.run(program, check=True, capture_output=True, env={**os.environ, **seed})
    for name, suffix in itertools.product(names, (".svg", ".png")):
        here, there = ((tmp_path / run / name).with_suffix(suffix).read_bytes() for run in ("here", "there"))
        assert here == there, name
        assert not re.search(rb"<dc:date>|Matplotlib v", here)


def test_an_unknown_figure_is_an_error_that_lists_the_names(tmp_path, capsys) -> None:
    with pytest.raises(SystemExit) as stop:
        command.main(["fig99", "--out", str(tmp_path)])
    assert stop.value.code == 2
    assert "no figure fig99; there are fig1_structure" in capsys.readouterr().err


def test_missing_matplotlib_is_reported_in_one_line() -> None:
    program = "import runpy, sys; sys.modules['matplotlib'] = None; runpy.run_module('posfet_model.figures')"
    folder = Path(command.__file__).parents[2]
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False, cwd=folder)
    assert done.returncode == 1
    assert re.fullmatch(r"posfet_model\.figures: needs matplotlib\S* \(pip install matplotlib\)\n", done.stderr)


def test_every_figure_is_stored_and_shown_in_a_document() -> None:
    shown = "".join(page.read_text(encoding="utf-8") for page in DOCS.glob("*.md"))
    for name in FIGURES:
        assert f"(figures/{name}.svg)" in shown, name
        for suffix in (".svg", ".png"):
            stored = (STORED / name).with_suffix(suffix)
            assert stored.stat().st_size > 5_000, f"python -m posfet_model.figures {name}"


SIMULATED = ("stability", "fig6_slew", "fig6_follower_sine", "design_film", "errata")
"""Those that take a second or more for what they show, and show it like others."""


@pytest.mark.parametrize("name", long_cases(FIGURES.keys(), [name for name in FIGURES if name not in SIMULATED]))
def test_a_figure_is_complete_and_legible(name: str) -> None:
    with style():
        figure = FIGURES[name]()
        FigureCanvasAgg(figure)
        figure.draw_without_rendering()
    panels = [axes for axes in figure.axes if axes.get_subplotspec() is not None]
    for axes in panels:
        assert axes.lines or axes.collections or axes.patches, "an empty panel"
    for axes in (axes for axes in panels if axes.axison):
        _has_labels(axes, panels)
        _differs_in_more_than_colour(axes)
    _texts_are_apart(figure)


def _has_labels(axes: Axes, panels: list[Axes]) -> None:
    """Assert that axes, or their column and row, are labelled "quantity [unit]"."""
    place = axes.get_subplotspec()
    column = [other for other in panels if other.get_subplotspec().colspan == place.colspan]
    row = [other for other in panels if other.get_subplotspec().rowspan == place.rowspan]
    names = [[other.get_xlabel() for other in column], [other.get_ylabel() for other in row]]
    for found in names:
        assert any(found)
        assert all(re.fullmatch(r"\S(.*\S)? \[\S[^\[\]]*\]", text) for text in found if text), found


def _differs_in_more_than_colour(axes: Axes) -> None:
    looks: dict[tuple[object, ...], str] = {}
    for line in axes.get_lines():
        if np.size(line.get_xdata()) > 2:
            look = (line.get_linestyle(), repr(line._unscaled_dash_pattern), line.get_marker(), line.get_linewidth())
            colour = looks.setdefault(look, line.get_color())
            assert colour == line.get_color(), f"two colours with the same line style: {look}"


def _texts(figure: Figure) -> Iterator[Text]:
    for axes in figure.axes:
        yield from axes.texts
        yield from (axes.title, axes._left_title)
        if axes.axison:
            for axis, (low, high) in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, axes.get_ylim())):
                yield axis.label
                for tick in axis.get_major_ticks():
                    if min(low, high) <= tick.get_loc() <= max(low, high):
                        yield from (tick.label1, tick.label2)
    for legend in filter(None, [*figure.legends, *(axes.get_legend() for axes in figure.axes)]):
        yield from (legend.get_title(), *legend.get_texts())


def _texts_are_apart(figure: Figure) -> None:
    """Assert that no text is cut off at the edge, and that no two overlap by more than a pixel."""
    boxes = [
        (text.get_text(), text.get_window_extent())
        for text in _texts(figure)
        if text.get_visible() and text.get_text().strip()
    ]
    assert len(boxes) > 5
    edge = figure.bbox
    for text, box in boxes:
        inside = box.x0 >= edge.x0 - 1 and box.y0 >= edge.y0 - 1 and box.x1 <= edge.x1 + 1 and box.y1 <= edge.y1 + 1
        assert inside, f"{text!r} is cut off"
    for (text, box), (other, around) in itertools.combinations(boxes, 2):
        wide = min(box.x1, around.x1) - max(box.x0, around.x0)
        high = min(box.y1, around.y1) - max(box.y0, around.y0)
        assert wide <= 1 or high <= 1, f"{text!r} overlaps {other!r}"
