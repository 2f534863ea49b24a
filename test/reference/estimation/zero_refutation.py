# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""When the temperature sensors say that zeros are wrong, and until when."""

from __future__ import annotations

from typing import Final

SURPRISING: Final = 3.0
"""Deviations from which on a reading of the temperature sensors is unexpected [1]."""

EVIDENCE: Final = 14.0
"""Twice the logarithm of how much likelier readings must be without zeros [1]."""

SIGNIFICANT: Final = 2.0
"""Deviations from which on the total force is significant, and a reading contradicts zeros that have changed the rate
beyond its dynamics [1]."""

GONE: Final = 0.3
"""Share of its peak below which the total force has gone [1]."""

PRESSED: Final = 0.5
"""Share of the mean force from which on a taxel is pressed by what presses all [1]."""

MEMORY: Final = 10.0
"""Time after which what is not significant is none [s], assumed."""


class ZeroRefutation:
    """Decides whether something presses on all taxels, too slowly to be noticed.

    State variables: the greatest significant total force since zeros were refuted [N], and for how long it has not been
    significant [s].
    """

    def __init__(self) -> None:
        self._peak, self._insignificant = 0.0, 0.0
        self.wide = False
        """Whether zeros have been refuted, and what presses has not left since."""
        self.significant = False
        """Whether the total force is significant."""

    def refute(self) -> None:
        """Record that zeros have been refuted."""
        self._peak = self._peak if self.wide else 0.0
        self._insignificant, self.wide = 0.0, True

    def end_block(self, duration: float, total: float, deviation: float) -> None:
        """Process the end of a block of `duration` [s], with the `total` force and its `deviation` [N]."""
        self.significant = total > SIGNIFICANT * deviation
        if self.significant:
            self._peak, self._insignificant = max(self._peak, total), 0.0
            return
        self._insignificant += duration
        self.wide = self.wide and total >= GONE * self._peak and self._insignificant < MEMORY
