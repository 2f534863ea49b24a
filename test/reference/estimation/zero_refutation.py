# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""When the temperature sensors say that zeros are wrong."""

from __future__ import annotations

import math
from typing import Final

CONTRADICTED: Final = 2.0
"""Deviations by which a reading must contradict zeros that have changed the rate beyond its dynamics [1]."""

SURPRISING: Final = 3.0
"""Deviations from which on a reading of the temperature sensors is unexpected [1]."""

IN_TURN: Final = 2
"""Number of unexpected readings in turn that contradict them without such a change [1]."""

MEMORY: Final = 10.0
"""Time in which the rate at rest is averaged, and a press is forgotten that no contact shows [s], assumed."""


class ZeroRefutation:
    """Finds that something presses on all taxels, too slowly to be noticed, from readings of the temperature sensors.

    State variables: the rate at rest [K/s], the number of readings in turn that contradict zeros, and what these may
    have hidden of a press, as a temperature of the film [K].

    Parameters
    ----------
    newton_per_kelvin : float
        Mean signal of a change of the film's temperature [N/K].
    lag_known : bool
        Whether the lag of the sensors is calibrated.
    """

    def __init__(self, newton_per_kelvin: float, lag_known: bool) -> None:
        self._per_kelvin, self._lag_known = newton_per_kelvin, lag_known
        self._resting_rate, self._in_turn = 0.0, 0
        self.hidden = 0.0
        """What zeros may have hidden of a wide press, as a temperature of the film [K]."""

    def may_hide(self, kelvin: float) -> bool:
        """Return whether a reading that is `kelvin` above its expectation is in the direction of a press."""
        return kelvin * self._per_kelvin < 0.0

    def count(self, deviations: float, rate: float) -> None:
        """Count a reading of so many `deviations` at a `rate` of the temperature [K/s]; 0: it contradicts nothing."""
        turned = (rate - self._resting_rate) * self._per_kelvin > 0.0
        self._in_turn = self._in_turn + 1 if turned and self._lag_known and deviations > SURPRISING else 0

    @property
    def in_turn(self) -> bool:
        """Whether zeros are refuted by readings in turn."""
        return self._in_turn >= IN_TURN

    def end_block(self, duration: float, age: float, rate: float, listed: bool, rested: bool) -> None:
        """Process the end of a block of `duration` [s], where a contact is listed, or none has been for a while."""
        self.hidden *= 0.0 if listed else math.exp(-duration / MEMORY)
        if rested:
            self._resting_rate += duration / min(max(age, duration), MEMORY) * (rate - self._resting_rate)
