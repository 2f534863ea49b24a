# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A board with frames of its own as a source of scans: only listened to, never written to."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from typing import Final

from posfet_driver.board.board_connection import BoardConnection
from posfet_driver.board.board_report import board_report
from posfet_driver.board.command_queue import CommandError
from posfet_driver.board.connection_state import ConnectionState
from posfet_driver.board.faults import FaultKind
from posfet_driver.board.scan_source import SourceReport
from posfet_driver.board.transit_time import mapped_transit_times
from posfet_driver.bus.frame_bus import FrameBus
from posfet_driver.clock import Clock, SystemClock
from posfet_driver.protocol.mapped_decoder import MappedDecoder
from posfet_driver.protocol.messages import Command, Response
from posfet_model._lib.units import NANOSECONDS
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import Scan

LISTENS_ONLY: Final = "the driver only listens to a board with frames of its own (protocol in the sensor file)"


class ListeningBoard:
    """One board on a bus that nothing is sent to. Used by one thread, but for `submit` and `report`.

    The bus is reopened, with back-off, whenever it cannot be opened, fails, or stays without a frame of the
    board. None of this raises: `report` states what is missing and why.

    Parameters
    ----------
    sensor : Sensor
        The array and the mapping of its frames.
    open_bus : callable
        Opens the bus; raises can.CanError or ConfigError.
    clock : Clock, optional
        Source of time; by default that of this machine.
    presence : callable, optional
        Returns a value that changes when the adapter is connected again: then the bus is opened without further delay.

    Raises
    ------
    ConfigError
        When the mapping does not fit the DBC file, or the file cannot be read.
    """

    simulated = False

    def __init__(
        self,
        sensor: Sensor,
        open_bus: Callable[[], FrameBus],
        clock: Clock | None = None,
        presence: Callable[[], object] | None = None,
    ) -> None:
        self.decoder = MappedDecoder(sensor)
        self._clock = clock or SystemClock()
        self._connection = BoardConnection(
            sensor.can, self.decoder, open_bus, self._clock, presence, "waiting for scans"
        )
        self.bus = self._connection.bus
        self.decoder.transit_time.times = mapped_transit_times(sensor.can, self.decoder.tables)
        self._dbc = sensor.mapping.dbc.name if sensor.mapping else ""

    @property
    def stamp_uncertainty(self) -> float:
        """Largest error of the newest scan's stamp [s]; NaN before the first, and when the board sends no time."""
        return self.decoder.scan.stamp_uncertainty

    def open(self) -> None:
        """Begin to listen; a bus that cannot be opened yet is retried by `read`.

        Raises
        ------
        ConfigError
            When the bus can never be opened with these arguments.
        """
        if self._connection.state == ConnectionState.CLOSED and self._connection.open():
            self._listen()

    def close(self) -> None:
        """Close the bus; may be called twice."""
        self._connection.close()

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
        connection, wait, end = self._connection, round(timeout * NANOSECONDS), 0
        while not self._next_scan():
            now = self._clock.monotonic()
            end = end or now + wait
            if now >= end:
                return None
            if connection.wait(now, end):
                self._handle_timeout(now)
        return self.decoder.scan

    def submit(self, command: Command, argument: int = 0, timeout: float = 0.5) -> Future[Response]:
        """Refuse a command: nothing is sent to this board. Raises CommandError."""
        raise CommandError(f"{command.name}: {LISTENS_ONLY}")

    def request(self, command: Command, argument: int = 0, timeout: float = 0.5) -> Response:
        """Refuse a command: nothing is sent to this board. Raises CommandError."""
        return self.submit(command, argument, timeout).result()

    def report(self) -> SourceReport:
        """Return the state for diagnostics; may be called from any thread."""
        return board_report(self._connection, self.decoder, self.stamp_uncertainty)

    def _next_scan(self) -> bool:
        """Process the frames at hand up to the next complete scan; return whether there is one."""
        connection = self._connection
        for _ in connection.decoded:
            connection.deadline = connection.arrival + connection.scan_timeout
            if not connection.flowing:
                connection.flowing = True
                connection.fault, connection.reason = None, "receiving scans"
                self.bus.reset_backoff()
                connection.no_response.board_responded()
            return True
        connection.check_adapter()
        return False

    def _listen(self) -> None:
        """Receive scans: the bus was opened."""
        self._connection.flowing = False
        self._connection.enter(
            ConnectionState.SCANS, self._connection.reason, self._connection.scan_timeout / NANOSECONDS
        )
        self.decoder.start()

    def _handle_timeout(self, now: int) -> None:
        """Open the bus again, or find out why no scans arrive and reopen it from time to time."""
        connection = self._connection
        if connection.state == ConnectionState.BUS:
            if connection.reopen():
                self._listen()
            return
        if connection.flowing:
            connection.flowing = False
            connection.no_response.begin(now)
            connection.reason = "waiting for scans"
        else:
            cause = connection.no_response.cause()
            connection.fault = FaultKind.NO_SCANS if cause == FaultKind.NOT_RESPONDING else cause
            connection.reason = (
                f"the board's frames give no complete scan: compare {self._dbc} with them"
                if connection.fault == FaultKind.NO_SCANS
                else f"no frames of the board: check power, cable, bit rate and the identifiers in {self._dbc}"
            )
        connection.deadline = now + connection.scan_timeout
        connection.ask_adapter()
        if connection.fault != FaultKind.NO_SCANS and connection.reopen_when_silent():
            self._listen()
