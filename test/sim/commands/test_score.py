# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The score: an ideal board scores well, wrong parameters show, and invalid input gives one-line errors."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.sensor.description import load_sensor
from posfet_sim.commands import score as score_command
from posfet_sim.commands.score import Run, main, perturbed, run
from posfet_sim.contact.indenters import Sphere
from posfet_sim.device.error_model import MODERATE, ErrorModel
from posfet_sim.emulation.offline import received_scans
from posfet_sim.evaluation.scorer import Score, Scorer
from posfet_sim.evaluation.slip_scorer import SlipScorer
from posfet_sim.loads import Loads
from posfet_sim.scene import Keyframes, SceneObject, load_scene
from support.calibrations import with_rate
from support.long_cases import long_cases

SENSOR = load_sensor()
SLOWER = with_rate(SENSOR)
"""A quarter of the scans, where neither slips nor single scans matter."""
SCENE = load_scene("press_slide_lift", SENSOR)
NAMES = [
    "force_rmse_pct",
    "total_force_error_pct",
    "cop_error_mm",
    "contact_precision",
    "contact_recall",
    "id_switches",
    "detection_latency_scans",
    "held_force_drift_pct",
    "false_contacts_per_hour",
    "slip_onset_delay_ms",
    "slip_recall",
    "false_slips_per_hour",
    "total_force_worst_pct",
    "coverage_pct",
    "valid_pct",
    "misleading_pct",
    "contacts_left",
    "us_per_scan",
]

MEETING = """
name: meeting
description: two fingertips slide together until they merge, and separate again
temperature_degC: 25.0
objects:
  - name: left
    kind: sphere
    radius_mm: 1.5
    effective_modulus_MPa: 8.0
    keyframes:
      - {time_s: 0.4, x_mm: -2.6, y_mm: 0.0, force_N: 0.0}
      - {time_s: 0.6, x_mm: -2.6, y_mm: 0.0, force_N: 0.8}
      - {time_s: 2.0, x_mm: -0.8, y_mm: 0.0, force_N: 0.8}
      - {time_s: 3.5, x_mm: -2.6, y_mm: 0.0, force_N: 0.8}
      - {time_s: 3.7, x_mm: -2.6, y_mm: 0.0, force_N: 0.0}
  - name: right
    kind: sphere
    radius_mm: 1.5
    effective_modulus_MPa: 8.0
    keyframes:
      - {time_s: 0.4, x_mm: 2.6, y_mm: 0.0, force_N: 0.0}
      - {time_s: 0.6, x_mm: 2.6, y_mm: 0.0, force_N: 1.0}
      - {time_s: 2.0, x_mm: 0.8, y_mm: 0.0, force_N: 1.0}
      - {time_s: 3.5, x_mm: 2.6, y_mm: 0.0, force_N: 1.0}
      - {time_s: 3.7, x_mm: 2.6, y_mm: 0.0, force_N: 0.0}
"""


STRONG = """
name: strong
description: a ball presses with 4 N, and lifts
temperature_degC: 25.0
objects:
  - name: ball
    kind: sphere
    radius_mm: 4.0
    effective_modulus_MPa: 5.0
    keyframes:
      - {time_s: 0.5, x_mm: 0.3, y_mm: 0.2, force_N: 0.0}
      - {time_s: 0.8, x_mm: 0.3, y_mm: 0.2, force_N: 4.0}
      - {time_s: 1.5, x_mm: 0.3, y_mm: 0.2, force_N: 4.0}
      - {time_s: 1.7, x_mm: 0.3, y_mm: 0.2, force_N: 0.0}
"""


@pytest.fixture(scope="module")
def calibrated(shared_calibrate: Callable[..., Calibration]) -> Calibration:
    """Calibration of the board with seed 1, pressed taxel by taxel."""
    return shared_calibrate(SENSOR, 1, replace(ErrorModel.default(), resets_per_hour=0.0))


