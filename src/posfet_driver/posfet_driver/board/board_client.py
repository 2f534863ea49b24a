"""A board on a CAN bus as a source of scans: identified, started, supervised, and restarted after every fault."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Future
from typing import Final

import can

from posfet_driver.board.board_report import Connection, board_report
from posfet_driver.board.command_queue import CommandQueue
from posfet_driver.board.connection_state import HEALTH, NOT_RECEIVING, ConnectionState
from posfet_driver.board.faults import FaultKind, Health
from posfet_driver.board.no_response import NoResponseMonitor
from posfet_driver.board.scan_source import SourceReport
from posfet_driver.bus.arrival_time import ArrivalTime
from posfet_driver.bus.bus_error import one_line
from posfet_driver.bus.bus_load import BusLoad
from posfet_driver.bus.frame import CLASSIC, Frame
from posfet_driver.bus.frame_bus import FrameBus
from posfet_driver.bus.frame_timing import classic_time, fd_time
from posfet_driver.bus.reconnecting_bus import PRESENCE_PERIOD, ReconnectingBus
from posfet_driver.clock import Clock, SystemClock
from posfet_driver.protocol.decoder import Decoded, Decoder, ResponseReceived, ScanReady, StatusReceived
from posfet_driver.protocol.messages import (
    COMMAND_OFFSET,
    LONGEST_PERIOD,
    PROTOCOL_VERSION,
    Command,
    Identification,
    Identity,
    Request,
    Response,
    Result,
    Status,
)
from posfet_driver.protocol.scan_codec import CLASSIC_LENGTH, FD_LENGTH
from posfet_model._lib.units import NANOSECONDS
from posfet_model.config import ConfigError
from posfet_model.sensor.description import CanLink, Sensor
from posfet_model.sensor.scan import Scan, ScanStatus

RESPONSE_TIMEOUT: Final = 0.2
"""Time within which a board has to respond [s]; then the command is repeated."""
TAGS_KEPT: Final = 16
"""Number of the newest commands whose responses are accepted: a link may delay a response by some repetitions."""
REPETITIONS: Final = 12
"""Number of times that SET_RATE or START is repeated before the board is identified again."""
REFUSED_PERIOD: Final = 1.0
"""Period at which an unsuitable board is identified again [s]."""
SCAN_TIMEOUT: Final = 0.3
"""Time without a scan [s] after which a board that should send is identified and restarted."""
SCAN_TIMEOUT_SCANS: Final = 10
"""The same in scan periods, for low scan rates."""
NEVER: Final = 1 << 63
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


def scan_transit_time(link: CanLink, blocks: int) -> float:
    """Return the longest time that the frames of one scan occupy the bus [s].

    Parameters
    ----------
    link : CanLink
        Frame format and bit rates.
    blocks : int
        Number of scan frames of a scan.

    Returns
    -------
    float
        Transit time with as many stuff bits as there can be [s].
    """
    frame = (
        fd_time(FD_LENGTH, link.bitrate, link.data_bitrate) if link.fd else classic_time(CLASSIC_LENGTH, link.bitrate)
    )
    return blocks * frame.most


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
        self.load = BusLoad(sensor.can.bitrate, sensor.can.data_bitrate)
        self.restarted = 0
        """Number of times a silent board was restarted."""
        self.brown_outs = 0
        """Resets around which the supply voltage was low."""
        self._sensor = sensor
        self._clock = clock or SystemClock()
        self.bus = ReconnectingBus(open_bus, presence, self._clock)
        self._no_response = NoResponseMonitor(self.decoder.traffic, self.bus.errors)
        self._transit_time = scan_transit_time(sensor.can, self.decoder.blocks)
        self._batch: list[Frame] = []
        self._decoded: Iterator[Decoded] = iter(())
        self._commands = CommandQueue()
        self._state = ConnectionState.CLOSED
        self._reason = "closed"
        self._fault: FaultKind | None = None
        self._arrival = 0  # when the newest batch of frames was read
        self._arrival_time = ArrivalTime()
        self._deadline = NEVER
        self._checked = -1  # deadline after which the bus was read once more
        self._tag = 0
        self._sent: dict[int, Command] = {}  # the newest commands by tag, in the order of sending
        self._repetitions = 0  # of the command of the present state
        self._boot: int | None = None
        self._bus_offs = 0
        self._low_supply = -round(LOW_SUPPLY_MEMORY * NANOSECONDS)  # time of the newest report
        self._flowing = False  # a scan arrived since the board was started
        self._period = round(1e6 / sensor.can.scan_rate)  # to be set at each start [us]
        self._scan_period = self._period  # in force [us]

    @property
    def stamp_uncertainty(self) -> float:
        """Largest delay of a stamp after the acquisition [s]: transit time of a scan plus `clock_uncertainty`."""
        return self._transit_time + self.decoder.clock_uncertainty

    def open(self) -> None:
        """Begin to look for the board; a bus that cannot be opened yet is retried by `read`.

        Raises
        ------
        ConfigError
            When the bus can never be opened with these arguments.
        """
        if self._state == ConnectionState.CLOSED:
            self.bus.reset_backoff()
            self._enter(ConnectionState.BUS, "opening the bus", 0.0)
            self._connect()

    def close(self) -> None:
        """Stop the board and close the bus; may be called twice."""
        if self._state in _STARTING:
            self._send(Command.STOP)
            self.decoder.forget_gap()
        self._fault = None
        self.bus.close()
        self._decoded = iter(())
        self._enter(ConnectionState.CLOSED, "closed", 0.0)
        self._commands.fail(self._reason)

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
        wait, end = round(timeout * NANOSECONDS), 0
        while not self._next_scan():
            # While scans arrive the time of the newest batch suffices, and nothing is due before the next one.
            steady = self._state is ConnectionState.SCANS and self._arrival + wait < self._deadline
            now = self._arrival if steady else self._clock.monotonic()
            end = end or now + wait
            if now >= end:
                return None
            if steady and not self._commands.pending():
                self._read_frames(end - now)
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
        if self._state == ConnectionState.CLOSED:
            self._commands.fail(self._reason)
        while not pending.done():
            self.read(min(timeout, RESPONSE_TIMEOUT))
        return pending.result()

    def report(self) -> SourceReport:
        """Return the state for diagnostics; may be called from any thread."""
        waiting = self._state == ConnectionState.SCANS and not self._flowing
        connection = Connection(
            health=Health.WARN if waiting else HEALTH[self._state],
            state=self._reason,
            fault=self._fault,
            restarts=self.restarted,
            brown_outs=self.brown_outs,
            stamp_uncertainty=self.stamp_uncertainty,
        )
        return board_report(connection, self.decoder, self.bus, self.load)

    def _next_scan(self) -> bool:
        """Process the frames at hand up to the next complete scan; return whether there is one."""
        for decoded in self._decoded:
            if isinstance(decoded, ScanReady):
                if self._flowing:
                    self._deadline = self._arrival + self._scan_timeout()
                else:  # started, or sending again before it was restarted
                    self._flowing = True
                    self._fault = None
                    self._enter(ConnectionState.SCANS, "receiving scans", self._scan_timeout() / NANOSECONDS)
                return True
            if self.decoder.scan_period != self._scan_period:  # also when another host has set it
                self._scan_period = self.decoder.scan_period
                self._deadline = max(self._deadline, self._arrival + self._scan_timeout())
            if isinstance(decoded, ResponseReceived):
                self._handle_response(decoded.response)
            elif isinstance(decoded, StatusReceived):
                self._handle_status(decoded.status)
            else:
                self._handle_identity(decoded.identity)
        if self.bus.errors.bus_off != self._bus_offs:
            self._bus_offs = self.bus.errors.bus_off
            self._fail(can.CanOperationError("the controller is bus-off"), FaultKind.BUS_OFF)
        return False

    def _handle_status(self, status: Status) -> None:
        now = self._clock.monotonic()
        if status.flags & ScanStatus.SUPPLY_LOW:
            self._low_supply = now
        reset = self._boot is not None and status.boot != self._boot
        self._boot = status.boot
        if reset:
            self.brown_outs += now - self._low_supply < LOW_SUPPLY_MEMORY * NANOSECONDS
        if self._state == ConnectionState.SCANS and (reset or not status.scanning):
            self._reason = f"the board {'was reset' if reset else 'does not scan'}: restarting it"
            self.restarted += not reset
            self._flowing = False
            self._identify()

    def _handle_identity(self, identity: Identity) -> None:
        if self._state == ConnectionState.SCANS and self._unsuitable(identity.board):
            self._identify()

    def _wait(self, now: int, end: int) -> None:
        """Read frames, or do what is due when there are none."""
        if pending := self._commands.pending():
            self._process_commands(now)
        late = now >= self._deadline
        if late and (not self.bus.is_open or self._checked == self._deadline):
            self._handle_timeout()
            return
        due = min(end, self._deadline)
        if pending:
            due = min(due, now + round(PRESENCE_PERIOD * NANOSECONDS))
        left = max(due - now, 0)
        if self.bus.is_open:
            deadline = self._deadline
            arrived = self._read_frames(left)
            if late or (not arrived and self._clock.monotonic() >= deadline):
                self._checked = deadline  # no frame that arrived in time is left
        elif self._state != ConnectionState.BUS:
            self._clock.sleep(left / NANOSECONDS)
        elif self.bus.wait_for_device(left):
            self._deadline = self._clock.monotonic()

    def _handle_timeout(self) -> None:
        """Act on the deadline of the current state."""
        if self._state == ConnectionState.BUS:
            self._reconnect()
            return
        if self._state == ConnectionState.SCANS:
            self.restarted += 1
            self._flowing = False
            self._reason = "the board sends no complete scans: restarting it"
            self._fault = FaultKind.NO_SCANS
            self._ask_adapter()
        elif self._state == ConnectionState.IDENTITY:
            self._diagnose_no_response()
            if self._state != ConnectionState.IDENTITY:
                return
        elif self._state in {ConnectionState.RATE, ConnectionState.START}:
            if self._repetitions < REPETITIONS:
                self._repetitions += 1
                self._request_state(self._state)
                return
            self._reason = "the board responds, but does not start"
            self._fault = FaultKind.START_FAILED
        self._identify()

    def _diagnose_no_response(self) -> None:
        """Find out why the board does not respond; reopen the bus from time to time."""
        base = self._sensor.can.base_id
        self._reason = f"no board responds at base identifier 0x{base:X}: check power, cable, bit rate and base_id"
        self._fault = self._no_response.cause()
        self._ask_adapter()
        if self.bus.is_open and self._no_response.reopen_due(self._clock.monotonic()):
            self.bus.close()
            self._decoded = iter(())
            self._enter(ConnectionState.BUS, self._reason, 0.0)
            self._reconnect()

    def _reconnect(self) -> None:
        try:
            self._connect()
        except ConfigError as error:
            self._fail(error)

    def _connect(self) -> None:
        try:
            self.bus.connect()
        except can.CanError as error:
            self._fail(error)
            return
        if self._fault in {None, FaultKind.ADAPTER_DISCONNECTED}:
            self._reason = "looking for the board"
        self._identify(first=True)

    def _identify(self, first: bool = False) -> None:
        if first or self._state != ConnectionState.IDENTITY:
            self._no_response.begin(self._clock.monotonic())
        self._request_state(ConnectionState.IDENTITY)

    def _request_state(self, state: ConnectionState) -> None:
        """Enter a state in which the response to a command is awaited, and send the command."""
        if state != self._state:
            self._repetitions = 0
        self._enter(state, self._reason, RESPONSE_TIMEOUT)
        command = _COMMANDS[state]
        self._send(command, self._period if command == Command.SET_RATE else 0)

    def _handle_response(self, response: Response) -> None:
        """Act on the response to one of the newest commands, however late it is: the board has done as it says."""
        if self._sent.get(response.tag) != response.command:
            return
        asked = self._commands.complete(response) is not None
        match response.command:
            case Command.IDENTIFY if self._state == ConnectionState.IDENTITY and response.result == Result.OK:
                self._check_identity(Identification.unpack(response.value))
            case Command.SET_RATE:
                self._rate_answered(response, asked)
            case Command.STOP if response.result == Result.OK and self._state != ConnectionState.CLOSED:
                self._flowing, self._fault = False, None
                self.decoder.forget_gap()
                self._enter(ConnectionState.STOPPED, "stopped on request", 0.0)
            case Command.START if response.result == Result.OK:
                self._started()

    def _unsuitable(self, board: Identification) -> tuple[FaultKind, str] | None:
        """Return why a board is not the one that the sensor file describes; None when it is."""
        if board.protocol != PROTOCOL_VERSION:
            reason = f"the board implements version {board.protocol} of the protocol, this driver {PROTOCOL_VERSION}"
            return FaultKind.WRONG_PROTOCOL, reason
        wanted = self._sensor
        if board.layout != wanted.layout.id:
            reason = f"the board has layout {board.layout}, the sensor file {wanted.layout.id}"
            return FaultKind.WRONG_LAYOUT, reason
        if board.fd != wanted.can.fd:
            formats = "classic CAN", "CAN FD"
            reason = (
                f"the board sends scans in {formats[board.fd]} frames, the sensor file says {formats[wanted.can.fd]}"
            )
            return FaultKind.WRONG_FORMAT, reason
        return None

    def _check_identity(self, board: Identification) -> None:
        if unsuitable := self._unsuitable(board):
            self._refuse(*unsuitable)
        else:
            self._request_state(ConnectionState.RATE)

    def _rate_answered(self, response: Response, asked: bool) -> None:
        """Act on the response to SET_RATE; the decoder has the new period from it."""
        if response.result == Result.OK and 1 <= response.value <= LONGEST_PERIOD:
            self._period = response.value
        elif not asked and self._state == ConnectionState.RATE:
            reason = f"the board answers a scan period of {self._period} us with: {response.reason}"
            self._refuse(FaultKind.RATE_REFUSED, reason)
        if self._state == ConnectionState.RATE:
            self._request_state(ConnectionState.START)

    def _refuse(self, fault: FaultKind, reason: str) -> None:
        self._fault, self._flowing = fault, False
        self._enter(ConnectionState.REFUSED, reason, REFUSED_PERIOD)

    def _started(self) -> None:
        if self._state not in {ConnectionState.START, ConnectionState.STOPPED}:
            return
        self.decoder.start()
        self._flowing = False
        self.bus.reset_backoff()
        self._no_response.board_responded()
        self._enter(ConnectionState.SCANS, self._reason, self._scan_timeout() / NANOSECONDS)

    def _process_commands(self, now: int) -> None:
        """Send the next command when the board is ready for it, and fail those that have expired."""
        self._commands.expire(now, self._reason)
        if not self.bus.is_open:
            self._commands.fail(self._reason)
        elif self._state in _READY and (pending := self._commands.next()):
            pending.tag = self._send(pending.command, pending.argument)

    def _scan_timeout(self) -> int:
        """Return the time without a scan after which the board is restarted [ns]."""
        return max(round(SCAN_TIMEOUT * NANOSECONDS), SCAN_TIMEOUT_SCANS * self.decoder.scan_period * 1000)

    def _read_frames(self, timeout: int) -> bool:
        """Read the frames that are waiting or arrive within `timeout` [ns]; return whether anything happened."""
        self.load.add(self._batch, self._arrival)  # of the previous read: scans were delivered first
        self._batch = []
        try:
            frames = self._batch = self.bus.read(timeout / NANOSECONDS)
        except (can.CanError, OSError) as error:
            self._fail(error)
            return True
        now = self._arrival = self._clock.monotonic()
        wall_offset = self._clock.wall() - now
        arrival = self._arrival_time.of_newest(self.bus.arrival_stamp, now, wall_offset)
        self._decoded = self.decoder.decode(frames, arrival, wall_offset)
        return bool(frames)

    def _send(self, command: Command, argument: int = 0) -> int:
        """Send a command and return its tag."""
        self._tag = (self._tag + 1) & 0xFF
        self._sent[self._tag] = command
        if len(self._sent) > TAGS_KEPT:
            del self._sent[next(iter(self._sent))]
        request = Request(command, self._tag, argument)
        try:
            self.bus.write((self._sensor.can.base_id + COMMAND_OFFSET, CLASSIC, request.pack()))
        except (can.CanError, OSError) as error:
            self._fail(error)
        return self._tag

    def _ask_adapter(self) -> None:
        try:
            self.bus.ask_state()
        except (can.CanError, OSError) as error:
            self._fail(error)

    def _fail(self, error: Exception, fault: FaultKind = FaultKind.ADAPTER_DISCONNECTED) -> None:
        """Close the bus and retry later."""
        self._fault = fault
        self._decoded = iter(())
        self._enter(ConnectionState.BUS, f"CAN bus unavailable, retrying: {one_line(error)}", self.bus.fail())
        self._commands.fail(self._reason)

    def _enter(self, state: ConnectionState, reason: str, timeout: float) -> None:
        self._state = state
        if state in NOT_RECEIVING:
            self.decoder.receiving = False
        self._reason = reason
        timed = state not in {ConnectionState.CLOSED, ConnectionState.STOPPED}
        self._deadline = self._clock.monotonic() + round(timeout * NANOSECONDS) if timed else NEVER
