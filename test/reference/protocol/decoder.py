# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The decoder in Python, which `posfet_core.protocol.BoardDecoder` agrees with exactly."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from posfet_driver.bus.frame import CLASSIC, ERROR, EXTENDED, Frame
from posfet_driver.protocol.decoded import (
    Decoded,
    IdentityReceived,
    ResponseReceived,
    ScanReady,
    StatusReceived,
)
from posfet_driver.protocol.messages import (
    CLASSIC_BLOCK_OFFSET,
    COMMAND_OFFSET,
    FD_BLOCK_OFFSET,
    HEADER_OFFSET,
    IDENTITY_OFFSET,
    LONGEST_PERIOD,
    NO_STATUS,
    RESPONSE_OFFSET,
    STATUS_OFFSET,
    Command,
    Identity,
    Response,
    Result,
    Status,
    parse_message,
)
from posfet_driver.protocol.scan_codec import make_codec
from posfet_model._lib.units import NANOSECONDS
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import Scan, ScanStatus
from reference.protocol.ascending_stamps import AscendingStamps
from reference.protocol.classic_scans import ClassicScans
from reference.protocol.clock_sync import ClockSync, WallOffset
from reference.protocol.fd_scans import FdScans
from reference.protocol.power_ons import PowerOns
from reference.protocol.scan_assembler import Assembler, ScanStatistics
from reference.protocol.scan_group import Held
from reference.protocol.transit_time import TransitTime

COMMANDS_KEPT: Final = 16
"""Number of the newest own commands that are remembered: a link may delay their responses by some repetitions."""
_TIME_ESTIMATED: Final = int(ScanStatus.TIME_ESTIMATED)  # a flag is ten times as slow as a number
_NO_BLOCK: Final = EXTENDED | ERROR
_SHORT: Final = (STATUS_OFFSET, IDENTITY_OFFSET, RESPONSE_OFFSET, COMMAND_OFFSET)
_SET_RATE: Final = bytes([Command.SET_RATE])


@dataclass(slots=True)
class Traffic:
    """Frames that carry no scan of the board, by cause."""

    frames: int = 0
    commands: int = 0
    unrelated: int = 0
    malformed: int = 0
    status_lost: int = 0
    status_repeated: int = 0


