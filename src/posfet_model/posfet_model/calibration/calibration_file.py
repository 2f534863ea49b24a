# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Calibration files (YAML). A file belongs to one sensor: one of another sensor or layout is refused."""

from __future__ import annotations

import math
import os
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml

from posfet_model._lib.shown import one_line, shown
from posfet_model._lib.types import Array
from posfet_model.calibration.taxel_calibration import (
    CALIBRATED_GAIN_DEVIATION,
    CALIBRATED_LEAK_DEVIATION,
    CHIP_WARMING_TIMES,
    COVER_SPREADS,
    NOMINAL_BENDING_DEVIATION,
    NOMINAL_WARMTH_DEVIATION,
    PLAY_HALF_WIDTHS,
    POLES,
    Calibration,
    Residuals,
)
from posfet_model.config import ConfigError, Section, read_yaml, write_text
from posfet_model.files import check_folder
from posfet_model.sensor.description import Sensor

VERSION: Final = 2
"""Version of the file format that is written. Version 1 is read, too: it has neither deviations nor relaxation, and the
assumed values of `taxel_calibration` are used."""

DIGITS: Final = 6
"""Significant digits of the numbers in a file."""

FILE_SIZE: Final = (64_000, 256)
"""Largest size of a file [byte]: for any sensor, and for each taxel, for which at most 90 are written. A small array
has a small limit, since a service reads the file while scans wait."""


# The emitter in C takes a tenth of the time, during which scans may wait; not every build of PyYAML has it.
_Dumper: Any = getattr(yaml, "CSafeDumper", yaml.SafeDumper)


