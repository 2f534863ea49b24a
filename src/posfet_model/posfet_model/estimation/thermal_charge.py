# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Charge that changes of the film's temperature left at the gates: while it changes, so does a taxel's response."""

from __future__ import annotations

import math


class ThermalCharge:
    """Charge by the film's changes of temperature, which leaks, as a temperature.

    The response of a taxel to a warming is wrong by the error p of its pyroelectric response at first, and by p and the
    error of its leakage time constant once the charge is steady: at a constant rate, or after it.

    State variables: the charge, and the temperature up to which it counts, both [K].

    Parameters
    ----------
    time_constant : float
        Leakage time constant [s].
    """

    def __init__(self, time_constant: float) -> None:
        self._tau = time_constant
        self._charge = self._film = 0.0

    def advance(self, film: float, duration: float) -> float:
        """Advance by a block; return the share by which the charge changed [1].

        Parameters
        ----------
        film : float
            Temperature of the film since the start [K].
        duration : float
            Duration of the block [s].
        """
        before = self._charge
        self._charge = before * math.exp(-duration / self._tau) + film - self._film
        self._film = film
        greatest = max(abs(before), abs(self._charge))
        return min(abs(self._charge - before) / greatest, 1.0) if greatest else 0.0
