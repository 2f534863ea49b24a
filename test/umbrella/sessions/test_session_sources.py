# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Sessions of recordings and of boards on a bus."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import posfet
from posfet_model import Calibration, load_sensor
from posfet_sim.commands.simulate import main as simulate_command

pytest.importorskip("mcap")


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("sessions") / "press.mcap"
    assert posfet.simulate("press", seed=4).record(path, seconds=0.8) == 800
    return path


def test_a_replay_repeats_the_session_that_was_recorded(recording: Path) -> None:
    before, after = posfet.simulate("press", seed=4).arrays(seconds=0.8), posfet.replay(recording).arrays()
    for name, array in after.as_dict().items():
        if name.startswith("true"):  # recorded in single precision
            np.testing.assert_allclose(array, before.as_dict()[name], rtol=1e-6)
        else:
            assert array.tobytes() == before.as_dict()[name].tobytes(), name


def test_a_replay_knows_objects_and_that_they_were_simulated(recording: Path) -> None:
    session = posfet.replay(recording)
    assert session.simulated
    truth = list(session.truth())[-1]
    assert truth.objects.names == ("fingertip",)
    assert truth.objects.contact_forces[0] == pytest.approx(truth.force.sum(), rel=0.01)
    assert "800 of 800 scans" in session.state


def test_a_replay_uses_another_calibration(recording: Path) -> None:
    sensor = load_sensor()
    calibration = replace(Calibration.nominal(sensor), gain=np.full(25, 2.0))
    plain, calibrated = (posfet.replay(recording, calibration=each).arrays() for each in (None, calibration))
    np.testing.assert_array_equal(plain.counts, calibrated.counts)
    valid = plain.valid & calibrated.valid & (plain.total > 0.1)
    assert valid.sum() > 100
    np.testing.assert_allclose(calibrated.total[valid] / plain.total[valid], 0.5, atol=0.05)


def test_files_of_the_command_are_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "command.mcap"
    assert simulate_command(["press", "--seed", "4", "--for", "0.2", "--out", str(path)]) == 0
    capsys.readouterr()
    np.testing.assert_array_equal(
        posfet.replay(path).arrays().counts, posfet.simulate("press", seed=4).arrays(seconds=0.2).counts
    )


def test_a_recording_is_loaded_as_arrays(recording: Path) -> None:
    arrays = posfet.load(recording, ["raw"])
    assert arrays["tactile/raw/counts"].shape == (800, 25)
    assert not any(name.startswith("tactile/truth") for name in arrays)


def test_a_file_is_not_overwritten(recording: Path) -> None:
    with pytest.raises(posfet.ConfigError, match="File exists; choose another name"):
        posfet.simulate().record(recording, seconds=0.1)


def test_the_whole_path_of_a_board_behind_an_adapter() -> None:
    with posfet.open("emulator:hold", timeout=60.0, seed=1) as session:
        assert session.simulated
        frame = next(session.frames())
        assert frame.image.force.shape == (5, 5)
        assert frame.truth is not None
        assert frame.truth.sequence == frame.sequence
        assert "receiving scans" in session.state
    assert session.state == "closed"


def test_a_board_that_is_not_there_is_said_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(posfet.SourceError, match=r"no scan within 0.05 s: CAN bus unavailable.*No such file") as raised:
        posfet.open(f"slcan:{tmp_path / 'none'}", timeout=0.05)
    assert "\n" not in str(raised.value)
