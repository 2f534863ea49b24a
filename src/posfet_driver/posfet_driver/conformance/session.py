# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A board under test: found, let scan, left in peace, and switched off and on."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace

from posfet_driver.bus.frame_bus import FrameBus
from posfet_driver.clock import Clock
from posfet_driver.conformance.commander import Commander
from posfet_driver.conformance.records import (
    JITTER,
    PATIENCE,
    SECOND,
    SILENCE,
    Board,
    NoBoardError,
    NotCheckedError,
    PowerOn,
    Run,
    Window,
)
from posfet_driver.conformance.seen_scans import SeenScan


class Session(Commander):
    """A board under test, with the runs, windows and the power cycle that the rules are judged by.

    Parameters
    ----------
    bus : FrameBus
        The open bus.
    clock : Clock
        Clock of the host.
    board : Board
        What is known about the board.
    numbers : random.Random
        Source of all that is free: tags, periods, arguments, order.
    """

    def __init__(self, bus: FrameBus, clock: Clock, board: Board, numbers: random.Random) -> None:
        super().__init__(bus, clock, board, numbers)
        self.runs: list[Run] = []
        self.windows: list[Window] = []
        self.power_on: PowerOn | None = None

    def listen_to_scans(self, count: int) -> None:
        """Keep the frames of `count` scan periods.

        Parameters
        ----------
        count : int
            Number of scans.
        """
        self.listen(count * self.period * 1e-6)

    @contextmanager
    def scanning(self, owner: str = "") -> Iterator[Run]:
        """Let the board scan within a block.

        Parameters
        ----------
        owner : str, optional
            Rule that is tried out in this run.

        Yields
        ------
        Run
            The run.
        """
        run = Run(self.must("START"), owner)
        self.runs.append(run)
        try:
            yield run
        finally:
            self.listen(JITTER)  # frames that were on their way
            run.end = len(self.frames)
        run.stop = self.must("STOP")
        self.listen_to_scans(3)
        self.listen(JITTER)
        run.end = len(self.frames)

    @contextmanager
    def window(self, scanning: bool) -> Iterator[None]:
        """Note the duration of a block, in which no command is sent.

        Parameters
        ----------
        scanning : bool
            Whether the board scans.

        Yields
        ------
        None
            Nothing.
        """
        self.listen(JITTER)  # to what follows the latest response
        begin, first = self.clock.monotonic(), len(self.frames)
        yield
        self.windows.append(Window(scanning, begin, self.clock.monotonic(), first, len(self.frames)))

    def run_scans(self, run: Run) -> list[SeenScan]:
        """Return the scans of a run.

        Parameters
        ----------
        run : Run
            The run.
        """
        return self.scans(run.start.before, run.end)

    @staticmethod
    def owned_by_none(run: Run) -> bool:
        """Return whether nothing was tried out in a run.

        Parameters
        ----------
        run : Run
            The run.
        """
        return not run.owner and run.stop is not None

    def find(self) -> None:
        """Find the board and stop it; its own identity says which frames it sends.

        Raises
        ------
        NoBoardError
            When no status or no identity arrives.
        """
        self.expect("Status")
        begin = len(self.frames)
        try:
            self.ask("STOP")
            self.must("IDENTIFY")
            self.expect("Identity", begin)
            identity = self.named("Identity", begin)[-1].values
            self.board = replace(self.board, fd=bool(identity["Format"]))
            self.period = identity["ScanPeriod"]
            if self.ask("SET_RATE", self.board.period).result:
                self.board = replace(self.board, period=self.period)
        except NotCheckedError as error:
            raise NoBoardError(f"the board cannot be tested: {error}") from error

    def switch_off_and_on(self, request: Callable[[], None]) -> None:
        """Have the board switched off and on, listen to it, then to its first scans.

        Parameters
        ----------
        request : callable
            Asks for it, or does it.

        Raises
        ------
        NoBoardError
            When it was not switched off and on.
        """
        self.expect("Status")
        boot = self.named("Status")[-1].values["Boot"]
        request()
        first = self._first_after_power_on(boot)
        self.power_on = PowerOn(boot, first)
        self.listen(1.3)
        identity = self.named("Identity", first)
        self.period = identity[-1].values["ScanPeriod"] if identity else self.board.period
        with self.scanning("power-on") as self.power_on.run:
            self.listen_to_scans(8)

    def _first_after_power_on(self, boot: int) -> int:
        """Return the index of the first frame after a reset: after a silence, or with another boot than before it."""
        begin = heard = self.clock.monotonic()
        while self.clock.monotonic() < begin + PATIENCE * SECOND:
            count = len(self.frames)
            self.read(SILENCE / 5)
            received = self.frames[count:]
            if received and received[0].time > heard + SILENCE * SECOND:
                return count
            heard = received[-1].time if received else heard
            if any(frame.name == "Status" and frame.values["Boot"] != boot for frame in received):
                return max(frame.index for frame in self.frames if frame.boot == boot) + 1
        raise NoBoardError(f"the board was not switched off and on within {PATIENCE:g} s")
