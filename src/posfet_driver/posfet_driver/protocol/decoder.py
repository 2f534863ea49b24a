# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Decodes the frames of one board into scans, status and responses. Knows no bus, thread or clock."""

from __future__ import annotations

from collections.abc import Iterator

from posfet_core.protocol import (
    COMMANDS_KEPT,
    ArrivalTime,
    Assembler,
    Batch,
    BoardDecoder,
    FramePort,
    LoopControl,
    ScanLoop,
    ScanStatistics,
    Traffic,
    TransitTime,
    TransitTimes,
)
from posfet_driver.bus.frame import Frame
from posfet_driver.protocol.decoded import Decoded, IdentityReceived, ResponseReceived, ScanReady, StatusReceived
from posfet_driver.protocol.messages import NO_STATUS, Identity, Response, Status, parse_message
from posfet_driver.protocol.scan_codec import make_codec
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import Scan

__all__ = ["COMMANDS_KEPT", "Decoder", "TransitTimes"]


class Decoder:
    """Decodes the frames of a bus and picks out those of one board.

    The compiled `posfet_core.protocol.BoardDecoder` does it; this class gives its results the form that Python uses.

    Parameters
    ----------
    sensor : Sensor
        Array, frame format and base identifier.

    Raises
    ------
    ConfigError
        When the layout does not fit the frames.

    Examples
    --------
    >>> from posfet_driver.protocol.scan_codec import make_codec
    >>> from posfet_model.sensor.description import load_sensor
    >>> sensor = load_sensor()
    >>> decoder = Decoder(sensor)
    >>> decoder.start()
    >>> scan, frames = Scan.empty(sensor.layout.id, sensor.layout.taxels), []
    >>> for scan.sequence in range(3):
    ...     scan.device_time = 1000 * scan.sequence
    ...     frames += make_codec(sensor).encode(scan, sensor.can.base_id)
    >>> [found.scan.sequence for found in decoder.decode(frames, arrival=0, wall_offset=0)]
    [0, 1, 2]
    """

    def __init__(self, sensor: Sensor) -> None:
        codec = make_codec(sensor)
        self._core = BoardDecoder(codec.fd, codec.taxels, sensor.can.base_id)
        self._base = sensor.can.base_id
        self.assembler: Assembler = self._core.assembler
        self.statistics: ScanStatistics = self.assembler.statistics
        """Frames and scans that were lost or rejected, by cause."""
        self.traffic: Traffic = self._core.traffic
        self.transit_time: TransitTime = self._core.transit_time
        """Longest time that the frames of a scan occupy the bus."""
        self.scan = Scan.empty(sensor.layout.id, sensor.layout.taxels)
        """The newest complete scan; overwritten by the next one."""
        self.scan.counts = self.assembler.counts
        self.status = NO_STATUS
        """The newest status; `NO_STATUS` while it is unknown."""
        self.identity: Identity | None = None
        """The newest identity; None: unknown."""
        self._ready = ScanReady(self.scan)
        self.set_period(round(1e6 / sensor.can.scan_rate))

    @property
    def receiving(self) -> bool:
        """False until the board was identified and started: scans are ignored and not counted."""
        return self._core.receiving

    @receiving.setter
    def receiving(self, receiving: bool) -> None:
        """Receive scans, or ignore them."""
        self._core.receiving = receiving

    @property
    def scans(self) -> int:
        """Number of complete scans."""
        return self._core.scans

    @property
    def blocks(self) -> int:
        """Number of scan frames of a scan, without its header."""
        return self.assembler.blocks

    @property
    def resets(self) -> int:
        """Number of times that the board was reset."""
        return self._core.resets

    @property
    def sequence(self) -> int:
        """Sequence of the scan that was begun last; -1 before the first."""
        return self._core.sequence

    @property
    def frames_lost(self) -> int:
        """Frames of the board that did not arrive or could not be used."""
        return self._core.frames_lost

    @property
    def frozen_clock(self) -> int:
        """Number of times that the board repeated a device time, from the third in a row on: its clock is frozen."""
        return self._core.frozen_clock

    @property
    def clock_uncertainty(self) -> float:  # numpydoc ignore=RT01
        """Possible error of a stamp by drift and steps of the clock, or its order [s]; NaN before the first frame.

        What else is known about the newest scan is in its `stamp_uncertainty`.
        """
        return self._core.clock_uncertainty

    @property
    def scan_period(self) -> int:
        """Scan period that the board has announced [us]."""
        return round(self._core.announced_period)

    @property
    def kept_period(self) -> int:
        """Scan period that the scans keep [us]: as announced, or as measured where they contradict that."""
        return round(self._core.kept_period)

    def set_period(self, period: int, confirmed: bool = True) -> None:
        """Set the scan period that the board keeps.

        Parameters
        ----------
        period : int
            Scan period [us].
        confirmed : bool, default True
            Whether it was set; what the board states unasked has to be confirmed by its scans.
        """
        self._core.set_period(period, confirmed)

    def sent(self, command: bytes) -> None:
        """Note a command that this driver sends: of the newest ones, the same frame is no other host's.

        Parameters
        ----------
        command : bytes
            Data of the frame.
        """
        self._core.sent(command)

    def start(self) -> None:
        """Receive scans from now on, whatever their sequence: the board was started."""
        self._core.start()

    def doubt_sequence(self) -> None:
        """Accept any sequence next: the board is silent or does not scan, and may have been reset."""
        self._core.doubt_sequence()

    def forget_gap(self) -> None:
        """Count no scan as lost before the next one: the board was stopped on request."""
        self._core.forget_gap()

    def note_overflow(self) -> None:
        """Note that frames were lost within the next batch: numbers and headers tell which."""
        self._core.note_overflow()

    def forget_status(self) -> None:
        """Forget the newest status, which is too old: temperatures and flags are unknown up to the next one."""
        self._core.forget_status()
        self.status = NO_STATUS
        self.scan.temperatures[:] = self.status.temperatures

    def decode(self, frames: list[Frame], arrival: int, wall_offset: int) -> Iterator[Decoded]:
        """Decode a batch of frames, one step of the iterator at a time.

        Classic scans may be held until a later batch, or dropped when their sequence cannot be known.

        Parameters
        ----------
        frames : list of Frame
            Frames in the order of their arrival.
        arrival : int
            Monotonic time at which they were read [ns].
        wall_offset : int
            Wall time less monotonic time [ns].

        Returns
        -------
        Iterator of ScanReady, StatusReceived, IdentityReceived or ResponseReceived
            What the frames contain. Exhaust it before the next batch; what is not consumed is dropped.
        """
        return self._decode(self._core.begin_batch(frames, arrival, wall_offset))

    def _decode(self, batch: Batch) -> Iterator[Decoded]:
        advance, scan, ready = self._core.advance, self.scan, self._ready
        while (found := advance(batch, scan)) is not None:
            yield ready if found is True else self.message(found)

    def rest_of(self, loop: ScanLoop) -> Iterator[Decoded]:
        """Decode what a loop has left of a batch; see `decode`.

        Parameters
        ----------
        loop : ScanLoop
            The loop, with the core of this decoder.
        """
        while (found := loop.advance()) is not None:
            yield self._ready if found is True else self.message(found)

    def make_loop(self, port: FramePort, control: LoopControl, arrival_time: ArrivalTime) -> ScanLoop:
        """Return a loop that decodes what a port reads; the newest scan is `scan`, as for `decode`.

        Parameters
        ----------
        port : FramePort
            What is read.
        control : LoopControl
            Calls the loop back.
        arrival_time : ArrivalTime
            Maps the stamps of arrivals.
        """
        return ScanLoop(self._core, port, control, arrival_time, self.scan)

    def message(self, frame: Frame) -> StatusReceived | ResponseReceived | IdentityReceived:
        """Return the message in a frame of the board, which the compiled decoder has taken already.

        Parameters
        ----------
        frame : Frame
            The frame.
        """
        identifier, kind, data = frame
        message = parse_message(identifier - self._base, kind, data)
        match message:
            case Status():
                self.status = message
                self.scan.temperatures[:] = message.temperatures
                return StatusReceived(message)
            case Response():
                return ResponseReceived(message)
            case Identity():
                self.identity = message
                return IdentityReceived(message)
        raise AssertionError(f"no message: {frame}")
