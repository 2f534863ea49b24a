# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Online identification of the charge leakage; a varying force is not mistaken for leakage."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from posfet_model.estimation.choice import Estimator
from posfet_model.estimation.leakage_identification import LeakageIdentifier
from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_sim.commands.score import perturbed
from support.scan_player import press, scans

SENSOR = load_sensor()
SHAPE = np.exp(-0.5 * np.sum((SENSOR.layout.positions / 1.2e-3) ** 2, axis=1))
SHAPE /= SHAPE.sum()


EACH = pytest.mark.parametrize("estimator", list(Estimator))


def totals(device: Sensor, duration: float, force: object, estimator: Estimator) -> np.ndarray:
    reconstructor, found = Reconstructor(SENSOR, estimator=estimator), []
    for _, scan in scans(device, duration, force=force, shape=SHAPE):  # type: ignore[arg-type]
        reconstructor.process(scan)
        found.append(reconstructor.image().total)
    return np.array(found)


@EACH
@pytest.mark.parametrize("percent", [-20.0, -8.0, 8.0, 20.0])
def test_a_leakage_error_is_identified_while_a_force_is_held(percent: float, estimator: Estimator) -> None:
    device = perturbed(SENSOR, {"leak": percent})
    found = totals(device, 4.0, press(2.0, 0.3, 60.0), estimator)
    # Without identification the relative error of the force would equal that of the leakage.
    assert found[2000:] == pytest.approx(2.0, abs=0.06)


@EACH
def test_identified_leakage_is_used_for_the_next_touch(estimator: Estimator) -> None:
    device = perturbed(SENSOR, {"leak": 20.0})
    found = totals(device, 4.0, lambda time: press(1.0, 0.3, 1.5)(time) + press(2.0, 3.0, 60.0)(time), estimator)
    assert found[3200] == pytest.approx(2.0, abs=0.03)
    assert found[-1] == pytest.approx(2.0, abs=0.03)


@EACH
@pytest.mark.parametrize("hertz", [0.3, 1.0, 2.0])
def test_a_varying_force_is_not_mistaken_for_leakage(hertz: float, estimator: Estimator) -> None:
    def force(time: float) -> float:
        return press(2.0, 0.3, 60.0)(time) * (1.0 - 0.3 * math.sin(2 * math.pi * hertz * max(time - 0.5, 0.0)))

    found = totals(SENSOR, 4.0, force, estimator)
    true = np.array([force(index * 1e-3) for index in range(4000)])
    assert np.abs(found - true)[400:].max() < 0.06


@EACH
def test_the_reported_uncertainty_covers_a_leakage_error_not_identified_yet(estimator: Estimator) -> None:
    device = replace(perturbed(SENSOR, {"leak": 15.0}))
    reconstructor, outside = Reconstructor(SENSOR, estimator=estimator), 0
    for time, scan in scans(device, 3.0, force=press(2.0, 0.3, 60.0), shape=SHAPE):
        reconstructor.process(scan)
        image = reconstructor.image()
        outside += time > 0.4 and abs(image.total - 2.0) > 2.0 * image.total_standard_deviation
    assert outside == 0


DESCRIBED = np.array([0.30, 0.31, 0.29, 0.30, 0.32, 0.28, 0.30, 0.30, 0.31])
ALL = np.ones(len(DESCRIBED), np.bool_)
BLOCK = 0.02


