# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Brings a board to send scans: it is identified, set to its rate, and started; each command is repeated if need be."""

from __future__ import annotations

from typing import Final

from posfet_driver.board.board_connection import BoardConnection
from posfet_driver.board.command_sender import CommandSender
from posfet_driver.board.connection_state import ConnectionState
from posfet_driver.board.faults import FaultKind
from posfet_driver.board.suitability import unsuitable
from posfet_driver.clock import Clock
from posfet_driver.protocol.decoder import Decoder
from posfet_driver.protocol.messages import Command, Identification, Response, Result
from posfet_model._lib.units import NANOSECONDS
from posfet_model.sensor.description import Sensor

RESPONSE_TIMEOUT: Final = 0.2
"""Time within which a board has to respond [s]; then the command is repeated."""
REPETITIONS: Final = 12
"""Number of times that SET_RATE or START is repeated before the board is identified again."""
REFUSED_PERIOD: Final = 0.3
"""Period at which an unsuitable board is identified again [s]: another one may have been connected."""

_COMMANDS: Final = {
    ConnectionState.IDENTITY: Command.IDENTIFY,
    ConnectionState.RATE: Command.SET_RATE,
    ConnectionState.START: Command.START,
}
"""Command whose response is awaited in a state."""
_STARTED: Final = {ConnectionState.START, ConnectionState.STOPPED, ConnectionState.SCANS}
"""States in which a board that was started is expected to keep the period that it has confirmed."""


class BoardStarter:
    """Owner of the commands that start a board.

    Parameters
    ----------
    sensor : Sensor
        The array and its frames.
    connection : BoardConnection
        Connection to the board, whose state it leads to SCANS.
    decoder : Decoder
        Receives the scans from then on.
    sender : CommandSender
        Sends the commands.
    clock : Clock
        Source of time.
    """

    def __init__(
        self, sensor: Sensor, connection: BoardConnection, decoder: Decoder, sender: CommandSender, clock: Clock
    ) -> None:
        self._sensor, self._connection, self._decoder, self._sender = sensor, connection, decoder, sender
        self._clock = clock
        self._repetitions = 0  # of the command of the present state
        self._period = round(1e6 / sensor.can.scan_rate)  # to be set at each start [us]
        self._rate_boot: int | None = None  # number of the power-on that has confirmed it

    def identify(self) -> None:
        """Begin, or begin again."""
        if self._connection.state != ConnectionState.IDENTITY:
            self._connection.no_response.begin(self._clock.monotonic())
        self._request(ConnectionState.IDENTITY)

    def handle_timeout(self) -> None:
        """Act when no response has arrived in time."""
        connection = self._connection
        if connection.state == ConnectionState.IDENTITY:
            self._diagnose_no_response()
        elif connection.state in {ConnectionState.RATE, ConnectionState.START}:
            if self._repetitions < REPETITIONS:
                self._repetitions += 1
                self._request(connection.state)
                return
            connection.reason = "the board responds, but does not start"
            connection.fault = FaultKind.START_FAILED
        if connection.bus.is_open:
            self.identify()

    def handle_response(self, response: Response, asked: bool) -> None:
        """Act on the response to IDENTIFY, SET_RATE or START.

        Parameters
        ----------
        response : Response
            The response.
        asked : bool
            Whether a user has sent the command.
        """
        state, accepted = self._connection.state, response.result == Result.OK
        match response.command:
            case Command.IDENTIFY if state == ConnectionState.IDENTITY and accepted:
                if cause := unsuitable(self._sensor, Identification.unpack(response.value)):
                    self._refuse(*cause)
                else:
                    self._request(ConnectionState.RATE)
            case Command.SET_RATE:
                self._rate_answered(response, asked)
            case Command.START if accepted and state in _STARTED and response.boot != self._rate_boot:
                self._decoder.receiving = False  # its scans have another period
                self.identify()
            case Command.START if accepted and state in {ConnectionState.START, ConnectionState.STOPPED}:
                self._started()

    def _request(self, state: ConnectionState) -> None:
        """Enter a state in which the response to a command is awaited, and send the command."""
        if state != self._connection.state:
            self._repetitions = 0
        self._connection.enter(state, self._connection.reason, RESPONSE_TIMEOUT)
        command = _COMMANDS[state]
        self._sender.send(command, self._period if command == Command.SET_RATE else 0)

    def _rate_answered(self, response: Response, asked: bool) -> None:
        """Act on the response to SET_RATE; the decoder has the new period from it.

        A response that states another period than was set confirms nothing: who knows which one is in force.
        """
        period = self._sender.argument(response)
        if response.confirms(period):
            self._period, self._rate_boot = period, response.boot
        elif not asked and self._connection.state == ConnectionState.RATE:
            self._period = round(1e6 / self._sensor.can.scan_rate)  # not for ever one that a user has set
            reason = f"the board answers a scan period of {period} us with: {response.reason}"
            self._refuse(FaultKind.RATE_REFUSED, reason)
        if self._connection.state == ConnectionState.RATE:
            self._request(ConnectionState.START)

    def _refuse(self, fault: FaultKind, reason: str) -> None:
        self._connection.fault, self._connection.flowing = fault, False
        self._connection.enter(ConnectionState.REFUSED, reason, REFUSED_PERIOD)

    def _started(self) -> None:
        connection = self._connection
        self._decoder.start()
        connection.flowing = False
        connection.bus.reset_backoff()
        connection.no_response.board_responded()
        connection.enter(ConnectionState.SCANS, connection.reason, connection.scan_timeout / NANOSECONDS)

    def _diagnose_no_response(self) -> None:
        """Find out why the board does not respond; reopen the bus from time to time."""
        connection, base = self._connection, self._sensor.can.base_id
        connection.reason = f"no board responds at base identifier 0x{base:X}: check power, cable, bit rate and base_id"
        connection.fault = connection.no_response.cause()
        connection.ask_adapter()
        connection.reopen_when_silent()
