# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Settings that change between two scans: forces, baselines and tracks go on."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from posfet_model.contacts.tracker import ContactState
from posfet_model.estimation.error_states import ErrorPriors
from posfet_model.reconstruction.reconstructor import Reconstruction, Reconstructor
from posfet_model.reconstruction.settings import ReconstructionSettings
from posfet_model.sensor.description import ContactThresholds, load_sensor
from support.scan_player import press, scans

SENSOR = load_sensor()
FORCE = 0.1
"""Force of a touch on the middle taxel [N], from 0.5 s on."""
CHANGE = 0.7
"""Time of the change [s], during the touch."""
SETTINGS = ReconstructionSettings()
HIGH = replace(SETTINGS, contact=ContactThresholds(5 * FORCE, FORCE))


def run(
    change: Callable[[Reconstructor], None], before: ReconstructionSettings = SETTINGS
) -> tuple[Reconstructor, list[Reconstruction], list[np.ndarray]]:
    """Return reconstructor, results and forces of a touch of 0.4 s, with a change of the settings in its middle."""
    reconstructor = Reconstructor(SENSOR, settings=before)
    results, forces = [], []
    for time, scan in scans(SENSOR, 1.1, force=press(FORCE, 0.5, 0.9)):
        if time == pytest.approx(CHANGE, abs=1e-9):
            change(reconstructor)
        results.append(copy.copy(reconstructor.process(scan)))
        forces.append(reconstructor.image().force.copy())
    return reconstructor, results, forces


def live(result: Reconstruction) -> list[int]:
    return [contact.id for contact in result.contacts if contact.state is not ContactState.RELEASED]


def test_equal_settings_change_nothing() -> None:
    _, expected, forces = run(lambda _: None)
    _, results, same = run(lambda model: model.change(replace(SETTINGS)))
    assert [(r.valid, live(r)) for r in results] == [(r.valid, live(r)) for r in expected]
    np.testing.assert_array_equal(same, forces)
    assert any(live(result) for result in results)


def test_a_higher_threshold_ends_the_contact_with_the_next_scan_and_no_force_jumps() -> None:
    _, expected, forces = run(lambda _: None)
    _, results, changed = run(lambda model: model.change(HIGH))
    at = round(CHANGE * 1000)
    assert live(results[at - 1])
    assert [contact.state for contact in results[at].contacts] == [ContactState.RELEASED]
    assert all(not live(result) for result in results[at:])
    assert results[at].valid
    # In one scan neither the baseline nor the force has followed the change.
    np.testing.assert_allclose(changed[at][12], forces[at][12], rtol=0, atol=1e-3)
    assert live(expected[at])


def test_a_lower_threshold_finds_the_touch_with_the_next_scan() -> None:
    _, results, _ = run(lambda model: model.change(SETTINGS), before=HIGH)
    at = round(CHANGE * 1000)
    assert not any(live(result) for result in results[:at])
    assert live(results[at])


def test_without_contact_thresholds_those_of_the_sensor_are_used_again() -> None:
    def twice(model: Reconstructor) -> None:
        model.change(HIGH)
        model.change(SETTINGS)

    _, expected, _ = run(lambda _: None)
    _, results, _ = run(twice)
    assert [live(result) for result in results] == [live(result) for result in expected]


def test_hum_removal_is_switched_while_the_forces_go_on() -> None:
    off = replace(SETTINGS, hum_removal=False)
    model, results, _ = run(lambda model: model.change(off))
    at = round(CHANGE * 1000)
    assert not model._hum.sampling
    assert live(results[at]) == live(results[at - 1]) != []
    assert all(result.valid for result in results[at:])
    model.change(SETTINGS)
    assert model._hum.searches


def test_fault_detection_is_switched() -> None:
    def stuck(settings: ReconstructionSettings) -> int:
        model = Reconstructor(SENSOR)
        model.change(settings)
        for _, scan in scans(SENSOR, 1.5):
            scan.counts[3] = 0x8000
            model.process(scan)
        return model.faulty

    assert stuck(SETTINGS) == 1
    assert stuck(replace(SETTINGS, fault_detection=False)) == 0


def test_the_limit_of_uncertainty_reaches_the_estimator() -> None:
    model = Reconstructor(SENSOR)
    model.change(replace(SETTINGS, max_relative_uncertainty=0.25))
    assert model._estimator.max_relative_uncertainty == 0.25


def test_other_priors_are_refused_and_nothing_changes() -> None:
    refused = replace(HIGH, hum_removal=False, priors=ErrorPriors())

    def change(model: Reconstructor) -> None:
        with pytest.raises(ValueError, match="priors must be as before"):
            model.change(refused)

    _, expected, _ = run(lambda _: None)
    model, results, _ = run(change)
    assert [live(result) for result in results] == [live(result) for result in expected]
    assert model._hum.searches
    model.change(SETTINGS)  # what is compared with are still the settings before
