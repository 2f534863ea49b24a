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

from posfet_model.estimation.choice import Estimator
from posfet_model.estimation.error_states import ErrorPriors
from posfet_model.estimation.settings import ObserverSettings
from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.reconstruction.settings import ReconstructionSettings
from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.scan import Scan
from posfet_sim.device.error_model import ErrorModel
from posfet_sim.emulation.offline import received_scans
from posfet_sim.scene import load_scene

SENSOR = load_sensor()
PRESS = load_scene("press", SENSOR)


def played(
    settings: ReconstructionSettings | None,
    board: ErrorModel,
    seconds: float = 1.0,
    estimator: Estimator = Estimator.OBSERVER,
) -> Reconstructor:
    model = Reconstructor(SENSOR, None, estimator, settings)
    for scan, _ in received_scans(SENSOR, PRESS, seconds, 1, board):
        model.process(scan)
    return model


def test_without_hum_removal_no_hum_is_found() -> None:
    board = replace(ErrorModel.none(), hum_amplitude=5e-3)
    assert abs(played(None, board).hum_frequency - 50.0) < 0.5
    assert np.isnan(played(ReconstructionSettings(hum_removal=False), board).hum_frequency)


def test_without_fault_detection_a_stuck_taxel_counts_as_working() -> None:
    models = [Reconstructor(SENSOR, settings=ReconstructionSettings(fault_detection=on)) for on in (True, False)]
    rng, scan = np.random.default_rng(1), Scan.empty(SENSOR.layout.id, SENSOR.layout.taxels)
    for number in range(1000):
        scan.sequence, scan.stamp = number, 10**9 + number * 10**6
        scan.device_time = number * 1000
        scan.temperatures[:] = 25.0
        scan.counts[:] = np.round(32768 + 5.0 * rng.standard_normal(scan.counts.size))
        scan.counts[7] = 32768
        for model in models:
            model.process(scan)
    assert [model.faulty for model in models] == [1, 0]


def test_without_roll_back_the_baseline_keeps_what_it_absorbed_of_a_touch() -> None:
    board = ErrorModel.none()
    with_it, without = (
        played(ReconstructionSettings(ObserverSettings(roll_back=on)), board, 0.9).image().total for on in (True, False)
    )
    assert without < with_it < 1.5


def test_the_priors_reach_the_estimator_of_all_errors() -> None:
    board = ErrorModel.none()
    narrow, wide = (
        played(ReconstructionSettings(priors=ErrorPriors(warmth=warmth)), board, 0.9, Estimator.ERROR_STATE)
        .image()
        .total_standard_deviation
        for warmth in (0.0, 0.1)
    )
    assert wide > narrow + 0.05
