# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Texts with units to SI, and refusals."""

import pytest

from posfet_model.device.physical_units import UNITS, Plausible


@pytest.mark.parametrize(
    ("unit", "text", "value"),
    [
        ("m", "2.5 um", 2.5e-6),
        ("m", "2.5e-6", 2.5e-6),
        ("m", " 45nm ", 45e-9),
        ("m", "2.5 \N{GREEK SMALL LETTER MU}m", 2.5e-6),
        ("m2", "1 mm2", 1e-6),
        ("V/m", "160 kV/cm", 160e5),
        ("C/m2", "2 uC/cm2", 0.02),
        ("C/N", "-38 pC/N", -38e-12),
        ("m2/(V s)", "850 cm2/(V s)", 0.085),
        ("ohm", "10 Gohm", 1e10),
        ("1", "5 %", 0.05),
        ("V m", "10 mV um", 1e-8),
        ("F", "46.2 pF", 46.2e-12),
        ("m2", "1 mm\N{SUPERSCRIPT TWO}", 1e-6),
        ("m2", "1 mm^2", 1e-6),
        ("ohm", "10 G\N{GREEK CAPITAL LETTER OMEGA}", 1e10),
        ("Hz", "1.5 GHz", 1.5e9),
    ],
)
def test_a_text_with_a_unit_is_in_si(unit: str, text: str, value: float) -> None:
    assert Plausible(unit).parse(text) == pytest.approx(value, rel=1e-15, abs=0)


@pytest.mark.parametrize("text", ["2.5 pF", "thick", "2,5 um", "2.5 um um", "", "nan m", "1e400 parsec"])
def test_another_text_is_refused_with_the_units_that_are_understood(text: str) -> None:
    with pytest.raises(ValueError, match=r"must be a number, alone or with a unit of m, um, nm, mm, cm, got"):
        Plausible("m").parse(text)


def test_every_unit_is_read_back() -> None:
    for si, others in UNITS.items():
        for other, factor in others.items():
            assert Plausible(si).parse(f"3 {other}") == pytest.approx(3 * factor, rel=1e-15, abs=0)


def test_a_temperature_in_degrees_celsius_is_recognised() -> None:
    with pytest.raises(ValueError, match=r"temperature must be in \[100, 500\] K, got 25; in degC it is 298.15 K"):
        Plausible("K", 100, 500).array("temperature", 25.0)


@pytest.mark.parametrize("value", [float("inf"), float("-inf"), float("nan"), [1e-6, float("nan")]])
def test_what_is_not_finite_is_refused_with_range_and_unit(value: float) -> None:
    with pytest.raises(ValueError, match=r"^width must be in \[1e-08, 0.1\] m, got (inf|-inf|nan)$"):
        Plausible("m", 1e-8, 0.1).array("width", value)
    with pytest.raises(ValueError, match=r"^width must be in \(-inf, inf\) m, got "):
        Plausible("m").array("width", value)


def test_a_number_that_no_unit_explains_is_refused_without_a_guess() -> None:
    with pytest.raises(ValueError, match=r"^width must be in \[1e-08, 0.1\] m, got -1$"):
        Plausible("m", 1e-8, 0.1).array("width", -1.0)