def save_calibration(path: str | Path, sensor: Sensor, calibration: Calibration) -> None:
    """Write a calibration to a file, which is complete or not there.

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
            "gain_deviation_percent": _rounded(calibration.gain_deviation * 100),
            "pyroelectric_gain": _rounded(calibration.pyroelectric_gain),
            "leak_time_constant_s": _rounded(calibration.leak_time_constant),
            "leak_deviation_percent": _rounded(calibration.leak_deviation * 100),
            "offset_mV": _rounded(calibration.offset * 1e3),
        },
        "common_gain_deviation_percent": _number(calibration.common_gain_deviation * 100),
        "crosstalk_percent": _number(calibration.crosstalk * 100),
        "relaxation_poles": len(calibration.relaxation_sizes),
        "relaxation": {
            "time_constants_s": _rounded(calibration.relaxation_time_constants),
            "sizes_percent": _rounded(calibration.relaxation_sizes * 100),
            "deviations_percent": _rounded(calibration.relaxation_deviations * 100),
        },
        "warmth": {
            "level_K": _number(calibration.warmth),
            "deviation_K": _number(calibration.warmth_deviation),
            "time_constant_s": _number(calibration.warmth_time_constant),
            "saturation_force_mN": _number(calibration.warmth_force * 1e3),
            "steepness": _number(calibration.warmth_steepness),
        },
        "temperature_sensor_lag_s": _number(calibration.temperature_sensor_lag),
        "temperature_sensor_dead_time_s": _number(calibration.temperature_sensor_dead_time),
        "temperature_reading_deviation_mK": _number(calibration.temperature_reading_deviation * 1e3),
    }
    if len(calibration.bending):
        document["bending"] = {
            "sizes_mN_per_N": _rounded(calibration.bending * 1e3),
            "deviations_mN_per_N": _rounded(calibration.bending_deviation * 1e3),
        }
        if len(calibration.bending_profile):
            document["bending"]["profile"] = _rounded(calibration.bending_profile)
    if len(calibration.cover_shares):
        document["cover"] = {
            "spreads_mm": _rounded(calibration.cover_spreads * 1e3),
            "shares_percent": _rounded(calibration.cover_shares * 100),
        }
    if len(calibration.chip_warming):
        document["chip_warming"] = {
            "time_constants_s": _rounded(calibration.chip_warming_time_constants),
            "sizes_K_per_N": _rounded(calibration.chip_warming),
        }
    if len(calibration.hysteresis_weights):
        document["hysteresis"] = {
            "half_widths_N": _rounded(calibration.hysteresis_half_widths),
            "weights_percent": _rounded(calibration.hysteresis_weights * 100),
            "slope_percent": _number(calibration.hysteresis_slope * 100),
        }
    document["leak_temperature"] = {
        "percent_per_K": _number(calibration.leak_per_kelvin * 100),
        "deviation_percent_per_K": _number(calibration.leak_per_kelvin_deviation * 100),
    }
    if calibration.temperature is not None:
        document["temperature_C"] = _number(calibration.temperature)
    if calibration.thermal_time_constant is not None:
        document["thermal_time_constant_s"] = _number(calibration.thermal_time_constant)
    if residuals is not None:
        document["residuals"] = {
            "force_rms_mN": _number(residuals.force_rms * 1e3),
            "force_rms_before_mN": _number(residuals.force_rms_before * 1e3),
            "samples": residuals.samples,
        }
    write_text(check_writable(path), yaml.dump(document, Dumper=_Dumper, sort_keys=False, width=120))


def check_writable(path: str | Path) -> Path:
    """Refuse a file that cannot be written, before the work that leads to it.

    Parameters
    ----------
    path : str or Path
        The file; it is neither created nor changed.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    ConfigError
        The file is not a regular one, or its folder is missing or read-only; one line.
    """
    target, reason = Path(path), ""
    try:
        if not target.name or (target.exists() and not target.is_file()):  # it would be replaced, even a device node
            reason = "not a regular file"
        else:
            check_folder(target)
            if not os.access(target.parent, os.W_OK | os.X_OK):
                reason = f"{one_line(str(target.parent))} is read-only"
    except OSError as error:  # such as a name that is too long
        reason = error.strerror or "not a file name"
    if reason:
        raise ConfigError(f"{one_line(str(target))}: cannot be written: {reason}")
    return target


def check_replaceable(path: str | Path, sensor: Sensor) -> None:
    """Refuse to overwrite a file that is no calibration of the sensor, such as its sensor file.

    Parameters
    ----------
    path : str or Path
        The file; it may be missing.
    sensor : Sensor
        The sensor to which the calibration has to belong.

    Raises
    ------
    ConfigError
        The file exists and is something else; one line.
    """
    target = Path(path)
    if not target.exists():
        return
    try:
        load_calibration(target, sensor)
    except ConfigError as error:
        raise ConfigError(
            f"{one_line(str(target))}: exists and is no calibration of this sensor, so it is not replaced: choose "
            "another name"
        ) from error


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
    top = read_yaml(path, FILE_SIZE[0] + FILE_SIZE[1] * sensor.layout.taxels)
    version = top.whole("version", 1, VERSION)
    date = top.text("date")
    owner = top.section("sensor")
    for name, expected in (("name", sensor.name), ("serial", sensor.serial)):
        text = owner.text(name)
        if text != expected:
            raise owner.error(name, f"is of another sensor: must be '{expected}', got {shown(text)}")
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
        gain_deviation=np.full(taxels, CALIBRATED_GAIN_DEVIATION),
        leak_deviation=np.full(taxels, CALIBRATED_LEAK_DEVIATION),
        crosstalk=top.number("crosstalk_percent", 0.0, 20.0) / 100,
        thermal_time_constant=top.number("thermal_time_constant_s", 0.0, 1e4)
        if "thermal_time_constant_s" in top
        else None,
        date=date,
        residuals=_residuals(top.section("residuals")) if "residuals" in top else None,
    )
    if version > 1:
        calibration = _with_deviations(calibration, top, section)
    section.end()
    top.end()
    return calibration


def _with_deviations(calibration: Calibration, top: Section, taxels: Section) -> Calibration:
    """Return the calibration with what version 2 of the format added."""
    count = len(calibration.gain)
    relaxation, warmth = top.section("relaxation"), top.section("warmth")
    older = "common_leak_deviation_percent" in top  # it is not used
    top.number("common_leak_deviation_percent", 0.0, 100.0, default=0.0)
    listed = top.whole("relaxation_poles", 0, POLES)
    calibration = replace(
        calibration,
        gain_deviation=np.array(taxels.numbers("gain_deviation_percent", count, 0.0, 100.0)) / 100,
        leak_deviation=np.array(taxels.numbers("leak_deviation_percent", count, 0.0, 100.0)) / 100,
        common_gain_deviation=top.number("common_gain_deviation_percent", 0.0, 100.0) / 100,
        relaxation_time_constants=np.array(relaxation.numbers("time_constants_s", listed, 1e-3, 1e6)),
        relaxation_sizes=np.array(relaxation.numbers("sizes_percent", listed, -100.0, 100.0)) / 100,
        relaxation_deviations=np.array(relaxation.numbers("deviations_percent", listed, 0.0, 100.0)) / 100,
        warmth=warmth.number("level_K", -10.0, 10.0),
        warmth_deviation=warmth.number("deviation_K", 0.0, 10.0),
        warmth_steepness=warmth.number("steepness", 0.1, 100.0, default=1.0),
        temperature_sensor_lag=top.number("temperature_sensor_lag_s", 0.0, 1e4),
        temperature_sensor_dead_time=top.number("temperature_sensor_dead_time_s", 0.0, 1e4, default=0.0),
        temperature_reading_deviation=top.number("temperature_reading_deviation_mK", 0.0, 1e6, default=0.0) * 1e-3,
        temperature=top.number("temperature_C", -273.15, 1000.0) if "temperature_C" in top else None,
    )
    if np.any(np.diff(calibration.relaxation_time_constants) <= 0.0):
        raise relaxation.error("time_constants_s", "must be in ascending order")
    if older and not calibration.warmth_observed:  # another deviation was assumed then
        calibration = replace(calibration, warmth_deviation=NOMINAL_WARMTH_DEVIATION)
    if "time_constant_s" in warmth:
        calibration = replace(calibration, warmth_time_constant=warmth.number("time_constant_s", 1e-3, 1e4))
    if "weak_share_percent" in warmth:  # of a force of 5 mN; the rest saturated at 50 mN
        share = warmth.number("weak_share_percent", 0.0, 100.0) / 100
        calibration = replace(calibration, warmth_force=0.05 * 0.1**share)
    elif "saturation_force_mN" in warmth:
        calibration = replace(calibration, warmth_force=warmth.number("saturation_force_mN", 0.1, 1e4) * 1e-3)
    if "leak_temperature" in top:
        leak = top.section("leak_temperature")
        calibration = replace(
            calibration,
            leak_per_kelvin=leak.number("percent_per_K", -100.0, 100.0) / 100,
            leak_per_kelvin_deviation=leak.number("deviation_percent_per_K", 0.0, 100.0) / 100,
        )
        leak.end()
    if "bending" in top:
        bending, bends = top.section("bending"), len(NOMINAL_BENDING_DEVIATION)
        calibration = replace(
            calibration,
            bending=np.array(bending.numbers("sizes_mN_per_N", bends, -1000.0, 1000.0)) * 1e-3,
            bending_deviation=np.array(bending.numbers("deviations_mN_per_N", bends, 0.0, 1000.0)) * 1e-3,
        )
        if "profile" in bending:
            profile = np.array(bending.numbers("profile", count, -100.0, 100.0))
            calibration = replace(calibration, bending_profile=profile)
        bending.end()
    if "cover" in top:
        cover, covers = top.section("cover"), 1 + len(COVER_SPREADS)
        calibration = replace(
            calibration,
            cover_spreads=np.array(cover.numbers("spreads_mm", covers, 0.0, 1000.0)) * 1e-3,
            cover_shares=np.array(cover.numbers("shares_percent", covers, 0.0, 100.0)) / 100,
        )
        cover.end()
    if "chip_warming" in top:
        warming, sizes = top.section("chip_warming"), len(CHIP_WARMING_TIMES)
        calibration = replace(
            calibration,
            chip_warming_time_constants=np.array(warming.numbers("time_constants_s", sizes, 1e-3, 1e6)),
            chip_warming=np.array(warming.numbers("sizes_K_per_N", sizes, -10.0, 10.0)),
        )
        warming.end()
    if "hysteresis" in top:
        hysteresis, loops = top.section("hysteresis"), len(PLAY_HALF_WIDTHS)
        calibration = replace(
            calibration,
            hysteresis_half_widths=np.array(hysteresis.numbers("half_widths_N", loops, 1e-6, 1e6)),
            hysteresis_weights=np.array(hysteresis.numbers("weights_percent", loops, -100.0, 100.0)) / 100,
            hysteresis_slope=hysteresis.number("slope_percent", -100.0, 100.0) / 100,
        )
        hysteresis.end()
    relaxation.end()
    warmth.end()
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
    return [_number(value) for value in values.tolist()]


def _number(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")