class HeldForce:
    """A held force that leaks with the true time constants and is integrated with those of the identifier."""

    def __init__(self, true: np.ndarray, force: float = 2.0) -> None:
        self.identifier = LeakageIdentifier(DESCRIBED, np.full(len(DESCRIBED), 1e-8), 0.1, 0.1)
        self.true, self.time, self.leaked = true, 0.0, np.zeros(len(true))
        self.force = self.charge = np.full(len(true), force)
        self.identifier.begin_touch(ALL, self.leaked)

    def run(self, seconds: float, trend: float = 0.0, turn: int = 7, touched: np.ndarray = ALL) -> None:
        """Let blocks pass; the true force changes by `trend` [N] in each, the other way after every `turn` blocks."""
        for number in range(round(seconds / BLOCK)):
            change = trend * (1 - 2 * ((number // turn) % 2))
            before, self.charge = self.charge, self.charge * np.exp(-BLOCK / self.true) + change
            lost = before - self.charge + change  # the force that has leaked, which tau' turns into an increment
            increment = lost * self.true / self.identifier.time_constant
            mean = self.force + change - lost + increment
            self.leaked = self.leaked + increment
            self.identifier.add_block(BLOCK, 20, 0.5 * (self.force + mean), self.leaked, touched)
            self.force = mean
            corrected = self.identifier.update(touched, np.zeros(len(self.true)))
            if corrected is not None:
                self.force, self.leaked = self.force + corrected, self.leaked + corrected


@pytest.mark.parametrize("factor", [0.8, 0.92, 1.0, 1.1, 1.25])
def test_the_time_constants_of_a_held_force_are_found_and_the_force_is_mended(factor: float) -> None:
    held = HeldForce(factor * DESCRIBED)
    held.run(1.5)
    assert held.identifier.time_constant == pytest.approx(factor * DESCRIBED, rel=0.02)
    assert held.force == pytest.approx(2.0, rel=0.02)
    assert held.identifier.standard_deviation < 0.1


def test_what_one_taxel_shows_carries_over_to_those_that_nothing_touches() -> None:
    held = HeldForce(1.2 * DESCRIBED)
    touched = np.arange(len(DESCRIBED)) != 0
    held.run(1.5, touched=touched)
    assert held.identifier.time_constant[0] == pytest.approx(1.2 * DESCRIBED[0], rel=0.03)
    individual = held.identifier.individual_deviation
    assert individual[0] == pytest.approx(0.1)
    assert (individual[1:] < 0.08).all()


def test_an_untouched_array_and_a_changing_force_show_nothing() -> None:
    idle, moving = HeldForce(1.2 * DESCRIBED), HeldForce(1.2 * DESCRIBED)
    idle.run(2.0, touched=~ALL)
    moving.run(2.0, trend=0.1)
    for held in (idle, moving):
        assert held.identifier.time_constant.tolist() == DESCRIBED.tolist()
        assert held.identifier.common_deviation == 0.1


@pytest.mark.parametrize(("percent", "found"), [(0.5, True), (8.0, False)])
def test_a_slow_ramp_shows_the_leak_and_a_fast_one_may_have_any_cause(percent: float, found: bool) -> None:
    held = HeldForce(1.1 * DESCRIBED)
    window = 0.3 / BLOCK  # about one time constant
    held.run(0.9, trend=2.0 * percent / 100 / window, turn=1000)
    if found:
        assert held.identifier.time_constant == pytest.approx(1.1 * DESCRIBED, rel=0.04)
    else:
        assert held.identifier.time_constant.tolist() == DESCRIBED.tolist()


def test_the_force_is_as_uncertain_as_what_leaked_times_the_unknown_time_constant() -> None:
    identifier = HeldForce(DESCRIBED).identifier
    leaked, observed = np.linspace(0.0, 2.0, len(DESCRIBED)), np.full(len(DESCRIBED), 0.5)
    identifier.begin_touch(ALL, np.zeros(len(DESCRIBED)))
    identifier.add_block(BLOCK, 20, leaked, leaked, ALL)
    assert identifier.update(ALL, observed) is None
    # 10 % in common, less what the other taxels would show, and 10 % of each taxel's own.
    assert identifier.correlated_error == pytest.approx(0.1 * (leaked - observed))
    assert identifier.variance == pytest.approx((0.1 * (leaked - observed)) ** 2 + (0.1 * leaked) ** 2)
    identifier.end_touch()
    assert not identifier.variance.any()
    assert not identifier.correlated_error.any()
