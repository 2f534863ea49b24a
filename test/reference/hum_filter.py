# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Reference of the subtraction of mains hum, in NumPy."""

from __future__ import annotations

import math

import numpy as np

from posfet_model._lib.types import Array

TURN = 2.0 * math.pi
ORDERS = 1, 3, 5
"""Orders of the harmonics of a hum [1]."""


class HumFilter:
    """Subtracts the hum of signals in any unit, and keeps the rest in a window.

    Parameters
    ----------
    taxels : int
        Number of taxels.
    scans : int
        Number of scans of a window.
    """

    def __init__(self, taxels: int, scans: int) -> None:
        self.scans = scans
        self.present, self.sampling = False, scans > 0
        self.hum_frequency = self.phase = self.time = 0.0
        self.parts = np.zeros((len(ORDERS), 2, taxels))
        self.window, self.times, self.filled = np.zeros((scans, taxels)), np.zeros(scans), 0

    def remove(self, signal: Array, step: float) -> None:
        """Subtract the hum from the signals of a scan, in place, a step [s] after the one before."""
        self.time += step
        if self.present:
            angle = self.phase + TURN * self.hum_frequency * self.time
            for order, (of_cosine, of_sine) in zip(ORDERS, self.parts, strict=True):
                signal -= math.cos(order * angle) * of_cosine + math.sin(order * angle) * of_sine
        if self.filled < self.scans:
            self.window[self.filled] = signal
            self.times[self.filled] = self.time
            self.filled += 1

    def start_window(self) -> None:
        """Begin a new window, from the phase at the end of this one."""
        self.phase = (self.phase + TURN * self.hum_frequency * self.time) % TURN
        self.time, self.filled, self.sampling = 0.0, 0, self.scans > 0

    def clear(self) -> None:
        """Subtract nothing from now on."""
        self.present = False
        self.parts[:] = 0.0
