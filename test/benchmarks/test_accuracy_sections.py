# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The tables of accuracy: every effect has its rows, and one section is replaced without the others."""

from __future__ import annotations

from dataclasses import fields, replace

import pytest

pytest.importorskip("matplotlib", reason="the document has a figure")

from benchmarks.accuracy import __main__ as command
from benchmarks.accuracy import effects
from benchmarks.accuracy.ablation import PIECES
from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.sensor.description import load_sensor
from posfet_sim.device.board_effects import BoardEffects
from posfet_sim.device.film_effects import SHAPES, FilmEffects

SENSOR = load_sensor()


@pytest.mark.parametrize("moderate_too", [True, False])
def test_every_effect_of_film_and_board_is_alone_in_some_row(moderate_too: bool) -> None:
    changed: set[str] = set()
    for case in effects.alone(1, moderate_too):
        board = case.board
        of_film = {field.name for field in fields(FilmEffects) if getattr(board.film, field.name)} - set(SHAPES)
        of_board = {field.name for field in fields(BoardEffects) if getattr(board.board, field.name)}
        assert len(of_film) <= 1
        assert not (of_film and of_board)
        assert case.scene.name == "brief"
        changed |= of_film | of_board
        if board != effects.BOARD and not of_film and not of_board:
            changed |= {
                name
                for name in ("clock_jitter", "drop_probability")
                if getattr(board, name) != getattr(effects.BOARD, name)
            }
    names = {field.name for kind in (FilmEffects, BoardEffects) for field in fields(kind)} - set(SHAPES)
    assert changed == names | {"clock_jitter", "drop_probability"}


def test_all_effects_at_once_are_those_of_the_realism() -> None:
    cases = effects.together(2)
    moderate, hard = effects.BOARD.with_realism("moderate"), effects.BOARD.with_realism("hard")
    assert [case.board for case in cases] == [moderate, moderate, hard, hard]
    assert [case.stand for case in cases] == [None, effects.BOARD] * 2


def test_a_scene_plays_once_and_rests_for_longer_than_contacts_may_last() -> None:
    case = effects.by_contact(1, ["ring"])[0]
    scene, duration = case.play()
    assert duration == pytest.approx(3.2 + effects.REST)
    assert scene.local_time(duration) == duration
    warm, duration = replace(case, warming=0.1).play()
    assert warm.temperature.at(duration)[0] == pytest.approx(25.0 + 0.1 * (duration - 1.0))


def test_replacing_a_section_keeps_the_others_and_their_order() -> None:
    document = "# Accuracy\n\nHead.\n\n## Scenes\n\nOld scenes.\n\n### Part\n\nText.\n\n## Slips\n\nSlips.\n"
    new = command.replaced(document, "Real film and board", "New.\n")
    assert new == document.replace("## Slips", "## Real film and board\n\nNew.\n\n## Slips")
    assert command.replaced(new, "Scenes", "Better.") == new.replace("Old scenes.\n\n### Part\n\nText.", "Better.")
    assert command.replaced(document, "Slips", "Slips.") == document


def test_every_component_can_be_disabled() -> None:
    for without in PIECES.values():
        without.reconstructor(SENSOR, Calibration.nominal(SENSOR))
