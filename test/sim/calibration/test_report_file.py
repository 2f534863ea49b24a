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