def test_an_ideal_board_scores_well() -> None:
    score = run(Run(SENSOR, SCENE, 4.0))
    assert list(asdict(score)) == NAMES
    assert score.force_rmse_pct is not None and score.force_rmse_pct < 0.05
    assert score.total_force_error_pct is not None and score.total_force_error_pct < 0.5
    assert score.cop_error_mm["p95"] is not None and score.cop_error_mm["p95"] < 0.05
    assert (score.contact_precision, score.contact_recall, score.id_switches) == (1.0, 1.0, 0)
    assert score.detection_latency_scans is not None and score.detection_latency_scans <= 2
    assert score.false_contacts_per_hour == 0.0
    assert score.held_force_drift_pct is None
    assert (score.slip_recall, score.false_slips_per_hour) == (None, 0.0)


@pytest.mark.slow
def test_the_drift_of_a_held_force_is_scored() -> None:
    """The noise before the touch decides about one board; the mean of three tells more."""
    scene = load_scene("hold", SENSOR)
    drifts = [run(Run(SENSOR, scene, 7.0, seed)).held_force_drift_pct for seed in (1, 2, 3)]
    assert all(drift is not None and drift > 0.0 for drift in drifts)
    assert np.mean(drifts) < 0.5


def test_every_stick_slip_event_of_a_cylinder_is_one_slip() -> None:
    score = run(Run(SENSOR, load_scene("grasp_lift_slip", SENSOR), 3.0))
    assert score.slip_recall == 1.0
    assert score.slip_onset_delay_ms["mean"] is not None and 0.0 <= score.slip_onset_delay_ms["mean"] < 6.0


def test_forces_beside_noisy_taxels_in_a_contact_are_not_taken_for_bending(calibrated: Calibration) -> None:
    """Two taxels in the middle of this board are noisy: their neighbours feel a part of what these are pressed with."""
    score = run(Run(SENSOR, load_scene("texture", SENSOR), 1.6, 1, ErrorModel.default(), calibrated))
    assert score.total_force_error_pct is not None and score.total_force_error_pct < 3.0
    assert score.coverage_pct["total"] > 90.0
    assert score.misleading_pct == 0.0


@pytest.mark.slow
def test_a_slow_press_on_noisy_taxels_is_felt(calibrated: Calibration) -> None:
    """0.2 N within 10 s onto the two: each block raises them, and their neighbours, by less than noise."""
    score = run(Run(SENSOR, load_scene("slow_press", SENSOR), 9.0, 1, ErrorModel.default(), calibrated))
    assert score.total_force_error_pct is not None and score.total_force_error_pct < 20.0
    assert score.misleading_pct == 0.0


def test_a_light_touch_after_an_overload_is_felt() -> None:
    """0.1 N a second after 20 N, on the same taxel."""
    score = run(Run(SLOWER, load_scene("overload", SENSOR), 6.5))
    assert score.misleading_pct < 3.0
    assert score.coverage_pct["total"] > 90.0


@pytest.mark.slow
def test_a_light_touch_after_an_overload_on_noisy_taxels_is_in_the_total_force(calibrated: Calibration) -> None:
    """Their thresholds are higher for a while: no contact lists 0.1 N on them, but their readings show it.

    Once zeros of the taxels beside them may have taken 20 mN of it, forces are not valid.
    """
    score = run(Run(SENSOR, load_scene("overload", SENSOR), 6.5, 1, ErrorModel.default(), calibrated))
    assert score.coverage_pct["total"] is not None and score.coverage_pct["total"] > 95.0
    assert score.valid_pct is not None and score.valid_pct > 75.0


@pytest.mark.slow
def test_what_a_press_within_10_s_loses_is_in_the_deviations(calibrated: Calibration) -> None:
    """The taxel that carries most of the force is dead on this board."""
    score = run(Run(SENSOR, load_scene("slow_press", SENSOR), 15.0, 1, ErrorModel.default(), calibrated))
    assert score.valid_pct is not None and score.valid_pct > 98.0
    assert score.coverage_pct["taxel"] is not None and score.coverage_pct["taxel"] > 95.0
    assert score.coverage_pct["total"] is not None and score.coverage_pct["total"] > 85.0


@pytest.mark.slow
def test_what_a_real_film_keeps_of_an_overload_is_covered(shared_calibrate: Callable[..., Calibration]) -> None:
    """Preload, creep and hysteresis of 20 N are 1.5 N then, and 80 mN after the release."""
    real = ErrorModel.default().with_realism(MODERATE)
    what = shared_calibrate(SENSOR, 1, real)
    score = run(Run(SENSOR, load_scene("overload", SENSOR), 6.5, 1, real, what))
    assert score.coverage_pct["total"] is not None and score.coverage_pct["total"] > 80.0


