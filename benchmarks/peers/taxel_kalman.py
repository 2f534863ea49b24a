# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A plain Kalman filter for each taxel that knows the leakage, and nothing of temperature, offsets or neighbours.

State: force f (random walk) and signal s, which follows the force and leaks, ``s1 = a*s0 + m*(f1 - f0)``; measurement:
the signal with white noise (R. E. Kalman, J. Basic Eng. 82(1), 1960, doi:10.1115/1.3662552). The gain is the steady one
of the Riccati equation, one for each taxel.
"""

from __future__ import annotations

import numpy as np

from benchmarks.peers.peer import Array, Peer
from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.signal_chain import force_noise_rms

FORCE_STEP = 0.02
"""Standard deviation of the change of a force in one scan [N]; assumed: 2 N within 0.1 s."""

RICCATI_STEPS = 3000


class TaxelKalman(Peer):
    """Two states a taxel, steady gains."""

    name = "Kalman filter per taxel"

    def __init__(self, sensor: Sensor, calibration: Calibration) -> None:
        super().__init__(sensor, calibration)
        ratio = 1.0 / sensor.can.scan_rate / calibration.leak_time_constant
        self._decay, self._follow = np.exp(-ratio), -np.expm1(-ratio) / ratio
        self._gain = _steady_gain(self._decay, self._follow, force_noise_rms(sensor))

    def _begin(self, rest: Array) -> None:
        self._zero = rest.mean(axis=0)
        self._signal = np.zeros(len(self.force))

    def _update(self, reading: Array) -> None:
        predicted = self._decay * self._signal
        innovation = reading - self._zero - predicted
        self.force = self.force + self._gain[0] * innovation
        self._signal = predicted + self._gain[1] * innovation
        touched = self.force > self._threshold
        self.contacts = self._grouped(touched) if touched.any() else []


def _steady_gain(decay: Array, follow: Array, noise: float) -> Array:
    """Return the gains of force and signal, shape [2, taxels]."""
    ff = fs = ss = np.full(len(decay), noise**2)
    gain = np.zeros((2, len(decay)))
    step = FORCE_STEP**2
    for _ in range(RICCATI_STEPS):
        ff, fs, ss = ff + step, decay * fs + follow * step, decay**2 * ss + follow**2 * step
        gain = np.array([fs, ss]) / (ss + noise**2)
        ff, fs, ss = ff - gain[0] * fs, fs * (1 - gain[1]), ss * (1 - gain[1])
    return gain
