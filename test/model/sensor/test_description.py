# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The sensor file: its conversion, and every error in it, reported in one line."""

from __future__ import annotations

import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from posfet_model.sensor.description import DEFAULT_SENSOR, SENSOR_FOLDER, ConfigError, load_sensor
from support.each_row import each_row

SHIPPED = SENSOR_FOLDER / f"{DEFAULT_SENSOR}.yaml"


def values() -> dict[str, Any]:
    return yaml.safe_load(SHIPPED.read_text(encoding="utf-8"))


def refusal(folder: Path, content: dict[str, Any] | str) -> str:
    """Write a sensor file that must be rejected and return the message, without the path of the file."""
    path = folder / "odd.yaml"
    path.write_text(content if isinstance(content, str) else yaml.safe_dump(content), encoding="utf-8")
    with pytest.raises(ConfigError) as caught:
        load_sensor(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    return message.removeprefix(f"{path}: ")


def leaves(tree: dict[str, Any], path: tuple[str, ...] = ()) -> list[tuple[str, ...]]:
    found = []
    for key, value in tree.items():
        found += leaves(value, (*path, key)) if isinstance(value, dict) else [(*path, key)]
    return found


def changed(path: tuple[str, ...], value: Any) -> dict[str, Any]:
    tree = values()
    inner = tree
    for key in path[:-1]:
        inner = inner[key]
    if value is ...:
        del inner[path[-1]]
    else:
        inner[path[-1]] = value
    return tree


LEAVES = leaves(values())
NUMBERS = [path for path in LEAVES if path[0] not in ("name", "serial") and path[-1] != "fd"]


def test_the_shipped_sensor_is_converted_to_si_units() -> None:
    sensor = load_sensor()
    assert sensor.layout.taxels == 25
    assert sensor.layout.pitch_x == pytest.approx(1.5e-3, abs=1e-18)
    assert sensor.device.piezoelectric_coefficient == pytest.approx(-38e-12, abs=1e-24)
    # 12 times the permittivity of vacuum over 2.5 um; 42.3 dB as a factor.
    assert sensor.device.film_capacitance == pytest.approx(4.2500e-5, abs=1e-9)
    assert sensor.amplifier.open_loop_gain == pytest.approx(130.32, abs=0.005)
    assert sensor.volts_per_newton == pytest.approx(38e-6 / 4.2500e-5 * 130.32 / 131.32, abs=1e-5)
    assert sensor.can.base_id == 0x100


def test_positions_run_row_by_row_about_the_centre() -> None:
    positions = load_sensor().layout.positions
    np.testing.assert_allclose(positions[:2], [[-3e-3, -3e-3], [-1.5e-3, -3e-3]], rtol=0, atol=1e-15)
    np.testing.assert_allclose(positions[5], [-3e-3, -1.5e-3], rtol=0, atol=1e-15)
    np.testing.assert_allclose(positions.sum(axis=0), 0, rtol=0, atol=1e-15)
    with pytest.raises(ValueError, match="read-only"):
        positions[0, 0] = 1


def test_a_name_a_path_and_a_copy_give_the_same_sensor(tmp_path: Path) -> None:
    copy = tmp_path / "copy.yaml"
    copy.write_text(SHIPPED.read_text(encoding="utf-8"), encoding="utf-8")
    assert load_sensor(DEFAULT_SENSOR) == load_sensor(SHIPPED) == load_sensor(str(copy))


def test_unknown_names_and_paths_are_reported_with_the_shipped_ones(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=f"^posfet_9x9: no such sensor; .* one of .*{DEFAULT_SENSOR}"):
        load_sensor("posfet_9x9")
    missing = tmp_path / "missing.yaml"
    with pytest.raises(ConfigError, match=r"missing\.yaml: no such sensor file$"):
        load_sensor(missing)


def test_a_missing_key_is_reported_with_what_it_must_be(tmp_path: Path) -> None:
    with each_row() as row:
        for path in LEAVES:
            with row(".".join(path)):
                assert refusal(tmp_path, changed(path, ...)).startswith(f"{'.'.join(path)}: missing, must be ")


@pytest.mark.parametrize("section", ["layout", "device", "amplifier", "adc", "can", "contact"])
def test_a_missing_or_invalid_section_is_reported(tmp_path: Path, section: str) -> None:
    missing = refusal(tmp_path, changed((section,), ...))
    assert missing == f"{section}: missing, must be a mapping of keys to values"
    wrong = refusal(tmp_path, changed((section,), [1]))
    assert wrong == f"{section}: must be a mapping of keys to values, got [1]"
    unknown = refusal(tmp_path, changed((section, "colour"), 1))
    assert unknown.startswith(f"{section}.colour: unknown key, known here are ")


def test_a_wrong_type_is_reported_with_the_value(tmp_path: Path) -> None:
    with each_row() as row:
        for path, value in itertools.product(LEAVES, (None, {"a": 1}, [1.0])):
            with row(f"{'.'.join(path)} = {value}"):
                message = refusal(tmp_path, changed(path, value))
                assert message.startswith(f"{'.'.join(path)}: must be ")
                assert ", got " in message


@pytest.mark.parametrize("path", [("name",), ("serial",)], ids=".".join)
def test_a_number_in_place_of_text_is_rejected(tmp_path: Path, path: tuple[str, ...]) -> None:
    assert refusal(tmp_path, changed(path, 3)) == f"{path[0]}: must be text, got 3"


def test_a_number_out_of_range_is_reported_with_the_range(tmp_path: Path) -> None:
    with each_row() as row:
        for path, value in itertools.product(NUMBERS, (math.nan, math.inf, -1e300, 1e300, True)):
            with row(f"{'.'.join(path)} = {value}"):
                message = refusal(tmp_path, changed(path, value))
                assert message.startswith(f"{'.'.join(path)}: must be a")
                assert ", got " in message
                assert any(bracket in message for bracket in "[(")


def test_a_number_that_yaml_reads_as_text_is_explained_or_rejected(tmp_path: Path) -> None:
    with each_row() as row:
        for path in NUMBERS:
            with row(".".join(path)):
                message = refusal(tmp_path, changed(path, "1e-3"))
                assert message.startswith(f"{'.'.join(path)}: must be ")
                assert "1e-3" in message


def test_the_error_explains_that_yaml_needs_a_decimal_point(tmp_path: Path) -> None:
    text = SHIPPED.read_text(encoding="utf-8").replace("noise_mV: 0.3 ", "noise_mV: 3e-1 ")
    assert "got the text '3e-1' (YAML wants a point: 1.0e-3)" in refusal(tmp_path, text)


def test_a_duplicate_key_is_rejected_with_its_line(tmp_path: Path) -> None:
    text = SHIPPED.read_text(encoding="utf-8").replace("  rows: 5 ", "  rows: 6\n  rows: 5 ")
    line = text[: text.index("  rows: 5 ")].count("\n") + 1
    assert refusal(tmp_path, text).startswith(f"is not valid YAML: key 'rows' is given twice (line {line}, ")


def test_an_unknown_top_level_key_is_rejected(tmp_path: Path) -> None:
    assert refusal(tmp_path, {**values(), "colour": "red"}).startswith(
        "colour: unknown key, known here are name, serial"
    )


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        (
            ("layout", "taxel_area_mm2"),
            2.3,
            "layout.taxel_area_mm2: must be in (0, 2.25], the cell of one taxel, got 2.3",
        ),
        (("amplifier", "rail_low_V"), 4.8, "amplifier.rail_low_V: must be below rail_high_V = 4.8, got 4.8"),
        (("adc", "low_V"), 6.0, "adc.low_V: must be at least 0.001 below high_V = 5, got 6"),
        (("contact", "deadband_mN"), 21.0, "contact.deadband_mN: must be a number in [0, 20], got 21"),
        (("device", "force_max_N"), 0.0, "device.force_max_N: must be a number in (0, 10000), got 0"),
        (
            ("adc", "low_V"),
            1.0,
            "adc.low_V: must leave more than 0.00224 V (4 standard deviations of the noise and a step of the ADC) "
            "between adc.low_V and the signal at rest, amplifier.offset_mV = 0, got -1 V: widen the range",
        ),
        (
            ("amplifier", "rail_high_V"),
            -1.0,
            "amplifier.rail_high_V: rail_high_V and adc.high_V must be above 0 and the offset",
        ),
        (("can", "base_id"), 0x7FF, "can.base_id: must be a whole number in [0, 2032], got 2047"),
        (("layout", "rows"), 5.0, "layout.rows: must be a whole number in [1, 128], got 5.0"),
        (("can", "fd"), 1, "can.fd: must be true or false, got 1"),
    ],
    ids=lambda value: ".".join(value) if isinstance(value, tuple) else None,
)
def test_inconsistent_values_are_rejected(tmp_path: Path, path: tuple[str, ...], value: Any, said: str) -> None:
    assert refusal(tmp_path, changed(path, value)) == said


