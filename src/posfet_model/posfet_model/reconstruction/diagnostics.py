# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Diagnosis of the reconstruction for the operator: a level and one line with cause and remedy."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from posfet_model.calibration.taxel_calibration import UNCALIBRATED_ERROR
from posfet_model.reconstruction.scan_clock import ScanCounts

SILENCE: Final = 1.0
"""Time without a scan from which on there are none [s]; of a board with few scans per second"""

SILENT_PERIODS: Final = 2.0
"""this many of its scan periods, if that is longer [1]."""


class Level(IntEnum):
    """Severity; the values are those of diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2


@dataclass(frozen=True)
class Period:
    """Events in the period between two reports, and the state at its end."""

    silent: bool
    """Whether no scan has been accepted for so long that the board sends none."""
    layout_mismatch: int
    """Scans refused because their layout is not that of the sensor."""
    adc_fault: int
    """Scans refused because the ADC failed, as the board reports or as their counts show."""
    bursts: int
    """Scans refused for interference."""
    refused: int
    """Scans refused as duplicate or late."""
    missed: int
    """Scans missing in the sequence."""
    interruptions: int
    """Gaps too long to bridge, and resets after which the charge is another one."""
    resets: int
    """Resets of the board."""
    time_jumps: int
    """Jumps of the board clock."""
    unsettled: int
    """Taxels whose offset is unknown at the end of the period."""
    saturated: int
    """Taxels saturated at the end of the period."""
    faulty: int
    """Taxels dead, stuck or noisy at the end of the period."""
    temperature_known: bool
    """Whether a temperature sensor of the chip reports at the end of the period."""
    calibrated: bool
    """Whether the forces are those of a calibrated sensor."""

    @classmethod
    def between(
        cls,
        before: ScanCounts,
        after: ScanCounts,
        unsettled: int,
        saturated: int,
        faulty: int,
        temperature_known: bool,
        calibrated: bool,
        silent: bool,
    ) -> Period:
        """Return the period between two counts.

        Parameters
        ----------
        before, after : ScanCounts
            Counts at the start and at the end of the period.
        unsettled, saturated, faulty : int
            Number of taxels at the end: with unknown offset, saturated, and dead, stuck or noisy.
        temperature_known : bool
            Whether a temperature sensor reports at the end.
        calibrated : bool
            Whether the forces are those of a calibrated sensor.
        silent : bool
            Whether the board sends no scans, see `is_silent`.

        Returns
        -------
        Period
            Events and state of the period.
        """
        return cls(
            silent=silent,
            layout_mismatch=after.layout_mismatch - before.layout_mismatch,
            adc_fault=after.adc_fault + after.implausible - before.adc_fault - before.implausible,
            bursts=after.bursts - before.bursts,
            refused=after.repeated + after.late - before.repeated - before.late,
            missed=after.missed - before.missed,
            interruptions=after.gaps - before.gaps,
            resets=after.resets - before.resets,
            time_jumps=after.time_jumps - before.time_jumps,
            unsettled=unsettled,
            saturated=saturated,
            faulty=faulty,
            temperature_known=temperature_known,
            calibrated=calibrated,
        )


@dataclass(frozen=True)
class Verdict:
    """Severity with its cause."""

    level: Level
    """Severity."""
    text: str
    """One line: cause and remedy."""


def is_silent(without: float, rate: float) -> bool:
    """Return whether no scans arrive, and not only few.

    Parameters
    ----------
    without : float
        Time since the last report that knew new scans [s].
    rate : float
        Scans per second by the board clock [Hz].

    Returns
    -------
    bool
        Whether that is longer than `SILENCE` and `SILENT_PERIODS` of the board.
    """
    return without >= max(SILENCE, SILENT_PERIODS / rate)


def judge(period: Period) -> Verdict:
    """Return the most severe finding of a period.

    Parameters
    ----------
    period : Period
        Events and state between two reports.

    Returns
    -------
    Verdict
        Severity with its cause; OK when there is no finding.
    """
    faults = (
        (period.layout_mismatch > 0, Level.ERROR, "layout mismatch, scans refused: set this board's sensor file"),
        (period.adc_fault > 0, Level.ERROR, "ADC fault, scans refused: check supply and wiring of the board"),
        (period.silent, Level.ERROR, "no scans: check that the driver is running and active"),
        (period.interruptions > 0, Level.WARN, "interrupted: forces held meanwhile are unknown; check the bus"),
        (period.resets > 0, Level.WARN, "board restarted: forces are tracked across it; check its supply"),
        (period.time_jumps > 0, Level.WARN, "board clock jumped: intervals taken from the sequence"),
        (period.saturated > 0, Level.WARN, "taxels saturated: press less, or widen the ADC range"),
        (period.unsettled > 0, Level.WARN, "offset of some taxels unknown: leave the sensor untouched for a moment"),
        (period.faulty > 0, Level.WARN, "taxels dead, stuck or noisy: excluded from contacts; see status in `image`"),
        (not period.temperature_known, Level.WARN, "no chip temperature: 1 K reads as 1 N; check the status frames"),
        (period.bursts > 0, Level.WARN, "interference, scans refused: check shield and ground of board and cable"),
        (period.missed > 0, Level.WARN, "scans missing: the force is tracked across gaps; check the bus load"),
        (period.refused > 0, Level.WARN, "duplicate or late scans refused: check for a second driver"),
    )
    for present, level, text in faults:
        if present:
            return Verdict(level, text)
    if not period.calibrated:
        return Verdict(Level.OK, f"uncalibrated: forces may be off by {UNCALIBRATED_ERROR:.0%}; see posfet calibrate")
    return Verdict(Level.OK, "forces are valid")
