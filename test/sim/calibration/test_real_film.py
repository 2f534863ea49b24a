# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Calibration of boards whose film relaxes, creeps and warms, and refusal of what cannot be fitted."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from posfet_model.calibration.bench_signals import runs
from posfet_model.calibration.calibration_file import load_calibration, save_calibration
from posfet_model.calibration.fit_checks import FitError
from posfet_model.calibration.fit_steps import MIN_TEMPERATURE_RANGE
from posfet_model.calibration.least_squares_fit import fit
from posfet_model.calibration.taxel_calibration import (
    CALIBRATED_COMMON_GAIN_DEVIATION,
    NOMINAL_BENDING_DEVIATION,
    NOMINAL_WARMTH_DEVIATION,
    NOMINAL_WARMTH_FORCE,
    NOMINAL_WARMTH_TIME_CONSTANT,
    Calibration,
)
from posfet_model.config import ConfigError
from posfet_model.sensor.description import load_sensor
from posfet_sim.calibration.report import report
from support.film_bench import Alteration, Board, Film, gain_at_once, record, with_slow_charge

SHIPPED = load_sensor()
SENSOR = replace(SHIPPED, layout=replace(SHIPPED.layout, rows=4, cols=4))
HELD = 5
"""The taxel of the long hold: that next to the middle."""
DATE = "2024-01-01T00:00:00+00:00"
Floats = NDArray[np.float64]

FILMS = {
    "sensors 0.1 s late": Film(sensor_lag=0.1),
    "relaxation and creep": Film(relaxation=0.03, creep=0.05, sensor_lag=1.0),
    "a fast object": Film(warmth=0.03, warmth_time=0.2),
    "a slow object": Film(warmth=0.03, warmth_time=1.7),
    "bending": Film(bending=8e-3, bending_moment=2e-3),
    "all": Film(relaxation=0.02, creep=0.04, warmth=0.03, sensor_lag=1.0, bending=2e-3, ramp=2.0 / 60.0),
}
HYSTERETIC = {
    "loops of four sizes": Film(hysteresis=0.03),
    "loops of one size": Film(hysteresis=0.03, plays=(0.1,)),
    "loops of five sizes": Film(hysteresis=0.03, plays=(0.02, 0.05, 0.12, 0.25, 0.8)),
}


LONG = ("a fast object", "a slow object", "all")
"""What takes longest to fit, and the whole array to tell its causes apart."""
EACH = pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow if name in LONG else ()) for name in FILMS]
)


class Fits(dict[str, tuple[Board, Calibration]]):
    """Boards and their calibrations by the name of the film, made when they are asked for."""

    def __missing__(self, name: str) -> tuple[Board, Calibration]:
        sensor = SHIPPED if name in LONG else SENSOR
        board = record(sensor, FILMS[name])
        self[name] = board, fit(sensor, board.recording, DATE)
        return self[name]


@pytest.fixture(scope="module")
def fitted() -> Fits:
    return Fits()


@EACH
def test_gain_and_leakage_are_right_whatever_the_film_does(name: str, fitted: Fits) -> None:
    board, found = fitted[name]
    np.testing.assert_allclose(found.gain, board.gain * gain_at_once(FILMS[name]), rtol=0.01)
    np.testing.assert_allclose(found.leak_time_constant, board.leak_time_constant, rtol=0.01)
    np.testing.assert_allclose(found.pyroelectric_gain, 1.0, rtol=0.02)


@EACH
def test_the_lag_is_found_with_either_sign(name: str, fitted: Fits) -> None:
    # A reading has 2 mK of noise while the chip cools and warms by 0.75 K/s: 3 ms, and fewer with 50 readings or more.
    found = fitted[name][1]
    assert found.thermal_time_constant is not None
    film, sensors = SENSOR.device.thermal_time_constant, FILMS[name].sensor_lag
    assert found.thermal_time_constant - found.temperature_sensor_lag == pytest.approx(film - sensors, abs=0.01)


def test_the_poles_predict_a_held_force(fitted: Fits) -> None:
    """Charge of a force that rises within 0.1 s and is held for 20 s; without poles the growth itself is the error."""
    film = FILMS["relaxation and creep"]
    found = fitted["relaxation and creep"][1]
    time = np.arange(0.0, 20.0, 0.004)
    force = np.minimum(time / 0.1, 1.0)[:, None]
    true = with_slow_charge(time, force, film)[:, 0] / gain_at_once(film)
    predicted = force[:, 0].copy()
    for tau, size in zip(found.relaxation_time_constants, found.relaxation_sizes, strict=True):
        predicted += size * -np.expm1(-np.maximum(time - 0.05, 0.0) / tau)
    held = time > 0.2
    assert np.max(np.abs(true - 1.0)[held]) > 0.1
    assert np.max(np.abs(predicted - true)[held] / true[held]) < 0.01