@pytest.mark.slow
@pytest.mark.parametrize("time", [0.2, 1.7])
def test_the_time_constant_of_the_warmth_of_what_touches_does_not_matter_once_calibrated(
    time: float, shared_calibrate: Callable[..., Calibration]
) -> None:
    ideal = ErrorModel.none()
    film = replace(ideal.film, contact_warmth=0.03, contact_warmth_time=time)
    errors = replace(ideal, film=film, thermal_noise=ErrorModel.default().thermal_noise)
    calibrated = shared_calibrate(SENSOR, 1, errors)
    score = run(Run(SENSOR, SCENE, 6.0, 1, errors, calibrated))
    assert score.total_force_error_pct is not None and score.total_force_error_pct < 1.5
    assert score.coverage_pct["total"] is not None and score.coverage_pct["total"] > 95.0
    assert score.misleading_pct == 0.0


@pytest.mark.parametrize(
    ("name", "duration"), long_cases([("press_slide_lift", 6.0), ("overload", 6.5)], [("overload", 6.5)])
)
def test_the_hysteresis_of_a_film_is_subtracted_once_calibrated(
    name: str, duration: float, shared_calibrate: Callable[..., Calibration]
) -> None:
    """Of 3 %: small forces make up to 6 % less charge than strong ones, and some stays when they have gone."""
    ideal = ErrorModel.none()
    errors = replace(
        ideal,
        film=replace(ideal.film, minor_loops=0.03),
        thermal_noise=ErrorModel.default().thermal_noise,
    )
    calibrated = shared_calibrate(SENSOR, 1, errors, long_hold=False)
    score = run(Run(SLOWER, load_scene(name, SENSOR), duration, 1, errors, calibrated))
    assert score.total_force_error_pct is not None and score.total_force_error_pct < 0.8
    assert score.coverage_pct["total"] is not None and score.coverage_pct["total"] > 95.0
    assert score.misleading_pct is not None and score.misleading_pct < 1.0


@pytest.mark.slow
def test_a_light_touch_of_a_film_that_is_much_warmer_is_right_or_not_valid(
    shared_calibrate: Callable[..., Calibration],
) -> None:
    """By 0.1 K: as much as 0.1 N on a taxel. Its warmth may hide that it is still there."""
    keys = ((1.0, 0.0), (1.1, 3.0), (2.5, 3.0), (2.6, 0.0), (3.5, 0.0), (3.6, 0.1), (4.7, 0.1), (4.8, 0.0))
    course = Keyframes(tuple(time for time, _ in keys), tuple((0.2e-3, 0.0, 0.0, force) for _, force in keys))
    scene = replace(SCENE, period=math.inf, objects=(SceneObject("fingertip", Sphere(5e-3, 2e6), course),))
    ideal = ErrorModel.none()
    film = replace(ideal.film, contact_warmth=0.1)
    errors = replace(ideal, film=film, thermal_noise=ErrorModel.default().thermal_noise)
    score = run(Run(SENSOR, scene, 7.0, 1, errors, shared_calibrate(SENSOR, 1, errors)))
    assert score.misleading_pct is not None and score.misleading_pct < 1.0
    assert score.valid_pct is not None and score.valid_pct > 25.0


LIFTS = "a slip is reported as one of two fingers lifts"


@pytest.mark.parametrize(
    "name",
    [
        *long_cases(["press", "slide", "grasp_lift_slip", "vibration"], ["press", "grasp_lift_slip"]),
        pytest.param("two_fingers_slide", marks=(pytest.mark.slow, pytest.mark.xfail(strict=True, reason=LIFTS))),
    ],
)
def test_score_with_the_full_error_model_and_5_percent_gain_error(name: str, calibrated: Calibration) -> None:
    """Two taxels in the middle of this board are noisy."""
    what = calibrated.with_gain_error(0.05, np.random.default_rng(1))
    scene = load_scene(name, SENSOR)
    score = run(Run(SENSOR, scene, scene.duration, 1, ErrorModel.default(), what))
    assert (score.contact_precision, score.contact_recall, score.id_switches) == (1.0, 1.0, 0)
    assert score.detection_latency_scans is not None and score.detection_latency_scans <= 2
    assert score.cop_error_mm["mean"] is not None and score.cop_error_mm["mean"] <= 0.1
    assert score.force_rmse_pct is not None and score.force_rmse_pct <= 1.5
    assert score.false_slips_per_hour == score.false_contacts_per_hour == 0.0


