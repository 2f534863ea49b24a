"""Everything a board sends, made into scans, status and answers. Knows no bus and no clock."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from posfet_driver.bus.error_frame import ErrorCounts
from posfet_driver.bus.frame import CLASSIC, ERROR, EXTENDED, Frame
from posfet_driver.bus.frame_timing import classic_time, fd_time
from posfet_driver.protocol.clock_sync import BoardClock
from posfet_driver.protocol.messages import RESPONSE_OFFSET, STATUS_OFFSET, Command, Page, Response, Result, Status
from posfet_driver.protocol.scan_assembler import NUMBER_WRAP, SCAN_PAGE, Assembler
from posfet_driver.protocol.scan_codec import CLASSIC_LENGTH, FD_LENGTH, ScanCodec, make_codec
from posfet_driver.protocol.sequence_recovery import Numbering
from posfet_model._lib.units import NANOSECONDS
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import Scan, ScanStatus

_NEVER_READ: Final = 1 << 63
_TIME_ESTIMATED: Final = int(ScanStatus.TIME_ESTIMATED)  # a flag is ten times as slow as a number
_BOARD_RESET: Final = int(ScanStatus.BOARD_RESET)


@dataclass(slots=True)
class Traffic:
    """Frames that carry no scan of the board, by cause; never falls."""

    frames: int = 0
    """All frames of the bus, error frames included."""
    foreign: int = 0
    """Frames of other nodes on the bus."""
    malformed: int = 0
    """Status frames and answers of a wrong form."""


class Receiver:
    """Takes the frames of a bus one by one and picks out one board's.

    `scan` is filled anew by each frame that makes a scan whole.
    """

    def __init__(self, sensor: Sensor) -> None:
        """Raise ConfigError when the layout does not fit the frames."""
        codec: ScanCodec = make_codec(sensor)
        self.assembler = Assembler(codec)
        self.traffic = Traffic()
        self.errors = ErrorCounts()
        self.scan = Scan.empty(sensor.layout.id, sensor.layout.taxels)
        self.scan.counts = self.assembler.counts
        self.listening = False
        """False until the number of the next scan is known: scans are passed over, not even counted."""
        self.scan_period = NANOSECONDS / sensor.can.scan_rate
        """Time from scan to scan that the board was told [ns]."""
        self.scans = 0
        """Whole scans so far."""
        self.response: Response | None = None
        """The newest answer, until somebody takes it."""
        self.status = Status((math.nan, math.nan), math.nan, 0, Page.LAYOUT, 0)
        """The newest status."""
        self._flags = 0  # its flags, as classic scans carry them
        self.news = False
        """True when a status came; until somebody takes it."""
        self.layout_id: int | None = None
        self.firmware: int | None = None
        """Of the board, from its status frames; None: not known yet."""
        self._base = sensor.can.base_id
        self._fd = sensor.can.fd
        self._clock = BoardClock()
        self._clock_stood = False
        self._arrival = 0
        self._wall_offset = 0
        self._wall_read = _NEVER_READ  # as it was read with the batch before
        self._reset = False
        times = (
            fd_time(FD_LENGTH, sensor.can.bitrate, sensor.can.data_bitrate)
            if self._fd
            else classic_time(CLASSIC_LENGTH, sensor.can.bitrate)
        )
        self._way = codec.blocks * times.most
        self._first_block = codec.offset(0)
        self._last_block = codec.offset(codec.blocks - 1)
        self._numbering = Numbering(self._base, self.assembler)

    @property
    def frames_lost(self) -> int:
        """Frames of the board that did not arrive or could not be used."""
        losses = self.assembler.losses
        return losses.frames + losses.malformed + losses.stuck + self.traffic.malformed

    @property
    def clock_drift(self) -> float:
        """How far the map of clocks may have drifted since the last undelayed frame [s]; NaN before the first."""
        return self._clock.uncertainty / NANOSECONDS

    @property
    def stamp_uncertainty(self) -> float:
        """How far a stamp may be after the acquisition [s]: the way of a scan over the bus, and `clock_drift`."""
        return self._way + self.clock_drift

    def set_period(self, period: float) -> None:
        """Take the time from scan to scan that the board was told [ns]."""
        if period != self.scan_period and not self._fd:
            self._clock.reset()  # numbers of scans are its time
            self._numbering.forget()
        self.scan_period = period

    def resync(self, next_scan: int, count_gap: bool, reset: bool = False) -> bool:
        """Take the number of the next scan, as the board answers a start; return whether it was reset meanwhile.

        `count_gap` and `reset` as in `Assembler.resync`.
        """
        self.listening = True
        began_anew = self.assembler.resync(next_scan, count_gap, reset)
        self._numbering.anchor(self.assembler.sequence)
        if began_anew:
            self._clock.reset()
        self._reset = self._reset or began_anew or reset
        return began_anew

    def begin_batch(self, frames: list[Frame], arrival: int, wall_offset: int) -> list[Frame]:
        """Take `frames`, read at `arrival` [ns, monotonic]; return those to be fed now.

        `wall_offset` [ns] leads to wall time. The lesser of this one and the one before counts: a process that is held
        up between its looks at the two clocks reads too much. Classic blocks may be held until a later batch, or
        dropped when the numbers of their scans cannot be known (`Numbering`).
        """
        self.traffic.frames += len(frames)
        self._arrival = arrival
        self._wall_offset = wall_offset if wall_offset < self._wall_read else self._wall_read
        self._wall_read = wall_offset
        if self._fd:
            return frames
        return self._numbering.take(frames, arrival, self.scan_period, self.listening)

    @property
    def holding(self) -> bool:
        """Whether frames are held until the numbers of their scans are certain."""
        return self._numbering.holding

    @property
    def questions(self) -> int:
        """How often a running board was asked for the number of its next scan, which a classic counter hid."""
        return self._numbering.questions

    def question_due(self) -> bool:
        """Return whether a running board has to be told START, whose answer tells the number of the next scan."""
        return not self._fd and self._numbering.question_due()

    def asked(self, tag: int, now: int) -> None:
        """Take note that START is being sent with `tag` at `now` [ns]."""
        self._numbering.asked(tag, now)

    def feed(self, frame: Frame) -> bool:
        """Take one frame; return True when `scan` is a new one."""
        identifier, kind, data = frame
        offset = identifier - self._base
        if self._first_block <= offset <= self._last_block and not kind & (EXTENDED | ERROR):
            if not self.listening or not self.assembler.feed(offset, kind, data):
                return False
            self._complete()
            return True
        self._other(identifier, offset, kind, data)
        return False

    def _complete(self) -> None:
        scan, assembler = self.scan, self.assembler
        scan.sequence = assembler.sequence
        scan.frames_lost = self.frames_lost
        if self._fd:
            board_time = scan.device_time = assembler.device_time
            scan.status = assembler.status
        else:
            scan.status = self._flags
        clock_stands = assembler.clock_stands
        if clock_stands != self._clock_stood:  # from one clock to the other
            self._clock_stood = clock_stands
            self._clock.reset()
        if not self._fd or clock_stands:
            board_time = round(assembler.sequence * self.scan_period / 1000)
            scan.device_time = 0
            scan.status |= _TIME_ESTIMATED
        scan.stamp = self._clock.to_monotonic(board_time, self._arrival) + self._wall_offset
        if self._reset:
            scan.status |= _BOARD_RESET
            self._reset = False
        self.scans += 1

    def _other(self, identifier: int, offset: int, kind: int, data: bytes) -> None:
        if kind & ERROR:
            self.errors.take(identifier, data)
        elif offset == STATUS_OFFSET and not kind & EXTENDED:
            self._take_status(Status.unpack(data) if kind == CLASSIC else None)
        elif offset == RESPONSE_OFFSET and not kind & EXTENDED:
            response = Response.unpack(data) if kind == CLASSIC else None
            if response is None:
                self.traffic.malformed += 1
            else:
                self._take_response(response)
        else:
            self.traffic.foreign += 1

    def _take_response(self, response: Response) -> None:
        self.response = response
        if response.command == Command.START and response.result == Result.OK and self.listening:
            ahead = (response.value - self.assembler.sequence) % NUMBER_WRAP
            if not response.reset and ahead < NUMBER_WRAP // 2:  # else numbers began anew: `resync` is due
                self.assembler.align(response.value - 1, NUMBER_WRAP)

    def _take_status(self, status: Status | None) -> None:
        if status is None:
            self.traffic.malformed += 1
            return
        self.status = status
        self._flags = status.flags & ~_BOARD_RESET
        self.news = True
        self.scan.temperatures[:] = status.temperatures
        if status.page == Page.LAYOUT:
            self.layout_id = status.value
        elif status.page == Page.FIRMWARE:
            self.firmware = status.value
        elif status.page == Page.SCAN:
            self.assembler.align(status.value, SCAN_PAGE)
