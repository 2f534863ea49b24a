# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""`posfet replay` into a file: the results of the model, with other calibrations and parameters."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mcap", reason="recordings need the package mcap")

from posfet.replay_command import BAD_INPUT, main
from posfet_model.calibration.calibration_file import save_calibration
from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.sensor.description import load_sensor
from posfet_sim.commands.simulate import main as simulate
from posfet_sim.recording.mcap_file import DiskFull, MessageFile
from posfet_sim.recording.mcap_reader import Recording
from posfet_sim.recording.recorded_scans import INFO, RecordedScans
from support.paths import DATA

STORED = DATA / "recording" / "posfet_0.2.0.mcap"


def images(path: Path) -> list[list[float]]:
    """Return the forces of the images of a recording."""
    messages = [each for each in Recording(path).messages() if each.topic.type == "posfet_msgs/TactileImage"]
    return [each.topic.reader.read(each.data)["force"].tolist() for each in messages]


def test_a_replay_gives_what_the_model_gives(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out.mcap"
    assert main([str(STORED), "--out", str(out), "namespace:=hand/thumb"]) == 0
    assert capsys.readouterr().out.startswith(f"{out}: 40 scans, 0 contacts; 0.0 s in ")
    sensor = load_sensor()
    model, expected = Reconstructor(sensor), []
    for scan in RecordedScans(STORED, sensor).scans():
        result = model.process(scan)
        assert result.accepted or result.unusable
        expected.append(model.image().force.tolist())
    np.testing.assert_array_equal(images(out), expected)
    overview = Recording(out).overview()
    assert overview.counts == {"/hand/thumb/contacts": 40, "/hand/thumb/image": 40}


def test_contacts_follow_the_parameters_and_the_calibration(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recording, calibration = tmp_path / "run.mcap", tmp_path / "cal.yaml"
    assert simulate(["press_slide_lift", "--out", str(recording), "--for", "0.4", "--imperfections", "none"]) == 0
    sensor = load_sensor()
    nominal = Calibration.nominal(sensor)
    save_calibration(calibration, sensor, nominal.with_gain_error(0.3, np.random.default_rng(1)))
    found = {}
    for name, words in {
        "nominal": [],
        "deaf": ["contact_threshold:=50.0"],
        "calibrated": [f"calibration_file:={calibration}"],
    }.items():
        capsys.readouterr()
        out = tmp_path / f"{name}.mcap"
        assert main([str(recording), "--out", str(out), *words]) == 0
        found[name] = capsys.readouterr().out.split("scans, ")[1].split(";")[0], images(out)[-1]
        assert Recording(out).overview().counts["/tactile/truth"] == 400
    assert found["nominal"][0] == "1 contact"
    assert found["deaf"][0] == "0 contacts"
    assert found["calibrated"][1] != found["nominal"][1]


def test_of_several_sensors_the_description_and_the_ground_truth_of_the_chosen_one_are_kept(tmp_path: Path) -> None:
    both, out = MessageFile(tmp_path / "hand.mcap", "test"), tmp_path / "out.mcap"
    for finger in ("thumb", "index"):
        one = tmp_path / f"{finger}.mcap"
        assert simulate(["press_slide_lift", "--out", str(one), "--for", "0.01", "--namespace", f"hand/{finger}"]) == 0
        topics: dict[str, int] = {}
        for message in Recording(one).messages():
            topic = message.topic
            if topic.name not in topics:
                topics[topic.name] = both.add_topic(topic.name, topic.type, topic.schema)
            both.add(topics[topic.name], message.time, message.data)
        both.add(both.add_topic(f"/hand/{finger}/info", INFO, "bool simulated"), 0, bytes([0, 1, 0, 0, 1]))
    both.close()
    assert main([str(both.path), "--out", str(out), "replay_topic:=/hand/index/raw", "namespace:=again"]) == 0
    assert Recording(out).overview().counts == {
        "/again/contacts": 10,
        "/again/image": 10,
        "/hand/index/truth": 10,
        "/hand/index/info": 1,
    }


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["none.mcap"], "none.mcap: no such file"),
        ([str(STORED), "scene:=idle"], "scene:=idle: with --out an argument must be name:=value of namespace, sensor_"),
        ([str(STORED), "max_relative_uncertainty:=best"], "max_relative_uncertainty: must be a number"),
        ([str(STORED), "sensor_file:=posfet_16x16"], "give the sensor file that they were recorded with"),
        ([str(STORED), "calibration_file:=none.yaml"], "none.yaml"),
        ([str(STORED), "display_rate:=5.0"], "display_rate:=5.0: with --out an argument must be name:=value of "),
        ([str(STORED), "namespace:=a", "namespace:=b"], "namespace: is given twice"),
        ([str(STORED), "replay_topic:=x"], "has no scans on /x, but on /tactile/raw"),
    ],
)
def test_bad_input_is_one_line(
    words: list[str], reason: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main([*words, "--out", "out.mcap"]) == BAD_INPUT
    error = capsys.readouterr().err
    assert reason in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out.mcap").exists()


class FullDisk(MessageFile):
    """A file whose disk is full at the first message that is kept from the recording."""

    def add(self, topic: int, time: int, data: bytes, sequence: int = 0) -> None:
        if topic > 2:  # contacts and image come before
            raise DiskFull(f"{self.path}: cannot be written: No space left on device")
        super().add(topic, time, data, sequence)


def test_a_full_disk_is_not_taken_for_a_damaged_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    recording, out = tmp_path / "run.mcap", tmp_path / "out.mcap"
    assert simulate(["press_slide_lift", "--out", str(recording), "--for", "0.01"]) == 0
    monkeypatch.setattr("posfet.replay_command.MessageFile", FullDisk)
    capsys.readouterr()
    assert main([str(recording), "--out", str(out)]) == BAD_INPUT
    assert capsys.readouterr().err == f"{out}: cannot be written: No space left on device\n"
