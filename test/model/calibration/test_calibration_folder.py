# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Calibrations that other programs name: they stay in one folder, and overwrite nothing but a calibration."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from posfet_model.calibration.calibration_file import load_calibration
from posfet_model.calibration.calibration_folder import CalibrationFolder
from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.config import ConfigError
from posfet_model.sensor.description import load_sensor

SENSOR = load_sensor()
NOMINAL = Calibration.nominal(SENSOR)


@pytest.fixture
def folder(tmp_path: Path) -> CalibrationFolder:
    return CalibrationFolder(str(tmp_path / "made" / "here"), SENSOR)


def test_a_calibration_is_saved_replaced_and_loaded(folder: CalibrationFolder) -> None:
    for _ in range(2):
        path = folder.save("thumb.yaml", NOMINAL)
        assert path == folder.root / "thumb.yaml"
    assert list(folder.root.iterdir()) == [path]
    assert (folder.load("thumb.yaml").gain == NOMINAL.gain).all()
    (folder.root / "left").mkdir()
    assert folder.save("left/thumb.yaml", NOMINAL) == folder.root / "left" / "thumb.yaml"


@pytest.mark.parametrize(
    "name",
    [
        "", ".", "..", "thumb", "thumb.txt", ".yaml", ".hidden.yaml", "../thumb.yaml", "a/../../thumb.yaml", "/x.yaml",
        "a/.git/thumb.yaml", "thumb.yaml/", "a\nb.yaml", "x" * 300 + ".yaml", "~/thumb.yaml\0", "\ud800.yaml",
    ],
)  # fmt: skip
def test_a_name_that_is_none_in_the_folder_is_refused(folder: CalibrationFolder, name: str) -> None:
    for action in (lambda: folder.save(name, NOMINAL), lambda: folder.load(name)):
        with pytest.raises(ConfigError, match=r"must be the name of a file in the calibration folder .*for instance"):
            action()
    assert not folder.root.exists()


def test_symbolic_links_do_not_lead_out_of_the_folder(folder: CalibrationFolder, tmp_path: Path) -> None:
    folder.save("inside.yaml", NOMINAL)
    outside = tmp_path / "outside"
    outside.mkdir()
    (outside / "cal.yaml").write_text((folder.root / "inside.yaml").read_text())
    (folder.root / "door").symlink_to(outside)
    (folder.root / "link.yaml").symlink_to(outside / "cal.yaml")
    for name in ("door/cal.yaml", "link.yaml"):
        with pytest.raises(ConfigError, match="must be the name of a file in"):
            folder.load(name)
    with pytest.raises(ConfigError, match="must be the name of a file in"):
        folder.save("door/new.yaml", NOMINAL)
    with pytest.raises(ConfigError, match=r"link\.yaml: exists and is a symbolic link, so it is not replaced"):
        folder.save("link.yaml", NOMINAL)
    assert [path.name for path in outside.iterdir()] == ["cal.yaml"]
    (folder.root / "same.yaml").symlink_to(folder.root / "inside.yaml")
    assert (folder.load("same.yaml").gain == NOMINAL.gain).all()


def test_a_folder_that_is_a_symbolic_link_is_followed(tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "real")
    assert CalibrationFolder(str(tmp_path / "link"), SENSOR).save("a.yaml", NOMINAL) == tmp_path / "real" / "a.yaml"


@pytest.mark.parametrize("content", ["", "#!/bin/sh\n", "a: 1\n", "of another sensor"])
def test_what_is_no_calibration_of_the_sensor_is_not_overwritten(folder: CalibrationFolder, content: str) -> None:
    path = folder.save("thumb.yaml", NOMINAL)
    if content == "of another sensor":
        content = path.read_text().replace("layout: 1", "layout: 2")
    path.write_text(content)
    with pytest.raises(ConfigError, match=f"{path}: exists and is no calibration of this sensor.*choose another name"):
        folder.save("thumb.yaml", NOMINAL)
    assert path.read_text() == content


def test_a_folder_that_cannot_be_made_or_written_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    for place in ("file", "file/below"):
        refusing = CalibrationFolder(str(tmp_path / place), SENSOR)
        assert refusing.problem == (
            f"{tmp_path / place}: the calibration folder cannot be written: {tmp_path / 'file'} is not a folder"
        )
        with pytest.raises(ConfigError, match=f"^{refusing.problem}$"):
            refusing.save("thumb.yaml", NOMINAL)
    with pytest.raises(ConfigError, match="there is no such home folder"):
        CalibrationFolder("~nobody_of_this_name/x", SENSOR)
    none = CalibrationFolder(str(tmp_path / "none" / "yet"), SENSOR)
    assert none.problem == ""
    monkeypatch.setattr("os.access", lambda path, mode: Path(path) != tmp_path)  # as for a user without permission
    assert none.problem.endswith(f"yet: the calibration folder cannot be written: {tmp_path} is not writable")


def test_the_home_folder_is_expanded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    path = CalibrationFolder("~/.ros/posfet", SENSOR).save("thumb.yaml", NOMINAL)
    assert path == tmp_path / ".ros" / "posfet" / "thumb.yaml"
    assert load_calibration(path, SENSOR).date == NOMINAL.date


def test_what_is_prepared_under_a_predictable_name_is_neither_followed_nor_waited_for(
    folder: CalibrationFolder, tmp_path: Path
) -> None:
    folder.root.mkdir(parents=True)
    victim = tmp_path / "victim"
    victim.write_text("precious")
    (folder.root / "thumb.yaml.part").symlink_to(victim)
    os.mkfifo(folder.root / "index.yaml.part")
    for name in ("thumb.yaml", "index.yaml"):
        assert folder.save(name, NOMINAL).is_file()
    assert victim.read_text() == "precious"
