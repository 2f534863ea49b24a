# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Calibration from recorded frames and the readings of a calibration rig with another clock."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import can
import numpy as np
import pytest

from posfet_driver.bus.frame import CLASSIC
from posfet_driver.bus.message_conversion import message_of
from posfet_driver.protocol.messages import COMMAND_OFFSET, Command, Request
from posfet_model.calibration.calibration_file import load_calibration
from posfet_model.config import ConfigError
from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.signal_chain import InverseSignalChain, charge_per_newton, volts_per_count
from posfet_sim.calibration.bench_recording import COLUMNS, Reference, Scans, combine, read_reference, read_scans
from posfet_sim.calibration.simulated_bench import pressing_scene
from posfet_sim.commands.calibrate import main
from posfet_sim.contact.indenters import Sphere
from posfet_sim.device.error_model import ErrorModel
from posfet_sim.device.simulated_board import SimulatedBoard
from posfet_sim.device.taxel_variation import draw_taxel_parameters
from posfet_sim.emulation.bus_board import BusBoard
from posfet_sim.recording.mcap_file import MessageFile
from posfet_sim.recording.message_definitions import schema_text
from posfet_sim.recording.recorded_scans import RecordedScans
from posfet_sim.recording.scan_messages import RAW, ScanMessage
from posfet_sim.scene import SceneLoads
from support.calibrations import with_rate
from support.paths import DATA

SENSOR = load_sensor()
ROUGH = replace(
    ErrorModel.default(), resets_per_hour=0.0, dead_probability=0.0, stuck_probability=0.0, noisy_probability=0.0
)
SEED = 4
EPOCH = 1.7e9
"""Time of day at which the recording begins [s]."""
LATE = 0.0372
"""[s]"""
Files = tuple[Path, Path]


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Files:
    """A recording of the simulated board, and the readings of a noisy, delayed calibration rig at 200 Hz."""
    folder = tmp_path_factory.mktemp("bench")
    log, stand = folder / "board.log", folder / "stand.csv"
    scene = pressing_scene(SENSOR, long_hold=False)
    sensor = with_rate(SENSOR)
    node = BusBoard(SimulatedBoard(sensor, SceneLoads(scene, sensor), SEED, ROUGH), SEED, 0)
    with can.Logger(str(log)) as write:
        node.receive((SENSOR.can.base_id + COMMAND_OFFSET, CLASSIC, Request(Command.START, 0).pack()), 0)
        while (now := node.next_due()) < scene.period * 1e9:
            for frame in node.due(now):
                write(message_of(frame, EPOCH + now * 1e-9))
    rng = np.random.default_rng(1)
    lines = [",".join(COLUMNS)]
    for time in np.arange(-0.2, scene.period + 0.2, 0.005).tolist():
        x, y, _, force = scene.objects[0].path.at(max(time, 0.0))
        lines.append(f"{EPOCH + time + LATE:.4f},{1e3 * x:.3f},{1e3 * y:.3f},{force + rng.normal(0.0, 1e-3):.4f}")
    stand.write_text("\n".join(lines))
    return log, stand


def arguments(files: Files, out: Path) -> list[str]:
    return [str(out), "--recording", str(files[0]), "--reference", str(files[1])]


