"""A board on a CAN bus as a source of scans: identified, started, supervised, and restarted after every fault."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from typing import Final

from posfet_driver.board.board_connection import BoardConnection
from posfet_driver.board.board_report import board_report
from posfet_driver.board.command_queue import CommandQueue, CommandTags
from posfet_driver.board.connection_state import ConnectionState
from posfet_driver.board.faults import FaultKind
from posfet_driver.board.scan_source import SourceReport
from posfet_driver.board.suitability import unsuitable
from posfet_driver.board.transit_time import scan_transit_time
from posfet_driver.bus.frame import CLASSIC
from posfet_driver.bus.frame_bus import FrameBus
from posfet_driver.bus.reconnecting_bus import PRESENCE_PERIOD
from posfet_driver.clock import Clock, SystemClock
from posfet_driver.protocol.decoder import Decoder, ResponseReceived, ScanReady, StatusReceived
from posfet_driver.protocol.messages import (
    COMMAND_OFFSET,
    LONGEST_PERIOD,
    Command,
    Identification,
    Identity,
    Request,
    Response,
    Result,
    Status,
)
from posfet_model._lib.units import NANOSECONDS
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import Scan, ScanStatus

RESPONSE_TIMEOUT: Final = 0.2
"""Time within which a board has to respond [s]; then the command is repeated."""
REPETITIONS: Final = 12
"""Number of times that SET_RATE or START is repeated before the board is identified again."""
REFUSED_PERIOD: Final = 1.0
"""Period at which an unsuitable board is identified again [s]."""
LOW_SUPPLY_MEMORY: Final = 2.0
"""Time after a low supply was reported [s] within which a reset counts as a brown-out."""

_COMMANDS: Final = {
    ConnectionState.IDENTITY: Command.IDENTIFY,
    ConnectionState.RATE: Command.SET_RATE,
    ConnectionState.START: Command.START,
}
"""Command whose response is awaited in a state."""
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
        self.brown_outs = 0
        """Resets around which the supply voltage was low."""
        self._sensor = sensor
        self._clock = clock or SystemClock()
        self._connection = BoardConnection(
            sensor.can, self.decoder, open_bus, self._clock, presence, "looking for the board"
        )
        self.bus = self._connection.bus
        self._transit_time = scan_transit_time(sensor.can, self.decoder.blocks)
        self._commands = CommandQueue()
        self._tags = CommandTags()
        self._repetitions = 0  # of the command of the present state
        self._boot: int | None = None
        self._low_supply = -round(LOW_SUPPLY_MEMORY * NANOSECONDS)  # time of the newest report
        self._flowing = False  # a scan arrived since the board was started
        self._period = round(1e6 / sensor.can.scan_rate)  # to be set at each start [us]
        self._scan_period = self._period  # in force [us]

    @property
    def stamp_uncertainty(self) -> float:
        """Largest error of a stamp [s]: transit time of a scan plus `clock_uncertainty`."""
        return self._transit_time + self.decoder.clock_uncertainty

    def open(self) -> None:
        """Begin to look for the board; a bus that cannot be opened yet is retried by `read`.

        Raises
        ------
        ConfigError
            When the bus can never be opened with these arguments.
        """
        if self._connection.state == ConnectionState.CLOSED and self._connection.open():
            self._identify()

    def close(self) -> None:
        """Stop the board and close the bus; may be called twice."""
        connection = self._connection
        if connection.state in _STARTING:
            self._send(Command.STOP)
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
        return board_report(
            self._connection, self.decoder, self._flowing, self.stamp_uncertainty, self.restarted, self.brown_outs
        )

    def _next_scan(self) -> bool:
        """Process the frames at hand up to the next complete scan; return whether there is one."""
        connection = self._connection
        for decoded in connection.decoded:
            if isinstance(decoded, ScanReady):
                if self._flowing:
                    connection.deadline = connection.arrival + connection.scan_timeout
                else:  # started, or sending again before it was restarted
                    self._flowing = True
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
        now = self._clock.monotonic()
        if status.flags & ScanStatus.SUPPLY_LOW:
            self._low_supply = now
        reset = self._boot is not None and status.boot != self._boot
        self._boot = status.boot
        if reset:
            self.brown_outs += now - self._low_supply < LOW_SUPPLY_MEMORY * NANOSECONDS
        if self._connection.state == ConnectionState.SCANS and (reset or not status.scanning):
            self._connection.reason = f"the board {'was reset' if reset else 'does not scan'}: restarting it"
            self.restarted += not reset
            self._flowing = False
            self._identify()

    def _handle_identity(self, identity: Identity) -> None:
        if self._connection.state == ConnectionState.SCANS and unsuitable(self._sensor, identity.board):
            self._identify()

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
                self._identify()
            return
        if connection.state == ConnectionState.SCANS:
            self.restarted += 1
            self._flowing = False
            connection.reason = "the board sends no complete scans: restarting it"
            connection.fault = FaultKind.NO_SCANS
            connection.ask_adapter()
        elif connection.state == ConnectionState.IDENTITY:
            self._diagnose_no_response()
        elif connection.state in {ConnectionState.RATE, ConnectionState.START}:
            if self._repetitions < REPETITIONS:
                self._repetitions += 1
                self._request_state(connection.state)
                return
            connection.reason = "the board responds, but does not start"
            connection.fault = FaultKind.START_FAILED
        if connection.bus.is_open:
            self._identify()

    def _diagnose_no_response(self) -> None:
        """Find out why the board does not respond; reopen the bus from time to time."""
        connection, base = self._connection, self._sensor.can.base_id
        connection.reason = f"no board responds at base identifier 0x{base:X}: check power, cable, bit rate and base_id"
        connection.fault = connection.no_response.cause()
        connection.ask_adapter()
        connection.reopen_when_silent()

    def _identify(self) -> None:
        if self._connection.state != ConnectionState.IDENTITY:
            self._connection.no_response.begin(self._clock.monotonic())
        self._request_state(ConnectionState.IDENTITY)

    def _request_state(self, state: ConnectionState) -> None:
        """Enter a state in which the response to a command is awaited, and send the command."""
        if state != self._connection.state:
            self._repetitions = 0
        self._connection.enter(state, self._connection.reason, RESPONSE_TIMEOUT)
        command = _COMMANDS[state]
        self._send(command, self._period if command == Command.SET_RATE else 0)

    def _handle_response(self, response: Response) -> None:
        """Act on the response to one of the newest commands, however late it is: the board has done as it says."""
        if not self._tags.is_own(response):
            return
        state = self._connection.state
        asked = self._commands.complete(response) is not None
        match response.command:
            case Command.IDENTIFY if state == ConnectionState.IDENTITY and response.result == Result.OK:
                self._check_identity(Identification.unpack(response.value))
            case Command.SET_RATE:
                self._rate_answered(response, asked)
            case Command.STOP if response.result == Result.OK and state != ConnectionState.CLOSED:
                self._flowing, self._connection.fault = False, None
                self.decoder.forget_gap()
                self._connection.enter(ConnectionState.STOPPED, "stopped on request", 0.0)
            case Command.START if response.result == Result.OK:
                self._started()

    def _check_identity(self, board: Identification) -> None:
        if cause := unsuitable(self._sensor, board):
            self._refuse(*cause)
        else:
            self._request_state(ConnectionState.RATE)

    def _rate_answered(self, response: Response, asked: bool) -> None:
        """Act on the response to SET_RATE; the decoder has the new period from it."""
        if response.result == Result.OK and 1 <= response.value <= LONGEST_PERIOD:
            self._period = response.value
        elif not asked and self._connection.state == ConnectionState.RATE:
            reason = f"the board answers a scan period of {self._period} us with: {response.reason}"
            self._refuse(FaultKind.RATE_REFUSED, reason)
        if self._connection.state == ConnectionState.RATE:
            self._request_state(ConnectionState.START)

    def _refuse(self, fault: FaultKind, reason: str) -> None:
        self._connection.fault, self._flowing = fault, False
        self._connection.enter(ConnectionState.REFUSED, reason, REFUSED_PERIOD)

    def _started(self) -> None:
        connection = self._connection
        if connection.state not in {ConnectionState.START, ConnectionState.STOPPED}:
            return
        self.decoder.start()
        self._flowing = False
        self.bus.reset_backoff()
        connection.no_response.board_responded()
        connection.enter(ConnectionState.SCANS, connection.reason, connection.scan_timeout / NANOSECONDS)

    def _process_commands(self, now: int) -> None:
        """Send the next command when the board is ready for it, and fail those that have expired."""
        self._commands.expire(now, self._connection.reason)
        if not self.bus.is_open:
            self._commands.fail(self._connection.reason)
        elif self._connection.state in _READY and (pending := self._commands.next()):
            pending.tag = self._send(pending.command, pending.argument)

    def _send(self, command: Command, argument: int = 0) -> int:
        """Send a command and return its tag."""
        tag = self._tags.next(command)
        request = Request(command, tag, argument)
        self._connection.write((self._sensor.can.base_id + COMMAND_OFFSET, CLASSIC, request.pack()))
        return tag
