# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The board's side of the protocol: which frames it sends and when, and its responses. Knows no transport."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final, Protocol

from posfet_driver.bus.frame import CLASSIC, Frame
from posfet_driver.protocol.messages import (
    BOARD_FLAGS,
    BOOT_COUNTER,
    COMMAND_OFFSET,
    IDENTITY_OFFSET,
    IDENTITY_PERIOD,
    LONGEST_PERIOD,
    PROTOCOL_VERSION,
    RESPONSE_OFFSET,
    STATUS_OFFSET,
    STATUS_PERIOD,
    Command,
    Identification,
    Identity,
    Request,
    Response,
    Result,
    Status,
)
from posfet_driver.protocol.scan_codec import HEADER_SCANS, SEQUENCE, make_codec
from posfet_model._lib.units import NANOSECONDS
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import Scan, ScanStatus
from posfet_sim.emulation.backlog import LATE, LONGEST_BACKLOG, STOPPED

FIRMWARE_VERSION: Final = (1, 0)
"""Version of the simulated firmware: major, minor."""
SUPPLY: Final = 5.0
"""Supply voltage of the simulated board [V]; assumed."""
SUPPLY_LIMIT: Final = 4.5
"""Supply voltage below which the board sets SUPPLY_LOW [V]; assumed."""
MICROSECOND: Final = 1000
"""[ns]"""
_STATUS_PER_IDENTITY: Final = round(IDENTITY_PERIOD / STATUS_PERIOD)
_STATUS_INTERVAL: Final = round(STATUS_PERIOD * NANOSECONDS)
_LATE: Final = round(LATE * NANOSECONDS)
_LONGEST_BACKLOG: Final = round(LONGEST_BACKLOG * NANOSECONDS)
_STOPPED: Final = round(STOPPED * NANOSECONDS)


def with_whole_period(sensor: Sensor) -> Sensor:
    """Return the sensor with a scan rate that a board can keep and state: its scan timer counts microseconds.

    Parameters
    ----------
    sensor : Sensor
        Sensor description.

    Returns
    -------
    Sensor
        With the rate of the nearest whole scan period.
    """
    return replace(sensor, can=replace(sensor.can, scan_rate=1e6 / round(1e6 / sensor.can.scan_rate)))


class ScanMaker(Protocol):
    """Source of the scans, such as a `SimulatedBoard`."""

    def scan(self, index: int, out: Scan) -> None:
        """Compute the scan of one tick; indices ascend, gaps are allowed. The board sets its sequence and device time.

        Parameters
        ----------
        index : int
            Index of the tick, at index times the shortest scan period.
        out : Scan
            Scan to fill in.
        """
        ...


