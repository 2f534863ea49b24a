# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Supervises a board: it is started, and restarted after a reset, a stop or silence; commands of users are sent."""

from __future__ import annotations

from typing import Final

from posfet_driver.board.board_connection import BoardConnection
from posfet_driver.board.board_starter import RESPONSE_TIMEOUT, BoardStarter
from posfet_driver.board.command_queue import CommandQueue
from posfet_driver.board.command_sender import CommandSender
from posfet_driver.board.connection_state import ConnectionState
from posfet_driver.board.faults import FaultKind
from posfet_driver.board.power_watch import PowerWatch
from posfet_driver.board.suitability import unsuitable
from posfet_driver.clock import Clock
from posfet_driver.protocol.decoded import IdentityReceived, ResponseReceived, StatusReceived
from posfet_driver.protocol.decoder import Decoder
from posfet_driver.protocol.messages import Command, Identity, Response, Result, Status
from posfet_model._lib.units import NANOSECONDS
from posfet_model.sensor.description import Sensor

_STARTING: Final = {ConnectionState.START, ConnectionState.SCANS}
STOPS: Final = 2
"""Number of times that STOP is sent at the most before the bus is closed."""
STATUS_TIMEOUT: Final = 1.0
"""Time without a status, while scans flow, after which the newest one is forgotten [s]: ten intervals; assumed."""
_READY: Final = {ConnectionState.SCANS, ConnectionState.STOPPED, ConnectionState.REFUSED}
"""States in which the board accepts a command of the user."""


class BoardSupervisor:
    """Decides what a board is told, by what it sends and by what fails to arrive. Used by the thread that reads.

    Parameters
    ----------
    sensor : Sensor
        The array and its frames.
    connection : BoardConnection
        Connection to the board, whose state it leads.
    decoder : Decoder
        Decodes the frames of the board.
    clock : Clock
        Source of time.
    """

    def __init__(self, sensor: Sensor, connection: BoardConnection, decoder: Decoder, clock: Clock) -> None:
        self.restarted = 0
        """Number of times a silent board was restarted."""
        self.power = PowerWatch()
        """Resets, and their causes."""
        self.status_missing = False
        """Whether scans flow and no status has arrived for long."""
        self.commands = CommandQueue()
        """Commands of users, from any thread."""
        self._sensor, self._connection, self._decoder, self._clock = sensor, connection, decoder, clock
        self._sender = CommandSender(connection, decoder, sensor.can.base_id)
        self._starter = BoardStarter(sensor, connection, decoder, self._sender, clock)
        self._scan_period = decoder.scan_period  # in force [us]
        self._stopped = False  # by a user
        self._status_due = 0  # time after which a status is missing [ns]

    def start(self) -> None:
        """Identify the board and start it: the bus is open."""
        self._starter.identify()

    def stop(self) -> None:
        """Stop the board before the bus is closed; what was said up to then, by board or user, says nothing later."""
        self._stopped = False
        if self._connection.state in _STARTING:
            self._decoder.receiving = False
            self._connection.take_rest()
            for _ in self._connection.decoded:
                pass
            for _ in range(STOPS):
                if self._stop_answered():
                    break
            self._decoder.forget_gap()
        self._sender.forget()

    def handle(self, received: StatusReceived | IdentityReceived | ResponseReceived) -> None:
        """Act on a message of the board."""
        connection = self._connection
        if self._decoder.scan_period != self._scan_period:  # also when another host has set it
            self._scan_period = self._decoder.scan_period
            if connection.state == ConnectionState.SCANS:  # else a response is awaited
                connection.deadline = connection.arrival + connection.scan_timeout
        if isinstance(received, ResponseReceived):
            self._handle_response(received.response)
        elif isinstance(received, StatusReceived):
            self._handle_status(received.status)
        else:
            self._handle_identity(received.identity)

    def handle_timeout(self) -> None:
        """Act on the deadline of the current state."""
        connection = self._connection
        if connection.state == ConnectionState.BUS:
            if connection.reopen():
                self._go_on()
            return
        if connection.state == ConnectionState.SCANS:
            self.restarted += 1
            self._decoder.doubt_sequence()
            connection.flowing = False
            connection.reason = "the board sends no complete scans: restarting it"
            connection.fault = FaultKind.NO_SCANS
            connection.ask_adapter()
        self._starter.handle_timeout()

    def check_status(self) -> None:
        """Forget the status of the board when none has arrived for long while scans flow."""
        connection = self._connection
        if not connection.flowing:
            self._expect_status()
        elif connection.arrival > self._status_due and not self.status_missing:
            self.status_missing = True
            self._decoder.forget_status()

    def process_commands(self, now: int) -> None:
        """Send the next command when the board is ready for it, and fail those that have expired."""
        self.commands.expire(now, self._connection.reason)
        if not self._connection.bus.is_open:
            self.commands.fail(self._connection.reason)
        elif self._connection.state in _READY and (pending := self.commands.next()):
            pending.tag = self._sender.send(pending.command, pending.argument)

    def _expect_status(self) -> None:
        self.status_missing = False
        self._status_due = self._connection.arrival + round(STATUS_TIMEOUT * NANOSECONDS)

    def _handle_status(self, status: Status) -> None:
        self._expect_status()
        reset = self.power.was_reset(status, self._clock.monotonic())
        if self._connection.state == ConnectionState.SCANS and (reset or not status.scanning):
            self._connection.reason = f"the board {'was reset' if reset else 'does not scan'}: restarting it"
            self.restarted += not reset
            self._connection.flowing = False
            self._decoder.doubt_sequence()
            self._starter.identify()

    def _handle_identity(self, identity: Identity) -> None:
        if self._connection.state == ConnectionState.SCANS and unsuitable(self._sensor, identity.board):
            self._starter.identify()

    def _handle_response(self, response: Response) -> None:
        """Act on the response to one of the newest commands, however late it is: the board has done as it says."""
        if not self._sender.is_own(response):
            return
        asked = self.commands.complete(response) is not None
        if response.result == Result.OK and response.command in {Command.STOP, Command.START}:
            self._stopped = response.command == Command.STOP
        if self._stopped and response.command == Command.STOP and self._connection.state != ConnectionState.CLOSED:
            self._decoder.forget_gap()
            self._go_on()
        else:
            self._starter.handle_response(response, asked)

    def _stop_answered(self) -> bool:
        """Send STOP, and return whether the response has arrived in time: then it is no longer in the adapter."""
        connection, tag = self._connection, self._sender.send(Command.STOP)
        end = self._clock.monotonic() + round(RESPONSE_TIMEOUT * NANOSECONDS)
        while connection.bus.is_open and (left := end - self._clock.monotonic()) > 0:
            connection.read(left)
            for decoded in connection.decoded:
                if isinstance(decoded, ResponseReceived) and decoded.response.tag == tag:
                    return True
        return False

    def _go_on(self) -> None:
        """Identify the board and start it, unless a user has stopped it: then it is left alone."""
        if not self._stopped:
            self._starter.identify()
            return
        self._connection.flowing, self._connection.fault = False, None
        self._connection.enter(ConnectionState.STOPPED, "stopped on request", 0.0)
