# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Readings of 12 bits in classic frames: most noise stays within one code, or switches between two."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.sensor.description import load_sensor
from posfet_sim.device.error_model import ErrorModel
from posfet_sim.emulation.offline import received_scans
from posfet_sim.scene import load_scene

RATE, SECONDS, SETTLED = 500.0, 0.8, 0.2
DEFAULT = load_sensor()
SENSOR = replace(
    DEFAULT, can=replace(DEFAULT.can, scan_rate=RATE, fd=False), adc=replace(DEFAULT.adc, bits=12)
)  # fmt: skip
NOISE = ErrorModel.default()
NOISE_ALONE = replace(
    ErrorModel.none(), thermal_noise=NOISE.thermal_noise, flicker_noise=NOISE.flicker_noise
)  # fmt: skip


def test_forces_stay_valid_while_all_taxels_switch_between_the_same_two_codes() -> None:
    model, valid, codes = Reconstructor(SENSOR), [], set()
    for scan, _ in received_scans(SENSOR, load_scene("idle", SENSOR), SECONDS, 3, NOISE_ALONE):
        valid.append(model.process(scan).valid)
        codes |= set(np.unique(scan.counts).tolist())
    assert len(codes) <= 4
    assert all(valid[round(SETTLED * RATE) :])
    assert model.restarts == 0
