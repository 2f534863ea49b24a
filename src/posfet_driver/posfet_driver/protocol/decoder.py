"""Decodes the frames of one board into scans, status and responses. Knows no bus, thread or clock."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, TypeAlias

from posfet_driver.bus.frame import ERROR, EXTENDED, Frame
from posfet_driver.protocol.clock_sync import ClockSync
from posfet_driver.protocol.messages import (
    RESPONSE_OFFSET,
    STATUS_OFFSET,
    Command,
    Message,
    Page,
    Response,
    Result,
    Status,
    parse_message,
)
from posfet_driver.protocol.scan_assembler import Assembler, ScanStatistics
from posfet_driver.protocol.scan_codec import ScanCodec, make_codec
from posfet_driver.protocol.sequence_recovery import RESPONSE_WRAP, STATUS_WRAP, SequenceRecovery, SequenceTracker
from posfet_model._lib.units import NANOSECONDS
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import Scan, ScanStatus

_NEVER_READ: Final = 1 << 63
_TIME_ESTIMATED: Final = int(ScanStatus.TIME_ESTIMATED)  # a flag is ten times as slow as a number
_BOARD_RESET: Final = int(ScanStatus.BOARD_RESET)
_NO_BLOCK: Final = EXTENDED | ERROR


@dataclass(frozen=True, slots=True)
class ScanReady:
    """A scan is complete. The decoder overwrites it with the next one: copy what is to be kept."""

    scan: Scan


@dataclass(frozen=True, slots=True)
class StatusReceived:
    """The board sent its status."""

    status: Status


@dataclass(frozen=True, slots=True)
class ResponseReceived:
    """The board responded to a command."""

    response: Response


Decoded: TypeAlias = ScanReady | StatusReceived | ResponseReceived


@dataclass(slots=True)
class Traffic:
    """Frames that carry no scan of the board, by cause; counters never fall."""

    frames: int = 0
    """All frames on the bus, error frames included."""
    unrelated: int = 0
    """Frames of other nodes on the bus."""
    malformed: int = 0
    """Status frames and responses of the wrong length or type."""


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

    Examples
    --------
    >>> from posfet_driver.protocol.scan_codec import make_codec
    >>> from posfet_model.sensor.description import load_sensor
    >>> sensor = load_sensor()
    >>> decoder = Decoder(sensor)
    >>> decoder.resync(0, count_gap=False)
    False
    >>> frames = make_codec(sensor).encode(Scan.empty(sensor.layout.id, sensor.layout.taxels), sensor.can.base_id)
    >>> [type(found).__name__ for found in decoder.decode(frames, arrival=0, wall_offset=0)]
    ['ScanReady']
    """

    def __init__(self, sensor: Sensor) -> None:
        codec: ScanCodec = make_codec(sensor)
        self.assembler = Assembler(codec)
        self.statistics: ScanStatistics = self.assembler.statistics
        """Frames and scans that were lost or rejected, by cause."""
        self.traffic = Traffic()
        self.scan = Scan.empty(sensor.layout.id, sensor.layout.taxels)
        """The newest complete scan; overwritten by the next one."""
        self.scan.counts = self.assembler.counts
        self.receiving = False
        """False until the sequence of the next scan is known: scans are ignored and not counted."""
        self.scan_period = NANOSECONDS / sensor.can.scan_rate
        """Scan period that the board was set to [ns]."""
        self.scans = 0
        """Number of complete scans."""
        self.status = Status((math.nan, math.nan), math.nan, 0, Page.LAYOUT, 0)
        """The newest status."""
        self.layout_id: int | None = None
        """Layout of the board, from its status frames; None: unknown."""
        self.firmware: int | None = None
        """Firmware version of the board, from its status frames; None: unknown."""
        self._flags = 0  # of the newest status, as classic scans carry them
        self._base = sensor.can.base_id
        self._fd = sensor.can.fd
        self._clock = ClockSync()
        self._clock_was_frozen = False
        self._arrival = 0
        self._wall_offset = 0
        self._last_wall_offset = _NEVER_READ
        self._reset = False
        self._first_block = codec.offset(0)
        self._last_block = codec.offset(codec.blocks - 1)
        self._tracker = SequenceTracker(self.assembler)
        self._recovery = SequenceRecovery(self._base, self._tracker)
        self._ready = ScanReady(self.scan)

    @property
    def blocks(self) -> int:
        """Number of scan frames of a scan."""
        return self.assembler.codec.blocks

    @property
    def sequence(self) -> int:
        """Sequence of the scan that was begun last; -1 before the first."""
        return self._tracker.sequence

    @property
    def frames_lost(self) -> int:
        """Frames of the board that did not arrive or could not be used."""
        statistics = self.statistics
        unusable = statistics.malformed + statistics.frozen_counter + self.traffic.malformed
        return statistics.missing_frames + unusable

    @property
    def clock_uncertainty(self) -> float:
        """Possible drift of the clock offset since the last undelayed frame [s]; NaN before the first frame."""
        return self._clock.uncertainty / NANOSECONDS

    @property
    def holding(self) -> bool:
        """Whether frames are held until their sequence is certain."""
        return self._recovery.holding

    @property
    def held_frames(self) -> int:
        """Number of frames that are held until their sequence is certain."""
        return self._recovery.held_frames

    @property
    def resync_requests(self) -> int:
        """Number of times START was sent to a running board, because a classic counter was ambiguous."""
        return self._recovery.resync_requests

    def set_period(self, period: float) -> None:
        """Set the scan period that the board confirmed [ns]."""
        if period != self.scan_period and not self._fd:
            self._clock.reset()  # the sequence is its time
            self._recovery.forget_bound()
        self.scan_period = period

    def resync(self, next_scan: int, count_gap: bool, reset: bool = False) -> bool:
        """Set the sequence of the next scan, from the response to START, and begin to receive scans.

        Parameters
        ----------
        next_scan : int
            Low 32 bits of the sequence of the next scan.
        count_gap : bool
            Whether scans between the last one and the next one count as lost.
        reset : bool, default False
            Whether the board reports a reset.

        Returns
        -------
        bool
            Whether the board was reset since the last scan.
        """
        self.receiving = True
        restarted = self._tracker.resync(next_scan, count_gap, reset)
        self._recovery.set_initial_sequence(self._tracker.sequence)
        if restarted:
            self._clock.reset()
        self._reset = self._reset or restarted or reset
        return restarted

    def resync_needed(self) -> bool:
        """Return whether START has to be sent to a running board, to learn the sequence of its next scan."""
        return not self._fd and self._recovery.resync_needed()

    def note_start_sent(self, tag: int, now: int) -> None:
        """Note that START is being sent with `tag`, at the monotonic time `now` [ns].

        Parameters
        ----------
        tag : int
            Tag of the command.
        now : int
            Monotonic time [ns].
        """
        self._recovery.note_start_sent(tag, now)

    def decode(self, frames: list[Frame], arrival: int, wall_offset: int) -> Iterator[Decoded]:
        """Decode a batch of frames, one step of the iterator at a time.

        Classic blocks may be held until a later batch, or dropped when the sequence of their scans cannot be known
        (`SequenceRecovery`). Of this wall offset and the previous one the smaller is used: a process that is suspended
        between its reads of the two clocks reads too large a value.

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
        Iterator of ScanReady, StatusReceived or ResponseReceived
            What the frames contain. Exhaust it before the next batch; what is not consumed is dropped.
        """
        self.traffic.frames += len(frames)
        self._arrival = arrival
        self._wall_offset = wall_offset if wall_offset < self._last_wall_offset else self._last_wall_offset
        self._last_wall_offset = wall_offset
        if self._fd or self._recovery.begin_batch(arrival, self.scan_period, self.receiving):
            return self._decode(frames)
        base = self._base
        items = [parse_message(frame[0] - base, frame[1], frame[2]) or frame for frame in frames]
        return self._decode(self._recovery.sort_out(items, self.receiving))

    def _decode(self, items: list[Frame] | list[Frame | Message]) -> Iterator[Decoded]:
        base, first, last = self._base, self._first_block, self._last_block
        feed, ready = self._tracker.feed, self._ready
        for item in items:
            if isinstance(item, tuple):
                identifier, kind, data = item
                offset = identifier - base
                if first <= offset <= last and not kind & _NO_BLOCK:
                    if self.receiving and feed(offset, kind, data):
                        self._stamp()
                        yield ready
                    continue
                message = parse_message(offset, kind, data)
                if message is None:
                    self._count(offset, kind)
                    continue
            else:
                message = item
            if isinstance(message, Status):
                self._apply_status(message)
                yield StatusReceived(message)
            else:
                self._apply_response(message)
                yield ResponseReceived(message)

    def _stamp(self) -> None:
        """Complete the scan: sequence, time and status."""
        scan, assembler = self.scan, self.assembler
        sequence = scan.sequence = self._tracker.sequence
        scan.frames_lost = self.frames_lost
        if self._fd:
            board_time = scan.device_time = assembler.device_time
            scan.status = assembler.status
        else:
            scan.status = self._flags
        clock_frozen = assembler.clock_frozen
        if clock_frozen != self._clock_was_frozen:  # from one clock to the other
            self._clock_was_frozen = clock_frozen
            self._clock.reset()
        if not self._fd or clock_frozen:
            board_time = round(sequence * self.scan_period / 1000)
            scan.device_time = 0
            scan.status |= _TIME_ESTIMATED
        scan.stamp = self._clock.to_monotonic(board_time, self._arrival) + self._wall_offset
        if self._reset:
            scan.status |= _BOARD_RESET
            self._reset = False
        self.scans += 1

    def _count(self, offset: int, kind: int) -> None:
        """Count a frame that is no message of the board."""
        if kind & ERROR:
            return  # error frames are counted by the bus
        if offset in {STATUS_OFFSET, RESPONSE_OFFSET} and not kind & EXTENDED:
            self.traffic.malformed += 1
        else:
            self.traffic.unrelated += 1

    def _apply_response(self, response: Response) -> None:
        if response.command == Command.START and response.result == Result.OK and self.receiving:
            ahead = (response.value - self._tracker.sequence) % RESPONSE_WRAP
            if not response.reset and ahead < RESPONSE_WRAP // 2:  # else the sequence restarted: `resync` is due
                self._tracker.align(response.value - 1, RESPONSE_WRAP)

    def _apply_status(self, status: Status) -> None:
        self.status = status
        self._flags = status.flags & ~_BOARD_RESET
        self.scan.temperatures[:] = status.temperatures
        if status.page == Page.LAYOUT:
            self.layout_id = status.value
        elif status.page == Page.FIRMWARE:
            self.firmware = status.value
        elif status.page == Page.SCAN:
            self._tracker.align(status.value, STATUS_WRAP)
