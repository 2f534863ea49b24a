"""Every fault that a driver can tell: its name, how bad it is, what it means, and what to do about it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

from posfet_driver.board.scan_source import Health, SourceReport

HOLD: Final = 5_000_000_000
"""Time [ns] for which a fault that was counted is called present: one that comes and goes is told once."""


@dataclass(frozen=True)
class Fault:
    """One fault. The name is that of its counter, where it has one."""

    name: str
    health: Health
    meaning: str
    remedy: str

    @property
    def text(self) -> str:
        """The fault in one line."""
        return f"{self.name}: {self.meaning}; {self.remedy}"


_WARN, _ERROR = Health.WARN, Health.ERROR

FAULTS: Final = {
    fault.name: fault
    for fault in (
        # From the worst and most telling to the least.
        Fault(
            "bus gone", _ERROR, "the adapter cannot be opened or has gone", "plug it in; it is tried again by itself"
        ),
        Fault(
            "bus off",
            _ERROR,
            "the adapter's controller left the bus after too many errors",
            "check wiring, termination and bitrate; with socketcan set restart-ms 100 on the interface",
        ),
        Fault(
            "bus unreadable",
            _ERROR,
            "there is a signal on the bus, but no frame in it",
            "check that bitrate and data bitrate are the board's, and the wiring",
        ),
        Fault(
            "bus silent",
            _ERROR,
            "nothing at all is on the bus",
            "check cable, termination and the board's power",
        ),
        Fault("board missing", _ERROR, "others speak on the bus, but not this board", "check its power and base_id"),
        Fault(
            "board deaf",
            _ERROR,
            "the board sends, but answers no command",
            "check that the adapter is not in listen-only mode; else switch the board off and on",
        ),
        Fault("wrong layout", _ERROR, "the board has another layout than the sensor file", "use its sensor file"),
        Fault(
            "wrong firmware",
            _ERROR,
            "the board's firmware speaks another version of the protocol",
            "update the driver or the board",
        ),
        Fault(
            "rate refused",
            _ERROR,
            "the board cannot scan at the rate of the sensor file",
            "lower scan_rate_Hz",
        ),
        Fault("no start", _ERROR, "the board answers, but does not start", "switch it off and on"),
        Fault(
            "stuck counter",
            _ERROR,
            "the board sends new scans under an old number: they cannot be told apart",
            "update its firmware",
        ),
        Fault(
            "stuck clock",
            _WARN,
            "the board's clock stands still: stamps are reckoned from the numbers of scans",
            "switch the board off and on, and update its firmware",
        ),
        Fault(
            "no scans",
            _ERROR,
            "no whole scan comes",
            "it is asked and started again by itself; if that does not help, switch it off and on",
        ),
        Fault("brown-outs", _ERROR, "the board was reset when its supply was low", "check its supply and cable"),
        Fault("board resets", _WARN, "the board was reset", "check its supply; its numbers and clock began anew"),
        Fault("supply low", _WARN, "the board says so", "check its supply and cable"),
        Fault("ADC fault", _ERROR, "the board says so", "forces cannot be trusted: run SELF_TEST, replace the board"),
        Fault("overtemperature", _WARN, "the board says so", "cool it"),
        Fault("scan overrun", _WARN, "the board cannot keep its own rate", "lower scan_rate_Hz"),
        Fault(
            "receive overflows",
            _WARN,
            "the adapter or the kernel had no room for frames",
            "free the processor, raise net.core.rmem_max with socketcan, or take a faster adapter",
        ),
        Fault(
            "malformed lines",
            _WARN,
            "the serial port sends what is no slcan",
            "check that it is the adapter's port, and its cable",
        ),
        Fault("bus full", _WARN, "little room is left on the bus", "slow down or move other nodes, or use CAN FD"),
        Fault("torn scans", _WARN, "parts of scans are missing; they are not published", "check wiring and bus load"),
        Fault("lost scans", _WARN, "whole scans are missing", "check wiring, bus load, and load of this machine"),
        Fault("repeated frames", _WARN, "frames came twice", "look for a gateway or adapter that doubles frames"),
        Fault(
            "late frames",
            _WARN,
            "frames came after their scan was given up",
            "the board or a gateway must keep the order of scans; look for a second board of this base_id",
        ),
        Fault(
            "reordered frames",
            _WARN,
            "blocks of scans came in another order",
            "nothing is lost by it, but the board should send from one queue",
        ),
        Fault(
            "malformed frames",
            _WARN,
            "frames with the board's identifiers that cannot be its",
            "look for another node in its identifier range, and compare can.fd with the board",
        ),
        Fault("unacknowledged", _WARN, "nobody received what was sent", "check cable, bitrate and the board's power"),
        Fault("error frames", _WARN, "errors on the bus", "check termination, wiring and sample points"),
        Fault(
            "stamps uncertain",
            _WARN,
            "the clocks are mapped with less certainty than usual",
            "free the bus and this machine: no frame comes undelayed",
        ),
    )
}
"""By name, the worst first."""


class FaultWatch:
    """Tells which faults are present: those that a source names, and those whose counter rose lately."""

    def __init__(self) -> None:
        self._counts: dict[str, int] = {}
        self._until: dict[str, int] = {}

    def present(self, report: SourceReport, now: int) -> list[Fault]:
        """Return the faults at time `now` [ns], the worst first. Ask once for each report, in one thread."""
        for name, count in report.counters.items():
            if count > self._counts.get(name, 0):
                self._until[name] = now + HOLD
            self._counts[name] = count
        return [
            fault for name, fault in FAULTS.items() if name in report.conditions or self._until.get(name, now) > now
        ]


def worst(faults: Iterable[Fault], health: Health) -> Health:
    """Return how a source fares that has these faults and calls itself as well as `health`."""
    return max((health, *(fault.health for fault in faults)))


def changes(before: Sequence[Fault], now: Sequence[Fault]) -> tuple[list[Fault], list[Fault]]:
    """Return which faults have come and which are over."""
    return [fault for fault in now if fault not in before], [fault for fault in before if fault not in now]
