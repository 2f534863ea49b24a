# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The model of the stack on boards of an independent plant, each calibrated on its own stand.

Limits are those of `independent.judge.rows`, and are not tuned to what the model reaches. `HELD` and `HELD_SLOWLY` list
the rows and scenes in which the model meets them: nothing else of the table is asserted, and nothing of it is loosened.
``python -m independent.judge`` shows all rows.

Not met on board 1 with the cover `gauss`:

- none: `ridged`, `rolling` and `grasp` are wrong by 0.6 to 1.2 % in place of 0.5.
- Objects that warm the film by 0.1 K, if the stand does not: the first touch misleads. If they warm it by 30 mK, the
  scene `mixed` is wrong by 3.7 % in place of 2, and 3.2 % of it mislead in place of 1.
- Objects that warm the film by 0.1 K, on the stand too: forces are almost never valid.

- Films that conduct warmth to the taxels beside (`other_laws`): a finger that slides or rolls. Telegraph noise whose
  levels last for seconds: one that rolls.

What is in none of these lists is not met either, or was not judged.
"""

from __future__ import annotations

import fcntl
import math
import os
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from independent.contacts import COVERS, CoverName, cover_of, scenes, sphere
from independent.film import RELAXATION_TIMES, Board, Effects, Recording, gate_voltage, low_pass, play
from independent.judge import Limits, judge, rows, scans
from independent.other_laws import LAWS
from independent.stand import CLOCK_DELAY, calibrate, calibration_of, programme, recorded
from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.estimation.error_states import Shared
from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.sensor.description import load_sensor
from support.long_cases import long_cases

SENSOR = load_sensor()
STEP = 1e-3
BOARD = 1
FOLDERS: list[Path] = []
"""Folder of the calibrations while tests run."""

HELD = (("moderate", "mixed"), ("moderate", "sliding"))
"""Rows and scenes whose limits hold, on board 1 with the cover `gauss`; with one calibration, to be quick."""

HELD_SLOWLY = (
    *(
        ("none", scene)
        for scene in (
            "mixed",
            "slow",
            "sliding",
            "pad",
            "pad_slow",
            "ring",
            "tap",
            "handle",
            "power_on",
            "regrasp",
            "two_fingers",
            "hold300",
        )
    ),
    *(
        ("moderate", scene)
        for scene in (
            "pad",
            "tap",
            "ring",
            "overload",
            "grasp",
            "regrasp",
            "two_fingers",
            "ridged",
            "rolling",
            "power_on",
            "held_at_start",
            "hold300",
        )
    ),
    *((row, scene) for row in ("warmth_100mK", "warmth_100mK_step") for scene in ("pad", "slow")),
    ("warmth_30mK_objects", "pad"),
    ("warmth_30mK_objects", "regrasp"),
    ("moderate_under_way", "power_on"),
    ("moderate_under_way", "hold300"),
    *(
        (row, "mixed")
        for row in (
            "relaxation",
            "creep",
            "hysteresis",
            "warmth_30mK",
            "warmth_30mK_objects",
            "drift",
            "drift_under_way",
            "drift_dead_time",
            "bending_2",
            "bending_8",
            "bending_8_dome",
            "hum",
            "bursts",
            "stuck_bit_1",
            "stuck_bit_7",
            "telegraph",
            "timing",
            "nonlinearity",
            "gain_drift",
            "leak_halving",
        )
    ),
)
"""The same, where it takes longer: most with a calibration of their own, a quarter of a minute."""


@pytest.fixture(scope="module", autouse=True)
def calibrations(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Return the folder of the calibrations, of all processes if several run these tests."""
    base = tmp_path_factory.getbasetemp()
    FOLDERS.append((base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "calibrations")
    yield FOLDERS[-1]
    FOLDERS.pop()


def calibrated(row: str, number: int, cover: CoverName, law: str = "film") -> tuple[Board, Calibration]:
    """Return a board and its calibration, which one process makes, and all that need it share."""
    board, folder = LAWS[law](SENSOR, rows()[row].effects, number), FOLDERS[-1]
    folder.mkdir(exist_ok=True)
    with (folder / f"{cover}-{row}-{number}-{law}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        return board, calibration_of(board, cover, folder)


def check(row: str, scene: str, cover: CoverName = "gauss", law: str = "film") -> None:
    board, calibration = calibrated(row, BOARD, cover, law)
    limits = rows()[row].scenes[scene]
    assert limits != Limits(None, None, None), "nothing is required"
    verdict = judge(board, calibration, cover, scenes()[scene])
    assert not verdict.failures(limits), verdict


@pytest.mark.parametrize(("row", "scene"), HELD)
def test_the_model_meets_the_requirements(row: str, scene: str) -> None:
    check(row, scene)


def test_a_cover_as_in_the_sensor_file_stays_one() -> None:
    _, calibration = calibrated("moderate", BOARD, "gauss")
    np.testing.assert_array_equal(calibration.cover_shares, np.eye(len(calibration.cover_spreads))[0])


def test_bending_is_that_of_the_chip_wherever_the_ball_presses() -> None:
    # Part of a ball over the edge presses beside the array: the load cell shows it, the taxels do not. Counted as a
    # force on the taxels alone, bending came out 13 % too large, and 20 % in the middle.
    board, calibration = calibrated("moderate", BOARD, "gauss")
    size = board.effects.bending
    assert calibration.bending[0] == pytest.approx(size, rel=0.05)
    np.testing.assert_allclose(calibration.bending_profile, 1.0, rtol=0, atol=0.06)


def test_a_pad_that_follows_another_is_not_taken_for_a_drift_of_the_chip() -> None:
    # Half a second after a pad the rate of the chip is hardly known. Free to change as soon as under a warm finger, it
    # became that of the next pad's rise: no force at all, and valid. Each block of such a rise is less than its noise.
    board, calibration = calibrated("moderate", BOARD, "gauss")
    verdict = judge(board, calibration, "gauss", scenes()["pad_slow"])
    assert verdict.error < 4.0
    assert verdict.misleading < 5.0


def test_a_pad_that_presses_the_whole_array_within_four_seconds_is_no_colder_film() -> None:
    # Zeros of all taxels made a film of its force that cools, whatever the sensors showed: 48 % of it were missing.
    board, calibration = calibrated("moderate", BOARD, "gauss")
    verdict = judge(board, calibration, "gauss", scenes()["pad_slower"])
    assert verdict.error < 20.0
    assert verdict.total > 85.0


def test_a_light_touch_is_not_valid_while_warmth_may_hide_it() -> None:
    # 0.2 N within 10 s: no contact lists it for six seconds, and the filter knows nothing of what it warms.
    board, calibration = calibrated("moderate", BOARD, "gauss")
    verdict = judge(board, calibration, "gauss", scenes()["slow"])
    assert verdict.misleading <= 1.0
    assert verdict.total >= 90.0
    assert verdict.error < 25.0


def test_a_tap_within_a_scan_or_two_is_within_its_deviation() -> None:
    # The film answers it more than the presses of a calibration by 6 to 14 %, within a block that is not over.
    board, calibration = calibrated("moderate", BOARD, "gauss")
    verdict = judge(board, calibration, "gauss", scenes()["tap"])
    assert min(verdict.taxels, verdict.total) >= 90.0


def test_objects_of_other_temperatures_are_within_the_deviation() -> None:
    # What one object taught of the warmth counted as known of the next one: 72 % of the totals were within it.
    board, calibration = calibrated("moderate", BOARD, "gauss")
    objects = replace(board, effects=replace(board.effects, warmth_spread=0.25))
    verdict = judge(objects, calibration, "gauss", scenes()["regrasp"])
    assert min(verdict.taxels, verdict.total) >= 95.0


@pytest.mark.slow
def test_a_board_that_warms_up_reads_no_force_that_is_none() -> None:
    # 5 K within a minute: leakage as at the calibration made 1.5 N of 0.8, and 3.8 N that nothing caused, for good.
    board, calibration = calibrated("moderate", BOARD, "gauss")
    verdict = judge(board, calibration, "gauss", scenes()["power_on"])
    assert not verdict.failures(Limits(3.0, 90.0, 2.0, clean=True, left=0.02)), verdict


@pytest.mark.slow
def test_what_warmth_hides_of_a_light_touch_warms_as_well() -> None:
    # Where weak forces are hidden altogether, it is most of the force that warms: 20 % of the scans were valid.
    board, calibration = calibrated("moderate", 12, "gauss")
    verdict = judge(board, calibration, "gauss", scenes()["slow"])
    assert verdict.valid < 12.0
    assert verdict.misleading == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("cover", ["layer", "half_space"])
def test_a_cover_that_is_no_gaussian_is_found_by_the_presses(cover: CoverName) -> None:
    # Spread as a Gaussian of the sensor file, the forces on the taxels gave gains that were wrong by 4 and 7 %.
    board, calibration = calibrated("none", BOARD, cover)
    np.testing.assert_allclose(calibration.gain, board.gain, rtol=0.02)
    verdict = judge(board, calibration, cover, scenes()["mixed"])
    assert verdict.error < 0.8
    assert verdict.misleading == 0.0


@pytest.mark.slow
def test_crosstalk_is_no_cover() -> None:
    calibration = calibrate(Board(SENSOR, rows()["none"].effects, BOARD), "gauss", crosstalk=0.02)
    assert calibration.crosstalk == pytest.approx(0.02, abs=1e-3)
    np.testing.assert_array_equal(calibration.cover_shares, np.eye(len(calibration.cover_spreads))[0])


@pytest.mark.slow
def test_an_edge_that_moves_is_no_drift_of_the_chip() -> None:
    # It covers most of the array, and the taxels beside it feel more of it as it moves there: not that the film cools.
    board, calibration = calibrated("none", BOARD, "gauss")
    verdict = judge(board, calibration, "gauss", scenes()["handle"])
    assert verdict.error < 0.5  # 0.84 % before


@pytest.mark.slow
@pytest.mark.parametrize("row", ["moderate_under_way", "drift_under_way"])
def test_a_film_that_warms_since_before_the_start_reads_no_force(row: str) -> None:
    # Zeros show no warming at all. Explained by a wrong scale of the sensors, it became forces of 5 N that stayed.
    board, calibration = calibrated(row, 5, "gauss")
    verdict = judge(board, calibration, "gauss", scenes()["power_on"])
    assert not verdict.failures(Limits(2.0, 90.0, 1.0, clean=True, left=0.02)), verdict


@pytest.mark.parametrize("number", [2, 3])
def test_a_strong_hum_at_the_start_is_no_warming_of_the_film(number: int) -> None:
    # It is found after 0.2 s. Until then it made the film warm by up to 1 K/s, and offsets went along: for seconds.
    board = Board(SENSOR, rows()["hum"].effects, number)
    recording = board.record(scenes()["ring"].load(SENSOR, "gauss", number), 5)
    reconstructor = Reconstructor(SENSOR, None)
    for scan in islice(scans(SENSOR, recording), 1000):
        result = reconstructor.process(scan)
    rate = reconstructor._estimator.belief.shared[Shared.RATE]
    assert result.valid
    assert abs(rate) < 5e-3


@pytest.mark.slow
def test_a_taxel_that_measures_nothing_under_a_bar_at_an_angle_is_interpolated() -> None:
    # Estimated as up to 0.47 N in place of 0.19 N: 3.7 % wrong, 24 % of the scans misled.
    board, calibration = calibrated("stuck_bit_7", 6, "gauss")
    verdict = judge(board, calibration, "gauss", scenes()["handle"])
    assert not verdict.failures(Limits(1.0, 90.0, 1.0)), verdict


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["pad", "slow"])
def test_a_hum_that_drifts_is_tracked_while_the_whole_array_is_touched(scene: str) -> None:
    # It was predicted there: 4.6 % wrong, 18 % of the scans misled; 0.2 N within 10 s was 8 % wrong.
    board, calibration = calibrated("hum", 1, "gauss")
    verdict = judge(board, calibration, "gauss", scenes()[scene])
    assert not verdict.failures(Limits(2.0, 90.0, 1.0)), verdict


@pytest.mark.slow
@pytest.mark.parametrize(("row", "scene"), HELD_SLOWLY)
def test_the_model_meets_the_requirements_of_single_effects(row: str, scene: str) -> None:
    check(row, scene)


@pytest.mark.slow
@pytest.mark.parametrize("cover", ["layer", "half_space"])
@pytest.mark.parametrize("scene", ["mixed", "sliding", "pad"])
def test_the_requirements_are_met_under_other_covers(scene: str, cover: CoverName) -> None:
    check("moderate", scene, cover)


@pytest.mark.slow
def test_what_is_beside_ridges_that_move_does_not_cool_the_film() -> None:
    # Two corners rose together. Each as if by itself, they were a film that cools: 84 % of the totals covered.
    board, calibration = calibrated("drift", BOARD, "gauss")
    verdict = judge(board, calibration, "gauss", scenes()["ridged"])
    assert min(verdict.taxels, verdict.total) >= 90.0, verdict
    assert verdict.misleading <= 10.0, verdict  # 32 % before


@pytest.mark.slow
@pytest.mark.parametrize(
    ("constant", "value", "number", "changes"),
    [
        # What a sensor showed a second ago was what it shows now: 15 % wrong, 15 % of the totals covered, 17 % misled.
        pytest.param("SENSOR_RATE", 1.0, 15, {}, id="read once a second"),
        # Readings with 20 mK of noise were believed to 3.5 mK: 11 % wrong, 31 % of the totals covered, 12 % misled.
        pytest.param("SENSOR_NOISE", 0.02, 1, {}, id="noisy"),
        # Cooling by 20 mK/s more than expected halved the warmth: 73 % of the totals covered, 15 % misled.
        pytest.param("SENSOR_STEP", 1.0 / 64.0, 1, {"warmth_force": 0.016}, id="coarse"),
    ],
)
def test_a_light_touch_after_a_strong_one_is_right_with_poor_temperature_sensors(
    constant: str, value: float, number: int, changes: dict[str, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(f"independent.film.{constant}", value)
    board = Board(SENSOR, replace(rows()["moderate"].effects, **changes), number)
    verdict = judge(board, calibrate(board, "gauss"), "gauss", scenes()["overload"])
    assert not verdict.failures(Limits(None, 90.0, 2.0)), verdict


@pytest.mark.slow
def test_a_light_touch_that_became_uncertain_after_a_strong_one_is_not_released() -> None:
    # 0.1 N were zero after 1.6 s, valid: 51 % of the totals covered, 46 % misled.
    board, calibration = calibrated("moderate", 8, "gauss")
    verdict = judge(board, calibration, "gauss", scenes()["overload"])
    assert not verdict.failures(Limits(None, 90.0, 2.0)), verdict


@pytest.mark.slow
def test_a_board_that_leaks_as_slowly_as_a_film_relaxes_is_calibrated() -> None:
    # Its time constant of 1 s was that of a pole: both together were a leakage of 10 s, and refused.
    slow = replace(SENSOR, device=replace(SENSOR.device, leak_time_constant=1.0))
    board = Board(slow, rows()["moderate"].effects, 15)
    verdict = judge(board, calibrate(board, "gauss"), "gauss", scenes()["mixed"])
    assert not verdict.failures(rows()["moderate"].scenes["mixed"]), verdict


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["pad", "pad_slow"])
def test_pads_are_measured_while_the_chip_drifts_by_2_kelvin_a_minute(scene: str) -> None:
    # Zeros of all taxels made the film seem to turn: 16 % of the scans of slow pads misled.
    board, calibration = calibrated("drift", BOARD, "gauss")
    verdict = judge(board, calibration, "gauss", scenes()[scene])
    assert not verdict.failures(Limits(2.0, 90.0, 1.0)), verdict


@pytest.mark.slow
@pytest.mark.parametrize("row", ["moderate", "warmth_30mK"])
def test_slow_pads_bring_the_warmth_of_their_beginning(row: str) -> None:
    # For a third of a second they count as a warmer film. What they warmed in that time was lost: 2.5 to 3 % of
    # the scans of ten boards misled.
    verdicts = [judge(*calibrated(row, number, "gauss"), "gauss", scenes()["pad_slow"]) for number in range(1, 6)]
    assert np.mean([each.error for each in verdicts]) <= 2.4
    assert np.mean([each.misleading for each in verdicts]) <= 2.0


@pytest.mark.slow
def test_what_is_least_significant_of_a_contact_with_the_whole_array_is_not_released_alone() -> None:
    # Taxels that still felt 10 to 20 mN became zeros, and with them all: 29 and 43 % of the scans misled.
    for number in (1, 6):
        board, calibration = calibrated("drift_under_way", number, "gauss")
        verdict = judge(board, calibration, "gauss", scenes()["ridged"])
        assert verdict.misleading <= 12.0, verdict
        assert min(verdict.taxels, verdict.total) >= 90.0, verdict


@pytest.mark.parametrize("row", long_cases(["none", "warmth_300mK"], ["warmth_300mK"]))
def test_the_clock_of_a_stand_is_found_whether_its_ball_is_warm_or_not(row: str) -> None:
    # Warmth that comes in after a force made the force look as if it came 0.75 ms earlier.
    _, delay = recorded(Board(SENSOR, rows()[row].effects, 1), "gauss")
    assert delay == pytest.approx(CLOCK_DELAY, abs=1e-4)


@pytest.mark.slow
def test_a_stand_whose_ball_is_hot_is_named() -> None:
    # By 0.3 K. The line was that the presses are too short.
    with pytest.raises(ValueError, match=r"^warmth: the ball .* by 0.3.* K, more than 0.2 K: press with an object"):
        calibrate(Board(SENSOR, rows()["warmth_300mK"].effects, 1), "gauss")


@pytest.mark.slow
@pytest.mark.parametrize("number", [1, 2])
def test_a_board_with_all_effects_at_their_hard_size_is_calibrated_and_covered(number: int) -> None:
    # Its presses counted as too short, as warmth by 0.1 K looks like leakage.
    board, calibration = calibrated("hard", number, "gauss")
    assert calibration.warmth == pytest.approx(0.1, abs=0.02)
    verdict = judge(board, calibration, "gauss", scenes()["mixed"])
    assert verdict.misleading == 0.0, verdict
    assert min(verdict.taxels, verdict.total) >= 90.0, verdict


@pytest.mark.slow
@pytest.mark.parametrize(("number", "scene"), [(1, "mixed"), (6, "mixed"), (1, "regrasp"), (4, "regrasp")])
def test_objects_that_are_far_hotter_than_on_the_stand_are_not_valid(number: int, scene: str) -> None:
    # They warm the film by 0.3 K: forces read below zero, and what their warmth left as forces.
    _, calibration = calibrated("none", number, "gauss")
    hot = Board(SENSOR, rows()["warmth_300mK"].effects, number)
    verdict = judge(hot, calibration, "gauss", scenes()[scene])
    assert verdict.misleading <= 1.0, verdict


@pytest.mark.parametrize(("number", "scene"), long_cases([(1, "mixed"), (4, "regrasp")], [(4, "regrasp")]))
def test_hot_objects_are_not_valid_without_calibration_either(number: int, scene: str) -> None:
    # What touches was below zero, counted as released, and then as a touch: 4 and 12 % misled.
    verdict = judge(Board(SENSOR, rows()["warmth_300mK"].effects, number), None, "gauss", scenes()[scene])
    assert verdict.misleading <= 1.0, verdict


@pytest.mark.slow
@pytest.mark.parametrize("number", [1, 2])
def test_a_light_touch_that_its_warmth_hides_is_not_valid_and_leaves_no_force(number: int) -> None:
    # 0.1 N after 20 N. It was zero, valid, after a second: 45 and 39 % misled, and 2.8 and 0.6 N stayed.
    board, calibration = calibrated("warmth_100mK", number, "gauss")
    verdict = judge(board, calibration, "gauss", scenes()["overload"])
    assert verdict.misleading <= 1.0, verdict
    assert verdict.lasting == 0, verdict
    assert abs(verdict.left) <= 0.02, verdict


@pytest.mark.slow
@pytest.mark.parametrize(
    "row",
    [
        "warmth_100mK",
        "warmth_100mK_soft",
        "warmth_100mK_stiff",
        "warmth_100mK_step",
    ],
)
def test_a_film_that_hides_more_than_a_weak_force_loses_no_edge_of_a_contact(row: str) -> None:
    # The edges of a hold read zero, one after the other: 18, 28 and 4 % wrong; where a force of 10 mN warms all, 26 %.
    board, calibration = calibrated(row, 2, "gauss")
    verdict = judge(board, calibration, "gauss", scenes()["mixed"])
    assert verdict.error <= 10.0, verdict
    assert verdict.misleading <= 1.0, verdict
    assert verdict.lasting == 0, verdict


@pytest.mark.slow
@pytest.mark.parametrize("row", ["moderate_soft", "moderate_stiff", "moderate_step"])
def test_an_object_that_warms_weakly_touched_taxels_more_or_less_is_measured_as_well(row: str) -> None:
    for scene in ("mixed", "sliding"):
        check(row, scene)


@pytest.mark.slow
def test_ridges_on_the_whole_array_are_measured_soon_after_the_start() -> None:
    # The error of the first temperature reading was a warming since before it: 15 % wrong, 62 % of the scans misled.
    # Nothing on the array shows the film's temperature for seconds: of a deviation of 15 % some errors are beyond 10 %.
    limits, misleading = rows()["moderate"].scenes["ridged"], []
    for number in (2, 3, 4, 5):
        board, calibration = calibrated("moderate", number, "gauss")
        verdict = judge(board, calibration, "gauss", scenes()["ridged"])
        assert verdict.error <= limits.error, verdict
        misleading.append(verdict.misleading)
    assert np.mean(misleading) <= limits.misleading, misleading


CONDUCTION = pytest.mark.xfail(strict=True, reason="10 and 12 % too low: a film that conducts warmth is not known")
RARE = pytest.mark.xfail(strict=True, reason="a level that changes as the force moves looks like a part of that force")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("law", "scene"),
    [
        *((law, scene) for law in LAWS if law not in {"film", "conduction"} for scene in ("mixed", "sliding")),
        *((law, "rolling") for law in LAWS if law not in {"film", "conduction", "telegraph_rare"}),
        ("conduction", "mixed"),
        pytest.param("conduction", "sliding", marks=CONDUCTION),
        pytest.param("conduction", "rolling", marks=CONDUCTION),
        pytest.param("telegraph_rare", "rolling", marks=RARE),
    ],
)
def test_films_and_boards_of_other_laws_are_measured_as_well(law: str, scene: str) -> None:
    # The estimator was made with the laws of one plant in view; these are of the same sizes.
    check("moderate", scene, law=law)


@pytest.mark.slow
@pytest.mark.parametrize(("number", "scene"), [(4, "mixed"), (4, "regrasp"), (6, "regrasp")])
def test_a_signal_that_steps_as_the_force_moves_is_corrected(number: int, scene: str) -> None:
    # One taxel drifted by 4 mN/s from then on: up to 36 % of the scans misled, and a contact stayed.
    board, calibration = calibrated("moderate", number, "gauss", "telegraph_rare")
    verdict = judge(board, calibration, "gauss", scenes()[scene])
    assert verdict.error < 1.5, verdict
    assert verdict.misleading <= rows()["moderate"].scenes[scene].misleading, verdict
    assert not verdict.lasting, verdict


@pytest.mark.slow
@pytest.mark.parametrize("number", [1, 2, 3])
def test_an_object_that_is_warmer_than_that_of_the_stand_leaves_nothing(number: int) -> None:
    # What its film left stayed as forces of up to 1 N: 70 to 80 % of the scans misled.
    board, calibration = calibrated("warm_object_100mK", number, "gauss")
    verdict = judge(board, calibration, "gauss", scenes()["regrasp"])
    assert verdict.misleading < 10.0, verdict  # of the first touch
    assert not verdict.lasting, verdict
    assert abs(verdict.left) < 0.02, verdict


@pytest.mark.slow
@pytest.mark.parametrize("number", [1, 2, 3, 4])
def test_what_touched_at_the_start_leaves_nothing(number: int) -> None:
    # Three of these boards never became valid, and the fourth misled in 69 % of the scans.
    board, calibration = calibrated("moderate", number, "gauss")
    verdict = judge(board, calibration, "gauss", scenes()["held_at_start"])
    assert verdict.valid > 70.0, verdict  # what is not is the time before the release
    assert verdict.error_valid < 3.0, verdict
    assert verdict.total >= 90.0, verdict
    assert verdict.misleading <= 2.0, verdict
    assert not verdict.lasting, verdict


# The plant itself


def test_a_gate_leaks_with_its_time_constant() -> None:
    time = STEP * np.arange(2000)
    charge = (time >= 0.1)[:, None] * np.ones(2)
    tau = np.array([0.2, 0.3])
    volts = gate_voltage(charge, tau, 0.0, STEP)
    # The step rises within one scan: its middle is half a scan before the first one with the charge.
    rise = STEP / tau
    expected = -np.expm1(-rise) / rise * np.exp(-(time[100:, None] - 0.1) / tau)
    np.testing.assert_allclose(volts[100:], expected, rtol=0.0, atol=1e-9)


def test_a_gate_relaxes_as_its_network_in_small_steps() -> None:
    tau, relaxation, parts = 0.27, 0.03, 100
    charge = np.zeros((400, 1))
    charge[100:] = 1.0
    volts = gate_voltage(charge, np.array([tau]), relaxation, STEP)[:, 0]
    times, small = np.array(RELAXATION_TIMES), STEP / parts
    branches, leaked, expected = np.zeros(len(times)), 0.0, []
    for index in range(parts * 399 + 1):
        now = float(np.interp(index / parts, np.arange(400), charge[:, 0]))
        voltage = now - 0.5 * relaxation * branches.sum() - leaked
        if index % parts == 0:
            expected.append(voltage)
        branches += small * (voltage - branches) / times
        leaked += small * voltage / tau
    np.testing.assert_allclose(volts, expected, rtol=0.0, atol=2e-4)  # explicit Euler steps of 10 us


def test_relaxation_without_leakage_is_its_share_per_decade() -> None:
    charge = np.concatenate([[[0.0]], np.ones((4000, 1))])
    volts = gate_voltage(charge, np.array([1e9]), 0.03, STEP)[:, 0]
    assert math.isclose(1.0 / volts[1000] - 1.0 / volts[100], 0.03, abs_tol=0.002)  # of the capacitance


def test_a_lag_is_exact_for_a_ramp() -> None:
    time = STEP * np.arange(3000, dtype=np.float64)
    lag = low_pass(time[:, None], np.array([0.5]), STEP)[:, 0]
    np.testing.assert_allclose(lag, time + 0.5 * np.expm1(-time / 0.5), rtol=0.0, atol=1e-9)


def test_play_operators_leave_half_their_width_behind() -> None:
    force = np.concatenate([np.linspace(0.0, 1.0, 200), np.linspace(1.0, 0.0, 200)])[:, None]
    sizes = np.array([0.05, 0.2])
    pulled = play(force, sizes, np.array([1.0, 0.5]))[:, 0]
    assert math.isclose(pulled[199], -0.05 - 0.1, abs_tol=1e-12)
    assert math.isclose(pulled[-1], 0.05 + 0.1, abs_tol=1e-12)


@pytest.mark.parametrize("size", [0.01, 0.03])
def test_hysteresis_is_the_opening_of_the_widest_loop(size: float) -> None:
    board = Board(SENSOR, Effects(hysteresis=size), 1)
    widest = 0.0
    for top in (0.1, 0.3, 1.0, 2.0, 5.0):
        rise = np.linspace(0.0, top, 401)
        force = np.tile(np.concatenate([rise, rise[::-1]])[:, None], SENSOR.layout.taxels)
        charge = board._charge(force, force.sum(axis=1), STEP)[:, 0]  # the film alone, without leakage
        widest = max(widest, float((charge[:400:-1] - charge[:401]).max()) / top)
    assert math.isclose(widest, size, rel_tol=0.1)


@pytest.mark.parametrize("cover", COVERS)
def test_a_cover_keeps_the_force(cover: CoverName) -> None:
    shares = cover_of(SENSOR, cover).shares(sphere(2e-3), np.zeros(1), np.zeros(1), np.ones(1))
    assert 0.98 < shares.sum() <= 1.0 + 1e-6  # the rest is beside the array
    assert shares.min() >= 0.0


def test_the_cover_of_the_sensor_file_spreads_like_a_gaussian() -> None:
    spread, pitch = SENSOR.device.contact_spread, SENSOR.layout.pitch_x
    needle = cover_of(SENSOR, "gauss").shares(sphere(2e-3), np.zeros(1), np.zeros(1), np.zeros(1))[0]
    middle = SENSOR.layout.taxels // 2
    own = math.erf(0.5 * pitch / (math.sqrt(2.0) * spread))
    assert math.isclose(needle[middle], own**2, rel_tol=2e-3)  # pressures are drawn on a grid of 0.05 mm
    assert math.isclose(
        needle[[middle - 1, middle + 1]].sum(),
        own * (math.erf(1.5 * pitch / math.sqrt(2.0) / spread) - own),
        rel_tol=5e-3,
    )


def test_the_same_board_has_the_same_scans_and_another_has_others() -> None:
    load = scenes()["tap"].load(SENSOR, "gauss", 1)
    first, again, other = (Board(SENSOR, rows()["timing"].effects, seed).record(load, 5) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.counts, again.counts)
    assert (first.counts[:1000] != other.counts[:1000]).any()


@pytest.mark.parametrize("name", list(scenes()))
def test_every_scene_begins_and_ends_at_rest(name: str) -> None:
    scene = scenes()[name]
    ends = [touch.force[-1][0] for touch in scene.touches]
    assert min(touch.force[0][0] for touch in scene.touches) >= 2.0
    assert scene.duration - max(ends) >= 5.0
    assert all(touch.force[0][1] == touch.force[-1][1] == 0.0 for touch in scene.touches)


def test_the_stand_presses_every_taxel() -> None:
    load = programme(SENSOR).load(SENSOR, "gauss", 1)
    assert (load.force.max(axis=0) > 0.2).all()
    assert not load.force[:2000].any()


@cache
def tapped(law: str) -> Recording:
    """Return what a board of a law records of taps."""
    effects = replace(rows()["moderate"].effects, lost=0.0, telegraph=20e-3, drift=0.03, sensor_lag=1.0)
    return LAWS[law](SENSOR, effects, BOARD).record(scenes()["tap"].load(SENSOR, "gauss", BOARD), 1)


@pytest.mark.parametrize(
    "law",
    long_cases(
        [law for law in LAWS if law != "film"], ["loops_closed", "conduction", "sensors_two_stages", "telegraph_rare"]
    ),
)
def test_another_law_makes_other_signals_of_the_same_size(law: str) -> None:
    ours, others = tapped("film"), tapped(law)
    differ = ours.counts.astype(float) - others.counts
    differ_read = np.abs(ours.temperatures - others.temperatures).max()
    assert differ.any() or differ_read > 0.0
    assert np.abs(differ).max() < 0.2 * np.ptp(ours.counts.astype(float), axis=0).max()