class BoardFirmware:
    """Firmware of a board, running from its construction on.

    It sends status and identity at once, and scans after the start command. Its scan period is a whole number of
    microseconds, the nearest to that of the sensor file. The sequence of a scan equals its index in `board` as long as
    the rate is the nominal one.

    Parameters
    ----------
    sensor : Sensor
        Sensor description.
    board : ScanMaker
        Source of the scans.
    now : int
        Monotonic time [ns].
    boot : int, default 0
        Number of the power-on.
    charge_reset : bool, default False
        Whether the charge at the gates does not continue that before the power-on.

    Raises
    ------
    ConfigError
        The layout does not fit the frames.
    """

    def __init__(self, sensor: Sensor, board: ScanMaker, now: int, boot: int = 0, charge_reset: bool = False) -> None:
        self.on_scan: Callable[[Scan], None] | None = None
        """Called with each scan that is sent."""
        self.running = False
        """Whether the board sends scans."""
        self.missed = 0
        """Ticks of the scan timer without a scan, since the emulation was late."""
        self.supply = SUPPLY
        """Supply voltage of the board [V]."""
        self.version = FIRMWARE_VERSION
        """Firmware version that the board reports: major, minor."""
        self.protocol = PROTOCOL_VERSION
        """Version of the protocol that the board reports."""
        self.layout_id = sensor.layout.id
        """Layout id that the board reports."""
        self.boot = boot & BOOT_COUNTER
        """Number of the power-on, modulo 16."""
        self._board = board
        self._charge_reset = charge_reset
        self._codec = make_codec(sensor)
        self._base = sensor.can.base_id
        self._shortest_period = round(1e6 / sensor.can.scan_rate)  # [us]
        self._scan = Scan.empty(sensor.layout.id, sensor.layout.taxels)
        self.switched_on = now
        """Time 0 of the board [ns]."""
        self._status_sent = 0
        self._heartbeat = 0
        self._step = 1  # scan indices from one tick of the scan timer to the next
        self._position = 0  # index of the next tick
        self._sequence = 0  # of the next tick
        self._header_due = True
        self._late_scan = self._late_status = False  # whether the next one states an overrun

    @property
    def blocks(self) -> int:
        """Number of blocks of a scan."""
        return self._codec.blocks

    @property
    def next_index(self) -> int:
        """Index of the next tick."""
        return self._position

    def next_due(self) -> int:
        """Return when the next frame is due [ns]."""
        return min(self._status_due(), self._tick()) if self.running else self._status_due()

    def due(self, now: int, until: int | None = None) -> list[Frame]:
        """Return the frames that are due at `now` [ns], in the order in which they are sent.

        Scans in FD frames that are later than LONGEST_BACKLOG are missed, but for the newest of them. Of those in
        classic frames, which after a gap only a header numbers that is not late, all but the newest are missed then, as
        after a stop. So are status frames, of which one that is due waits for no late scan then.

        Parameters
        ----------
        now : int
            Monotonic time [ns].
        until : int, optional
            Time before `now` [ns]: what is due later is not returned yet, unless what is due by then was missed.

        Returns
        -------
        list of Frame
            Frames of whole scans, and others.
        """
        if now - self._status_due() > _LONGEST_BACKLOG:
            self._skip_status(now)
        late = now - self._tick()
        frames: list[Frame] = []
        if self.running and late > _LONGEST_BACKLOG:
            self._miss(now - _LONGEST_BACKLOG if self._codec.fd and late <= _STOPPED else now)
            if self._status_due() <= now:
                self._skip_status(now)
                frames += self._periodic_frames()
        end = now if until is None else max(until, min(self.next_due(), now))
        while self.next_due() <= end:
            if self.running and self._tick() == self.next_due():
                frames += self._scan_frames(now)
            else:
                frames += self._periodic_frames()
        return frames

    def receive(self, frame: Frame, now: int) -> list[Frame]:
        """Process a frame from the bus at `now` [ns] and return the frames that answer it."""
        identifier, kind, data = frame
        request = Request.unpack(data) if identifier == self._base + COMMAND_OFFSET and kind == CLASSIC else None
        if request is None:
            return []
        result, value = self._execute(request, now)
        response = Response(request.command, request.tag, result, value, self.boot)
        frames = [(self._base + RESPONSE_OFFSET, CLASSIC, response.pack())]
        if result == Result.OK and request.command in {Command.IDENTIFY, Command.SET_RATE}:
            frames.append(self._identity_frame())
        return frames

    def _execute(self, request: Request, now: int) -> tuple[Result, int]:
        self._pass_ticks(now)
        if request.argument and request.command != Command.SET_RATE and request.command in Command.__members__.values():
            return Result.BAD_ARGUMENT, 0
        match request.command:
            case Command.START:
                self._header_due |= not self.running
                self.running = True
                answer = Result.OK, self._sequence & SEQUENCE
            case Command.STOP:
                self.running = False
                answer = Result.OK, self._sequence & SEQUENCE
            case Command.SET_RATE:
                answer = self._set_period(request.argument, now)
            case Command.IDENTIFY:
                answer = Result.OK, self._identification().pack()
            case Command.SELF_TEST:
                flags = self._flags()
                answer = (Result.FAILED if flags else Result.OK), flags
            case _:
                answer = Result.UNKNOWN_COMMAND, 0
        return answer

    def _pass_ticks(self, now: int) -> None:
        """Count the ticks up to `now` [ns] at which no scan was sent."""
        if not self.running and self._tick() < now:
            index = (now - self.switched_on) // (self._shortest_period * MICROSECOND)
            ticks = max((index - self._position) // self._step, 0)
            self._position += ticks * self._step
            self._sequence += ticks
            while self._tick() < now:
                self._position += self._step
                self._sequence += 1

    def _set_period(self, period: int, now: int) -> tuple[Result, int]:
        step, rest = divmod(period, self._shortest_period)
        if rest or not self._shortest_period <= period <= LONGEST_PERIOD:
            return Result.BAD_ARGUMENT, 0
        if step != self._step and self._sequence:
            if self.running:
                self._miss(now)
            overdue = -((self.switched_on - now) // (self._shortest_period * MICROSECOND))
            self._position = max(self._position - self._step + step, overdue)
        self._header_due |= step != self._step
        self._step = step
        return Result.OK, period

    def _status_due(self) -> int:
        """Return the time of the next status [ns]."""
        return self.switched_on + self._status_sent * _STATUS_INTERVAL

    def _skip_status(self, now: int) -> None:
        """Miss the status frames that are due by `now` [ns], but for the newest of them."""
        self._status_sent = (now - self.switched_on) // _STATUS_INTERVAL

    def _tick(self) -> int:
        """Return the time of the next tick of the scan timer [ns]."""
        return self.switched_on + self._position * self._shortest_period * MICROSECOND

    def _miss(self, until: int) -> None:
        """Miss the scans that are due by `until` [ns], but for the newest of them."""
        ticks = (until - self._tick()) // (self._step * self._shortest_period * MICROSECOND)
        if ticks > 0:
            self._position += ticks * self._step
            self._sequence += ticks
            self.missed += ticks
            self._late_scan = self._late_status = self._header_due = True

    def _scan_frames(self, now: int) -> list[Frame]:
        scan = self._scan
        if now - self._tick() > _LATE:
            self._late_scan = self._late_status = True
        self._board.scan(self._position, scan)
        scan.sequence = self._sequence
        scan.device_time = self._position * self._shortest_period
        header = self._header_due or self._sequence % HEADER_SCANS == 0
        self._header_due = False
        self._position += self._step
        self._sequence += 1
        own_status = scan.status
        if self._late_scan:
            scan.status |= ScanStatus.SCAN_OVERRUN
            self._late_scan = False
        if self.on_scan:
            self.on_scan(scan)
        frames = self._codec.encode(scan, self._base, self.boot, header)
        scan.status = own_status  # the self test finds no overrun
        return frames

    def _periodic_frames(self) -> list[Frame]:
        first, second = (float(temperature) for temperature in self._scan.temperatures)
        flags = self._flags() | ScanStatus.SCAN_OVERRUN * self._late_status
        self._late_status = False
        counters = self.boot, self._heartbeat
        status = Status((first, second), self.supply, flags, self.running, *counters, self._charge_reset)
        frames = [(self._base + STATUS_OFFSET, CLASSIC, status.pack())]
        if self._status_sent % _STATUS_PER_IDENTITY == 0:
            frames.append(self._identity_frame())
        self._status_sent += 1
        self._heartbeat = (self._heartbeat + 1) & 0xF
        return frames

    def _identification(self) -> Identification:
        return Identification(self.layout_id, self.protocol, self._codec.fd, self.version[0])

    def _identity_frame(self) -> Frame:
        identity = Identity(self._identification(), self.version[1], self._step * self._shortest_period)
        return self._base + IDENTITY_OFFSET, CLASSIC, identity.pack()

    def _flags(self) -> int:
        """Return the flags of the board."""
        flags = int(self._scan.status) & BOARD_FLAGS
        return flags | ScanStatus.SUPPLY_LOW if self.supply < SUPPLY_LIMIT else flags
