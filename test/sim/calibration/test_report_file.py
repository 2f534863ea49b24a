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
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from posfet_model import files
from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.config import ConfigError
from posfet_model.sensor.description import load_sensor
from posfet_sim.calibration.report import summary, write_report

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


def test_the_summary_has_one_finding_a_line_in_two_columns() -> None:
    found = replace(
        NOMINAL,
        relaxation_time_constants=np.array([0.1, 1.0]),
        relaxation_sizes=np.array([0.01, 0.02]),
        relaxation_deviations=np.array([0.001, 0.002]),
        bending=np.array([1e-3, 2e-4]),
        bending_deviation=np.array([1e-4, 1e-4]),
    )
    lines = summary(found)
    column = lines[0].index("1.000 of nominal")
    assert all(line[column - 2 : column] == "  " and line[column] != " " for line in lines)
    findings = {line[:column].rstrip(): line[column:] for line in lines}
    assert findings["relaxation with 0.1 s"] == "1.00 ± 0.10 %"
    assert findings["bending of the chip, along x"] == "0.20 ± 0.10 mN/N"
    assert findings["temperature rise by touch"].startswith("not observable")
    assert not any("+-" in line for line in lines)
