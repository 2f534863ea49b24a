# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Calibration: verified against the parameters of the simulated board, saved in files, and used."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import yaml

from posfet_model.calibration.bench_signals import Recording
from posfet_model.calibration.calibration_file import load_calibration, save_calibration
from posfet_model.calibration.least_squares_fit import fit
from posfet_model.calibration.taxel_calibration import (
    CALIBRATED_GAIN_DEVIATION,
    CALIBRATED_LEAK_DEVIATION,
    NOMINAL_LEAK_PER_KELVIN_DEVIATION,
    Calibration,
)
from posfet_model.config import ConfigError
from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.reconstruction.taxel_faults import TaxelStatus
from posfet_model.sensor.description import SENSOR_FOLDER, load_sensor
from posfet_model.sensor.signal_chain import charge_per_newton
from posfet_sim.calibration import simulated_bench
from posfet_sim.calibration.simulated_bench import pressing_scene, record
from posfet_sim.commands import calibrate
from posfet_sim.commands.calibrate import main
from posfet_sim.commands.score import Run, perturbed, run
from posfet_sim.commands.score import main as score_main
from posfet_sim.device.error_model import ErrorModel
from posfet_sim.device.taxel_variation import draw_taxel_parameters
from posfet_sim.scene import load_scene
from support.calibrations import with_rate

SENSOR = load_sensor()
SMALL = replace(SENSOR, layout=replace(SENSOR.layout, rows=3, cols=3))
DATE = "2024-01-01T00:00:00+00:00"
ROUGH = replace(ErrorModel.default(), resets_per_hour=0.0, dead_probability=0.0, stuck_probability=0.0)
DEVICE = perturbed(SENSOR, {"leak": 20.0, "d33": 10.0, "lag": 30.0})


@pytest.fixture(scope="module")
def recording() -> Recording:
    """A recording of the board with seed 4 while each taxel is pressed."""
    return record(SENSOR, 4, ROUGH, with_rate(DEVICE))


@pytest.fixture(scope="module")
def found(recording: Recording) -> Calibration:
    return fit(SENSOR, recording, DATE)


@pytest.fixture(scope="module")
def presses(recording: Recording) -> Recording:
    """The recording without its long hold: what depends on neither relaxation nor warmth is fitted in less time."""
    kept = recording.time < pressing_scene(SENSOR, long_hold=False).period
    return Recording(recording.time[kept], recording.counts[kept], recording.temperature[kept], recording.force[kept])


def test_calibration_recovers_taxel_parameters_despite_model_mismatch(found: Calibration) -> None:
    true = draw_taxel_parameters(DEVICE, ROUGH, 4)
    nominal = SENSOR.amplifier.follower_gain / SENSOR.device.film_capacitance
    gain = true.charge_per_newton / charge_per_newton(SENSOR) * true.volts_per_charge / nominal
    # A press of 0.5 N exceeds the play operators of 0.25, 0.5 and 1 N by 0.25, 0.5 and 0.5 N, each of which reduces the
    # effective force by 1 %/0.7: 1 - 0.0143*1.25/0.5 = 0.964.
    assert np.std(found.gain / gain) < 0.005
    assert np.mean(found.gain / gain) == pytest.approx(0.964, abs=0.005)
    np.testing.assert_allclose(found.leak_time_constant, true.leak_time_constant, rtol=0.01)
    np.testing.assert_allclose(found.pyroelectric_gain, true.volts_per_charge / nominal, rtol=0.02)
    np.testing.assert_allclose(found.offset, true.offset, rtol=0, atol=0.6e-3)
    assert found.crosstalk == pytest.approx(0.02, abs=0.004)
    assert found.thermal_time_constant == pytest.approx(DEVICE.device.thermal_time_constant, rel=0.15)