@EACH
def test_the_temperature_rise_of_touched_taxels_is_found_beside_the_rest(name: str, fitted: Fits) -> None:
    found = fitted[name][1]
    assert abs(found.warmth - FILMS[name].warmth) < found.warmth_deviation
    assert found.warmth_deviation < NOMINAL_WARMTH_DEVIATION


@pytest.mark.slow
@pytest.mark.parametrize("name", LONG)
def test_the_time_constant_of_that_rise_is_found(name: str, fitted: Fits) -> None:
    assert fitted[name][1].warmth_time_constant == pytest.approx(FILMS[name].warmth_time, rel=0.15)


@pytest.mark.slow
@pytest.mark.parametrize("half", [0.004, 0.04])
def test_the_force_that_causes_most_of_that_rise_is_found(half: float) -> None:
    """The film saturates otherwise than the fit: as F/(F + half), and so by 1 - 1/e at 1.72 times that force."""
    board = record(SENSOR, Film(warmth=0.03, warmth_force=half))
    found = fit(SENSOR, board.recording, DATE)
    assert found.warmth_force == pytest.approx(half * (math.e - 1.0), rel=0.4)
    assert found.warmth_steepness == 1.0
    assert abs(found.warmth - 0.03) < found.warmth_deviation


@pytest.mark.slow
@pytest.mark.parametrize("step", [0.006, 0.03])
def test_a_rise_that_is_whole_from_a_force_on_is_found_as_a_steep_one(step: float) -> None:
    board = record(SENSOR, Film(warmth=0.03, warmth_force=step, warmth_power=20.0))
    found = fit(SENSOR, board.recording, DATE)
    assert found.warmth_steepness >= 4.0
    assert found.warmth_force == pytest.approx(step, rel=0.25)
    assert abs(found.warmth - 0.03) < found.warmth_deviation


def test_a_film_that_does_not_warm_keeps_the_nominal_time_constant_and_force(
    fitted: Fits,
) -> None:
    # What fits best is the time constant of something else, and would be one of all that remains after a touch.
    cold = [name for name in FILMS if FILMS[name].warmth == 0.0]
    assert cold
    for name in cold:
        assert fitted[name][1].warmth_time_constant == NOMINAL_WARMTH_TIME_CONSTANT
        assert fitted[name][1].warmth_force == NOMINAL_WARMTH_FORCE


def loop_gain(film: Film, force: float) -> float:
    """Return the signal per force from end to end of a loop between 0 and a force [1]."""
    weight = 0.5 * film.hysteresis / sum(film.plays)
    return 1.0 + weight * sum(max(0.0, 1.0 - 2.0 * width / force) for width in film.plays)


@pytest.mark.slow
@pytest.mark.parametrize("name", HYSTERETIC)
def test_hysteresis_is_neither_relaxation_nor_a_temperature_nor_leakage(name: str) -> None:
    """The film has play operators of other half widths than the fit."""
    film = HYSTERETIC[name]
    board = record(SENSOR, film)
    found = fit(SENSOR, board.recording, DATE)
    assert (np.abs(found.relaxation_sizes) < 3.0 * found.relaxation_deviations).all()
    assert found.relaxation_deviations.max() < 6e-3
    assert abs(found.warmth) < 1e-3
    assert found.warmth_time_constant == NOMINAL_WARMTH_TIME_CONSTANT
    np.testing.assert_allclose(found.leak_time_constant, board.leak_time_constant, rtol=0.005)
    np.testing.assert_allclose(found.gain, board.gain * loop_gain(film, 0.3), rtol=0.01)
    assert found.common_gain_deviation > CALIBRATED_COMMON_GAIN_DEVIATION
    for force in (0.1, 0.9):
        assert abs(loop_gain(film, force) - loop_gain(film, 0.3)) < 2.0 * found.common_gain_deviation