def test_wrong_gains_are_no_warmth_of_the_object(calibrated: Calibration) -> None:
    """They leave something of a slip behind, too, on few taxels: the next grasp had four times the error."""
    what = calibrated.with_gain_error(0.05, np.random.default_rng(1))
    score = run(Run(SLOWER, load_scene("grasp_lift_slip", SENSOR), 6.0, 1, ErrorModel.default(), what))
    assert score.total_force_error_pct is not None and score.total_force_error_pct < 0.5


def test_two_contacts_that_merge_and_separate_keep_their_ids(tmp_path: Path) -> None:
    path = tmp_path / "meeting.yaml"
    path.write_text(MEETING)
    score = run(Run(SLOWER, load_scene(path, SENSOR), 4.0))
    assert (score.contact_precision, score.id_switches, score.false_contacts_per_hour) == (1.0, 0, 0.0)
    assert score.contact_recall is not None and 0.5 < score.contact_recall < 1.0, "the two contacts never merged"


def test_residual_hysteresis_after_a_strong_touch_is_no_contact(tmp_path: Path) -> None:
    path = tmp_path / "strong.yaml"
    path.write_text(STRONG)
    what = Run(SLOWER, load_scene(path, SENSOR), 4.0, 1, replace(ErrorModel.none(), hysteresis=0.01))
    found = run(what)
    assert found.contact_precision == 1.0
    assert found.contact_recall == 1.0


GRAZING = """
name: grazing
description: a fingertip presses twenty times a second and grazes in between
temperature_degC: 25.0
objects:
  - name: finger
    kind: sphere
    radius_mm: 3.0
    effective_modulus_MPa: 2.0
    path: {kind: sine, start_s: 0.5, end_s: 1.5, rise_s: 0.1, x_mm: 0.0, y_mm: 0.0, force_N: 0.5, amplitude_N: 0.499,
           frequency_Hz: 20.0}
"""


def test_each_press_after_a_grazing_touch_is_a_new_contact(tmp_path: Path) -> None:
    path = tmp_path / "grazing.yaml"
    path.write_text(GRAZING)
    scene = load_scene(path, SENSOR)
    assert run(Run(SENSOR, scene, 1.6)).id_switches == 0
    insensitive = replace(SENSOR, contact=replace(SENSOR.contact, threshold=1.0))
    scorer, reconstructor = Scorer(SENSOR), Reconstructor(insensitive)
    for scan, truth in received_scans(SENSOR, scene, 1.6, 1):
        scorer.add(reconstructor.process(scan), reconstructor.image(), truth)
    assert scorer.score(0.0).detection_latency_scans == pytest.approx(47, abs=3), "presses never detected"


def test_strong_taps_of_100_ms_are_not_slips(tmp_path: Path, calibrated: Calibration) -> None:
    presses = [(0.65, -0.1), (-0.3, 0.71), (-0.43, -0.56), (-0.4, -0.5), (-1.4, 0.2), (-0.9, -0.3), (-0.3, 0.7)]
    lines = ["name: strong", "description: a ball presses and lifts", "temperature_degC: 25.0", "objects:"]
    for index, (x, y) in enumerate(presses):
        path = f"{{kind: slide, start_s: {0.4 + 0.36 * index:.2f}, end_s: {0.66 + 0.36 * index:.2f}, rise_s: 0.1,"
        path += f" x_mm: {x}, y_mm: {y}, to_x_mm: {x}, to_y_mm: {y}, force_N: 3.0}}"
        lines += [f"  - name: ball {index}", "    kind: sphere", "    radius_mm: 4.0", "    effective_modulus_MPa: 2.0"]
        lines += [f"    path: {path}"]
    path = tmp_path / "strong.yaml"
    path.write_text("\n".join(lines))
    what = calibrated.with_gain_error(0.05, np.random.default_rng(1))
    found = run(Run(SENSOR, load_scene(path, SENSOR), 3.0, 1, ErrorModel.default(), what))
    assert found.false_slips_per_hour == 0.0
    # A press that begins 100 ms after the last one is found up to 5 ms after it reaches the threshold: what those
    # taxels read at rest is less certain until they have been still for 60 ms.
    assert found.contact_recall > 0.998


