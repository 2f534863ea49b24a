# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Each component that can be switched off does nothing then."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from posfet_model.estimation.error_states import ErrorPriors
from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.reconstruction.settings import ReconstructionSettings
from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.scan import Scan
from posfet_sim.device.error_model import ErrorModel
from posfet_sim.emulation.offline import received_scans
from posfet_sim.scene import load_scene

SENSOR = load_sensor()
PRESS = load_scene("press", SENSOR)


def played(settings: ReconstructionSettings | None, board: ErrorModel, seconds: float = 1.0) -> Reconstructor:
    model = Reconstructor(SENSOR, settings=settings)
    for scan, _ in received_scans(SENSOR, PRESS, seconds, 1, board):
        model.process(scan)
    return model


def with_and_without_fault_detection(noise: float) -> list[Reconstructor]:
    """Return both models after a second of rest in which taxel 7 has another noise [counts] than the others."""
    models = [Reconstructor(SENSOR, settings=ReconstructionSettings(fault_detection=on)) for on in (True, False)]
    rng, scan = np.random.default_rng(1), Scan.empty(SENSOR.layout.id, SENSOR.layout.taxels)
    for number in range(1000):
        scan.sequence, scan.stamp = number, 10**9 + number * 10**6
        scan.device_time = number * 1000
        scan.temperatures[:] = 25.0
        deviations = 5.0 * rng.standard_normal(scan.counts.size)
        deviations[7] *= noise / 5.0
        scan.counts[:] = np.round(32768 + deviations)
        for model in models:
            model.process(scan)
    return models


def test_without_hum_removal_no_hum_is_found() -> None:
    board = replace(ErrorModel.none(), hum_amplitude=5e-3)
    assert abs(played(None, board).hum_frequency - 50.0) < 0.5
    assert np.isnan(played(ReconstructionSettings(hum_removal=False), board).hum_frequency)


def test_without_fault_detection_a_stuck_taxel_counts_as_working() -> None:
    models = with_and_without_fault_detection(noise=0.0)
    assert [model.faulty for model in models] == [1, 0]


def test_without_fault_detection_the_noise_of_a_loud_taxel_is_still_measured() -> None:
    with_it, without = with_and_without_fault_detection(noise=40.0)
    assert (with_it.faulty, without.faulty) == (1, 0)
    assert without.counts.bursts == with_it.counts.bursts < 40  # in the first period, before it is measured
    assert without.unsettled == 0


def test_the_priors_reach_the_estimator() -> None:
    board = ErrorModel.none()
    narrow, wide = (
        played(ReconstructionSettings(priors=ErrorPriors(warmth=warmth)), board, 0.9).image().total_standard_deviation
        for warmth in (0.0, 0.1)
    )
    assert wide > narrow + 0.05
