"""A board with frames of its own as a source of scans: only listened to, never written to."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Future
from typing import Final

import can

from posfet_driver.board.board_report import Connection, board_report
from posfet_driver.board.command_queue import CommandError
from posfet_driver.board.connection_state import HEALTH, ConnectionState
from posfet_driver.board.faults import FaultKind, Health
from posfet_driver.board.no_response import NoResponseMonitor
from posfet_driver.board.scan_source import SourceReport
from posfet_driver.bus.bus_error import one_line
from posfet_driver.bus.bus_load import BusLoad
from posfet_driver.bus.frame import Frame
from posfet_driver.bus.frame_bus import FrameBus
from posfet_driver.bus.frame_timing import classic_time, fd_time
from posfet_driver.bus.reconnecting_bus import ReconnectingBus
from posfet_driver.clock import Clock, SystemClock
from posfet_driver.protocol.decoder import Decoded
from posfet_driver.protocol.frame_tables import FrameTables
from posfet_driver.protocol.mapped_decoder import MappedDecoder
from posfet_driver.protocol.messages import Command, Response
from posfet_model._lib.units import NANOSECONDS
from posfet_model.config import ConfigError
from posfet_model.sensor.description import CanLink, Sensor
from posfet_model.sensor.scan import Scan

SCAN_TIMEOUT: Final = 0.3
"""Time without a scan [s] after which the reason is looked for."""
SCAN_TIMEOUT_SCANS: Final = 10
"""The same in scan periods, for low scan rates."""
LISTENS_ONLY: Final = "the driver only listens to a board with frames of its own (protocol in the sensor file)"
_EXTENDED_BITS: Final = 25  # of an identifier of 29 bits more than of one of 11, with stuff bits


def mapped_transit_time(link: CanLink, tables: FrameTables) -> float:
    """Return the longest time that the frames of one scan occupy the bus [s].

    Parameters
    ----------
    link : CanLink
        Bit rates.
    tables : FrameTables
        Lengths of the frames.

    Returns
    -------
    float
        Transit time with as many stuff bits as there can be [s].
    """
    total = 0.0
    for length, extended in tables.sent:
        time = fd_time(length, link.bitrate, link.data_bitrate) if link.fd else classic_time(length, link.bitrate)
        total += time.most + extended * _EXTENDED_BITS / link.bitrate
    return total


class ListeningBoard:
    """One board on a bus that nothing is sent to. Used by one thread, but for `submit` and `report`.

    The bus is reopened, with exponential back-off, whenever it cannot be opened, fails, or stays without a frame of the
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
        self.load = BusLoad(sensor.can.bitrate, sensor.can.data_bitrate)
        self._clock = clock or SystemClock()
        self.bus = ReconnectingBus(open_bus, presence, self._clock)
        self._traffic = NoResponseMonitor(self.decoder.traffic, self.bus.errors)
        self._transit_time = mapped_transit_time(sensor.can, self.decoder.tables)
        self._scan_timeout = round(max(SCAN_TIMEOUT, SCAN_TIMEOUT_SCANS / sensor.can.scan_rate) * NANOSECONDS)
        self._dbc = sensor.mapping.dbc.name if sensor.mapping else ""
        self._batch: list[Frame] = []
        self._decoded: Iterator[Decoded] = iter(())
        self._state = ConnectionState.CLOSED
        self._reason = "closed"
        self._fault: FaultKind | None = None
        self._arrival = 0  # of the newest batch of frames
        self._deadline = 0  # time at which the bus is opened, or a scan should have arrived
        self._bus_offs = 0

    @property
    def stamp_uncertainty(self) -> float:
        """Largest delay of a stamp after the acquisition [s]; NaN when the board sends no time."""
        return self._transit_time + self.decoder.clock_uncertainty

    def open(self) -> None:
        """Begin to listen; a bus that cannot be opened yet is retried by `read`.

        Raises
        ------
        ConfigError
            When the bus can never be opened with these arguments.
        """
        if self._state == ConnectionState.CLOSED:
            self.bus.reset_backoff()
            self._enter(ConnectionState.BUS, "opening the bus", 0)
            self._connect()

    def close(self) -> None:
        """Close the bus; may be called twice."""
        self._fault = None
        self.bus.close()
        self._enter(ConnectionState.CLOSED, "closed", 0)

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
        while True:
            for _ in self._decoded:
                self._deadline = self._arrival + self._scan_timeout
                if self._fault or self._reason != "receiving scans":
                    self._fault, self._reason = None, "receiving scans"
                    self.bus.reset_backoff()
                    self._traffic.board_responded()
                return self.decoder.scan
            if self.bus.errors.bus_off != self._bus_offs:
                self._bus_offs = self.bus.errors.bus_off
                self._fail(can.CanOperationError("the controller is bus-off"), FaultKind.BUS_OFF)
            now = self._clock.monotonic()
            end = end or now + wait
            if now >= end:
                return None
            self._wait(now, end)

    def submit(self, command: Command, argument: int = 0, timeout: float = 0.5) -> Future[Response]:
        """Refuse a command: nothing is sent to this board. Raises CommandError."""
        raise CommandError(f"{command.name}: {LISTENS_ONLY}")

    def request(self, command: Command, argument: int = 0, timeout: float = 0.5) -> Response:
        """Refuse a command: nothing is sent to this board. Raises CommandError."""
        return self.submit(command, argument, timeout).result()

    def report(self) -> SourceReport:
        """Return the state for diagnostics; may be called from any thread."""
        waiting = self._state == ConnectionState.SCANS and self._reason != "receiving scans"
        connection = Connection(
            health=Health.WARN if waiting else HEALTH[self._state],
            state=self._reason,
            fault=self._fault,
            restarts=0,
            brown_outs=0,
            stamp_uncertainty=self.stamp_uncertainty,
        )
        return board_report(connection, self.decoder, self.bus, self.load)

    def _wait(self, now: int, end: int) -> None:
        """Read frames up to `end` [ns], or do what is due."""
        if self._state == ConnectionState.CLOSED:
            self._clock.sleep((end - now) / NANOSECONDS)
        elif self._state == ConnectionState.BUS:
            if now >= self._deadline or self.bus.wait_for_device(min(end, self._deadline) - now):
                self._reconnect()
        elif now < self._deadline:
            self._read_frames(min(end, self._deadline) - now)
        elif not self._read_frames(0):  # no frame that arrived in time is left
            self._diagnose(now)

    def _diagnose(self, now: int) -> None:
        """Find out why no scans arrive; reopen the bus from time to time."""
        if self._reason == "receiving scans":
            self._traffic.begin(now)
            self._reason = "waiting for scans"
        else:
            cause = self._traffic.cause()
            self._fault = FaultKind.NO_SCANS if cause == FaultKind.NOT_RESPONDING else cause
            self._reason = (
                f"the board's frames give no complete scan: compare {self._dbc} with them"
                if self._fault == FaultKind.NO_SCANS
                else f"no frames of the board: check power, cable, bit rate and the identifiers in {self._dbc}"
            )
        self._deadline = now + self._scan_timeout
        self._ask_adapter()
        if self.bus.is_open and self._fault != FaultKind.NO_SCANS and self._traffic.reopen_due(now):
            self.bus.close()
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
            self._fault, self._reason = None, "waiting for scans"
        self._traffic.begin(self._clock.monotonic())
        self._enter(ConnectionState.SCANS, self._reason, self._scan_timeout)
        self.decoder.start()

    def _read_frames(self, timeout: int) -> bool:
        """Read the frames that are waiting or arrive within `timeout` [ns]; return whether anything happened."""
        self.load.add(self._batch, self._arrival)  # of the previous read: scans were delivered first
        self._batch = []
        overflows = self.bus.errors.overflow
        try:
            frames = self._batch = self.bus.read(timeout / NANOSECONDS)
        except (can.CanError, OSError) as error:
            self._fail(error)
            return True
        if self.bus.errors.overflow != overflows:
            self.decoder.note_overflow()
        arrival = self._arrival = self._clock.monotonic()
        self._decoded = self.decoder.decode(frames, arrival, self._clock.wall() - arrival)
        return bool(frames)

    def _ask_adapter(self) -> None:
        try:
            self.bus.ask_state()
        except (can.CanError, OSError) as error:
            self._fail(error)

    def _fail(self, error: Exception, fault: FaultKind = FaultKind.ADAPTER_DISCONNECTED) -> None:
        """Close the bus and retry later."""
        self._fault = fault
        delay = self.bus.fail()
        self._enter(
            ConnectionState.BUS, f"CAN bus unavailable, retrying: {one_line(error)}", round(delay * NANOSECONDS)
        )

    def _enter(self, state: ConnectionState, reason: str, timeout: int) -> None:
        self._state, self._reason = state, reason
        self._decoded = iter(())
        self._deadline = self._clock.monotonic() + timeout
