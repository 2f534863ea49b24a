"""The figures: drawn without errors, reproducible, with units, and readable without colour."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from support.paths import DOCS

pytest.importorskip("matplotlib", reason="the figures need matplotlib")

from posfet_model.figures import __main__ as command
from posfet_model.figures.registry import FIGURES
from posfet_model.figures.style import save, style

STORED = DOCS / "figures"


def test_the_command_draws_the_requested_figures_reproducibly(tmp_path, capsys) -> None:
    name = "fig2_hysteresis"
    for run in ("first", "second"):
        assert command.main([name, "--out", str(tmp_path / run)]) == 0
    assert capsys.readouterr().out.count("\n") == 4
    for suffix in (".svg", ".png"):
        first, second = ((tmp_path / run / name).with_suffix(suffix).read_bytes() for run in ("first", "second"))
        assert first == second
        assert not re.search(rb"<dc:date>|Matplotlib v", first)


def test_an_unknown_figure_is_an_error_that_lists_the_names(tmp_path, capsys) -> None:
    with pytest.raises(SystemExit) as stop:
        command.main(["fig99", "--out", str(tmp_path)])
    assert stop.value.code == 2
    assert "no figure fig99; there are fig2_hysteresis" in capsys.readouterr().err


def test_missing_matplotlib_is_reported_in_one_line() -> None:
    program = "import runpy, sys; sys.modules['matplotlib'] = None; runpy.run_module('posfet_model.figures')"
    folder = Path(command.__file__).parents[2]
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False, cwd=folder)
    assert done.returncode == 1
    assert re.fullmatch(r"posfet_model\.figures: needs matplotlib\S* \(pip install matplotlib\)\n", done.stderr)


@pytest.mark.parametrize("name", FIGURES)
def test_every_figure_is_stored_and_can_be_drawn(name: str, tmp_path: Path) -> None:
    for path in save(FIGURES[name], tmp_path / name):
        assert path.stat().st_size > 5_000
        assert (STORED / path.name).exists(), f"python -m posfet_model.figures {name}"


@pytest.mark.parametrize("name", FIGURES)
def test_axes_are_labelled_and_lines_differ_in_more_than_colour(name: str) -> None:
    with style():
        figure = FIGURES[name]()
        figure.draw_without_rendering()
    panels = [axes for axes in figure.axes if hasattr(axes, "get_subplotspec") and axes.get_subplotspec() is not None]
    for axes in panels:  # one label may serve a column or a row of panels
        place = axes.get_subplotspec()
        column = [other for other in panels if other.get_subplotspec().colspan == place.colspan]
        row = [other for other in panels if other.get_subplotspec().rowspan == place.rowspan]
        assert any(other.get_xlabel() for other in column)
        assert any(other.get_ylabel() for other in row)
        line_styles: dict[tuple[object, ...], str] = {}
        for line in axes.get_lines():
            if np.size(line.get_xdata()) > 2:
                look = (
                    line.get_linestyle(),
                    repr(line._unscaled_dash_pattern),
                    line.get_marker(),
                    line.get_linewidth(),
                )
                colour = line_styles.setdefault(look, line.get_color())
                assert colour == line.get_color(), f"two colours with the same line style: {look}"