def test_a_force_beyond_the_amplifier_range_is_rejected_with_the_limit(tmp_path: Path) -> None:
    message = refusal(tmp_path, changed(("device", "force_max_N"), 6.0))
    # 4.8 V over 0.8873 V/N.
    assert message == "device.force_max_N: must be in (0, 5.41] for this amplifier and ADC, got 6"


def test_the_limit_of_the_force_has_the_offset_that_the_follower_puts_out(tmp_path: Path) -> None:
    """Output gain*(shift + offset): with a gain of 0.666 an offset of -1 V leaves 4.8 V + 0.666 V, not 5.8 V."""
    content = changed(("device", "force_max_N"), 9.5)
    content["amplifier"] |= {"offset_mV": -1000.0, "open_loop_gain_dB": 6.0}
    message = refusal(tmp_path, content)
    gain = 10**0.3 / (1 + 10**0.3)
    limit = (4.8 + gain) / gain / (38e-12 * 2.5e-6 / (12 * 8.8541878188e-12 * 1e-6))
    assert message == f"device.force_max_N: must be in (0, {limit:.4g}] for this amplifier and ADC, got 9.5"


def test_noise_that_leaves_no_range_at_rest_is_rejected(tmp_path: Path) -> None:
    content = changed(("adc", "noise_mV"), 1000.0)
    content["amplifier"]["rail_low_V"] = -3.0
    assert refusal(tmp_path, content) == (
        "adc.noise_mV: must leave more than 4 V (4 standard deviations of the noise and a step of the ADC) between "
        "amplifier.rail_low_V and the signal at rest, amplifier.offset_mV = 0, got 3 V: lower the noise"
    )
