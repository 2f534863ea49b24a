# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The scans that tests of the reconstruction get are those of the forward chain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from posfet_model.sensor.description import Sensor
from posfet_model.sensor.signal_chain import ForwardSignalChain
from support.scan_player import CHUNK, press, scans


@pytest.mark.parametrize("bits", [12, 16])
@pytest.mark.parametrize("noise", [0.0, 1e-4])
def test_scans_are_those_of_the_forward_chain(sensor: Sensor, bits: int, noise: float) -> None:
    device = replace(sensor, adc=replace(sensor.adc, bits=bits, noise=noise))
    chain = ForwardSignalChain(device, np.random.default_rng(3))
    shape = np.linspace(-1.0, 1.0, device.layout.taxels)
    force = press(20.0, 0.02, 0.07)  # into both rails
    count = 0
    for index, (time, scan) in enumerate(scans(device, 0.1125, force, shape, lambda at: 25.0 + at, 3, 2000.0)):
        chain.advance(shape * force(time), 25.0 + time, 1 / 2000.0)
        np.testing.assert_array_equal(scan.counts, chain.counts())
        assert scan.sequence == index
        count += 1
    assert count == 225 > CHUNK