def test_calibration_does_not_depend_on_the_sign_of_the_temperature_change(
    presses: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Residual charge from hysteresis must not be identified as leakage or temperature rise, whose signs differ then.
    monkeypatch.setattr(simulated_bench, "COOLING", -simulated_bench.COOLING)
    found = fit(SENSOR, presses, DATE)
    warmed = fit(SENSOR, record(SENSOR, 4, ROUGH, with_rate(DEVICE), long_hold=False), DATE)
    np.testing.assert_allclose(warmed.gain, found.gain, rtol=0.006)
    np.testing.assert_allclose(warmed.leak_time_constant, found.leak_time_constant, rtol=0.01)
    np.testing.assert_allclose(warmed.pyroelectric_gain, found.pyroelectric_gain, rtol=0.01)


def test_hold_out_error_is_a_hundred_times_below_that_of_nominal_parameters(
    recording: Recording, found: Calibration
) -> None:
    assert found.residuals is not None
    assert found.residuals.force_rms < 3e-3
    assert found.residuals.force_rms < 0.01 * found.residuals.force_rms_before
    assert 0.15 < found.residuals.samples / recording.counts.size < 0.25


def test_scores_with_model_mismatch_and_five_percent_gain_error(found: Calibration) -> None:
    scene = load_scene("press_slide_lift", SENSOR)
    calibration = found.with_gain_error(0.05, np.random.default_rng(2))
    score = run(Run(SENSOR, scene, 4.0, 4, replace(ROUGH, noisy_probability=0.0), calibration, DEVICE))
    assert score.force_rmse_pct is not None and score.force_rmse_pct < 1.5
    assert score.total_force_error_pct is not None and score.total_force_error_pct < 4.0
    assert score.cop_error_mm["mean"] is not None and score.cop_error_mm["mean"] < 0.1
    assert (score.contact_precision, score.contact_recall, score.id_switches) == (1.0, 1.0, 0)


def test_a_taxel_without_response_is_marked_dead_permanently(presses: Recording) -> None:
    counts = presses.counts.copy()
    counts[:, 7] = 0x8000
    found = fit(SENSOR, replace(presses, counts=counts), DATE)
    assert np.flatnonzero(found.dead).tolist() == [7]
    assert Reconstructor(SENSOR, found).image().status[7] == TaxelStatus.DEAD


def test_a_saved_calibration_survives_a_round_trip(found: Calibration, tmp_path: Path) -> None:
    path = tmp_path / "cal.yaml"
    gain = found.gain.copy()
    gain[3] = np.nan
    cover = {"cover_spreads": 1e-3 * np.arange(1.0, 7.0), "cover_shares": np.array([0.5, 0.2, 0.0, 0.1, 0.0, 0.2])}
    save_calibration(path, SENSOR, replace(found, gain=gain, **cover))
    again = load_calibration(path, SENSOR)
    assert again.date == DATE
    for name, values in cover.items():
        np.testing.assert_allclose(getattr(again, name), values, rtol=1e-5)
    np.testing.assert_allclose(again.gain, gain, rtol=1e-5, atol=0)
    np.testing.assert_allclose(again.offset, found.offset, rtol=1e-5, atol=1e-9)
    np.testing.assert_allclose(again.leak_time_constant, found.leak_time_constant, rtol=1e-5, atol=0)
    assert again.residuals is not None and found.residuals is not None
    assert again.residuals.force_rms == pytest.approx(found.residuals.force_rms, rel=1e-4)
    assert again.crosstalk == pytest.approx(found.crosstalk, rel=1e-4)
    assert not list(tmp_path.glob("*.part"))


@pytest.mark.parametrize(
    ("keys", "value", "words"),
    [
        (("sensor", "serial"), "B7", "another sensor"),
        (("sensor", "layout"), 9, "another layout"),
        (("sensor", "rows"), 8, "another layout"),
        (("version",), 3, "version"),
        (("taxels", "gain"), [1.0], "25 numbers"),
        (("taxels", "gain"), [float("nan")] * 25, "gain"),
        (("taxels", "dead"), [25], "dead"),
        (("crosstalk_percent",), 50, "crosstalk_percent"),
        (("colour",), 1, "unknown key"),
    ],
)
def test_a_mismatched_file_is_rejected_with_a_one_line_error(
    tmp_path: Path, keys: tuple[str, ...], value: object, words: str
) -> None:
    path = tmp_path / "cal.yaml"
    save_calibration(path, SENSOR, Calibration.nominal(SENSOR))
    document = yaml.safe_load(path.read_text())
    inner = document
    for key in keys[:-1]:
        inner = inner[key]
    inner[keys[-1]] = value
    path.write_text(yaml.safe_dump(document))
    with pytest.raises(ConfigError, match=words) as caught:
        load_calibration(path, SENSOR)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_an_insufficient_recording_is_rejected(recording: Recording) -> None:
    force = recording.force.copy()
    force[:, 5] = 0.0
    with pytest.raises(ValueError, match="taxel 5"):
        fit(SENSOR, replace(recording, force=force), DATE)
    with pytest.raises(ValueError, match="no taxel responds"):
        fit(SENSOR, replace(recording, counts=np.full_like(recording.counts, 32768)), DATE)
    with pytest.raises(ValueError, match="time constants"):
        fit(
            SENSOR,
            Recording(
                *(array[:125] for array in (recording.time, recording.counts, recording.temperature, recording.force))
            ),
            DATE,
        )


def test_the_command_writes_a_calibration_that_the_score_reads(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    shared_calibrate: Callable[..., Calibration],
) -> None:
    monkeypatch.setattr(calibrate, "calibrate", partial(shared_calibrate, long_hold=False))
    path = tmp_path / "cal.yaml"
    page = tmp_path / "report.html"
    small = tmp_path / "small.yaml"
    shipped = (SENSOR_FOLDER / "posfet_5x5.yaml").read_text()
    small.write_text(shipped.replace("rows: 5 ", "rows: 3 ").replace("cols: 5", "cols: 3"))
    sensor = ["--sensor", str(small)]
    assert main([str(path), "--report", str(page), *sensor]) == 0
    assert "hold-out set" in capsys.readouterr().out
    text = page.read_text()
    assert text.count("<svg") == 4
    assert text.count("http") == 0  # self-contained
    assert score_main(["press_slide_lift", "--calibration", str(path), "--for", "1", *sensor]) == 0
    capsys.readouterr()
    monkeypatch.setattr(calibrate, "calibrate", lambda *_: pytest.fail("an unwritable file is rejected before the fit"))
    assert main([str(tmp_path / "none" / "cal.yaml")]) == 1
    assert "cannot be written" in capsys.readouterr().err
    device = tmp_path / "device"
    os.mkfifo(device)
    assert main([str(device)]) == 1
    assert capsys.readouterr().err == f"{device}: cannot be written: not a regular file\n"
    assert device.is_fifo()
    assert main([str(path), "--report", str(tmp_path / "none" / "report.html"), *sensor]) == 1
    assert "report.html: cannot be written" in capsys.readouterr().err


def test_the_command_replaces_nothing_but_a_calibration_of_the_sensor(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    nominal = Calibration.nominal(SENSOR)
    monkeypatch.setattr(calibrate, "calibrate", lambda *_: nominal)
    path = tmp_path / "thumb.yaml"
    for content in ((SENSOR_FOLDER / "posfet_5x5.yaml").read_text(), ""):
        path.write_text(content)
        assert main([str(path)]) == 1
        reason = "exists and is no calibration of this sensor, so it is not replaced: choose another name"
        assert capsys.readouterr().err == f"{path}: {reason}\n"
        assert path.read_text() == content
    save_calibration(path, SENSOR, replace(nominal, date=DATE))
    assert main([str(path)]) == 0
    assert load_calibration(path, SENSOR).date == nominal.date != DATE
    assert main([str(path), "--serial", "T-0042"]) == 1
    assert "no calibration of this sensor" in capsys.readouterr().err


def test_a_file_of_the_first_version_is_read_with_assumed_deviations(tmp_path: Path) -> None:
    path = tmp_path / "cal.yaml"
    save_calibration(path, SENSOR, Calibration.nominal(SENSOR))
    document = yaml.safe_load(path.read_text())
    for key in (
        "relaxation_poles", "relaxation", "warmth", "temperature_sensor_lag_s", "common_gain_deviation_percent",
        "leak_temperature", "temperature_reading_deviation_mK",
        "temperature_sensor_dead_time_s",
    ):  # fmt: skip
        del document[key]
    del document["taxels"]["gain_deviation_percent"], document["taxels"]["leak_deviation_percent"]
    path.write_text(yaml.safe_dump({**document, "version": 1}))
    read = load_calibration(path, SENSOR)
    assert read.relaxation_sizes.size == 0
    assert (read.gain_deviation == CALIBRATED_GAIN_DEVIATION).all()
    assert (read.leak_deviation == CALIBRATED_LEAK_DEVIATION).all()
    assert read.leak_per_kelvin == 0.0
    assert read.leak_per_kelvin_deviation == NOMINAL_LEAK_PER_KELVIN_DEVIATION
    assert read.temperature_reading_deviation == read.temperature_sensor_dead_time == 0.0


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_taxel_with_a_stuck_bit_is_dead_and_the_others_are_calibrated(
    seed: int, shared_calibrate: Callable[..., Calibration]
) -> None:
    default = ErrorModel.default()
    board = replace(default, resets_per_hour=0.0, board=replace(default.board, stuck_bit=7))
    found = shared_calibrate(SMALL, seed, board, long_hold=False)
    sound = shared_calibrate(SMALL, seed, replace(board, board=default.board), long_hold=False)
    stuck = found.dead & ~sound.dead
    assert stuck.sum() == 1
    assert (sound.dead <= found.dead).all()
    np.testing.assert_allclose(found.gain[~found.dead], sound.gain[~found.dead], rtol=0.01)
