"""The board's side of the protocol: which frames it sends and when, and its responses. Knows no transport."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, Protocol

from posfet_driver.bus.frame import CLASSIC, Frame
from posfet_driver.protocol.messages import (
    COMMAND_OFFSET,
    RESPONSE_OFFSET,
    STATUS_OFFSET,
    STATUS_PERIOD,
    Command,
    Page,
    Request,
    Response,
    Result,
    Status,
)
from posfet_driver.protocol.scan_codec import make_codec
from posfet_model._lib.units import NANOSECONDS
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import Scan, ScanStatus

FIRMWARE_VERSION: Final = 0x0001
"""Version of the simulated firmware: major in the high byte, minor in the low."""
SUPPLY: Final = 5.0
"""Supply voltage of the simulated board [V]; assumed."""
SUPPLY_LIMIT: Final = 4.5
"""Supply voltage below which the board sets SUPPLY_LOW [V]; assumed."""
LONGEST_PERIOD: Final = 10_000_000
"""Maximum scan period that a board accepts [us]."""


class ScanMaker(Protocol):
    """Source of the scans, such as a `SimulatedBoard`."""

    def scan(self, index: int, out: Scan) -> None:
        """Compute the scan at time index / scan rate; indices ascend, gaps are allowed.

        Parameters
        ----------
        index : int
            Index of the scan.
        out : Scan
            Scan to fill in.
        """
        ...


class BoardFirmware:
    """Firmware of a board, running from its construction on.

    It sends status frames at once, and scans after the start command. The sequence of a scan equals its index in
    `board` as long as the rate is the nominal one.

    Parameters
    ----------
    sensor : Sensor
        Sensor description.
    board : ScanMaker
        Source of the scans.
    now : int
        Monotonic time [ns].

    Raises
    ------
    ConfigError
        The layout does not fit the frames.
    """

    def __init__(self, sensor: Sensor, board: ScanMaker, now: int) -> None:
        self.on_scan: Callable[[Scan], None] | None = None
        """Called with each scan that is sent."""
        self.running = False
        """Whether the board sends scans."""
        self.supply = SUPPLY
        """Supply voltage of the board [V]."""
        self.firmware = FIRMWARE_VERSION
        """Firmware version that the board reports."""
        self.layout_id = sensor.layout.id
        """Layout id that the board reports."""
        self._fresh = True  # not started since it was switched on
        self._board = board
        self._codec = make_codec(sensor)
        self._base = sensor.can.base_id
        self._rate = sensor.can.scan_rate
        self._shortest_period = round(1e6 / self._rate)
        self._scan = Scan.empty(sensor.layout.id, sensor.layout.taxels)
        self.switched_on = now
        """Time 0 of the board [ns]."""
        self._status_sent = 0
        self._step = 1.0  # scan indices from one scan to the next
        self._position = 0.0  # index of the next scan, before rounding
        self._sequence = 0  # of the next scan
        self._first = True

    @property
    def blocks(self) -> int:
        """Number of frames of a scan."""
        return self._codec.blocks

    def next_due(self) -> int:
        """Return when the next frame is due [ns]."""
        status = self.switched_on + round(self._status_sent * STATUS_PERIOD * NANOSECONDS)
        return min(status, self._scan_due()) if self.running else status

    def due(self, now: int) -> list[Frame]:
        """Return the frames that are due at `now` [ns], in the order in which they are sent."""
        frames: list[Frame] = []
        while self.next_due() <= now:
            if self.running and self._scan_due() == self.next_due():
                frames += self._scan_frames()
            else:
                frames.append(self._status_frame())
        return frames

    def receive(self, frame: Frame, now: int) -> list[Frame]:
        """Process a frame from the bus at `now` [ns] and return the frames that answer it."""
        identifier, kind, data = frame
        if identifier != self._base + COMMAND_OFFSET or kind != CLASSIC:
            return []
        request = Request.unpack(data)
        if request is None:
            return []
        fresh = self._fresh
        result, value = self._execute(request, now)
        answer = Response(request.command, request.tag, result, value, fresh)
        return [(self._base + RESPONSE_OFFSET, CLASSIC, answer.pack())]

    def begin(self, now: int) -> None:
        """Set the time at which the board was switched on to `now` [ns]."""
        self.switched_on, self._status_sent = now, 0

    def _execute(self, request: Request, now: int) -> tuple[Result, int]:
        match request.command:
            case Command.START:
                answer = self._start(now)
            case Command.STOP:
                self.running = False
                answer = Result.OK, self._sequence & 0xFFFF_FFFF
            case Command.SET_RATE:
                answer = self._set_period(request.argument)
            case Command.IDENTIFY:
                answer = Result.OK, self.layout_id | self.firmware << 16
            case Command.SELF_TEST:
                flags = self._flags() & ~ScanStatus.BOARD_RESET
                answer = (Result.FAILED if flags else Result.OK), int(flags)
            case _:
                answer = Result.UNKNOWN_COMMAND, 0
        return answer

    def _start(self, now: int) -> tuple[Result, int]:
        if not self.running:
            index = math.ceil((now - self.switched_on) / NANOSECONDS * self._rate)
            self._position = float(max(index, math.ceil(self._position)))
            self._sequence = max(self._sequence, int(self._position))
            self.running = True
            self._fresh = False
        return Result.OK, self._sequence & 0xFFFF_FFFF

    def _set_period(self, period: int) -> tuple[Result, int]:
        if not self._shortest_period <= period <= LONGEST_PERIOD:
            return Result.BAD_ARGUMENT, 0
        self._step = period * 1e-6 * self._rate
        return Result.OK, period

    def _scan_due(self) -> int:
        return self.switched_on + round(round(self._position) / self._rate * NANOSECONDS)

    def _scan_frames(self) -> list[Frame]:
        scan = self._scan
        self._board.scan(round(self._position), scan)
        scan.sequence = self._sequence
        if self._first:
            scan.status |= ScanStatus.BOARD_RESET
            self._first = False
        self._position += self._step
        self._sequence += 1
        if self.on_scan:
            self.on_scan(scan)
        return self._codec.encode(scan, self._base)

    def _status_frame(self) -> Frame:
        page = Page(self._status_sent % len(Page))
        values = {Page.LAYOUT: self.layout_id, Page.FIRMWARE: self.firmware, Page.SCAN: (self._sequence - 1) & 0xFFFF}
        first, second = (float(temperature) for temperature in self._scan.temperatures)
        status = Status((first, second), self.supply, self._flags(), page, values[page])
        self._status_sent += 1
        return self._base + STATUS_OFFSET, CLASSIC, status.pack()

    def _flags(self) -> int:
        """Return the flags of a status frame."""
        flags = int(self._scan.status) & ~(ScanStatus.BOARD_RESET | ScanStatus.TIME_ESTIMATED)
        if self.supply < SUPPLY_LIMIT:
            flags |= ScanStatus.SUPPLY_LOW
        return flags | ScanStatus.BOARD_RESET if self._fresh else flags
