# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A board on a CAN bus as a source of scans: identified, started, supervised, and restarted after every fault."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from typing import Final

from posfet_driver.board.board_connection import BoardConnection
from posfet_driver.board.board_report import board_report
from posfet_driver.board.board_starter import RESPONSE_TIMEOUT, BoardStarter
from posfet_driver.board.command_queue import CommandQueue
from posfet_driver.board.command_sender import CommandSender
from posfet_driver.board.connection_state import ConnectionState
from posfet_driver.board.faults import FaultKind
from posfet_driver.board.power_watch import PowerWatch
from posfet_driver.board.scan_source import SourceReport
from posfet_driver.board.suitability import unsuitable
from posfet_driver.board.transit_time import scan_transit_time
from posfet_driver.bus.frame_bus import FrameBus
from posfet_driver.bus.reconnecting_bus import PRESENCE_PERIOD
from posfet_driver.clock import Clock, SystemClock
from posfet_driver.protocol.decoder import Decoder, ResponseReceived, ScanReady, StatusReceived
from posfet_driver.protocol.messages import Command, Identity, Response, Result, Status
from posfet_model._lib.units import NANOSECONDS
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import Scan

_STARTING: Final = {ConnectionState.START, ConnectionState.SCANS}
_READY: Final = {ConnectionState.SCANS, ConnectionState.STOPPED, ConnectionState.REFUSED}
"""States in which the board accepts a command of the user."""


