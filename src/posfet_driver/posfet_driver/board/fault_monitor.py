# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Which faults are present, from the reports of a source."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

from posfet_driver.board.faults import FaultKind, Health
from posfet_driver.board.scan_source import SourceReport

HOLD: Final = 5_000_000_000
"""Time for which a counted fault stays present [ns]: an intermittent one is reported once."""


class FaultMonitor:
    """Lists the faults that are present: those that a source reports, and those whose counter rose recently."""

    def __init__(self) -> None:
        self._counts: dict[FaultKind, int] = {}
        self._until: dict[FaultKind, int] = {}

    def present(self, report: SourceReport, now: int) -> list[FaultKind]:
        """Return the faults that are present. Call it once for each report, from one thread.

        Parameters
        ----------
        report : SourceReport
            The newest report.
        now : int
            Monotonic time [ns].

        Returns
        -------
        list of FaultKind
            The most severe first.
        """
        for kind, count in report.fault_counts.items():
            if count > self._counts.get(kind, 0):
                self._until[kind] = now + HOLD
            self._counts[kind] = count
        return [kind for kind in FaultKind if kind in report.conditions or self._until.get(kind, now) > now]


def worst(faults: Iterable[FaultKind], health: Health) -> Health:
    """Return the health of a source that has these faults and reports `health` itself.

    Parameters
    ----------
    faults : iterable of FaultKind
        Faults that are present.
    health : Health
        Health that the source itself reports.
    """
    return max((health, *(fault.health for fault in faults)))


def changes(before: Sequence[FaultKind], now: Sequence[FaultKind]) -> tuple[list[FaultKind], list[FaultKind]]:
    """Return the faults that have appeared and those that have cleared.

    Parameters
    ----------
    before : sequence of FaultKind
        Faults before.
    now : sequence of FaultKind
        Faults now.
    """
    return [fault for fault in now if fault not in before], [fault for fault in before if fault not in now]
