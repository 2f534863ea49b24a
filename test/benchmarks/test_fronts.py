# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Fronts refuse what contradicts theory, a table or the eye; the short version of every stage runs."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("matplotlib", reason="fronts are drawn")


from benchmarks.fronts import __main__ as command
from benchmarks.fronts import chart, page
from benchmarks.fronts.estimators import shipped_variant, variants
from benchmarks.fronts.exhibit import Exhibit
from benchmarks.fronts.front import Check, Effort, Front, FrontError, order
from benchmarks.fronts.interleaved import interleaved
from benchmarks.fronts.pipeline import theory
from benchmarks.outcome import shown
from posfet_model.reconstruction.settings import ReconstructionSettings
from posfet_model.spice import ngspice
from support.long_cases import long_cases
from support.made_up_fronts import FAST, GOOD
from support.made_up_fronts import choice as _choice
from support.made_up_fronts import front as _front

SHORT = Effort(2, True)
QUICK = ("charge", "inverse", "crosstalk", "tracking", "mechanics", "hysteresis", "labelling", "messages")
"""Stages whose short version takes seconds at most; `theory` covers the pipeline."""


@pytest.mark.parametrize("value", [-0.1, 2.1, math.nan, math.inf])
def test_a_check_out_of_range_fails_the_front(value: float) -> None:
    front = _front(FAST, GOOD, checks=(Check("a quantity", value, 0.0, 2.0),))
    with pytest.raises(FrontError, match="a quantity"):
        front.verify()


@pytest.mark.parametrize(
    ("front", "why"),
    [
        (_front(FAST, GOOD, checks=()), "no check"),
        (_front(FAST, FAST), "two choices have one name"),
        (_front(FAST, GOOD, shipped="other"), "'other' was not measured"),
        (_front(*(_choice(f"series {k}", "", 1.0, 1e-6) for k in range(8))), "more than 7 series"),
        (_front(FAST, replace(GOOD, error=math.nan)), "error nan"),
        (_front(FAST, replace(GOOD, more=(1.0,))), "further figures"),
        (_front(FAST, GOOD, reading="One sentence of 0.5 mm."), "1 sentences of reading, not 2 to 5"),
        (_front(FAST, GOOD, reading="One of 0.5 mm. " * 6), "6 sentences of reading, not 2 to 5"),
        (_front(FAST, GOOD, question="a use"), "question 'a use'"),
    ],
)
def test_an_incomplete_front_is_refused(front: Front, why: str) -> None:
    with pytest.raises(FrontError, match=why):
        front.verify()


def test_the_pareto_set_is_what_no_other_choice_beats() -> None:
    bad = _choice("bad", "3 us", 0.2, 2e-6)
    front = _front(bad, FAST, GOOD)
    assert front.pareto == (FAST, GOOD)
    assert "not on the Pareto set: fast, 1 us has 0.5 of its error in 0.5 of its run time" in front.verdict
    assert "a defect" in front.verdict
    assert _front(FAST, GOOD).verdict == "The shipped choice, fast, 1 us, is on the Pareto set."


def test_each_choice_that_beats_the_shipped_one_has_its_own_reason() -> None:
    bad = _choice("bad", "3 us", 0.2, 2e-3)
    front = _front(bad, FAST, GOOD, why_not={"fast": "It is for others.", "good, 2 us": "It is new.", "": "Unused."})
    assert "good, 2 us has 0.005 of its error in 0.05 of its run time. It is new." in front.verdict
    assert "fast, 1 us has 0.5 of its error in 0.0005 of its run time. It is for others." in front.verdict
    assert "Unused" not in front.verdict


def test_run_times_within_noise_and_errors_within_the_reference_do_not_decide() -> None:
    noisy = _choice("noisy", "", 0.1, 1.1e-6, spread=0.5)
    assert set(_front(FAST, noisy).pareto) == {FAST, noisy}
    better = replace(GOOD, error=1e-6)
    slower = _choice("slower", "", 1e-9, 1e-3)
    assert slower in _front(FAST, better, slower).pareto
    assert slower not in _front(FAST, better, slower, uncertainty=1e-5).pareto


def test_order_is_the_slope_of_the_logarithms() -> None:
    steps = [0.1, 0.2, 0.4]
    assert order(steps, [3 * step**2 for step in steps]) == pytest.approx(2.0)


