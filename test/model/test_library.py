# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""`import posfet_model` as a program without ROS uses it: names, lazy imports, forces and contacts from scans."""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import posfet_model
from posfet_model.reconstruction.force_image import ForceImage
from posfet_model.reconstruction.reconstructor import Reconstruction

PRESSED_FROM, SCANS = 600, 900
FORCE = 1.5
"""Sum of the forces on the taxels [N]."""
SUBPACKAGES = {
    "amplifier",
    "calibration",
    "contacts",
    "design",
    "device",
    "estimation",
    "figures",
    "reconstruction",
    "sensor",
    "spice",
}


def loaded_by(program: str) -> set[str]:
    """Return the modules that are loaded after a program ran in a separate process."""
    command = [sys.executable, "-c", f"import sys\n{program}\nprint(*sys.modules)"]
    package = Path(posfet_model.__file__).parents[1]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=package)
    return set(done.stdout.split())


def test_the_import_alone_loads_nothing_else() -> None:
    loaded = loaded_by("import posfet_model")
    assert {name for name in loaded if name.startswith("posfet_model")} == {"posfet_model"}
    assert not {"numpy", "yaml", "scipy", "matplotlib", "rclpy", "can"} & loaded


def test_a_name_loads_only_what_it_needs_and_neither_ros_nor_matplotlib() -> None:
    loaded = loaded_by("import posfet_model\nposfet_model.Reconstructor(posfet_model.load_sensor())")
    assert {"numpy", "yaml", "posfet_model.reconstruction.reconstructor"} <= loaded
    assert not {"scipy", "matplotlib", "rclpy", "can", "posfet_model.figures", "posfet_model.spice"} & loaded


def test_every_name_exists_and_is_listed() -> None:
    names = {"Calibration", "ConfigError", "Contact", "Reconstructor", "Scan", "TaxelStatus", "load_sensor"}
    assert set(posfet_model.__all__) == names | SUBPACKAGES | {"__version__"}
    assert set(posfet_model.__all__) <= set(dir(posfet_model))
    for name in posfet_model.__all__:
        assert isinstance(getattr(posfet_model, name), ModuleType) == (name in SUBPACKAGES)
    with pytest.raises(AttributeError, match="has no attribute 'reconstructor'"):
        _ = posfet_model.reconstructor  # type: ignore[attr-defined]


def test_modules_of_a_subpackage_are_its_attributes() -> None:
    assert posfet_model.reconstruction.reconstructor.Reconstructor is posfet_model.Reconstructor
    assert posfet_model.sensor.scan.Scan is posfet_model.Scan


def test_the_version_is_that_of_the_package() -> None:
    manifest = Path(posfet_model.__file__).parents[1] / "package.xml"
    if not manifest.is_file():  # an installed package, without its manifest beside it
        pytest.skip("no package.xml beside the package")
    assert f"<version>{posfet_model.__version__}</version>" in manifest.read_text(encoding="utf-8")


def test_an_error_in_a_file_is_a_config_error() -> None:
    with pytest.raises(posfet_model.ConfigError, match="no such sensor"):
        posfet_model.load_sensor("nowhere")


def force_profile(sensor: Any, x: float, y: float) -> np.ndarray:
    """Return forces on the taxels [N] that add up to FORCE, with their centre at (x, y) [m]."""
    distance = np.hypot(sensor.layout.positions[:, 0] - x, sensor.layout.positions[:, 1] - y)
    profile = np.exp(-0.5 * (distance / 0.7e-3) ** 2)
    return FORCE * profile / profile.sum()


def press(sensor: Any) -> Iterator[posfet_model.Scan]:
    """Yield the scans of an array that is pressed from scan PRESSED_FROM on, in one object, as a source does.

    Written by hand, without the model: an output voltage that decays with the leakage time constant, and noise.
    """
    rng = np.random.default_rng(5)
    step = 1.0 / sensor.can.scan_rate
    low, high = sensor.adc.low, sensor.adc.high
    force = force_profile(sensor, 0.0, 0.0)
    scan = posfet_model.Scan.empty(sensor.layout.id, sensor.layout.taxels)
    scan.temperatures[:] = 25.0
    for index in range(SCANS):
        volts = sensor.amplifier.offset * sensor.amplifier.follower_gain + rng.normal(0.0, sensor.adc.noise, len(force))
        held = (index - PRESSED_FROM + 0.5) * step
        if held > 0.0:
            volts += sensor.volts_per_newton * force * math.exp(-held / sensor.device.leak_time_constant)
        scan.counts[:] = np.rint((volts - low) / (high - low) * 65535.0)
        scan.sequence, scan.device_time = index, round(index * step * 1e6)
        scan.stamp = 1_700_000_000_000_000_000 + round(index * step * 1e9)
        yield scan