class Decoder:
    """Decodes the frames of a bus and picks out those of one board.

    Parameters
    ----------
    sensor : Sensor
        Array, frame format and base identifier.

    Raises
    ------
    ConfigError
        When the layout does not fit the frames.
    """

    def __init__(self, sensor: Sensor) -> None:
        codec = make_codec(sensor)
        self.assembler = Assembler(codec)
        self.statistics: ScanStatistics = self.assembler.statistics
        """Frames and scans that were lost or rejected, by cause."""
        self.traffic = Traffic()
        self.scan = Scan.empty(sensor.layout.id, sensor.layout.taxels)
        """The newest complete scan; overwritten by the next one."""
        self.scan.counts = self.assembler.counts
        self.receiving = False
        """False until the board was identified and started: scans are ignored and not counted."""
        self.scans = 0
        """Number of complete scans."""
        self.status = NO_STATUS
        """The newest status; `NO_STATUS` while it is unknown."""
        self.identity: Identity | None = None
        """The newest identity; None: unknown."""
        self.transit_time = TransitTime()
        """Longest time that the frames of a scan occupy the bus."""
        self._base = sensor.can.base_id
        self._fd = sensor.can.fd
        self._sync = ClockSync()
        self._ascending = AscendingStamps()
        self._power_ons = PowerOns()
        self._resets = 0  # flags of the next scan that is published: the one that was completed first may be dropped
        self._arrival = 0
        self._wall_offset = WallOffset()
        self._status_data = b""
        self._own_commands: deque[bytes] = deque(maxlen=COMMANDS_KEPT)
        self._first_block = FD_BLOCK_OFFSET if self._fd else CLASSIC_BLOCK_OFFSET
        self._last_block = codec.offset(codec.blocks - 1)
        self._fd_scans = FdScans(self.assembler, self._sync)
        self._classic_scans = ClassicScans(self.assembler, self._sync)
        self._scans: FdScans | ClassicScans = self._fd_scans if self._fd else self._classic_scans
        self._ready = ScanReady(self.scan)
        self.set_period(round(1e6 / sensor.can.scan_rate))

    @property
    def blocks(self) -> int:
        """Number of scan frames of a scan, without its header."""
        return self.assembler.codec.blocks

    @property
    def resets(self) -> int:
        """Number of times that the board was reset."""
        return self._power_ons.resets

    @property
    def sequence(self) -> int:
        """Sequence of the scan that was begun last; -1 before the first."""
        return self._scans.sequence

    @property
    def frames_lost(self) -> int:
        """Frames of the board that did not arrive or could not be used."""
        statistics = self.statistics  # a malformed block is missing in its scan
        return statistics.missing_frames + statistics.frozen_counter + self.traffic.malformed

    @property
    def frozen_clock(self) -> int:
        """Number of times that the board repeated a device time, from the third in a row on: its clock is frozen."""
        return self._scans.clock.repeated

    @property
    def clock_uncertainty(self) -> float:  # numpydoc ignore=RT01
        """Possible error of a stamp by drift and steps of the clock, or its order [s]; NaN before the first frame.

        What is known of the newest scan besides is in its `stamp_uncertainty`.
        """
        return (self._sync.uncertainty + self._ascending.excess) / NANOSECONDS

    @property
    def scan_period(self) -> int:
        """Scan period that the board has announced [us]."""
        return round(self._scans.numbering.announced)

    @property
    def kept_period(self) -> int:
        """Scan period that the scans keep [us]: as announced, or as measured where they contradict that."""
        return round(self._scans.numbering.period)

    def set_period(self, period: int, confirmed: bool = True) -> None:
        """Set the scan period that the board keeps.

        Parameters
        ----------
        period : int
            Scan period [us].
        confirmed : bool, default True
            Whether it was set; what the board states unasked has to be confirmed by its scans.
        """
        self._scans.announce(float(period), confirmed)

    def sent(self, command: bytes) -> None:
        """Note a command that this driver sends: of the newest ones, the same frame is no other host's.

        Parameters
        ----------
        command : bytes
            Data of the frame.
        """
        self._own_commands.append(command)

    def start(self) -> None:
        """Receive scans from now on, whatever their sequence: the board was started."""
        self.receiving = True
        self.transit_time.restart()
        self._scans.start()

    def doubt_sequence(self) -> None:
        """Accept any sequence next: the board is silent or does not scan, and may have been reset."""
        self._scans.numbering.open()

    def forget_gap(self) -> None:
        """Count no scan as lost before the next one: the board was stopped on request."""
        self._scans.numbering.forget_gap()

    def note_overflow(self) -> None:
        """Note that frames were lost within the next batch: numbers and headers tell which."""
        self._classic_scans.overflowed = True

    def forget_status(self) -> None:
        """Forget the newest status, which is too old: temperatures and flags are unknown up to the next one."""
        self._status_data = b""
        self.status = NO_STATUS
        self.scan.temperatures[:] = self.status.temperatures

    def decode(self, frames: list[Frame], arrival: int, wall_offset: int) -> Iterator[Decoded]:
        """Decode a batch of frames, one step of the iterator at a time.

        Classic scans may be held until a later batch, or dropped when their sequence cannot be known (`ClassicScans`).

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
        self.traffic.frames += len(frames)
        self._arrival = arrival
        self._wall_offset.read(wall_offset)
        return self._decode_fd(frames) if self._fd else self._decode_classic(frames)

    def _decode_fd(self, frames: list[Frame]) -> Iterator[Decoded]:
        feed, ready, block, arrival = self._fd_scans.feed, self._ready, self._base + FD_BLOCK_OFFSET, self._arrival
        for frame in frames:
            identifier, kind, data = frame
            if identifier == block and not kind & _NO_BLOCK:
                self.transit_time.see(kind)
                if self.receiving and feed(kind, data, arrival):
                    self._complete()
                    self._publish(self._fd_scans.time, self._fd_scans.clock.stalled)
                    yield ready
            elif message := self._other(frame):
                yield message

    def _decode_classic(self, frames: list[Frame]) -> Iterator[Decoded]:
        scans, ready, arrival = self._classic_scans, self._ready, self._arrival
        first, last = self._base + CLASSIC_BLOCK_OFFSET, self._base + self._last_block
        header = self._base + HEADER_OFFSET
        for frame in frames:
            identifier, kind, data = frame
            if kind & _NO_BLOCK or not (first <= identifier <= last or identifier == header):
                if message := self._other(frame):
                    yield message
            elif not self.receiving:
                continue
            elif identifier == header:
                for held in scans.feed_header(kind, data, arrival):
                    self._recall(held)
                    yield ready
            elif scans.feed(identifier - first, kind, data, arrival):
                self._complete(scans.dated)
                if scans.doubtful:
                    scans.hold(self.scan.snapshot())
                else:
                    self._publish(scans.time, scans.clock.stalled)
                    yield ready
        if scans.overflowed:
            scans.overflowed, scans.doubtful = False, True

    def _complete(self, dated: bool = True) -> None:
        """Complete the scan: sequence, time and status; one that is not `dated` tells nothing of the board's clock."""
        scan, scans = self.scan, self._scans
        scan.sequence = scans.sequence
        scan.frames_lost = self.frames_lost
        scan.status = self.assembler.status if self._fd else self.status.flags
        time = scan.device_time = scans.time
        if scans.clock.frozen:
            scan.device_time = 0
            scan.status |= _TIME_ESTIMATED
        if dated:
            scan.stamp = self._sync.to_monotonic(time, self._arrival)
        numbering = scans.numbering
        self._resets |= self._power_ons.flags(numbering.boot, numbering.restarted)
        numbering.restarted = False

    def _recall(self, held: Held) -> None:
        """Make a scan that was held the newest one."""
        scan, earlier, device_time = self.scan, held.scan, held.device_time
        scan.sequence, scan.device_time, scan.status = earlier.sequence, earlier.device_time, earlier.status
        scan.counts[:] = earlier.counts
        scan.frames_lost = self.frames_lost
        scan.stamp = device_time * 1000 + round(self._sync.offset)
        self._publish(device_time, held.stalled or self._scans.clock.stalled)

    def _publish(self, device_time: int, stalled: bool) -> None:
        """Stamp the newest scan, in the order of publication.

        It was acquired at `device_time` [us], which is counted on if the board's clock has `stalled`.
        """
        scan = self.scan
        scan.status |= self._resets
        self._resets = 0
        stamp = self._ascending.stamp(scan.stamp, device_time, self._arrival)
        scan.stamp = stamp + self._wall_offset.value
        scan.stamp_uncertainty = math.nan if stalled else self._uncertainty(stamp) / NANOSECONDS
        self.scans += 1

    def _uncertainty(self, stamp: int) -> float:
        """Return the largest error [ns] of the newest scan's stamp [ns], while the board's clock runs."""
        scans = self._scans
        late = self.transit_time.current * NANOSECONDS + self._ascending.excess + scans.late * 1000
        return self._sync.error(late, scans.early(self.scan.sequence) * 1000, self._arrival - stamp)

    def _other(self, frame: Frame) -> Decoded | None:
        """Return what a frame that belongs to no scan contains, or count it."""
        identifier, kind, data = frame
        offset, traffic = identifier - self._base, self.traffic
        message = None
        if kind & ERROR:
            pass  # error frames are counted by the bus
        elif kind & EXTENDED or offset not in _SHORT:
            traffic.unrelated += 1
        elif offset == COMMAND_OFFSET and kind == CLASSIC and data in self._own_commands:
            pass  # some buses hand back what was written
        elif offset == COMMAND_OFFSET:
            traffic.commands += 1
            if kind == CLASSIC and data[:1] == _SET_RATE:
                self._classic_scans.dispute_period(self._arrival)
        elif (message := parse_message(offset, kind, data)) is None:
            traffic.malformed += 1
        match message:
            case Status():
                return self._apply_status(message, data)
            case Response():
                return self._apply_response(message)
            case Identity():
                self.identity = message
                self.set_period(message.period, confirmed=False)
                return IdentityReceived(message)
        return None

    def _end_numbering(self, boot: int) -> None:
        """Stop the numbering of classic scans, unless a scan of this power-on has begun it again."""
        if boot != self._scans.numbering.boot:
            self._classic_scans.lose_number()

    def _apply_response(self, response: Response) -> Decoded | None:
        if self._power_ons.is_over(response.boot):
            return None
        if self._power_ons.note(response.boot):
            self._end_numbering(response.boot)
        if response.command == Command.SET_RATE and response.result == Result.OK:
            if 1 <= response.value <= LONGEST_PERIOD:
                self.set_period(response.value)
            else:
                self.traffic.malformed += 1
        return ResponseReceived(response)

    def _apply_status(self, status: Status, data: bytes) -> Decoded | None:
        traffic = self.traffic
        if data == self._status_data:
            traffic.status_repeated += 1
            return None
        if self._status_data and status.boot == self.status.boot:
            traffic.status_lost += (status.heartbeat - self.status.heartbeat - 1) & 0xF
        self._status_data = data
        self.status = status
        if self._power_ons.note_status(status):
            self._end_numbering(status.boot)
        self.scan.temperatures[:] = status.temperatures
        return StatusReceived(status)
