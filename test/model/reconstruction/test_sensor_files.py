# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A sensor file that loads never raises later, whatever the values are; one that could is refused at load."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.sensor.description import DEFAULT_SENSOR, SENSOR_FOLDER, ConfigError, Sensor, load_sensor
from posfet_model.sensor.scan import Scan

SHIPPED = yaml.safe_load((SENSOR_FOLDER / f"{DEFAULT_SENSOR}.yaml").read_text(encoding="utf-8"))
SMALLEST = 5e-324
RANGES: dict[tuple[str, str], tuple[float, float]] = {
    ("layout", "pitch_x_mm"): (0.01, 100),
    ("layout", "pitch_y_mm"): (0.01, 100),
    ("layout", "taxel_area_mm2"): (1e-4, 1e4),
    ("device", "piezoelectric_coefficient_pC_per_N"): (-1000, -0.1),
    ("device", "pyroelectric_coefficient_uC_per_m2K"): (-1000, 1000),
    ("device", "film_thickness_um"): (0.01, 1000),
    ("device", "relative_permittivity"): (1, 1000),
    ("device", "leak_time_constant_s"): (1e-3, 1e9),
    ("device", "thermal_time_constant_s"): (0, 1e4),
    ("device", "force_max_N"): (SMALLEST, 1e4),
    ("device", "contact_spread_mm"): (0, 100),
    ("amplifier", "open_loop_gain_dB"): (0, 200),
    ("amplifier", "gain_bandwidth_MHz"): (1e-6, 1e4),
    ("amplifier", "offset_mV"): (-1000, 1000),
    ("amplifier", "rail_low_V"): (-100, 100),
    ("amplifier", "rail_high_V"): (-100, 100),
    ("adc", "low_V"): (-100, 100),
    ("adc", "high_V"): (-100, 100),
    ("adc", "noise_mV"): (0, 1000),
    ("can", "scan_rate_Hz"): (0.1, 20_000),
    ("contact", "threshold_mN"): (SMALLEST, 1e6),
    ("contact", "deadband_mN"): (0, 1e6),
}
"""Allowed range of every key that is a number with a fraction."""
SIZES = [(1, 1), (1, 2), (1, 7), (3, 1), (2, 2), (5, 5), (1, 128)]
SCANS = 50


def value_in(low: float, high: float) -> st.SearchStrategy[float]:
    """Return values at the ends of a range, about zero, and anywhere in it on a logarithmic scale."""
    ends = [end for end in (low, high, 0.0, SMALLEST, 1e-12) if low <= end <= high]
    if low <= 0.0:
        return st.sampled_from(ends) | st.floats(low, high)
    return st.sampled_from(ends) | st.floats(math.log(low), math.log(high)).map(
        lambda exponent: min(max(math.exp(exponent), low), high)
    )


@st.composite
def sensor_files(draw: st.DrawFn) -> dict[str, Any]:
    """Return the content of a sensor file; some are inconsistent."""
    content = {name: dict(section) if isinstance(section, dict) else section for name, section in SHIPPED.items()}
    for section, key in draw(st.lists(st.sampled_from(list(RANGES)), min_size=1, max_size=len(RANGES), unique=True)):
        content[section][key] = draw(value_in(*RANGES[section, key]))
    layout, contact = content["layout"], content["contact"]
    layout["rows"], layout["cols"] = draw(st.sampled_from(SIZES))
    layout["taxel_area_mm2"] = min(layout["taxel_area_mm2"], layout["pitch_x_mm"] * layout["pitch_y_mm"])
    contact["deadband_mN"] = min(contact["deadband_mN"], contact["threshold_mN"])
    content["adc"]["bits"], content["can"]["fd"] = draw(st.integers(8, 16)), draw(st.booleans())
    return content


def loaded(path: Path, content: dict[str, Any]) -> Sensor | None:
    """Return the sensor, None if it is refused in one line; force_max is what amplifier and ADC allow at most."""
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    try:
        return load_sensor(path)
    except ConfigError as error:
        message = str(error)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    if "for this amplifier and ADC" not in message:
        return None
    content["device"]["force_max_N"] = 0.5 * float(message.partition("(0, ")[2].partition("]")[0])
    return loaded(path, content) if content["device"]["force_max_N"] > 0.0 else None


@settings(max_examples=100, suppress_health_check=[HealthCheck.filter_too_much, HealthCheck.too_slow])
@given(
    content=sensor_files(),
    kind=st.sampled_from(["rest", "random", "press", "ends"]),
    temperatures=st.sampled_from([(25.0, 25.0), (25.0, math.nan), (math.nan, math.nan), (-40.0, 150.0), (25.0,), ()]),
)
def test_a_sensor_file_that_loads_never_raises_later(
    content: dict[str, Any], kind: str, temperatures: tuple[float, ...], tmp_path_factory: pytest.TempPathFactory
) -> None:
    sensor = loaded(tmp_path_factory.getbasetemp() / "drawn.yaml", content)
    assume(sensor is not None)
    assert sensor is not None
    layout, rng = sensor.layout, np.random.default_rng(1)
    reconstructor = Reconstructor(sensor)
    reconstructor.vibration_wanted = True
    scan = Scan.empty(layout.id, layout.taxels)
    scan.temperatures = np.array(temperatures, np.float32)
    for index in range(SCANS):
        counts = 0x8000 + rng.integers(-3, 4, layout.taxels)
        if kind == "random":
            counts = rng.integers(0, 0x10000, layout.taxels)
        elif kind == "press" and index > SCANS // 2:
            counts[: 1 + layout.taxels // 3] += 5000
        elif kind == "ends":
            counts[:] = 0xFFFF * (index % 2)
        scan.counts[:] = counts
        time = index / sensor.can.scan_rate
        scan.sequence, scan.device_time, scan.stamp = index, round(time * 1e6), round(time * 1e9)
        result = reconstructor.process(scan)
        if index % 10 < 9:
            continue
        image = reconstructor.image()
        reconstructor.vibration()
        assert image.force.shape == (layout.taxels,)
        assert not result.valid or np.isfinite(image.force[~np.isin(image.status, (1, 2, 5))]).all()
    reconstructor.tare()
    reconstructor.tare(force=True)
