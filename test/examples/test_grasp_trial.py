# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A grasp in MuJoCo with simulated boards as fingertips: held with slip feedback, dropped without."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco")

from examples.grasp_mujoco.__main__ import main, make_parser
from examples.grasp_mujoco.gripper import OBJECTS, Gripper, Task
from examples.grasp_mujoco.reaction import Outcome, outcomes, table
from examples.grasp_mujoco.trial import Trial, grasp
from support.paths import ROOT

DOCUMENT = ROOT / "docs" / "grasp.md"
TASK = Task("sphere", pull_start=0.65, pull_rate=3.0)


def test_the_object_is_held_with_slip_feedback_and_dropped_without() -> None:
    """Takes 1.8 s of two boards at 1 kHz: nothing shorter shows onset, reaction and drop."""
    held = grasp(TASK, seed=1, duration=0.95)
    dropped = grasp(TASK, seed=1, feedback=False, duration=0.95)
    assert not held.dropped
    assert dropped.dropped
    assert held.slips
    reactions = [reaction for slip, reaction in held.reactions() if slip < 0.9]
    assert max(reactions) < 0.015  # the figures of many grasps are in docs/grasp.md
    end = held.columns()[:, -1]
    assert end[1] > end[4]  # the grip exceeds the least one,
    assert end[1] < 2.5 * end[4]  # but not by much
    assert end[5] > 0.017  # nearly as high as it was lifted
    before = dropped.columns()[:, dropped.columns()[0] < dropped.slips[-1]]
    assert before[1, -1] == pytest.approx(before[4, -1], rel=0.1)  # it fell when its weight exceeded the friction


def test_a_grasp_is_the_same_each_time() -> None:
    first, second = (grasp(TASK, seed=2, duration=0.2).columns() for _ in range(2))
    np.testing.assert_array_equal(first, second)
    assert first[1, -1] > 0
    assert not np.array_equal(first[-2:], grasp(TASK, seed=3, duration=0.2).columns()[-2:])


@pytest.mark.parametrize("kind", OBJECTS)
def test_each_object_rests_on_its_pedestal_and_slides_at_its_friction(kind: str) -> None:
    """The least grip by Coulomb's law holds; a little less does not."""
    for factor, holds in ((1.15, True), (0.85, False)):
        gripper = Gripper(Task(kind, friction=0.5, pull_start=9.0))
        assert gripper.height == pytest.approx(0.0, abs=1e-6)
        for share in np.linspace(0.0, 1.0, 100):
            gripper.command(1.5, 0.02 * share)
            gripper.advance(0.3 + 0.5 * share)
        gripper.advance(1.0)
        assert gripper.height > 0.018
        gripper.command(factor * gripper.least_grip, 0.02)
        gripper.advance(1.6)
        assert (gripper.sunk < 0.003) == holds


def test_reactions_belong_to_their_slips() -> None:
    trial = Trial(TASK, True, raised=[0.5, 1.008, 1.5], slips=[1.0, 1.52, 2.0])
    times = [reaction for _, reaction in trial.reactions()]
    assert times[:2] == pytest.approx([0.008, -0.02])
    assert np.isnan(times[2])


def test_the_table_has_a_line_for_each_object_and_one_for_all() -> None:
    found = [Outcome("sphere", (0.01, float("nan")), (0.007, float("nan")), 1e-3, 1.2, 1, True, True)]
    lines = table(found).splitlines()
    assert len(lines) == 7
    assert {line.count("|") for line in lines[:4]} == {16}
    assert lines[2].startswith("| sphere | 1 | 1 | 1 | 2 | 10.0 |")
    assert "20.4 +- 6 ms" in lines[-1]


def test_the_film_of_a_grasp_is_an_animated_gif(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    image = pytest.importorskip("PIL.Image")
    from examples.grasp_mujoco.video import draw  # noqa: PLC0415

    draw(TASK, tmp_path / "grasp.gif", rate=20.0, duration=0.15)
    with image.open(tmp_path / "grasp.gif") as picture:
        assert picture.n_frames == 3
        assert picture.size == (720, 450)


def test_the_words_in_the_film_have_no_negative_zero() -> None:
    pytest.importorskip("matplotlib")
    from examples.grasp_mujoco.video import Frame, described  # noqa: PLC0415

    images = (np.full((5, 5), -1e-4), np.zeros((5, 5)))
    assert described(Frame(0.1, 0.0, 0.0, 0.0, 0.0, images)) == "0.10 s\npull 0.00 N\nfelt 0.00 N"


def documented() -> list[list[str]]:
    """Return the arguments of each command of the document."""
    blocks = "\n".join(re.findall(r"```bash\n(.*?)```", DOCUMENT.read_text(encoding="utf-8"), re.DOTALL))
    found = re.findall(r"^python -m examples\.grasp_mujoco (.*)$", blocks, re.MULTILINE)
    return [shlex.split(line, comments=True) for line in found]


def test_the_commands_of_the_document_are_accepted() -> None:
    given = [make_parser().parse_args(words) for words in documented()]
    assert {each.action for each in given} == {"run", "reaction", "video", "ros"}


def test_the_example_of_another_engine_runs(capsys: pytest.CaptureFixture[str]) -> None:
    [program] = re.findall(r"```python\n(.*?)```", DOCUMENT.read_text(encoding="utf-8"), re.DOTALL)
    exec(compile(program, "grasp.md", "exec"), {})
    assert capsys.readouterr().out == "1.0 N at 1.0 mm\n"


def test_the_command_says_what_happened(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "--for", "0.3"]) == 0
    assert "held" in capsys.readouterr().out


@pytest.mark.slow
def test_every_object_is_held_by_every_board() -> None:
    found = outcomes(range(8))
    assert all(each.held and each.dropped_without for each in found)
    times = np.array([value for each in found for value in each.reactions])
    assert np.nanmean(times) < 0.010
    assert np.mean([each.excess for each in found]) < 1.3  # times the least grip at the end


@pytest.mark.slow
@pytest.mark.ros
def test_the_commands_of_the_document_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("rclpy")
    monkeypatch.chdir(tmp_path)
    for words in documented():
        if words[0] != "reaction":  # run by the test above
            assert main(words) == int("--no-feedback" in words)