def test_interleaved_calls_are_all_timed() -> None:
    seconds = interleaved({"short": lambda: None, "long": lambda: np.linalg.eigvals(np.eye(40))}, 5)
    assert [len(each) for each in seconds.values()] == [5, 5]
    assert np.median(seconds["short"]) < np.median(seconds["long"])


def test_the_shipped_variant_of_the_estimator_changes_nothing() -> None:
    shipped = variants()[shipped_variant()]
    assert shipped.settings == ReconstructionSettings()
    assert shipped.block is None


def test_peers_and_stack_answer_what_theory_says_on_an_ideal_board() -> None:
    assert all(check.passed for check in theory()), [str(check) for check in theory()]


@pytest.mark.parametrize("name", long_cases(QUICK, ["charge", "inverse", "crosstalk", "tracking", "labelling"]))
def test_the_short_version_of_a_stage_passes_its_checks(name: str) -> None:
    for front in command.verified(name, SHORT):
        assert front.title in page.section(front)


@pytest.mark.spice
@pytest.mark.skipif(not ngspice.available(), reason="needs ngspice")
def test_followers_are_held_to_the_circuit() -> None:
    (front, *_) = command.stage("followers")(SHORT)
    front.verify()
    assert isinstance(front, Front)
    errors = {choice.series: choice.error for choice in front.choices}
    assert errors["one pole"] < errors["ideal"] / 10


@pytest.mark.slow
def test_the_document_and_the_results_are_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    front = _front(FAST, GOOD, question="a use", rival=GOOD.name)
    figure = Exhibit(
        "front_lines", "Lines", front.reading, ("a", "b"), [("x", 1)], lambda palette: chart.draw(front, palette),
        front.checks, lambda figure: [("x",)], ("a line", "x", "1", "y", "2", "3"),
    )  # fmt: skip
    monkeypatch.setattr(command, "measure_all", lambda names, effort: ([front, figure], {"followers": "no ngspice"}))
    assert command.main(["--short", "--out", str(tmp_path)]) == 0
    text = (tmp_path / "docs" / "runtime_accuracy.md").read_text(encoding="utf-8")
    for part in (
        "| fast | 1 us | 1 | 0.1 |", 'src="figures/front_name.svg"', 'srcset="figures/front_name_dark.svg"',
        "- followers: no ngspice", "| x | 1 |", "| [a line](#lines) | x | 1 | y | 2 | 3 |",
        "| [a use](#title) | fast, 1 us | 0.1: error [1] | good, 2 us | 0.01 x | 0.01 x |",
    ):  # fmt: skip
        assert part in text
    rows = (tmp_path / "benchmarks" / "results" / "fronts.csv").read_text(encoding="utf-8").splitlines()
    assert len(rows) == 1 + 2 * 3
    assert (tmp_path / "benchmarks" / "results" / "fronts.json").exists()


def test_a_front_that_contradicts_itself_fails_the_run_and_is_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong = _front(FAST, GOOD, checks=(Check("a quantity", 3.0, 0.0, 2.0),))
    fronts = {"charge": [wrong], "inverse": [_front(FAST, GOOD, name="right")]}
    monkeypatch.setattr(command, "stage", lambda name: lambda effort: fronts[name])
    assert command.main(["--only", "charge", "inverse", "--out", str(tmp_path)]) == 1
    assert "make fronts: name: a quantity: 3, required in 0 to 2" in capsys.readouterr().err
    text = (tmp_path / "docs" / "runtime_accuracy.md").read_text(encoding="utf-8")
    assert "- charge: failed: name: a quantity: 3" in text
    assert "front_right.svg" in text
    assert "front_name.svg" not in text


def test_parts_alone_need_another_folder(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        command.main(["--short"])
    assert "name another folder with --out" in capsys.readouterr().err


def test_the_text_on_the_hold_states_the_run_time_that_is_measured() -> None:
    [front] = command.stage("charge")(SHORT)
    held = {each.series: each.median for each in front.choices if each.parameter == "1 ms"}
    ratio = shown(held["zero-order hold"] / held["first-order hold"])
    assert f"times as much, in {ratio} of the run time." in front.reading