@pytest.mark.slow
def test_hysteresis_leaves_the_rest_of_the_film_as_it_is(fitted: Fits) -> None:
    without = fitted["all"][1]
    board = record(SHIPPED, replace(FILMS["all"], hysteresis=0.015))
    found = fit(SHIPPED, board.recording, DATE)
    assert found.warmth == pytest.approx(without.warmth, abs=1e-3)
    assert found.warmth_time_constant == pytest.approx(without.warmth_time_constant, rel=0.05)
    change = np.abs(found.relaxation_sizes - without.relaxation_sizes)
    assert (change < 2.0 * found.relaxation_deviations).all()
    assert change.max() < 5e-3


@EACH
def test_the_bending_of_the_chip_is_found(name: str, fitted: Fits) -> None:
    film, found = FILMS[name], fitted[name][1]
    # With relaxation, a gain is that of 30 ms after a force, and the bending that at once.
    expected = np.array([film.bending, 0.0, 0.0, film.bending_moment])
    tolerance = 4.0 * found.bending_deviation + 0.05 * film.bending
    assert (np.abs(found.bending - expected) < tolerance).all()
    assert (found.bending_deviation < 0.1 * np.array(NOMINAL_BENDING_DEVIATION)).all()


def test_the_report_names_the_bending(fitted: Fits) -> None:
    found = fitted["bending"][1]
    assert f"{1e3 * found.bending[0]:.2f} ± {1e3 * found.bending_deviation[0]:.2f} mN/N" in report(SENSOR, found)
    assert "not in the file" in report(SENSOR, replace(found, bending=np.zeros(0), bending_deviation=np.zeros(0)))


@pytest.mark.parametrize(
    ("times", "reason"),
    [
        ([0.1, 1.0, 10.0, 100.0], r"must be a whole number in \[0, 3\]"),
        ([0.1, 10.0, 1.0], "must be in ascending order"),
    ],
)
def test_poles_that_the_model_does_not_have_are_refused(
    times: list[float], reason: str, fitted: Fits, tmp_path: Path
) -> None:
    none = np.zeros(len(times))
    found = replace(
        fitted["bending"][1],
        relaxation_time_constants=np.array(times), relaxation_sizes=none, relaxation_deviations=none,
    )  # fmt: skip
    save_calibration(tmp_path / "cal.yaml", SENSOR, found)
    with pytest.raises(ConfigError, match=reason):
        load_calibration(tmp_path / "cal.yaml", SENSOR)


def test_a_file_without_bending_is_read(fitted: Fits, tmp_path: Path) -> None:
    none = replace(fitted["bending"][1], bending=np.zeros(0), bending_deviation=np.zeros(0))
    save_calibration(tmp_path / "cal.yaml", SENSOR, none)
    assert load_calibration(tmp_path / "cal.yaml", SENSOR).bending.size == 0


def test_a_film_without_a_pyroelectric_signal_is_calibrated_while_its_temperature_changes() -> None:
    sensor = replace(SENSOR, device=replace(SENSOR.device, pyroelectric_coefficient=0.0))
    board = record(sensor, Film(), long_hold=False)
    assert np.ptp(board.recording.temperature) > MIN_TEMPERATURE_RANGE
    found = fit(sensor, board.recording, DATE)
    np.testing.assert_allclose(found.gain, board.gain, rtol=0.01)
    assert (found.pyroelectric_gain == 1.0).all()


def test_a_taxel_that_is_pressed_in_the_long_hold_alone_is_named() -> None:
    recording = record(SENSOR, Film()).recording
    begin, end = max(runs(recording.force[:, HELD] > 0.1), key=lambda run: run[1] - run[0])
    force = recording.force.copy()
    force[:, 7] = 0.0
    force[begin:end, 7] = 0.3
    with pytest.raises(
        ValueError, match=r"^taxel 7 must be pressed before the long hold, or well after it, but was not$"
    ):
        fit(SENSOR, replace(recording, force=force), DATE)


def test_a_bending_that_no_chip_has_is_refused() -> None:
    board = record(SENSOR, Film(bending=0.05), long_hold=False)
    with pytest.raises(FitError, match=r"^bending: must be within .* got 4[5-9]"):
        fit(SENSOR, board.recording, DATE)


def test_standard_deviations_cover_the_errors_of_the_fit(fitted: Fits) -> None:
    board, found = fitted["sensors 0.1 s late"]
    for value, true, deviation in (
        (found.gain, board.gain, found.gain_deviation),
        (found.leak_time_constant, board.leak_time_constant, found.leak_deviation),
    ):
        # 50 values within four standard deviations: a chance of 0.3 % to fail if the deviations are right.
        assert np.abs(value / true - 1.0).max() < 4.0 * deviation.max()
        assert deviation.max() < 0.005


