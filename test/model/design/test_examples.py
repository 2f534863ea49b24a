# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The examples run: the notebook prints what is stored in it, the optimisation improves and keeps its limits."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from types import ModuleType

import pytest

from support.notebooks import code_cells, run_cells, stored
from support.paths import ROOT

NOTEBOOK = ROOT / "examples" / "size_for_a_finger.ipynb"


def words(text: str) -> list[object]:
    """Return words, and numbers with a tolerance for other processors and versions."""
    parts = re.findall(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?|[^\s\d]+", text)
    return [pytest.approx(float(part), rel=0.03) if re.match(r"[-+]?\d", part) else part for part in parts]


def test_the_notebook_prints_what_is_stored_in_it() -> None:
    before = [stored(cell) for cell in code_cells(NOTEBOOK)]
    assert len(before) >= 8
    for found, kept in zip(run_cells(NOTEBOOK), before, strict=True):
        assert kept.text or kept.pictures
        assert words(found.text) == words(kept.text)
        assert len(found.pictures) == len(kept.pictures)


def optimisation() -> ModuleType:
    spec = importlib.util.spec_from_file_location("optimise_design", ROOT / "examples" / "optimise_design.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_optimisation_improves_within_its_limits(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    netlist = tmp_path / "best.cir"
    assert optimisation().main(["--designs", "60", "--generations", "4", "--netlist", str(netlist)]) == 0
    lines = capsys.readouterr().out.splitlines()
    best = [float(line.split()[-2]) for line in lines[:4]]
    assert best == sorted(best)
    assert best[-1] > 84
    assert lines[-1] == "valid"
    figures = {line.split()[0]: line for line in lines}
    assert float(figures["power_w"].split()[1]) <= 4.0
    assert figures["power_w"].split()[2] == "mW"
    assert netlist.read_text(encoding="ascii").endswith(".ends opamp\n")


def test_limits_that_nothing_meets_are_said(capsys: pytest.CaptureFixture[str]) -> None:
    assert optimisation().main(["--designs", "10", "--generations", "1", "--most-power", "1e-9"]) == 1
    assert capsys.readouterr().out.splitlines()[-1] == "no design is within the limits"
