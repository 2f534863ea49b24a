"""Calibration files (YAML). A file belongs to one sensor: one of another sensor or layout is refused."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml

from posfet_model._lib.types import Array
from posfet_model.calibration.taxel_calibration import Calibration, Residuals
from posfet_model.config import ConfigError, Section, read_yaml
from posfet_model.sensor.description import Sensor

VERSION: Final = 1
"""Version of the file format."""

DIGITS: Final = 6
"""Significant digits of the numbers in a file."""


def save_calibration(path: str | Path, sensor: Sensor, calibration: Calibration) -> None:
    """Write a calibration to a file, which is replaced atomically.

    Parameters
    ----------
    path : str or Path
        The file; an existing one is overwritten.
    sensor : Sensor
        The sensor to which the calibration belongs.
    calibration : Calibration
        The calibration.

    Raises
    ------
    ConfigError
        The file cannot be written; one line.
    """
    residuals = calibration.residuals
    document: dict[str, Any] = {
        "version": VERSION,
        "date": calibration.date,
        "sensor": {
            "name": sensor.name,
            "serial": sensor.serial,
            "layout": sensor.layout.id,
            "rows": sensor.layout.rows,
            "cols": sensor.layout.cols,
        },
        "taxels": {
            "dead": np.flatnonzero(calibration.dead).tolist(),
            "gain": _rounded(calibration.usable_gain),
            "pyroelectric_gain": _rounded(calibration.pyroelectric_gain),
            "leak_time_constant_s": _rounded(calibration.leak_time_constant),
            "offset_mV": _rounded(calibration.offset * 1e3),
        },
        "crosstalk_percent": float(f"{calibration.crosstalk * 100:.{DIGITS}g}"),
    }
    if calibration.thermal_time_constant is not None:
        document["thermal_time_constant_s"] = float(f"{calibration.thermal_time_constant:.{DIGITS}g}")
    if residuals is not None:
        document["residuals"] = {
            "force_rms_mN": float(f"{residuals.force_rms * 1e3:.{DIGITS}g}"),
            "force_rms_before_mN": float(f"{residuals.force_rms_before * 1e3:.{DIGITS}g}"),
            "samples": residuals.samples,
        }
    target = Path(path)
    if not target.name or (target.exists() and not target.is_file()):  # os.replace would replace a device node
        raise ConfigError(f"{target}: cannot be written: not a regular file")
    part = target.with_name(f"{target.name}.part")
    try:
        part.write_text(yaml.safe_dump(document, sort_keys=False, width=120), encoding="utf-8")
        os.replace(part, target)  # never an incomplete file
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written: {error.strerror}") from error


def load_calibration(path: str | Path, sensor: Sensor) -> Calibration:
    """Return the calibration of a sensor from its file.

    Parameters
    ----------
    path : str or Path
        The file.
    sensor : Sensor
        The sensor to which the calibration has to belong.

    Returns
    -------
    Calibration
        The calibration in SI units.

    Raises
    ------
    ConfigError
        The file belongs to another sensor or layout, or `read_yaml` or `Section` refuses it; one line that names file,
        key, allowed values and value.
    """
    top = read_yaml(path)
    top.whole("version", VERSION, VERSION)
    date = top.text("date")
    owner = top.section("sensor")
    for name, expected in (("name", sensor.name), ("serial", sensor.serial)):
        text = owner.text(name)
        if text != expected:
            raise owner.error(name, f"is of another sensor: must be '{expected}', got '{text}'")
    layout = sensor.layout
    for name, number in (("layout", layout.id), ("rows", layout.rows), ("cols", layout.cols)):
        value = owner.whole(name, 1, 0xFFFF)
        if value != number:
            raise owner.error(name, f"is of another layout: must be {number}, got {value}")
    owner.end()
    section = top.section("taxels")
    taxels, tau = layout.taxels, sensor.device.leak_time_constant
    gain = np.array(section.numbers("gain", taxels, 0.05, 20.0))
    gain[section.wholes("dead", 0, taxels - 1)] = math.nan
    calibration = Calibration(
        gain=gain,
        pyroelectric_gain=np.array(section.numbers("pyroelectric_gain", taxels, -100.0, 100.0)),
        leak_time_constant=np.array(section.numbers("leak_time_constant_s", taxels, 0.05 * tau, 20.0 * tau)),
        offset=np.array(section.numbers("offset_mV", taxels, -1000.0, 1000.0)) * 1e-3,
        crosstalk=top.number("crosstalk_percent", 0.0, 20.0) / 100,
        thermal_time_constant=top.number("thermal_time_constant_s", 0.0, 1e4)
        if "thermal_time_constant_s" in top
        else None,
        date=date,
        residuals=_residuals(top.section("residuals")) if "residuals" in top else None,
    )
    section.end()
    top.end()
    return calibration


def _residuals(section: Section) -> Residuals:
    residuals = Residuals(
        force_rms=section.number("force_rms_mN", 0.0, 1e9) * 1e-3,
        force_rms_before=section.number("force_rms_before_mN", 0.0, 1e9) * 1e-3,
        samples=section.whole("samples", 0, 10**15),
    )
    section.end()
    return residuals


def _rounded(values: Array) -> list[float]:
    return [float(f"{value:.{DIGITS}g}") for value in values.tolist()]
