# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.
"""Charge that warmings left at the gates."""

from __future__ import annotations

import pytest

from posfet_model.estimation.thermal_charge import ThermalCharge

BLOCK = 0.02
TAU = 0.27


def shares(*films: float) -> list[float]:
    charge = ThermalCharge(TAU)
    return [charge.advance(film, BLOCK) for film in films]


def test_nothing_changes_at_a_constant_temperature() -> None:
    assert shares(*[0.0] * 20) == [0.0] * 20


def test_the_first_charge_is_new_as_a_whole() -> None:
    assert shares(0.0, 0.1) == [0.0, 1.0]


def test_at_a_constant_rate_it_becomes_steady_within_time_constants_of_the_leakage() -> None:
    found = shares(*(0.01 * number for number in range(200)))
    assert found[10] > found[20] > found[50] > found[-1]
    assert found[-1] < 1e-5


def test_when_the_warming_ends_it_leaks() -> None:
    found = shares(*(0.01 * min(number, 100) for number in range(120)))
    assert found[-1] == pytest.approx(BLOCK / TAU, rel=0.05)