def test_without_a_long_hold_there_are_no_poles_and_the_report_says_so() -> None:
    board = record(SENSOR, Film(), long_hold=False)
    found = fit(SENSOR, board.recording, DATE)
    np.testing.assert_allclose(found.gain, board.gain, rtol=0.01)
    assert found.relaxation_sizes.size == 0
    assert (found.warmth, found.warmth_deviation) == (0.0, NOMINAL_WARMTH_DEVIATION)
    assert report(SENSOR, found).count("not observable") == 2


def late_press(time: Floats, source: Floats) -> Floats:
    """A ball that pressed taxel 7 by 32 ms later than the reference says."""
    changed = source.copy()
    changed[8:, 7] = source[:-8, 7]
    return changed


def slip_while_held(time: Floats, source: Floats) -> Floats:
    """A ball that slips off by a tenth of its force within ten seconds of the long hold, unknown to the reference."""
    changed = source.copy()
    changed[:, HELD] *= 1.0 - 0.2 * np.clip((time - 60.0) / 2.0, 0.0, 1.0)
    return changed


@pytest.mark.parametrize(
    ("change", "temperature", "part"),
    [
        (late_press, None, "^presses of taxel 7: "),
        (lambda _, source: 5.0 * source, None, "^gain of taxel 0: .*reference force"),
        (slip_while_held, None, f"^long hold: .*taxel {HELD}"),
        (None, lambda time, reading: reading[::-1], "^temperature part: "),
        (None, lambda time, reading: reading + 0.2 * np.sin(time), "^temperature part: .*sensors"),
    ],
)
def test_what_cannot_be_fitted_is_refused_with_the_name_of_the_part(
    change: Alteration | None, temperature: Alteration | None, part: str
) -> None:
    board = record(SENSOR, Film(), long_hold=change is slip_while_held, change=change, sensors=temperature)
    with pytest.raises(FitError, match=part) as caught:
        fit(SENSOR, board.recording, DATE)
    assert "\n" not in str(caught.value)


def test_a_leakage_far_from_the_sensor_file_is_refused() -> None:
    board = record(SENSOR, Film(), long_hold=False)
    device = replace(SENSOR.device, leak_time_constant=8.0 * SENSOR.device.leak_time_constant)
    with pytest.raises(FitError, match=r"^leakage of taxel \d+: .*leak_time_constant_s"):
        fit(replace(SENSOR, device=device), board.recording, DATE)


def test_poles_and_deviations_survive_a_round_trip(fitted: Fits, tmp_path: Path) -> None:
    found = fitted["bending"][1]
    save_calibration(tmp_path / "cal.yaml", SENSOR, found)
    again = load_calibration(tmp_path / "cal.yaml", SENSOR)
    for name in (
        "relaxation_time_constants", "relaxation_sizes", "relaxation_deviations", "gain_deviation", "leak_deviation",
        "common_gain_deviation", "warmth", "warmth_deviation", "temperature_sensor_lag",
        "temperature_reading_deviation", "temperature_sensor_dead_time",
        "warmth_time_constant", "warmth_force", "warmth_steepness", "bending", "bending_deviation",
        "bending_profile",
        "hysteresis_half_widths", "hysteresis_weights", "hysteresis_slope",
        "chip_warming_time_constants", "chip_warming",
        "thermal_time_constant", "temperature",
    ):  # fmt: skip
        np.testing.assert_allclose(getattr(again, name), getattr(found, name), rtol=1e-5, err_msg=name)


def test_a_file_with_the_share_of_a_weak_force_is_read(fitted: Fits, tmp_path: Path) -> None:
    path, found = tmp_path / "cal.yaml", fitted["bending"][1]
    for share, force in ((0.0, 0.05), (50.0, 0.0158), (100.0, 0.005)):
        save_calibration(path, SENSOR, found)
        lines = path.read_text(encoding="utf-8").splitlines()
        (at,) = (index for index, line in enumerate(lines) if "saturation_force_mN" in line)
        lines[at] = f"  weak_share_percent: {share}"
        path.write_text("\n".join(lines), encoding="utf-8")
        again = load_calibration(path, SENSOR)
        assert again.warmth_force == pytest.approx(force, rel=1e-2)
        assert again.warmth_time_constant == pytest.approx(found.warmth_time_constant, rel=1e-5)
