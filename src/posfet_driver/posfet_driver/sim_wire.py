"""The simulated board as a node on a CAN bus, with the faults of its line."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from typing import Final

import can

from posfet_driver.adapter import Node
from posfet_driver.bus import BusSettings, one_line, open_bus
from posfet_driver.codec import CLASSIC_LENGTH, FD_LENGTH
from posfet_driver.firmware import BoardFirmware
from posfet_driver.frames import CLASSIC, FD, Frame, FrameBus
from posfet_driver.messages import CLASSIC_BLOCK_OFFSET, COMMAND_OFFSET, FD_BLOCK_OFFSET, Command, Request
from posfet_driver.sim_faults import Fate, Fates, Resets
from posfet_driver.simulated_board import SimulatedBoard
from posfet_driver.source import Clock, SourceError, SystemClock
from posfet_model.scan import Scan

IDLE: Final = 0.1
"""Longest wait for frames [s]."""

_NANOSECONDS: Final = 1_000_000_000


class WireNode:
    """A board's firmware with the clock, the line and the resets of its imperfections.

    Frames that carry scans are lost, cut short (half the data, which CAN FD and classic CAN can carry), or come twice.
    A reset ends the scans: after its silence a fresh firmware runs, and waits to be started.
    """

    def __init__(self, board: SimulatedBoard, seed: int, now: int) -> None:
        """Switch the board on at `now` [ns], monotonic.

        Raises ConfigError when the layout does not fit the frames.
        """
        self.on_scan: Callable[[Scan], None] | None = None
        """Called with each scan that is sent, before the line has its way with it."""
        self.counters = {fate.name.lower(): 0 for fate in Fate if fate} | {"resets": 0}
        """Frames of scans by what became of them, and resets."""
        self._board = board
        self.switched_on = now
        """Time 0 of the board [ns]: when it was switched on, then when it was first started: no scene runs unseen."""
        self._slow = 1 + board.imperfections.clock_drift
        self._begun = False
        self._fates = Fates(board.imperfections, seed)
        self._frames = 0
        self._resets = Resets(board.imperfections, seed)
        self._alive_since = 0.0
        self._reset_at = self._resets.next_after(0.0)
        self._firmware: BoardFirmware | None = self._switch_on(0.0)

    @property
    def running(self) -> bool:
        """Whether the board sends scans."""
        return self._firmware is not None and self._firmware.running

    def next_due(self) -> int:
        """Return when the next frame is due, or the board resets or comes back [ns].

        Whoever asks is about to wait: what the next scan needs is computed before.
        """
        if self._firmware is None:
            return self._at(self._alive_since)
        if self._firmware.running:
            self._board.prepare(self._board.index + 1)
        due = self.switched_on + math.ceil((self._firmware.next_due() - self.switched_on) * self._slow) + 1
        return min(due, self._at(self._reset_at)) if math.isfinite(self._reset_at) else due

    def due(self, now: int) -> list[Frame]:
        """Return the frames that are due at `now` [ns]."""
        self._live(now)
        if self._firmware is None:
            return []
        return [sent for frame in self._firmware.due(self._own_time(now)) for sent in self._send(frame)]

    def receive(self, frame: Frame, now: int) -> list[Frame]:
        """Take a frame from the bus and return the frames that answer it."""
        self._live(now)
        if self._firmware and not self._begun and self._is_start(frame):
            self._begun, self.switched_on = True, now
            self._firmware.begin(now)
        return [] if self._firmware is None else self._firmware.receive(frame, self._own_time(now))

    def _is_start(self, frame: Frame) -> bool:
        identifier, kind, data = frame
        request = Request.unpack(data) if kind == CLASSIC else None
        to_board = identifier == self._board.sensor.can.base_id + COMMAND_OFFSET
        return to_board and request is not None and request.command == Command.START

    def _live(self, now: int) -> None:
        """Reset when it is time, and come back."""
        time = (now - self.switched_on) / _NANOSECONDS
        if time >= self._reset_at:
            self._alive_since = self._resets.alive_since(time)
            self._reset_at = self._resets.next_after(time)
            self._firmware = None
            self.counters["resets"] += 1
        if self._firmware is None and time >= self._alive_since:
            self._firmware = self._switch_on(self._alive_since)

    def _switch_on(self, time: float) -> BoardFirmware:
        """Return fresh firmware of a board that starts `time` [s] after the first."""
        rate = self._board.sensor.can.scan_rate
        offset = math.ceil(time / self._slow * rate)
        scans = _Later(self._board, offset) if offset else self._board
        start = self.switched_on + round(offset / rate * _NANOSECONDS)
        firmware = BoardFirmware(self._board.sensor, scans, start)
        firmware.on_scan = self._sent
        return firmware

    def _sent(self, scan: Scan) -> None:
        if self.on_scan:
            self.on_scan(scan)

    def _send(self, frame: Frame) -> list[Frame]:
        """Return what of a frame comes out at the far end of the line."""
        identifier, kind, data = frame
        offset = identifier - self._board.sensor.can.base_id
        if offset < (FD_BLOCK_OFFSET if kind & FD else CLASSIC_BLOCK_OFFSET):
            return [frame]
        fate = self._fates.at(self._frames)
        self._frames += 1
        if fate == Fate.WHOLE:
            return [frame]
        self.counters[Fate(fate).name.lower()] += 1
        if fate == Fate.DROPPED:
            return []
        if fate == Fate.TORN:
            return [(identifier, kind, data[: (FD_LENGTH if kind & FD else CLASSIC_LENGTH) // 2])]
        return [frame, frame]

    def _own_time(self, now: int) -> int:
        return self.switched_on + math.floor((now - self.switched_on) / self._slow)

    def _at(self, time: float) -> int:
        return self.switched_on + math.ceil(time * _NANOSECONDS)


class _Later:
    """The scans of a board from one of them on, with number and clock from 0."""

    def __init__(self, board: SimulatedBoard, offset: int) -> None:
        self._board = board
        self._offset = offset

    def scan(self, index: int, out: Scan) -> None:
        """Compute the scan at time index / scan rate since the reset."""
        self._board.scan(index + self._offset, out)
        out.device_time -= round(self._offset / self._board.sensor.can.scan_rate * 1e6)


class BusServer:
    """Puts a node on any python-can bus, in a thread of its own, from `open` to `close`."""

    def __init__(self, settings: BusSettings, node: Node, clock: Clock | None = None) -> None:
        """Take the bus to open, the node, and the clock (that of this machine by default)."""
        self.frames_sent = 0
        """Frames given to the bus."""
        self.frames_dropped = 0
        """Frames that the bus did not take."""
        self._settings = settings
        self._node = node
        self._clock = clock or SystemClock()
        self._bus: FrameBus | None = None
        self._thread: threading.Thread | None = None
        self._ended = threading.Event()
        self.gone = ""
        """Why the bus was given up; '' while it works."""

    def open(self) -> None:
        """Open the bus and serve it. Raises SourceError when it cannot be opened, ConfigError when it never can."""
        try:
            self._bus = open_bus(self._settings)
        except can.CanError as error:
            raise SourceError(one_line(error)) from error
        self._ended.clear()
        self._thread = threading.Thread(target=self._run, args=(self._bus,), name="simulated board", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread and close the bus; may be called twice."""
        if self._thread is None or self._bus is None:
            return
        self._ended.set()
        self._thread.join()
        self._bus.shutdown()
        self._thread = self._bus = None

    def _run(self, bus: FrameBus) -> None:
        while not self._ended.is_set():
            wait = (self._node.next_due() - self._clock.monotonic()) / _NANOSECONDS
            try:
                received = bus.read_frames(min(max(wait, 0.0), IDLE))
            except can.CanError as error:
                self.gone = one_line(error)
                return
            now = self._clock.monotonic()
            due = self._node.due(now)  # a board has sent it when a command comes that it answers
            answers = [answer for frame in received for answer in self._node.receive(frame, now)]
            for frame in due + answers:
                self._write(bus, frame)

    def _write(self, bus: FrameBus, frame: Frame) -> None:
        try:
            bus.write_frame(frame)
            self.frames_sent += 1
        except can.CanError:
            self.frames_dropped += 1
