# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Checks adapter and board step by step: `posfet can selftest`."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from typing import Final

import can
from rich.console import Console
from rich.table import Table
from rich.text import Text

from posfet_driver.board.board_client import Board
from posfet_driver.board.command_queue import CommandError
from posfet_driver.board.fault_monitor import FaultMonitor
from posfet_driver.board.faults import FaultKind
from posfet_driver.board.listening_board import ListeningBoard
from posfet_driver.bus.open_bus import BusSettings
from posfet_driver.bus.port_search import BusOpener
from posfet_driver.clock import Clock
from posfet_driver.protocol.identifiers import board_frames
from posfet_driver.protocol.messages import Command, Identification
from posfet_driver.tools.bus_options import bus_of
from posfet_driver.tools.one_shot import described
from posfet_model.sensor.description import Sensor

FIRST_SCAN: Final = 3.0
"""Time within which the first scan has to arrive [s], besides two scan periods."""
LEAST_SCANS: Final = 2
"""Least number of scans by which the rate is measured, at low scan rates for longer than was asked for."""
SILENCE: Final = 0.3
"""Time without a scan at the end of that after which they have stopped [s], besides one and a half scan periods."""
RATE_TOLERANCE: Final = 0.05
"""Greatest relative difference of the measured rate from the nominal one [1]."""
POLL: Final = 0.1
"""Longest wait for a scan [s]."""


class CheckFailed(Exception):
    """A check failed; the message is one line with the reason."""


class SelfTest:
    """The checks of one board, in order. Each returns its finding or raises CheckFailed, CommandError or CanError.

    Parameters
    ----------
    sensor : Sensor
        The array and its frames.
    settings : BusSettings
        The bus.
    seconds : float
        Duration for which scans are checked [s].
    clock : Clock
        Clock of the host.
    """

    def __init__(self, sensor: Sensor, settings: BusSettings, seconds: float, clock: Clock) -> None:
        self._sensor = sensor
        self._opener = BusOpener(settings, board_frames(sensor))
        kind = ListeningBoard if sensor.mapping else Board
        self._board: Board | ListeningBoard = kind(sensor, self._opener, clock)
        self._clock = clock
        self._seconds = seconds

    def checks(self) -> list[tuple[str, Callable[[], str]]]:
        """Return names and checks."""
        begin = [("adapter opens", self._open), ("board sends scans", self._first_scan)]
        scans = ("scans are complete and in time", self._scans)
        faults = ("no fault is present", self._faults)
        if self._sensor.mapping:  # such a board gets no commands
            return [*begin, scans, faults]
        return [
            *begin,
            ("board identifies itself", self._identify),
            ("board's self-test", self._self_test),
            scans,
            ("a command is refused with a reason", self._refuse),
            ("board stops and starts", self._stop_and_start),
            faults,
        ]

    def _time(self) -> float:
        """Return the time [s]."""
        return self._clock.monotonic() / 1e9

    def close(self) -> None:
        """Stop the board and close the bus."""
        self._board.close()

    def _open(self) -> str:
        self._board.open()
        if self._board.report().conditions == (FaultKind.ADAPTER_DISCONNECTED,):
            raise CheckFailed(self._board.report().state)
        return self._opener.channel or self._opener.settings.name

    def _first_scan(self) -> str:
        begin = self._time()
        while self._board.read(POLL) is None:
            if self._time() - begin > FIRST_SCAN + 2 / self._sensor.can.scan_rate:
                raise CheckFailed(self._board.report().state)
        return f"the first after {1e3 * (self._time() - begin):.0f} ms"

    def _identify(self) -> str:
        return described(Identification.unpack(self._board.request(Command.IDENTIFY).value))

    def _self_test(self) -> str:
        """Have the board test itself; stopped, since it need not be able to while it scans."""
        self._board.request(Command.STOP)
        try:
            self._board.request(Command.SELF_TEST)
        finally:
            self._board.request(Command.START)
        return "no fault found"

    def _scans(self) -> str:
        board = self._board
        self._first_scan()
        begin = newest = self._time()  # a scan arrived now
        scans, lost = board.decoder.scans, board.decoder.frames_lost
        end = begin + max(self._seconds, (LEAST_SCANS + 0.5) / self._sensor.can.scan_rate)
        while self._time() < end:
            if board.read(POLL) is not None:
                newest = self._time()
        scans, silent = board.decoder.scans - scans, end - newest
        rate = scans / (newest - begin) if newest > begin else 0.0
        lost = board.decoder.frames_lost - lost
        late = 1e3 * board.stamp_uncertainty
        stamps = "stamps estimated from arrivals" if math.isnan(late) else f"stamps at most {late:.2f} ms late"
        text = f"{rate:.1f} scans/s, {lost} frames lost, {stamps}"
        if silent > SILENCE + 1.5 / self._sensor.can.scan_rate:
            raise CheckFailed(f"{text}; no scan in the last {silent:.1f} s")
        if lost or scans < LEAST_SCANS or abs(rate / self._sensor.can.scan_rate - 1) > RATE_TOLERANCE:
            raise CheckFailed(f"{text}; {self._sensor.can.scan_rate:g} scans/s are expected")
        return text

    def _refuse(self) -> str:
        try:
            self._board.request(Command.SET_RATE, 1)
        except CommandError as error:
            return str(error)
        raise CheckFailed("a scan period of 1 us was accepted")

    def _stop_and_start(self) -> str:
        self._board.request(Command.STOP)
        if self._board.read(2 * POLL) is not None:
            raise CheckFailed("scans arrive after STOP")
        self._board.request(Command.START)
        return self._first_scan()

    def _faults(self) -> str:
        faults = FaultMonitor().present(self._board.report(), self._clock.monotonic())
        if faults:
            raise CheckFailed("; ".join(fault.text for fault in faults))
        return "none"


def run_selftest(options: argparse.Namespace) -> int:
    """Run `posfet can selftest`; return the exit code: 0 when all checks passed."""
    table = Table("check", "result", "finding")
    with bus_of(options) as (sensor, settings):
        test = SelfTest(sensor, settings, options.seconds, options.clock)
        passed = False
        try:
            for name, check in test.checks():
                passed, finding = _try(check)
                table.add_row(name, Text("ok", "green") if passed else Text("failed", "red"), finding)
                if not passed:
                    break
        finally:
            test.close()
    Console(highlight=False, markup=False).print(table)
    return 0 if passed else 1


def _try(check: Callable[[], str]) -> tuple[bool, str]:
    try:
        return True, check()
    except (CheckFailed, CommandError, can.CanError) as error:
        return False, str(error)
