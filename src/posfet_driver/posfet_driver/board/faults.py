# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""All faults that the driver detects: label, severity, meaning and remedy."""

from __future__ import annotations

from enum import Enum, IntEnum


class Health(IntEnum):
    """Health of a source; the values are those of diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


_WARN, _ERROR = Health.WARN, Health.ERROR


class FaultKind(Enum):
    """Every fault that the driver detects, the most severe and most specific first."""

    INTERNAL_ERRORS = (
        "internal errors",
        _ERROR,
        "a part of this process raised an error that nobody expected",
        "report it with the key 'latest internal error'; what has ended is restarted once a minute",
    )
    ADAPTER_DISCONNECTED = (
        "adapter disconnected",
        _ERROR,
        "the adapter cannot be opened or was disconnected",
        "connect it; the driver retries by itself",
    )
    BUS_OFF = (
        "bus off",
        _ERROR,
        "the adapter's controller went bus-off after too many errors",
        "check wiring, termination and bit rate; with socketcan set restart-ms 100 on the interface",
    )
    BUS_ERRORS = (
        "bus errors",
        _ERROR,
        "there is a signal on the bus, but no valid frame",
        "check the bit rate and data bit rate against the board's, and the wiring",
    )
    NO_TRAFFIC = (
        "no traffic",
        _ERROR,
        "there is no signal on the bus",
        "check cable, termination and the board's power supply",
    )
    BOARD_NOT_DETECTED = (
        "board not detected",
        _ERROR,
        "other nodes send frames, but this board does not",
        "check its power supply and base_id, or the identifiers in its DBC file",
    )
    NOT_RESPONDING = (
        "not responding to commands",
        _ERROR,
        "the board sends, but responds to no command",
        "check that the adapter is not in listen-only mode; else power-cycle the board",
    )
    WRONG_LAYOUT = (
        "wrong layout",
        _ERROR,
        "the board's layout differs from that of the sensor file",
        "use the board's sensor file",
    )
    WRONG_PROTOCOL = (
        "wrong protocol",
        _ERROR,
        "the board implements another version of the protocol",
        "update the driver or the board's firmware",
    )
    WRONG_FORMAT = (
        "wrong format",
        _ERROR,
        "the board sends classic scans and the sensor file says CAN FD, or the reverse",
        "set can.fd in the sensor file as the board does",
    )
    RATE_REFUSED = (
        "rate refused",
        _ERROR,
        "the board cannot scan at the rate of the sensor file",
        "lower scan_rate_Hz",
    )
    START_FAILED = ("failed to start", _ERROR, "the board responds, but does not start", "power-cycle it")
    FROZEN_COUNTER = (
        "frozen sequence counter",
        _ERROR,
        "the board sends new scans with an old counter: they cannot be distinguished",
        "update its firmware",
    )
    IMPLAUSIBLE_SEQUENCE = (
        "implausible sequence",
        _ERROR,
        "the board's sequence jumped ahead of all clocks; such scans are not used, or with CAN FD treated as a restart",
        "the driver restarts the board by itself; if that does not help, update its firmware",
    )
    FROZEN_TIMESTAMP = (
        "frozen timestamp",
        _WARN,
        "the board's clock has stopped: stamps are computed from the sequence",
        "power-cycle the board, and update its firmware",
    )
    NO_SCANS = (
        "no scans",
        _ERROR,
        "no complete scan arrives",
        "the driver restarts the board by itself, unless it only listens; if that does not help, power-cycle it",
    )
    NO_STATUS = (
        "no status",
        _WARN,
        "scans arrive, but no status of the board: its temperatures and flags are unknown",
        "check for a gateway or adapter that filters identifiers; else power-cycle the board, and update its firmware",
    )
    BROWN_OUTS = ("brown-outs", _ERROR, "the board was reset while its supply was low", "check its supply and cable")
    BOARD_RESETS = (
        "board resets",
        _WARN,
        "the board was reset",
        "check its supply; its sequence and clock have restarted",
    )
    SUPPLY_LOW = ("supply low", _WARN, "the board reports a low supply voltage", "check its supply and cable")
    ADC_FAULT = (
        "ADC fault",
        _ERROR,
        "the board reports a fault of its ADC",
        "forces are unreliable: run SELF_TEST, replace the board",
    )
    OVERTEMPERATURE = ("overtemperature", _WARN, "the board reports overtemperature", "cool it")
    SCAN_OVERRUN = ("scan overrun", _WARN, "the board cannot sustain its scan rate", "lower scan_rate_Hz")
    RECEIVE_OVERFLOWS = (
        "receive overflows",
        _WARN,
        "the adapter or the kernel had no room for frames",
        "reduce the processor load, raise net.core.rmem_max with socketcan, or use a faster adapter",
    )
    UNREADABLE = (
        "unreadable",
        _WARN,
        "the adapter delivers lines or frames that cannot be parsed",
        "check that it is the adapter's port, its cable, and the adapter's firmware",
    )
    HIGH_BUS_LOAD = (
        "high bus load",
        _WARN,
        "little bandwidth is left on the bus",
        "slow down or move other nodes, or use CAN FD",
    )
    INCOMPLETE_SCANS = (
        "incomplete scans",
        _WARN,
        "parts of scans are missing; these scans are not published",
        "check wiring and bus load",
    )
    LOST_SCANS = (
        "lost scans",
        _WARN,
        "scans are missing",
        "check wiring, bus load, and the load of this machine",
    )
    DUPLICATE_FRAMES = (
        "duplicate frames",
        _WARN,
        "frames arrived twice",
        "check for a gateway or adapter that duplicates frames",
    )
    LATE_FRAMES = (
        "late frames",
        _WARN,
        "frames arrived after their scan had been abandoned",
        "the board or a gateway must keep the order of scans; check for a second board with this base_id",
    )
    REORDERED_FRAMES = (
        "reordered frames",
        _WARN,
        "blocks of scans arrived in another order",
        "nothing is lost, but the board should send from one queue",
    )
    MALFORMED_FRAMES = (
        "malformed frames",
        _WARN,
        "frames with the board's identifiers have the wrong length or type",
        "check for another node in its identifier range, and compare can.fd with the board",
    )
    ERROR_PASSIVE = (
        "error passive",
        _WARN,
        "the adapter's controller went error-passive after many errors",
        "check wiring, termination and bit rate before it goes bus-off",
    )
    CHECKSUM_ERRORS = (
        "checksum errors",
        _WARN,
        "scans were changed between board and driver; these are not used",
        "check adapter, gateway and the board's memory; check for another node in its identifier range",
    )
    UNACKNOWLEDGED = (
        "unacknowledged",
        _WARN,
        "no node acknowledged a frame that was sent",
        "check cable, bit rate and the board's power supply",
    )
    ERROR_FRAMES = (
        "error frames",
        _WARN,
        "there are errors on the bus",
        "check termination, wiring and sample points",
    )
    CLOCK_SYNC_DEGRADED = (
        "clock sync degraded",
        _WARN,
        "the clock offset is less certain than usual",
        "reduce the load of the bus and of this machine: no frame arrives undelayed",
    )

    def __init__(self, label: str, health: Health, meaning: str, remedy: str) -> None:
        self.label = label
        """Name in diagnostics, logs and documents."""
        self.health = health
        """Severity: WARN or ERROR."""
        self.meaning = meaning
        self.remedy = remedy

    @property
    def text(self) -> str:
        """The fault in one line."""
        return f"{self.label}: {self.meaning}; {self.remedy}"
