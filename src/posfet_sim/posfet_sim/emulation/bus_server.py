# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Connects a simulated board to any bus of python-can, in a thread of its own."""

from __future__ import annotations

import threading
from collections import deque
from typing import Final

import can

from posfet_driver.board.scan_source import SourceError
from posfet_driver.bus.bus_error import one_line
from posfet_driver.bus.frame import Frame
from posfet_driver.bus.frame_bus import FrameBus
from posfet_driver.bus.open_bus import BusSettings, open_bus
from posfet_driver.clock import Clock, SystemClock
from posfet_model._lib.units import NANOSECONDS
from posfet_sim.emulation.backlog import first_due
from posfet_sim.emulation.bus_node import Node

IDLE: Final = 0.1
"""Maximum wait for frames [s]."""
REOPEN_PERIOD: Final = 0.1
"""Time between two attempts to open a bus that has failed [s]."""
RETRY_PERIOD: Final = 0.002
"""Time after which a frame that the bus had no room for is offered again [s]."""
MOST_ANSWERS: Final = 16
"""Answers that wait for room at most; older ones are dropped."""


class BusServer:
    """Connects a node to any python-can bus, in a thread of its own, from `open` to `close`.

    A bus that fails is opened again as soon as that is possible. The node goes on meanwhile, as a board does whose
    adapter is disconnected; what it sends is lost. While frames wait for room on the bus, the node's next ones are
    dropped, those of a scan all together; answers wait.

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
        self._waiting: deque[Frame] = deque()
        self._answers: deque[Frame] = deque()  # behind `_waiting`
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
        self.frames_dropped += len(self._waiting) + len(self._answers)
        self._waiting.clear()
        self._answers.clear()
        if bus:
            bus.shutdown()

    def _serve(self, bus: FrameBus) -> None:
        """Send what is due, and answer the frames that arrive until then."""
        wait = (self._node.next_due() - self._clock.monotonic()) / NANOSECONDS
        if self._waiting or self._answers:
            self._clock.sleep(RETRY_PERIOD)
            wait = 0.0
            self._write(bus)
        received = bus.read_frames(min(max(wait, 0.0), IDLE))
        now = self._clock.monotonic()
        due = first_due(self._node, now)  # a board has sent it when a command comes that it answers
        if self._waiting or self._answers:
            self.frames_dropped += len(due)
        else:
            self._waiting.extend(due)
        self._answers.extend(answer for frame in received for answer in self._node.receive(frame, now))
        while len(self._answers) > MOST_ANSWERS:
            self._answers.popleft()
            self.frames_dropped += 1
        self._write(bus)

    def _write(self, bus: FrameBus) -> None:
        """Send what waits, up to the first frame that the bus has no room for."""
        for frames in (self._waiting, self._answers):
            while frames:
                try:
                    if not bus.write_frame(frames[0]):
                        return
                except can.CanError:  # no room, or else reading fails, too
                    return
                frames.popleft()
                self.frames_sent += 1
