# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Steps and checks of a calibration fit that need no recording."""

from __future__ import annotations

import numpy as np
import pytest

from posfet_model.calibration.fit_checks import FitError, check_leakage
from posfet_model.calibration.fit_steps import relaxation_poles
from posfet_model.calibration.response_fit import ResponseFit, TaxelResponse
from posfet_model.sensor.description import load_sensor

SENSOR = load_sensor()


@pytest.mark.parametrize("leakage", [0.03, 0.1, 0.27, 0.5, 1.0, 3.0, 10.0])
def test_no_relaxation_pole_looks_like_the_leakage(leakage: float) -> None:
    poles = np.array(relaxation_poles(leakage))
    np.testing.assert_allclose(poles[1:] / poles[:-1], 10.0)
    assert 5.0 <= poles[-1] < 50.0
    assert np.abs(np.log(poles / leakage)).min() > np.log(2.6)


def test_the_poles_of_the_shipped_sensor_are_those_of_three_decades() -> None:
    assert relaxation_poles(SENSOR.device.leak_time_constant) == pytest.approx((0.1, 1.0, 10.0))


def presses(*deviations: float) -> ResponseFit:
    """Return a fit whose leakage rates of 2 per second are known with these relative standard deviations."""
    taxels = {
        taxel: TaxelResponse(2.0, np.ones(4), np.zeros(1), np.zeros(1), np.array([0.0, 0.0, 0.0, 0.0, 2.0 * each]))
        for taxel, each in enumerate(deviations)
    }
    return ResponseFit(taxels, np.zeros(0), np.zeros((0, 0)))


def test_presses_that_do_not_tell_the_leakage_are_refused_with_the_time_that_they_need() -> None:
    with pytest.raises(FitError, match=r"leakage of taxel 1: .* 30% only.* press each taxel for 0\.5 s"):
        check_leakage(SENSOR, presses(0.02, 0.3, 0.05), np.zeros(3, np.bool_))


def test_a_dead_taxel_need_not_tell_its_leakage() -> None:
    check_leakage(SENSOR, presses(0.02, 0.3, 0.05), np.array([False, True, False]))
