"""Connects a simulated board to any bus of python-can, in a thread of its own."""

from __future__ import annotations

import threading
from typing import Final

import can

from posfet_driver.board.scan_source import SourceError
from posfet_driver.bus.bus_error import one_line
from posfet_driver.bus.frame import Frame
from posfet_driver.bus.frame_bus import FrameBus
from posfet_driver.bus.open_bus import BusSettings, open_bus
from posfet_driver.clock import Clock, SystemClock
from posfet_model._lib.units import NANOSECONDS
from posfet_sim.emulation.bus_node import Node

IDLE: Final = 0.1
"""Maximum wait for frames [s]."""
REOPEN_PERIOD: Final = 0.1
"""Time between two attempts to open a bus that has failed [s]."""


class BusServer:
    """Connects a node to any python-can bus, in a thread of its own, from `open` to `close`.

    A bus that fails is opened again as soon as that is possible. The node goes on meanwhile, as a board does whose
    adapter is disconnected; what it sends is lost.

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
        """Frames that the bus did not accept, or that were due without a bus."""
        self._settings = settings
        self._node = node
        self._clock = clock or SystemClock()
        self._bus: FrameBus | None = None
        self._thread: threading.Thread | None = None
        self._stop = threading.Event()
        self.disconnected = ""
        """Why the bus is not open now; '' while it is."""
        self.failure = ""
        """Error that the node or this thread has ended on, in one line; '' while it runs."""

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
        self.disconnected = self.failure = ""
        self._stop.clear()
        self._thread = threading.Thread(target=self._run, name="simulated board", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop the thread and close the bus; may be called twice."""
        if self._thread is None:
            return
        self._stop.set()
        self._thread.join()
        self._close_bus()
        self._thread = None

    def _run(self) -> None:
        try:
            while not self._stop.is_set():
                try:
                    self._serve(self._bus or self._reopen())
                except can.CanError as error:
                    self.disconnected = one_line(error)
                    self._close_bus()
                    self._clock.sleep(REOPEN_PERIOD)
                    self.frames_dropped += len(self._node.due(self._clock.monotonic()))
        except Exception as error:
            self.failure = f"{type(error).__name__}: {one_line(error)}"

    def _reopen(self) -> FrameBus:
        self._bus = open_bus(self._settings)
        self.disconnected = ""
        return self._bus

    def _close_bus(self) -> None:
        bus, self._bus = self._bus, None
        if bus:
            bus.shutdown()

    def _serve(self, bus: FrameBus) -> None:
        """Send what is due, and answer the frames that arrive until then."""
        wait = (self._node.next_due() - self._clock.monotonic()) / NANOSECONDS
        received = bus.read_frames(min(max(wait, 0.0), IDLE))
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
