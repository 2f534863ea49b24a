# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The report of a calibration as a file."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import Any

import pytest

from posfet_model import files
from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.config import ConfigError
from posfet_model.sensor.description import load_sensor
from posfet_sim.calibration.report import write_report

SENSOR = load_sensor()
NOMINAL = Calibration.nominal(SENSOR)


def test_nothing_is_left_of_a_report_on_a_full_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "report.html"

    def full(*_: Any) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch, pytest.raises(ConfigError, match="cannot be written: No space left on device"):
        patch.setattr(files.os, "fsync", full)
        write_report(path, SENSOR, NOMINAL)
    assert not list(tmp_path.iterdir())
    (tmp_path / "report.html.part").symlink_to(tmp_path / "victim")
    write_report(path, SENSOR, NOMINAL)
    assert path.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    assert not (tmp_path / "victim").exists()