def test_calibration_on_a_rig_recovers_the_parameters_of_the_board(
    files: Files, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "cal.yaml"
    assert main(arguments(files, path)) == 0
    output = capsys.readouterr().out
    assert float(output.split("clock delay ")[1].split(" ms")[0]) == pytest.approx(1e3 * LATE, abs=0.5)
    found, true = load_calibration(path, SENSOR), draw_taxel_parameters(SENSOR, ROUGH, SEED)
    nominal = SENSOR.amplifier.follower_gain / SENSOR.device.film_capacitance
    gain = true.charge_per_newton / charge_per_newton(SENSOR) * true.volts_per_charge / nominal
    assert np.std(found.gain / gain) < 0.005
    assert np.mean(found.gain / gain) == pytest.approx(0.964, abs=0.005)  # as in test_calibration.py
    np.testing.assert_allclose(found.leak_time_constant, true.leak_time_constant, rtol=0.01)
    assert found.residuals is not None and found.residuals.force_rms < 5e-3
    assert found.residuals.samples > 0


@pytest.mark.parametrize("slower", [0.93, 1.0, 1.08])
@pytest.mark.parametrize("hum", [0.0, 50.0, 60.0])
def test_the_delay_depends_neither_on_the_leakage_of_the_board_nor_on_hum(slower: float, hum: float) -> None:
    """A force that leaks with another time constant than the nominal one, on the middle taxel; 5 mV of hum on all."""
    step, taxels, rng = 1e-3, SENSOR.layout.taxels, np.random.default_rng(2)
    time = step * np.arange(7_000)
    knots = np.cumsum(np.tile([0.7, 0.1, 0.6, 0.1], 4))
    force = np.interp(time, knots, np.tile([0.0, 2.0, 2.0, 0.0], 4))
    kept = math.exp(-step / (slower * SENSOR.device.leak_time_constant))
    signal = np.zeros((len(time), taxels))
    for index, change in enumerate(np.diff(force).tolist()):
        signal[index + 1, taxels // 2] = kept * signal[index, taxels // 2] + math.sqrt(kept) * change
    chain, counts = InverseSignalChain(SENSOR), np.full(taxels, 0x8000, np.uint16)
    low, high = (float(chain.charge(counts + each, np.empty(taxels))[0]) for each in (0, 1000))
    counts_per_newton = 1000.0 * charge_per_newton(SENSOR) / (high - low)
    noise = SENSOR.adc.noise * rng.standard_normal(signal.shape)
    noise += (5e-3 * np.sin(2.0 * np.pi * hum * time))[:, np.newaxis]
    counts = np.rint(0x8000 + counts_per_newton * signal + noise / volts_per_count(SENSOR)).astype(np.uint16)
    readings = np.arange(0.0, time[-1], 0.005)
    values = np.stack([0.0 * readings, 0.0 * readings, np.interp(readings, time, force)])
    scans = Scans(time, counts, np.full(len(time), 25.0))
    _, late = combine(SENSOR, scans, Reference(readings + LATE, values), Sphere(2e-3, 4e6))
    assert late == pytest.approx(LATE, abs=0.03e-3)


def test_a_pose_between_two_readings_is_that_of_a_straight_line_to_the_last_digit() -> None:
    rng = np.random.default_rng(3)
    times, values = np.cumsum(rng.uniform(1e-3, 1e-2, 300)), rng.normal(0.0, 1.0, (3, 300))
    reference = Reference(times, values)
    for time in (*rng.uniform(times[0] - 0.1, times[-1] + 0.1, 1000), *times, -1.0, 9.0):
        x, y, force = (float(np.interp(time, times, row)) for row in values)
        assert reference.at(float(time)) == (x, y, 0.0, force)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "line 1: must be"),
        ("time_s,x_mm,y_mm\n", "line 1: must be"),
        ("HEAD\n1,0,0,0\n", "two readings or more"),
        ("HEAD\n1,0,0,0\n2,0,0\n", "line 3: must have 4 values, got 3"),
        ("HEAD\n1,0,0,0\n2,0,0,nan\n", "line 3: force_N must be a number in"),
        ("HEAD\n1,0,0,0\n2,0,zero,1\n", "line 3: y_mm must be a number in"),
        ("HEAD\n2,0,0,0\n1,0,0,0\n", "reading 2: time_s must be after"),
        ("\udcff", "is not UTF-8 text"),
    ],
)
def test_an_invalid_rig_file_is_rejected_with_a_one_line_error(tmp_path: Path, text: str, reason: str) -> None:
    path = tmp_path / "stand.csv"
    path.write_bytes(text.replace("HEAD", ",".join(COLUMNS)).encode("utf-8", "surrogateescape"))
    with pytest.raises(ConfigError, match=reason) as caught:
        read_reference(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_mismatched_files_are_rejected(files: Files, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    times = np.arange(0.0, 40.0, 0.005)
    for begin, force, reason in (
        (0.0, 0.1 * times, "must last from"),
        (EPOCH - 1.0, np.random.default_rng(1).uniform(0.0, 2.0, len(times)), "compare the clocks"),
        (EPOCH - 1.0, 1000.0 + 0.0 * times, "above the maximum of the ball"),
    ):
        path = tmp_path / "stand.csv"
        rows = [f"{begin + time},0,0,{newton}" for time, newton in zip(times.tolist(), force.tolist(), strict=True)]
        path.write_text("\n".join([",".join(COLUMNS), *rows]))
        assert main(arguments((files[0], path), tmp_path / "cal.yaml")) == 1
        output = capsys.readouterr().err
        assert reason in output
        assert len(output.splitlines()) == 1
    assert main([str(tmp_path / "cal.yaml"), "--reference", str(files[1])]) == 1
    assert "only valid together" in capsys.readouterr().err


def test_frames_of_another_board_are_rejected(files: Files, tmp_path: Path) -> None:
    other = replace(SENSOR, can=replace(SENSOR.can, base_id=0x300))
    with pytest.raises(ConfigError, match="no scan in it"):
        read_scans(files[0], other)
    empty = tmp_path / "empty.log"
    empty.write_text("")
    with pytest.raises(ConfigError, match="no scan in it"):
        read_scans(empty, SENSOR)
    with pytest.raises(ConfigError, match=r"scans.csv: must end with one of .mcap, .log, .asc, .blf"):
        read_scans(tmp_path / "scans.csv", SENSOR)


def test_a_recording_that_was_cut_is_said_in_one_line(
    files: Files, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("mcap", reason="recordings need the package mcap")
    stored, cut = DATA / "recording" / "posfet_0.2.0.mcap", tmp_path / "cut.mcap"
    assert read_scans(stored, SENSOR).problem == ""
    file, message = MessageFile(cut, "test"), ScanMessage(SENSOR.layout.rows, SENSOR.layout.cols)
    topic = file.add_topic("/tactile/raw", RAW, schema_text(RAW))
    for scan in RecordedScans(stored, SENSOR).scans():
        file.add(topic, scan.stamp, message.fill(scan))
    file.flush()
    size = file.size
    file.close()
    cut.write_bytes(cut.read_bytes()[:size])
    assert read_scans(cut, SENSOR).problem.startswith(f"{cut}: it was not closed; 40 messages up to byte ")
    assert main(arguments((cut, files[1]), tmp_path / "cal.yaml")) == 1
    shown, refusal = capsys.readouterr().err.splitlines()
    assert shown == read_scans(cut, SENSOR).problem
    assert "must last from" in refusal
