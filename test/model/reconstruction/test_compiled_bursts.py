# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The compiled detection of bursts equals the plain reference in Python, scan by scan."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from posfet_model.reconstruction.bursts import BurstDetector
from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.signal_chain import charge_per_newton
from reference import bursts

SENSOR = load_sensor()


@settings(max_examples=40)
@given(st.integers(1, 64), st.integers(1, 64), st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.1]), st.booleans())
def test_scans_are_refused_as_by_the_reference(rows: int, cols: int, seed: int, faulty: float, shaken: bool) -> None:
    """Bursts on one, some or all taxels, touches, repeated bursts, lost scans, faulty taxels, strong vibration."""
    sensor = replace(SENSOR, layout=replace(SENSOR.layout, rows=rows, cols=cols))
    taxels, random = rows * cols, np.random.default_rng(seed)
    compiled, plain = BurstDetector(sensor), bursts.BurstDetector(sensor)
    scale, level, sequence = charge_per_newton(sensor), np.zeros(taxels), 0
    ill = random.random(taxels) < faulty
    for scan in range(40):
        if scan % 10 == 5:
            usual = np.abs(random.normal(0.0, 0.01 if shaken else 1e-4, taxels))
            compiled.set_usual_change(usual)
            plain.set_usual_change(usual)
        sequence += 1 if random.random() < 0.9 else 3
        burst = np.zeros(taxels)
        kind = random.integers(8)
        if kind == 0:
            burst[random.integers(taxels)] = random.choice([-0.2, 0.2])
        elif kind == 1:
            burst[:] = random.choice([-0.1, 0.1]) * random.uniform(0.5, 1.0, taxels)
        elif kind == 2:
            burst[random.random(taxels) < 0.3] = 0.1
        elif kind == 3:  # stays: a touch
            level = level + random.uniform(0.0, 0.1) * random.random(taxels)
        charge = scale * (level + burst + random.normal(0.0, 0.3e-3, taxels))
        assert compiled.is_burst(charge, sequence, ill) == plain.is_burst(charge, sequence, ill)