def test_missed_and_false_slips_are_counted() -> None:
    slips = SlipScorer()
    for scan, truth in received_scans(SENSOR, load_scene("grasp_lift_slip", SENSOR), 2.5, 1):
        slips.add(truth, {0: 1}, {7} if scan.sequence == 1500 else set())
    assert (slips.recall(), slips.delay()["max"], slips.false) == (0.0, None, 1)
    assert slips.missed == 3


def test_a_gain_error_appears_in_the_score_to_the_percent() -> None:
    wrong = replace(Calibration.nominal(SENSOR), gain=np.full(25, 1 / 1.1))
    score = run(Run(SLOWER, SCENE, 3.0, calibration=wrong))
    assert score.total_force_error_pct == pytest.approx(10.0, abs=0.5)
    stiffer = perturbed(SLOWER, {"d33": 10.0})
    score = run(Run(SLOWER, SCENE, 3.0, device=stiffer))
    assert score.total_force_error_pct == pytest.approx(10.0, abs=0.5)


def test_misplaced_contacts_count_as_false_and_as_missed() -> None:
    scorer, reconstructor = Scorer(SENSOR), Reconstructor(SENSOR)
    for scan, truth in received_scans(SENSOR, SCENE, 1.0, 1):
        elsewhere = replace(truth.objects, contact_centres=truth.objects.contact_centres + 5e-3)
        shifted = replace(truth, loads=Mock(spec=Loads, objects=Mock(return_value=elsewhere)))
        scorer.add(reconstructor.process(scan), reconstructor.image(), shifted)
    score: Score = scorer.score(0.0)
    assert score.contact_precision == 0.0
    assert score.false_contacts_per_hour > 3000


def test_every_received_scan_has_its_ground_truth_under_link_faults() -> None:
    ideal = [(scan.sequence, truth.sequence) for scan, truth in received_scans(SENSOR, SCENE, 1.0, 1)]
    assert len(ideal) >= 999
    assert all(scan == truth for scan, truth in ideal)
    bad = replace(
        ErrorModel.none(), drop_probability=0.02, truncation_probability=0.02, resets_per_hour=3600.0, reset_time=0.1
    )
    faulty = list(received_scans(SENSOR, SCENE, 3.0, 1, bad))
    assert 2000 < len(faulty) < 2950


def test_the_json_output_has_exactly_these_keys(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--for", "1", "--mismatch", "5", "--device", "leak=20", "--seed", "3", "--calibration", "none"]
    assert main(["press_slide_lift", *words]) == 0
    assert list(json.loads(capsys.readouterr().out)) == NAMES


def test_a_board_is_calibrated_before_scoring_by_default(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, shared_calibrate: Callable[..., Calibration]
) -> None:
    monkeypatch.setattr(score_command, "calibrate", shared_calibrate)
    errors = []
    for more in ([], ["--calibration", "none"]):
        assert main(["press", "--for", "2", *more]) == 0
        errors.append(json.loads(capsys.readouterr().out)["total_force_error_pct"])
    assert errors[0] < 2.0
    assert errors[1] > 5.0


@pytest.mark.parametrize(
    "words",
    [["nowhere"], ["press_slide_lift", "--imperfections", "nowhere.yaml"], ["idle", "--sensor", "nowhere"]],
)
def test_invalid_files_give_one_line_errors(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(words) == 1
    assert len(capsys.readouterr().err.splitlines()) == 1


@pytest.mark.parametrize("words", [["--mismatch", "x"], ["--device", "mass=3"], ["--for", "-1"], ["--seed", "nan"]])
def test_invalid_arguments_are_rejected(words: list[str]) -> None:
    with pytest.raises(SystemExit):
        main(["idle", *words])
