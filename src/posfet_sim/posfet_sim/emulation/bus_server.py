"""Connects a simulated board to any bus of python-can, in a thread of its own."""

from __future__ import annotations

import threading
from typing import Final

import can

from posfet_driver.board.scan_source import SourceError
from posfet_driver.bus.frame import Frame
from posfet_driver.bus.frame_bus import FrameBus
from posfet_driver.bus.open_bus import BusSettings, one_line, open_bus
from posfet_driver.clock import Clock, SystemClock
from posfet_model._lib.units import NANOSECONDS
from posfet_sim.emulation.bus_node import Node

IDLE: Final = 0.1
"""Maximum wait for frames [s]."""


class BusServer:
    """Connects a node to any python-can bus, in a thread of its own, from `open` to `close`.

    Parameters
    ----------
    settings : BusSettings
        Bus to open.
    node : Node
        Node to connect.
    clock : Clock, optional
        Default: the clock of this machine.
    """

    def __init__(self, settings: BusSettings, node: Node, clock: Clock | None = None) -> None:
        self.frames_sent = 0
        """Frames sent to the bus."""
        self.frames_dropped = 0
        """Frames that the bus did not accept."""
        self._settings = settings
        self._node = node
        self._clock = clock or SystemClock()
        self._bus: FrameBus | None = None
        self._thread: threading.Thread | None = None
        self._stop = threading.Event()
        self.failure = ""
        """Why the bus is no longer served; '' while it works."""

    def open(self) -> None:
        """Open the bus and serve it.

        Raises
        ------
        SourceError
            The bus cannot be opened now.
        ConfigError
            The settings are invalid.
        """
        try:
            self._bus = open_bus(self._settings)
        except can.CanError as error:
            raise SourceError(one_line(error)) from error
        self._stop.clear()
        self._thread = threading.Thread(target=self._run, args=(self._bus,), name="simulated board", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop the thread and close the bus; may be called twice."""
        if self._thread is None or self._bus is None:
            return
        self._stop.set()
        self._thread.join()
        self._bus.shutdown()
        self._thread = self._bus = None

    def _run(self, bus: FrameBus) -> None:
        while not self._stop.is_set():
            wait = (self._node.next_due() - self._clock.monotonic()) / NANOSECONDS
            try:
                received = bus.read_frames(min(max(wait, 0.0), IDLE))
            except can.CanError as error:
                self.failure = one_line(error)
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
