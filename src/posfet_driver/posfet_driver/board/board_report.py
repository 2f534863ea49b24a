"""What a board on a bus tells of itself: counters by cause, the faults that hold, and values for people."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from posfet_driver.board.scan_source import Health, SourceReport
from posfet_driver.protocol.messages import version
from posfet_model.sensor.scan import ScanStatus

if TYPE_CHECKING:
    from posfet_driver.board.board_client import Board

FULL_LOAD: Final = 0.9
"""Share of the bus in use from which it is called full; assumed."""
UNCERTAIN: Final = 1e-3
"""Drift of the map of clocks [s] from which stamps are called uncertain: 10 s without an undelayed frame."""

_FLAGS: Final = {
    ScanStatus.SUPPLY_LOW: "supply low",
    ScanStatus.ADC_FAULT: "ADC fault",
    ScanStatus.OVERTEMPERATURE: "overtemperature",
    ScanStatus.SCAN_OVERRUN: "scan overrun",
}


def board_report(board: Board, health: Health, state: str, diagnosis: str) -> SourceReport:
    """Return the report of `board`; `diagnosis` is the fault that keeps scans from coming, '' when none does."""
    receiver = board.receiver
    status, firmware = receiver.status, receiver.firmware
    conditions = [diagnosis] if diagnosis else []
    conditions += [name for flag, name in _FLAGS.items() if status.flags & flag]
    if board.load.load > FULL_LOAD:
        conditions.append("bus full")
    if receiver.clock_drift > UNCERTAIN:
        conditions.append("stamps uncertain")
    return SourceReport(
        health=health,
        state=state,
        scans=receiver.scans,
        frames_lost=receiver.frames_lost,
        counters=_counters(board),
        conditions=tuple(conditions),
        values={
            "temperature 1 [degC]": f"{status.temperatures[0]:.2f}",
            "temperature 2 [degC]": f"{status.temperatures[1]:.2f}",
            "supply [V]": f"{status.supply:.2f}",
            "board flags": str(status.flags),
            "firmware": "not known" if firmware is None else version(firmware),
            "bus load [%]": f"{100 * board.load.load:.1f}",
            "stamps after acquisition by at most [ms]": f"{1e3 * receiver.stamp_uncertainty:.3f}",
        },
    )


def _counters(board: Board) -> dict[str, int]:
    receiver = board.receiver
    losses, traffic, errors = receiver.assembler.losses, receiver.traffic, receiver.errors
    return {
        "torn scans": losses.torn_scans,
        "lost scans": losses.lost_scans,
        "repeated frames": losses.repeated,
        "late frames": losses.late,
        "reordered frames": losses.reordered,
        "stuck counter": losses.stuck,
        "stuck clock": losses.clock_stuck,
        "malformed frames": losses.malformed + traffic.malformed,
        "foreign frames": traffic.foreign,
        "error frames": errors.frames,
        "bus off": errors.bus_off,
        "error passive": errors.passive,
        "unreadable": errors.unreadable,
        "unacknowledged": errors.unacknowledged,
        "receive overflows": errors.overflow,
        "board resets": board.resets,
        "brown-outs": board.brown_outs,
        "malformed lines": board.link.malformed_lines,
        "bus lost": board.link.failed,
        "bus opened anew": max(board.link.opened - 1, 0),
        "board started anew": board.restarted,
        "numbers asked for": receiver.questions,
    }
