# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The guided calibration: its steps, its display, and the recording that it leaves."""

from __future__ import annotations

import shlex
import shutil
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mcap", reason="recordings need the package mcap")

from posfet_model.calibration.bench_signals import MIN_FORCE
from posfet_model.config import ConfigError
from posfet_model.sensor.description import SENSOR_FOLDER, load_sensor
from posfet_model.sensor.scan import Scan
from posfet_sim.calibration.bench_recording import COLUMNS, last_force, read_scans
from posfet_sim.calibration.guide import AFTER, HOLD, REST, Guide, Seen
from posfet_sim.commands import guided
from posfet_sim.commands.calibrate import main, make_parser
from posfet_sim.recording.recorded_scans import RecordedScans
from support.paths import DATA

STORED = DATA / "recording" / "posfet_0.2.0.mcap"
SENSOR = load_sensor()
TAXELS = SENSOR.layout.taxels


def seen(
    time: float, taxel: int | None = None, force: float = 1.0, temperature: float = 25.0, valid: bool = True
) -> Seen:
    forces = np.zeros(TAXELS)
    if taxel is not None:
        forces[taxel] = force
    return Seen(time, forces, valid, taxel is not None, temperature)


def feed(guide: Guide, *values: Seen) -> int:
    for value in values:
        guide.update(value)
    return guide.index


def test_a_calibration_goes_through_all_steps() -> None:
    guide = Guide(SENSOR)
    assert feed(guide, seen(0.0, valid=False), seen(5.0, valid=False)) == 0
    assert feed(guide, seen(6.0), seen(6.0 + 0.9 * REST)) == 0
    assert feed(guide, seen(9.0, 3), seen(10.0)) == 0  # touched: the rest begins again
    assert feed(guide, seen(10.0 + REST)) == 1
    for taxel in range(TAXELS - 1):
        assert feed(guide, seen(20.0 + taxel, taxel), seen(20.5 + taxel)) == 1
    assert guide.presses.missing == [TAXELS - 1]
    assert guide.presses.text == f"missing: taxels {TAXELS - 1}"
    assert feed(guide, seen(50.0, TAXELS - 1, 0.9 * MIN_FORCE), seen(51.0)) == 1
    assert feed(guide, seen(52.0, TAXELS - 1, 1.1 * MIN_FORCE)) == 1  # not released yet
    assert feed(guide, seen(53.0)) == 2
    assert feed(guide, seen(54.0), seen(55.0, temperature=float("nan")), seen(56.0, temperature=25.4)) == 2
    assert feed(guide, seen(57.0, temperature=24.8)) == 3
    assert feed(guide, seen(60.0, 12), seen(60.0 + 0.9 * HOLD, 12), seen(80.0), seen(81.0, 12)) == 3
    assert feed(guide, seen(81.5 + HOLD, 12)) == 3
    assert feed(guide, seen(82.0 + HOLD)) == 4
    assert feed(guide, seen(110.0), seen(110.0 + AFTER)) == 5
    assert guide.step is None
    assert guide.skipped == []


def test_steps_that_are_left_out_are_named_with_what_is_then_missing() -> None:
    guide = Guide(SENSOR)
    feed(guide, seen(0.0), seen(REST))
    guide.skip()
    guide.skip()
    assert [step.title for step in guide.skipped] == ["presses", "temperature"]
    shown = guided.lines(guide, 0.75)
    assert shown[0].startswith("done 1 rest")
    assert shown[1].startswith("done 2 presses (left out)")
    assert shown[3].startswith(">>>  4 long hold")
    assert "Enter goes on, q ends; without it relaxation and creep are not fitted" in shown[5]
    assert shown[6].startswith("board nan N (nominal), rig 0.750 N")


def stored() -> Iterator[Scan | None]:
    yield None
    yield from RecordedScans(STORED, SENSOR).scans()
    while True:
        yield None


def test_the_scans_are_recorded_and_read_as_those_of_a_calibration(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "thumb.mcap"
    keys = iter(["", "\n", "\n", "\n", "\n", "\n"])
    guide = guided.run(SENSOR, stored(), path, key=lambda: next(keys))
    assert [step.title for step in guide.skipped] == ["rest", "presses", "temperature", "long hold", "rest"]
    assert capsys.readouterr().out.startswith("step 1 of 5: leave the sensor untouched\nstep 2 of 5: press the ball")
    found, expected = read_scans(path, SENSOR), [scan.snapshot() for scan in RecordedScans(STORED, SENSOR).scans()]
    assert found.counts.tolist() == [scan.counts.tolist() for scan in expected]
    np.testing.assert_allclose(found.time, [scan.stamp * 1e-9 for scan in expected])
    assert np.isfinite(found.temperature).all()


def test_the_line_for_a_later_fit_names_what_was_given(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(guided, "scans_of", lambda *_: nullcontext(stored()))
    monkeypatch.setattr(guided, "_key", lambda: "\n")
    shutil.copy(SENSOR_FOLDER / "posfet_5x5.yaml", "my thumb.yaml")
    words = ["--guided", "-i", "slcan", "--sensor", "my thumb.yaml", "--serial", "T-0042", "--ball-radius", "2.5"]
    assert main(["cal.yaml", *words]) == 0
    line = capsys.readouterr().out.splitlines()[-1]
    assert line == (
        "cal.mcap: recorded. With the file of the rig: posfet calibrate cal.yaml --recording cal.mcap --reference FILE "
        "--ball-radius 2.5 --ball-modulus 4 --sensor 'my thumb.yaml' --serial T-0042 --report cal.html"
    )
    found = make_parser().parse_args(shlex.split(line.partition(": posfet calibrate ")[2]))
    assert (found.sensor, found.serial, found.ball_radius) == ("my thumb.yaml", "T-0042", 2.5)


def test_q_ends_it_with_what_was_recorded(tmp_path: Path) -> None:
    path = tmp_path / "thumb.mcap"
    with pytest.raises(ConfigError, match=f"ended by you; what was recorded is in {path}"):
        guided.run(SENSOR, stored(), path, key=lambda: "Q\n")
    assert path.is_file()


def test_the_newest_force_of_a_growing_file_is_found(tmp_path: Path) -> None:
    path = tmp_path / "stand.csv"
    assert last_force(path) is None
    path.write_text(f"{','.join(COLUMNS)}\n", encoding="utf-8")
    assert last_force(path) is None
    with path.open("a", encoding="utf-8") as stream:
        stream.writelines(f"{time},0,0,{0.001 * time}\n" for time in range(2000))
        stream.write("2000,0,0,7")  # a line that is being written
    assert last_force(path) == pytest.approx(1.999)


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["--guided"], "--guided: needs the board: -i INTERFACE -c CHANNEL; posfet can list shows them"),
        (["--guided", "--recording", "x.log"], "--recording: --guided records by itself; leave it out"),
        (["--guided", "-i", "slcan", "-c", ""], "slcan"),
    ],
)
def test_bad_input_is_one_line(
    words: list[str], reason: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(tmp_path / "cal.yaml"), *words]) == 1
    error = capsys.readouterr().err
    assert reason in error
    assert error.count("\n") == 1
    assert not list(tmp_path.glob("*.mcap"))
