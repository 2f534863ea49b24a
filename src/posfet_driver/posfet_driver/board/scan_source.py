"""Where scans come from: what a node needs to know of a board, real or simulated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Protocol, runtime_checkable

from posfet_model.sensor.scan import Scan


class SourceError(Exception):
    """A source cannot be opened; the message is one line with the reason."""


class Health(IntEnum):
    """How a source fares; the values are those of diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True)
class SourceReport:
    """State of a source at one moment. Counters count from the first `open` on and never fall."""

    health: Health
    state: str
    """One line without numbers that change: what is, and if it is not well, why and what to do about it."""
    scans: int
    """Whole scans handed on."""
    frames_lost: int
    """CAN frames lost, whatever the cause; 0 without a bus."""
    counters: Mapping[str, int] = field(default_factory=dict)
    """What went wrong, counted by cause."""
    conditions: tuple[str, ...] = ()
    """Names of the faults that hold at this moment, from the table in faults.py."""
    values: Mapping[str, str] = field(default_factory=dict)
    """What else a person wants to see, with units in the names."""


class ManagedDevice(Protocol):
    """What a lifecycle node opens, reports on and closes: a source of scans, or a simulated board on a bus."""

    def open(self) -> None:
        """Start. Raises SourceError or ConfigError when trying again would not help."""
        ...

    def close(self) -> None:
        """Give back what `open` took; may be called twice."""
        ...

    def report(self) -> SourceReport:
        """Return the state for diagnostics."""
        ...


@runtime_checkable
class ScanSource(ManagedDevice, Protocol):
    """Gives scans one by one. One thread opens, reads and closes; `report` may be called from any thread."""

    @property
    def simulated(self) -> bool:
        """Whether the signals come from a model instead of a device."""
        ...

    def open(self) -> None:
        """Make ready to read. Raises SourceError or ConfigError when trying again would not help."""
        ...

    def read(self, timeout: float) -> Scan | None:
        """Return the next whole scan, or None when there was none within `timeout` [s].

        The scan is filled anew by the next call: copy what is to be kept.
        """
        ...
