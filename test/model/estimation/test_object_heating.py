# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""What an object that leaves may do to the rate of the temperature."""

import pytest

from posfet_core.scan_path import GATE, ObjectHeating

USUAL, DEVIATION = 0.01, 1e-3


def touched(rate: float) -> ObjectHeating:
    """Return what has followed a touch of 2 N that began at the usual rate, and has another one now."""
    heating = ObjectHeating()
    assert heating.update(0.0, 1.0, rate, DEVIATION, USUAL) == 0.0
    assert heating.update(1.0, 2.0, rate, DEVIATION, rate) == 0.0, "only as the force falls"
    return heating


@pytest.mark.parametrize("change", [-0.1, 0.1])
def test_the_rate_may_change_by_as_much_as_it_has_since_the_touch_began(change: float) -> None:
    rate, expected = USUAL + change, (abs(change) - GATE * DEVIATION) / 2.0
    assert touched(rate).update(2.0, 1.5, rate, DEVIATION, rate) == pytest.approx(expected)


def test_a_change_that_may_be_noise_is_none() -> None:
    rate = USUAL + 0.9 * GATE * DEVIATION
    assert touched(rate).update(2.0, 1.5, rate, DEVIATION, rate) == 0.0


def test_each_touch_has_a_usual_rate_and_a_greatest_force_of_its_own() -> None:
    heating = touched(USUAL + 0.1)
    assert heating.update(2.0, 0.0, USUAL + 0.1, DEVIATION, USUAL + 0.1) > 0.0
    heating.update(0.0, 0.5, USUAL + 0.2, DEVIATION, USUAL + 0.1)
    found = heating.update(0.5, 0.1, USUAL + 0.2, DEVIATION, USUAL + 0.2)
    assert found == pytest.approx((0.1 - GATE * DEVIATION) / 0.5)
