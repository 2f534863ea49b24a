# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Report of a board: faults, counters and values to display."""

from __future__ import annotations

from typing import Final

from posfet_driver.board.board_connection import BoardConnection
from posfet_driver.board.connection_state import HEALTH, ConnectionState
from posfet_driver.board.faults import FaultKind, Health
from posfet_driver.board.scan_source import SourceReport
from posfet_driver.bus.reconnecting_bus import ReconnectingBus
from posfet_driver.protocol.decoder import Decoder
from posfet_driver.protocol.mapped_decoder import MappedDecoder
from posfet_driver.protocol.messages import NO_STATUS
from posfet_model.sensor.scan import ScanStatus

HIGH_LOAD: Final = 0.9
"""Bus load from which on it is reported as high [1]; assumed."""
MAX_CLOCK_UNCERTAINTY: Final = 2e-3
"""Uncertainty of the clock offset [s] above which clock sync is degraded: 10 s without an undelayed frame; assumed."""

_FLAGS: Final = {
    ScanStatus.SUPPLY_LOW: FaultKind.SUPPLY_LOW,
    ScanStatus.ADC_FAULT: FaultKind.ADC_FAULT,
    ScanStatus.OVERTEMPERATURE: FaultKind.OVERTEMPERATURE,
    ScanStatus.SCAN_OVERRUN: FaultKind.SCAN_OVERRUN,
}


def board_report(
    connection: BoardConnection,
    decoder: Decoder | MappedDecoder,
    stamp_uncertainty: float,
    restarts: int = 0,
    brown_outs: int = 0,
    status_missing: bool = False,
) -> SourceReport:
    """Return the report of a board.

    Parameters
    ----------
    connection : BoardConnection
        State of the connection, counters of failures and error frames, bus load.
    decoder : Decoder or MappedDecoder
        Source of the counters of scans and frames, and of the board's status.
    stamp_uncertainty : float
        Largest delay of a stamp after the acquisition [s].
    restarts : int, default 0
        Number of times a silent board was restarted.
    brown_outs : int, default 0
        Resets around which the supply voltage was low.
    status_missing : bool, default False
        Whether scans arrive, but no status of the board.

    Returns
    -------
    SourceReport
        The state of now.
    """
    bus, load = connection.bus, connection.load
    scanning = connection.state == ConnectionState.SCANS
    waiting = scanning and not connection.flowing
    status = decoder.status if bus.is_open else NO_STATUS
    identity = decoder.identity
    conditions = [connection.fault] if connection.fault else []
    flags = status.flags if scanning else status.flags & ~ScanStatus.SCAN_OVERRUN  # of a board that does not scan
    conditions += [fault for flag, fault in _FLAGS.items() if flags & flag]
    if status_missing and scanning:
        conditions.append(FaultKind.NO_STATUS)
    if bus.is_bus_off and connection.fault is not FaultKind.BUS_OFF:
        conditions.append(FaultKind.BUS_OFF)
    if load.load > HIGH_LOAD:
        conditions.append(FaultKind.HIGH_BUS_LOAD)
    if scanning and decoder.clock_uncertainty > MAX_CLOCK_UNCERTAINTY:
        conditions.append(FaultKind.CLOCK_SYNC_DEGRADED)
    return SourceReport(
        health=Health.WARN if waiting else HEALTH[connection.state],
        state=connection.reason,
        scans=decoder.scans,
        frames_lost=decoder.frames_lost,
        fault_counts=_fault_counts(decoder, bus, brown_outs),
        counters={
            "unrelated frames": decoder.traffic.unrelated,
            "bit errors": bus.errors.bit_errors,
            "bus losses": bus.failed,
            "bus open failures": bus.open_failures,
            "bus reopened": max(bus.opened - 1, 0),
            "board restarts": restarts,
            "commands of other hosts": decoder.traffic.commands,
            "status frames lost": decoder.traffic.status_lost,
            "status frames repeated": decoder.traffic.status_repeated,
        },
        conditions=tuple(conditions),
        values={
            "temperature 1 [degC]": f"{status.temperatures[0]:.2f}",
            "temperature 2 [degC]": f"{status.temperatures[1]:.2f}",
            "supply [V]": f"{status.supply:.2f}",
            "board flags": "unknown" if status is NO_STATUS else str(status.flags),
            "firmware": identity.firmware if identity else "unknown",
            "scan period [ms]": f"{decoder.scan_period / 1000:g}",
            "bus load by received frames [%]": f"{100 * load.load:.1f}",
            "maximum stamp delay [ms]": f"{1e3 * stamp_uncertainty:.3f}",
            **(decoder.origin if isinstance(decoder, MappedDecoder) else {}),
        },
    )


def decoder_fault_counts(decoder: Decoder | MappedDecoder) -> dict[FaultKind, int]:
    """Return how often each fault occurred that shows in the frames of a board.

    Parameters
    ----------
    decoder : Decoder or MappedDecoder
        Decodes the frames of the board.
    """
    statistics = decoder.statistics
    return {
        FaultKind.INCOMPLETE_SCANS: statistics.incomplete_scans,
        FaultKind.LOST_SCANS: statistics.lost_scans,
        FaultKind.DUPLICATE_FRAMES: statistics.duplicate,
        FaultKind.LATE_FRAMES: statistics.late,
        FaultKind.REORDERED_FRAMES: statistics.reordered,
        FaultKind.FROZEN_COUNTER: statistics.frozen_counter,
        FaultKind.FROZEN_TIMESTAMP: decoder.frozen_clock,
        FaultKind.IMPLAUSIBLE_SEQUENCE: statistics.implausible,
        FaultKind.CHECKSUM_ERRORS: statistics.checksum,
        FaultKind.MALFORMED_FRAMES: statistics.malformed + decoder.traffic.malformed,
        FaultKind.BOARD_RESETS: decoder.resets,
    }


def _fault_counts(decoder: Decoder | MappedDecoder, bus: ReconnectingBus, brown_outs: int) -> dict[FaultKind, int]:
    errors = bus.errors
    return {
        **decoder_fault_counts(decoder),
        FaultKind.ERROR_FRAMES: errors.frames,
        FaultKind.BUS_OFF: bus.bus_offs,
        FaultKind.ERROR_PASSIVE: errors.passive,
        FaultKind.UNACKNOWLEDGED: errors.unacknowledged,
        FaultKind.RECEIVE_OVERFLOWS: errors.overflow,
        FaultKind.BROWN_OUTS: brown_outs,
        FaultKind.UNREADABLE: bus.unreadable,
    }
