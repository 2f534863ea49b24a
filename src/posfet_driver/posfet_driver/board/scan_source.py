# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Interface of everything that delivers scans: a board, real or simulated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

from posfet_driver.board.faults import FaultKind, Health
from posfet_model.sensor.scan import Scan


class SourceError(Exception):
    """A source cannot be opened; the message is one line with the reason."""


@dataclass(frozen=True)
class SourceReport:
    """State of a source at one time. Counters run from the first `open` on and never fall."""

    health: Health
    state: str
    """One line without changing numbers: the state, and if it is not OK, the reason and the remedy."""
    scans: int
    """Complete scans delivered."""
    frames_lost: int
    """CAN frames lost, whatever the cause; 0 without a bus."""
    fault_counts: Mapping[FaultKind, int] = field(default_factory=dict)
    """Number of times that each counted fault occurred."""
    counters: Mapping[str, int] = field(default_factory=dict)
    """Other events, counted by name."""
    conditions: tuple[FaultKind, ...] = ()
    """Faults that are present now."""
    values: Mapping[str, str] = field(default_factory=dict)
    """Further values to display, with units in the names."""
    failure: str = ""
    """Why the source does nothing more until it is reopened, in one line; '' while it works or recovers by itself."""


class ManagedDevice(Protocol):
    """What a lifecycle node opens, reports on and closes: a source of scans, or a simulated board on a bus."""

    def open(self) -> None:
        """Start. Raises SourceError or ConfigError when a retry would not help."""
        ...

    def close(self) -> None:
        """Release what `open` acquired; may be called twice."""
        ...

    def report(self) -> SourceReport:
        """Return the state for diagnostics."""
        ...


@runtime_checkable
class ScanSource(ManagedDevice, Protocol):
    """Delivers scans one by one. One thread opens, reads and closes; `report` may be called from any thread."""

    @property
    def simulated(self) -> bool:
        """Whether the signals come from a model instead of a device."""
        ...

    def read(self, timeout: float) -> Scan | None:
        """Return the next complete scan.

        Parameters
        ----------
        timeout : float
            Longest time to wait [s].

        Returns
        -------
        Scan or None
            Overwritten by the next call: copy what is to be kept. None when no scan arrived in time.
        """
        ...


@runtime_checkable
class StreamingSource(ScanSource, Protocol):
    """A source that can hand its scans to compiled code, without Python."""

    def stream(self, sink: object, timeout: float) -> Scan | None:
        """Hand scans to a sink of `posfet_core` while nothing but scans arrives; else as `read`.

        Parameters
        ----------
        sink : object
            Capsule of what takes the scans.
        timeout : float
            Longest time to wait [s].

        Returns
        -------
        Scan or None
            A scan that the sink did not take.
        """
        ...

    def wake(self) -> None:
        """Have `stream` return; from any thread. After this no sink is given a scan before `stream` is called again."""
        ...
