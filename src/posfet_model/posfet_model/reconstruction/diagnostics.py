"""What the state of the reconstruction means for a person: a level, one line, and what to do."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from posfet_model.reconstruction.scan_clock import ScanCounts


class Level(IntEnum):
    """How well it goes; the values are those of diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True)
class Period:
    """What happened in one period between two reports."""

    scans: int
    """Scans taken."""
    layout_mismatch: int
    """Scans refused for another layout."""
    adc_fault: int
    """Scans refused because the ADC failed, by its own word or by what it gave."""
    refused: int
    """Scans refused because they came twice or late."""
    missed: int
    """Scans that never came."""
    interruptions: int
    """Resets of the board, and gaps too long to follow the force."""
    time_jumps: int
    """Jumps of the board's clock."""
    unsettled: int
    """Taxels whose offset is not known at its end."""
    saturated: int
    """Taxels at the end of their range at its end."""
    bad: int
    """Taxels that do not work at its end."""
    temperature_known: bool
    """Whether a temperature sensor of the chip is known at its end."""

    @classmethod
    def between(
        cls, before: ScanCounts, after: ScanCounts, unsettled: int, saturated: int, bad: int, temperature_known: bool
    ) -> Period:
        """Return what happened between two counts, and the state at its end."""
        return cls(
            scans=after.accepted - before.accepted,
            layout_mismatch=after.layout_mismatch - before.layout_mismatch,
            adc_fault=after.adc_fault + after.implausible - before.adc_fault - before.implausible,
            refused=after.repeated + after.late - before.repeated - before.late,
            missed=after.missed - before.missed,
            interruptions=after.resets + after.gaps - before.resets - before.gaps,
            time_jumps=after.time_jumps - before.time_jumps,
            unsettled=unsettled,
            saturated=saturated,
            bad=bad,
            temperature_known=temperature_known,
        )


@dataclass(frozen=True)
class Verdict:
    """A level and its reason."""

    level: Level
    text: str
    """One line: what is, why, and what to do about it."""


def judge(period: Period) -> Verdict:
    """Return the worst that can be said of a period."""
    faults = (
        (period.layout_mismatch > 0, Level.ERROR, "scans of another layout refused: give this board's sensor file"),
        (period.adc_fault > 0, Level.ERROR, "the ADC failed, scans refused: check supply and wiring of the board"),
        (period.scans == 0, Level.STALE, "no scans: check that the driver runs and is active"),
        (period.interruptions > 0, Level.WARN, "interrupted: forces held meanwhile are not known; check the bus"),
        (period.time_jumps > 0, Level.WARN, "the board's clock jumped: intervals were taken from the sequence"),
        (period.saturated > 0, Level.WARN, "taxels at the end of their range: press less, or give them a wider one"),
        (period.unsettled > 0, Level.WARN, "finding the zero of some taxels: leave the sensor at rest for a moment"),
        (period.bad > 0, Level.WARN, "taxels dead, stuck or noisy: left out of contacts; see status in `image`"),
        (not period.temperature_known, Level.WARN, "no chip temperature: 1 K reads like 1 N; check the status frames"),
        (period.missed > 0, Level.WARN, "scans missing: the force is followed across them; check the bus load"),
        (period.refused > 0, Level.WARN, "scans came twice or late and were refused: check for a second driver"),
    )
    for present, level, text in faults:
        if present:
            return Verdict(level, text)
    return Verdict(Level.OK, "forces are valid")