def test_forces_and_contacts_are_reconstructed_from_scans() -> None:
    sensor = posfet_model.load_sensor()
    calibration = posfet_model.Calibration.nominal(sensor)
    reconstructor = posfet_model.Reconstructor(sensor, calibration)
    for scan in press(sensor):
        result = reconstructor.process(scan)
        assert result.accepted
        if scan.sequence == PRESSED_FROM - 1:
            assert result.valid
            assert not result.contacts
    [contact] = result.contacts
    assert isinstance(contact, posfet_model.Contact)
    x, y = contact.region.centre_of_pressure
    assert math.hypot(x, y) < 0.1e-3
    image = reconstructor.image()
    assert image.total == pytest.approx(FORCE, abs=0.03)
    middle = sensor.layout.taxels // 2
    assert image.force[middle] == pytest.approx(force_profile(sensor, 0.0, 0.0)[middle], abs=0.03)
    assert (image.status == posfet_model.TaxelStatus.OK).all()
    assert reconstructor.counts.accepted == SCANS


def values(result: Any) -> dict[str, Any]:
    """Return every value of a result, copied deeply, for a comparison with `same`."""
    found = {}
    for field in fields(result):
        value = getattr(result, field.name)
        if isinstance(value, dict):
            value = {key: values(item) if is_dataclass(item) else item for key, item in value.items()}
        found[field.name] = value.copy() if isinstance(value, np.ndarray) else value
    return found


def same(first: Any, second: Any) -> bool:
    """Return whether two values are equal, arrays item by item and NaN equal to NaN."""
    if isinstance(first, dict):
        return first.keys() == second.keys() and all(same(first[key], second[key]) for key in first)
    if isinstance(first, np.ndarray):
        return np.array_equal(first, second, equal_nan=first.dtype.kind == "f")
    if isinstance(first, float) and math.isnan(first):
        return math.isnan(second)
    return bool(first == second)


def test_a_snapshot_is_unchanged_when_the_next_scans_overwrite_the_result() -> None:
    sensor = posfet_model.load_sensor()
    reconstructor = posfet_model.Reconstructor(sensor)
    results: tuple[Any, ...] = ()
    kept: list[tuple[Any, dict[str, Any]]] = []
    for scan in press(sensor):
        result = reconstructor.process(scan)
        if scan.sequence == PRESSED_FROM + 50:
            results = scan, result, reconstructor.image()
            assert result.contacts
            assert result.motions
            kept = [(original.snapshot(), values(original)) for original in results]
    reconstructor.image()
    assert [type(snapshot) for snapshot, _ in kept] == [posfet_model.Scan, Reconstruction, ForceImage]
    assert all(isinstance(original, type(snapshot)) for (snapshot, _), original in zip(kept, results, strict=True))
    for (snapshot, expected), original in zip(kept, results, strict=True):
        assert same(values(snapshot), expected), f"the copy of {type(original).__name__} has changed"
        assert not same(values(original), expected), f"{type(original).__name__} has not been overwritten"


def test_counts_are_those_of_their_time() -> None:
    sensor = posfet_model.load_sensor()
    reconstructor = posfet_model.Reconstructor(sensor)
    kept = []
    for scan in press(sensor):
        reconstructor.process(scan)
        kept.append(reconstructor.counts)
    assert [counts.accepted for counts in kept] == list(range(1, SCANS + 1))


@pytest.mark.parametrize("index", range(3), ids=["scan", "reconstruction", "image"])
def test_a_snapshot_shares_no_writable_memory(index: int) -> None:
    sensor = posfet_model.load_sensor()
    reconstructor = posfet_model.Reconstructor(sensor)
    for scan in press(sensor):
        result = reconstructor.process(scan)
    original: Any = (scan, result, reconstructor.image())[index]
    snapshot = original.snapshot()
    before = values(snapshot)
    for field in fields(original):
        value = getattr(original, field.name)
        if isinstance(value, np.ndarray):
            assert not np.shares_memory(value, getattr(snapshot, field.name))
            value[...] = 77
        elif isinstance(value, dict):
            value.clear()
        else:
            setattr(original, field.name, None)
    assert same(values(snapshot), before)
