# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The connection to one board: its bus, opened and reopened, and what arrives on it. Both kinds of boards have one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

import can

from posfet_driver.board.connection_state import NOT_RECEIVING, ConnectionState
from posfet_driver.board.faults import FaultKind
from posfet_driver.board.no_response import NoResponseMonitor
from posfet_driver.bus.bus_error import one_line
from posfet_driver.bus.bus_load import BusLoad
from posfet_driver.bus.frame import Frame
from posfet_driver.bus.frame_bus import FrameBus
from posfet_driver.bus.reconnecting_bus import ReconnectingBus
from posfet_driver.clock import Clock, SystemClock
from posfet_driver.protocol.decoded import Decoded
from posfet_driver.protocol.decoder import Decoder
from posfet_driver.protocol.mapped_decoder import MappedDecoder
from posfet_driver.protocol.scan_loop import ArrivalTime, LoopControl, LoopEnd, ScanLoop
from posfet_model._lib.units import NANOSECONDS
from posfet_model.config import ConfigError
from posfet_model.sensor.description import CanLink

NEVER: Final = 1 << 63
SCAN_TIMEOUT: Final = 0.3
"""Time without a scan [s] after which the reason is looked for."""
SCAN_TIMEOUT_SCANS: Final = 10
"""The same in scan periods, for low scan rates."""
ASK_INTERVAL: Final = 1.0
"""Time between two questions for the error state of an adapter while scans flow [s]: a line of two bytes each."""


