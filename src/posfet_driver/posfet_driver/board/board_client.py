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

from posfet_driver.board.board_connection import BoardConnection
from posfet_driver.board.board_report import board_report
from posfet_driver.board.board_starter import RESPONSE_TIMEOUT
from posfet_driver.board.board_supervisor import BoardSupervisor
from posfet_driver.board.connection_state import ConnectionState
from posfet_driver.board.scan_source import SourceReport
from posfet_driver.board.transit_time import scan_transit_times
from posfet_driver.bus.frame_bus import FrameBus
from posfet_driver.bus.reconnecting_bus import PRESENCE_PERIOD
from posfet_driver.clock import Clock, SystemClock
from posfet_driver.protocol.decoded import ScanReady
from posfet_driver.protocol.decoder import Decoder
from posfet_driver.protocol.messages import Command, Response
from posfet_driver.protocol.scan_loop import LoopEnd
from posfet_model._lib.units import NANOSECONDS
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import Scan


class Board:
    """One board on a bus. Used by one thread, but for `submit` and `report`.

    The bus is reopened, with back-off, whenever it cannot be opened, fails, or stays without a response; a
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
        self._clock = clock or SystemClock()
        self._connection = BoardConnection(
            sensor.can, self.decoder, open_bus, self._clock, presence, "looking for the board"
        )
        self.bus = self._connection.bus
        self.decoder.transit_time.times = scan_transit_times(sensor.can, self.decoder.blocks)
        self._supervisor = BoardSupervisor(sensor, self._connection, self.decoder, self._clock)
        self._commands = self._supervisor.commands

    @property
    def restarted(self) -> int:
        """Number of times a silent board was restarted."""
        return self._supervisor.restarted

    @property
    def brown_outs(self) -> int:
        """Resets around which the supply voltage was low."""
        return self._supervisor.power.brown_outs

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
            self._supervisor.start()

    def close(self) -> None:
        """Stop the board and close the bus; may be called twice."""
        self._supervisor.stop()
        self._connection.close()
        self._commands.fail(self._connection.reason)

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
        connection.take_rest()
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

    def stream(self, sink: object, timeout: float) -> Scan | None:
        """Hand scans to a compiled sink, without Python, while the board does nothing but scan; else as `read`.

        Parameters
        ----------
        sink : object
            Capsule of what takes the scans.
        timeout : float
            Longest time to wait [s].

        Returns
        -------
        Scan or None
            A scan that the sink did not take, as `read` returns it. None when the sink wants no more now, `wake` was
            called, or no such scan arrived in time.
        """
        connection = self._connection
        if self._next_scan():
            return self.decoder.scan
        end = self._clock.monotonic() + round(timeout * NANOSECONDS)
        while connection.can_loop() and not self._commands.pending():
            found = connection.run_loop(sink, end)
            if found == LoopEnd.SCAN:
                connection.deadline = connection.arrival + connection.scan_timeout
                return self.decoder.scan
            if found == LoopEnd.MESSAGE and connection.loop is not None:
                self._supervisor.handle(self.decoder.message(connection.loop.message))
            elif found == LoopEnd.HANDED:
                connection.read(0)
                return self.decoder.scan if self._next_scan() else None
            elif found != LoopEnd.INTERRUPTED:
                return None
        return self.read(max(end - self._clock.monotonic(), 0) / NANOSECONDS)

    def wake(self) -> None:
        """Have `stream` return; from any thread. After this no sink is given a scan until `stream` is called again."""
        self._connection.control.wake()

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
        pending = self._commands.put(command, argument, timeout, self._clock.monotonic())
        self.wake()
        return pending

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
        with self._connection.control:
            return board_report(
                self._connection,
                self.decoder,
                self.stamp_uncertainty,
                self.restarted,
                self.brown_outs,
                self._supervisor.status_missing,
            )

    def _next_scan(self) -> bool:
        """Process the frames at hand up to the next complete scan; return whether there is one."""
        connection = self._connection
        for decoded in connection.decoded:
            if isinstance(decoded, ScanReady):
                if connection.flowing:
                    if connection.state is ConnectionState.SCANS:  # else a response is awaited
                        connection.deadline = connection.arrival + connection.scan_timeout
                else:  # started, or sending again before it was restarted
                    connection.flowing = True
                    connection.fault = None
                    connection.enter(ConnectionState.SCANS, "receiving scans", connection.scan_timeout / NANOSECONDS)
                return True
            self._supervisor.handle(decoded)
        self._supervisor.check_status()
        connection.check_adapter()
        return False

    def _wait(self, now: int, end: int) -> None:
        """Read frames, or do what is due when there are none."""
        if self._commands.pending():
            self._supervisor.process_commands(now)
            end = min(end, now + round(PRESENCE_PERIOD * NANOSECONDS))
        if self._connection.wait(now, end):
            self._supervisor.handle_timeout()