class Board:
    """One board on a bus. Used by one thread, but for `submit` and `report`.

    The bus is reopened, with exponential back-off, whenever it cannot be opened, fails, or stays without a response; a
    board that does not respond or stops sending is identified and restarted. None of this raises: `report` states what
    is missing and why.

    Parameters
    ----------
    sensor : Sensor
        The array and its frames.
    open_bus : callable
        Opens the bus; raises can.CanError or ConfigError.
    clock : Clock, optional
        Source of time; by default that of this machine.
    presence : callable, optional
        Returns a value that changes when the adapter is connected again: then the bus is opened without further delay.

    Raises
    ------
    ConfigError
        When the layout does not fit the frames.
    """

    simulated = False

    def __init__(
        self,
        sensor: Sensor,
        open_bus: Callable[[], FrameBus],
        clock: Clock | None = None,
        presence: Callable[[], object] | None = None,
    ) -> None:
        self.decoder = Decoder(sensor)
        self.restarted = 0
        """Number of times a silent board was restarted."""
        self._sensor = sensor
        self._clock = clock or SystemClock()
        self._connection = BoardConnection(
            sensor.can, self.decoder, open_bus, self._clock, presence, "looking for the board"
        )
        self.bus = self._connection.bus
        self.decoder.transit_time = scan_transit_time(sensor.can, self.decoder.blocks)
        self._commands = CommandQueue()
        self._sender = CommandSender(self._connection, self.decoder, sensor.can.base_id)
        self._starter = BoardStarter(sensor, self._connection, self.decoder, self._sender, self._clock)
        self._power = PowerWatch()
        self._scan_period = self.decoder.scan_period  # in force [us]

    @property
    def brown_outs(self) -> int:
        """Resets around which the supply voltage was low."""
        return self._power.brown_outs

    @property
    def stamp_uncertainty(self) -> float:
        """Largest error of the newest scan's stamp [s]; NaN before it, and while the board's clock stands still."""
        return self.decoder.scan.stamp_uncertainty

    def open(self) -> None:
        """Begin to look for the board; a bus that cannot be opened yet is retried by `read`.

        Raises
        ------
        ConfigError
            When the bus can never be opened with these arguments.
        """
        if self._connection.state == ConnectionState.CLOSED and self._connection.open():
            self._starter.identify()

    def close(self) -> None:
        """Stop the board and close the bus; may be called twice."""
        connection = self._connection
        if connection.state in _STARTING:
            self._sender.send(Command.STOP)
            self.decoder.forget_gap()
        connection.close()
        self._commands.fail(connection.reason)

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
            # While scans arrive the time of the newest batch suffices, and nothing is due before the next one.
            steady = connection.state is ConnectionState.SCANS and connection.arrival + wait < connection.deadline
            now = connection.arrival if steady else self._clock.monotonic()
            end = end or now + wait
            if now >= end:
                return None
            if steady and not self._commands.pending():
                connection.read(end - now)
            else:
                self._wait(now, end)
        return self.decoder.scan

    def submit(self, command: Command, argument: int = 0, timeout: float = 0.5) -> Future[Response]:
        """Send a command, from any thread, while another one reads; scans go on meanwhile.

        After STOP the board is left alone until START.

        Parameters
        ----------
        command : Command
            The command.
        argument : int, default 0
            Its argument.
        timeout : float, default 0.5
            Time in which the response has to arrive [s].

        Returns
        -------
        Future of Response
            Raises CommandError when the bus is not open, no response arrives in time, or the board refuses.
        """
        return self._commands.put(command, argument, timeout, self._clock.monotonic())

    def request(self, command: Command, argument: int = 0, timeout: float = 0.5) -> Response:
        """Send a command from the thread that reads and return the response; scans that arrive meanwhile are dropped.

        Parameters
        ----------
        command : Command
            The command.
        argument : int, default 0
            Its argument.
        timeout : float, default 0.5
            Time in which the response has to arrive [s].

        Returns
        -------
        Response
            The board's response.

        Raises
        ------
        CommandError
            When the bus is not open, no response arrives in time, or the board refuses.
        """
        pending = self.submit(command, argument, timeout)
        if self._connection.state == ConnectionState.CLOSED:
            self._commands.fail(self._connection.reason)
        while not pending.done():
            self.read(min(timeout, RESPONSE_TIMEOUT))
        return pending.result()

    def report(self) -> SourceReport:
        """Return the state for diagnostics; may be called from any thread."""
        return board_report(self._connection, self.decoder, self.stamp_uncertainty, self.restarted, self.brown_outs)

    def _next_scan(self) -> bool:
        """Process the frames at hand up to the next complete scan; return whether there is one."""
        connection = self._connection
        for decoded in connection.decoded:
            if isinstance(decoded, ScanReady):
                if connection.flowing:
                    connection.deadline = connection.arrival + connection.scan_timeout
                else:  # started, or sending again before it was restarted
                    connection.flowing = True
                    connection.fault = None
                    connection.enter(ConnectionState.SCANS, "receiving scans", connection.scan_timeout / NANOSECONDS)
                return True
            if self.decoder.scan_period != self._scan_period:  # also when another host has set it
                self._scan_period = self.decoder.scan_period
                connection.deadline = max(connection.deadline, connection.arrival + connection.scan_timeout)
            if isinstance(decoded, ResponseReceived):
                self._handle_response(decoded.response)
            elif isinstance(decoded, StatusReceived):
                self._handle_status(decoded.status)
            else:
                self._handle_identity(decoded.identity)
        connection.check_bus_off()
        return False

    def _handle_status(self, status: Status) -> None:
        reset = self._power.was_reset(status, self._clock.monotonic())
        if self._connection.state == ConnectionState.SCANS and (reset or not status.scanning):
            self._connection.reason = f"the board {'was reset' if reset else 'does not scan'}: restarting it"
            self.restarted += not reset
            self._connection.flowing = False
            self._starter.identify()

    def _handle_identity(self, identity: Identity) -> None:
        if self._connection.state == ConnectionState.SCANS and unsuitable(self._sensor, identity.board):
            self._starter.identify()

    def _handle_response(self, response: Response) -> None:
        """Act on the response to one of the newest commands, however late it is: the board has done as it says."""
        if not self._sender.is_own(response):
            return
        asked = self._commands.complete(response) is not None
        stopped = response.command == Command.STOP and response.result == Result.OK
        if stopped and self._connection.state != ConnectionState.CLOSED:
            self._connection.flowing, self._connection.fault = False, None
            self.decoder.forget_gap()
            self._connection.enter(ConnectionState.STOPPED, "stopped on request", 0.0)
        else:
            self._starter.handle_response(response, asked)

    def _wait(self, now: int, end: int) -> None:
        """Read frames, or do what is due when there are none."""
        if self._commands.pending():
            self._process_commands(now)
            end = min(end, now + round(PRESENCE_PERIOD * NANOSECONDS))
        if self._connection.wait(now, end):
            self._handle_timeout()

    def _handle_timeout(self) -> None:
        """Act on the deadline of the current state."""
        connection = self._connection
        if connection.state == ConnectionState.BUS:
            if connection.reopen():
                self._starter.identify()
            return
        if connection.state == ConnectionState.SCANS:
            self.restarted += 1
            connection.flowing = False
            connection.reason = "the board sends no complete scans: restarting it"
            connection.fault = FaultKind.NO_SCANS
            connection.ask_adapter()
        self._starter.handle_timeout()

    def _process_commands(self, now: int) -> None:
        """Send the next command when the board is ready for it, and fail those that have expired."""
        self._commands.expire(now, self._connection.reason)
        if not self.bus.is_open:
            self._commands.fail(self._connection.reason)
        elif self._connection.state in _READY and (pending := self._commands.next()):
            pending.tag = self._sender.send(pending.command, pending.argument)