class BoardConnection:
    """State of the connection to a board, and the frames that were read. Used by one thread.

    The bus is reopened, with back-off, whenever it cannot be opened or fails, bus-off included, and at once
    when its adapter is connected again. None of this raises: `reason` and `fault` state what is missing.

    Parameters
    ----------
    link : CanLink
        Bit rates.
    decoder : Decoder or MappedDecoder
        Decodes the frames.
    open_bus : callable
        Opens the bus; raises can.CanError or ConfigError.
    clock : Clock
        Source of time.
    presence : callable or None
        Returns a value that changes when the adapter is connected again.
    searching : str
        State while the bus is open and the board was not found yet.
    """

    def __init__(
        self,
        link: CanLink,
        decoder: Decoder | MappedDecoder,
        open_bus: Callable[[], FrameBus],
        clock: Clock,
        presence: Callable[[], object] | None,
        searching: str,
    ) -> None:
        self.bus = ReconnectingBus(open_bus, presence, clock)
        self.load = BusLoad(link.bitrate, link.data_bitrate)
        self.no_response = NoResponseMonitor(decoder.traffic, self.bus.errors)
        self.state = ConnectionState.CLOSED
        self.reason = "closed"
        """One line: the state and its reason."""
        self.flowing = False
        """Whether a scan has arrived since the board was started, or listened to."""
        self.fault: FaultKind | None = None
        """The fault that prevents scans; None when there is none."""
        self.deadline = NEVER
        """Time at which something is to be done when nothing happens before [ns]."""
        self.arrival = 0
        """Time at which the newest batch of frames was read [ns]."""
        self.decoded: Iterator[Decoded] = iter(())
        """What the newest batch contains."""
        self.control = LoopControl()
        """Calls a loop back; held while what a loop changes is read in another thread."""
        self.loop: ScanLoop | None = None
        """Decodes what the open bus receives without Python; None where that needs Python."""
        self._decoder = decoder
        self._clock = clock
        self._searching = searching
        self._arrival_time = ArrivalTime()
        self._batch: list[Frame] = []
        self._overflows = 0
        self._bus_offs = 0
        self._ask_at = 0  # time of the next question for the adapter's error state while scans flow [ns]
        self._checked = -1  # deadline after which the bus was read once more

    @property
    def scan_timeout(self) -> int:
        """Time without a scan after which the reason is looked for [ns]."""
        in_scans = SCAN_TIMEOUT_SCANS * self._decoder.kept_period * 1000
        return max(round(SCAN_TIMEOUT * NANOSECONDS), in_scans)

    def open(self) -> bool:
        """Open the bus for the first time; return whether it is open.

        Raises
        ------
        ConfigError
            When it can never be opened with these arguments.
        """
        self.bus.reset_backoff()
        self.enter(ConnectionState.BUS, "opening the bus", 0.0)
        return self._connect()

    def reopen(self) -> bool:
        """Open the bus again; return whether it is open."""
        try:
            return self._connect()
        except ConfigError as error:
            self.fail(error)
            return False

    def reopen_when_silent(self) -> bool:
        """Close the bus and open it again when the board has been silent for long; return whether that was done."""
        if not self.bus.is_open or not self.no_response.reopen_due(self._clock.monotonic()):
            return False
        self.bus.close()
        self.enter(ConnectionState.BUS, self.reason, 0.0)
        return self.reopen()

    def close(self) -> None:
        """Close the bus; may be called twice."""
        self.fault = None
        self.bus.close()
        self.enter(ConnectionState.CLOSED, "closed", 0.0)

    def wait(self, now: int, end: int) -> bool:
        """Read frames, or wait for a bus, up to `end` or the deadline.

        Parameters
        ----------
        now : int
            Monotonic time [ns].
        end : int
            Latest time of return [ns].

        Returns
        -------
        bool
            Whether the deadline has passed, and no frame that arrived in time is left.
        """
        deadline = self.deadline
        late = now >= deadline
        if late and (not self.bus.is_open or self._checked == deadline):
            return True
        left = max(min(end, deadline) - now, 0)
        if self.bus.is_open:
            arrived = self.read(left)
            if late or (not arrived and self._clock.monotonic() >= deadline):
                self._checked = deadline
        elif self.state is not ConnectionState.BUS:
            self._clock.sleep(left / NANOSECONDS)
        elif self.bus.wait_for_device(left):
            self.deadline = self._clock.monotonic()
        return False

    def read(self, timeout: int) -> bool:
        """Read the frames that are waiting or arrive within `timeout` [ns]; return whether anything happened."""
        self.load.add(self._batch, self.arrival)  # of the previous read: scans were delivered first
        self._batch = []
        try:
            frames = self._batch = self.bus.read(timeout / NANOSECONDS)
        except (can.CanError, OSError) as error:
            self.fail(error)
            return True
        if self.bus.errors.overflow != self._overflows:
            self._overflows = self.bus.errors.overflow
            self._decoder.note_overflow()
        now = self.arrival = self._clock.monotonic()
        wall_offset = self._clock.wall() - now
        arrival = self._arrival_time.of_newest(self.bus.arrival_stamp, now, wall_offset)
        self.decoded = self._decoder.decode(frames, arrival, wall_offset)
        return bool(frames)

    def can_loop(self) -> bool:
        """Return whether nothing but scans is awaited from the bus, and none is overdue."""
        return (
            self.loop is not None
            and self.flowing
            and self.state is ConnectionState.SCANS
            and self.bus.read_by_port
            and self._clock.monotonic() < self.deadline
        )

    def run_loop(self, sink: object, end: int) -> LoopEnd:
        """Decode what arrives up to `end`, or up to the deadline, and hand on the scans, until Python is needed.

        Parameters
        ----------
        sink : object
            Capsule of what takes the scans.
        end : int
            Latest time of return [ns].

        Returns
        -------
        LoopEnd
            Why it has returned.
        """
        loop = self.loop
        assert loop is not None
        taken = loop.taken
        self.load.add(self._batch, self.arrival)  # of the previous read
        self._batch = []
        found = loop.run(sink, (min(end, self.deadline) - self._clock.monotonic()) / NANOSECONDS)
        self.arrival = max(self.arrival, loop.arrival)
        self.load.add_counts(loop.take_frame_counts(), self.arrival)
        if loop.taken != taken:
            self.deadline = self.arrival + self.scan_timeout
        return found

    def take_rest(self) -> None:
        """Decode what a loop has left of a batch before anything else."""
        if self.loop is not None and self.loop.pending:
            assert isinstance(self._decoder, Decoder)
            self.decoded = self._decoder.rest_of(self.loop)

    def write(self, frame: Frame) -> None:
        """Send a frame, or nothing when the bus is not open."""
        try:
            self.bus.write(frame)
        except (can.CanError, OSError) as error:
            self.fail(error)

    def ask_adapter(self) -> None:
        """Request the adapter's error state, which arrives as error frames."""
        try:
            self.bus.ask_state()
        except (can.CanError, OSError) as error:
            self.fail(error)

    def check_adapter(self) -> None:
        """Reopen the bus when its controller has gone bus-off, and ask now and then for errors that nothing else shows.

        Called when all that was read is processed.
        """
        if self.bus.errors.bus_off != self._bus_offs:
            self._bus_offs = self.bus.errors.bus_off
            self.fail(can.CanOperationError("the controller is bus-off"), FaultKind.BUS_OFF)
        elif self.flowing and self.arrival >= self._ask_at:
            self._ask_at = self.arrival + round(ASK_INTERVAL * NANOSECONDS)
            if self.bus.must_be_asked:
                self.ask_adapter()

    def fail(self, error: Exception, fault: FaultKind = FaultKind.ADAPTER_DISCONNECTED) -> None:
        """Close the bus and retry later.

        Parameters
        ----------
        error : Exception
            Why.
        fault : FaultKind, optional
            The fault that prevents scans.
        """
        self.fault = fault
        self.enter(ConnectionState.BUS, f"CAN bus unavailable, retrying: {one_line(error)}", self.bus.fail())

    def enter(self, state: ConnectionState, reason: str, timeout: float) -> None:
        """Enter a state.

        Parameters
        ----------
        state : ConnectionState
            The state.
        reason : str
            One line: the state and its reason.
        timeout : float
            Time to the deadline [s]; there is none for a board that is closed or stopped.
        """
        self.state, self.reason = state, reason
        if state in NOT_RECEIVING:
            self._decoder.receiving = False
        if not self.bus.is_open:
            self.decoded, self.loop, self._batch = iter(()), None, []
            self.load.reset()
        timed = state not in {ConnectionState.CLOSED, ConnectionState.STOPPED}
        self.deadline = self._clock.monotonic() + round(timeout * NANOSECONDS) if timed else NEVER

    def _connect(self) -> bool:
        try:
            self.bus.connect()
        except can.CanError as error:
            self.fail(error)
            return False
        if self.fault in {None, FaultKind.ADAPTER_DISCONNECTED}:
            self.reason = self._searching
        self.no_response.begin(self._clock.monotonic())
        port = self.bus.port
        if port is not None and isinstance(self._decoder, Decoder) and isinstance(self._clock, SystemClock):
            self.loop = self._decoder.make_loop(port, self.control, self._arrival_time)
        return True
