# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The scans of a board on a CAN bus, opened by an address such as ``slcan:/dev/ttyACM0``; needs python-can."""

from __future__ import annotations

import tempfile
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Final

from posfet.sessions.feeds import Delivered, ground_truth
from posfet.sessions.frames import GroundTruth
from posfet_driver.board.board_client import Board
from posfet_driver.board.listening_board import ListeningBoard
from posfet_driver.board.scan_source import SourceError
from posfet_driver.bus.open_bus import BusSettings, bus_settings, interfaces
from posfet_driver.bus.port_search import BusOpener
from posfet_driver.protocol.identifiers import board_frames
from posfet_model.config import ConfigError
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import Scan
from posfet_sim.device.error_model import ErrorModel
from posfet_sim.emulation.bus_peer import SimulatedBusPeer
from posfet_sim.scene import DEFAULT_SCENE, load_scene

EMULATOR: Final = "emulator"
"""Interface of a simulated board behind an emulated slcan adapter; its channel is the scene."""
READ_TIMEOUT: Final = 0.1
"""Longest wait at once [s]: bounds the time until Ctrl-C is noticed."""
KEPT_TRUTHS: Final = 4096
"""Scans of an emulated board whose ground truth is kept until they are read."""


class BoardFeed:
    """The scans of a board on a bus, in real time.

    The board is looked for, started and, after every fault, started again by the driver while scans are read.

    Parameters
    ----------
    sensor : Sensor
        Sensor description.
    settings : BusSettings
        The bus.
    timeout : float
        Longest time without a scan [s].
    truth_of : callable, optional
        Returns the ground truth of a scan by its sequence; default: there is none.
    """

    endless = True

    def __init__(
        self,
        sensor: Sensor,
        settings: BusSettings,
        timeout: float,
        truth_of: Callable[[int], GroundTruth | None] | None = None,
    ) -> None:
        link = replace(sensor.can, bitrate=settings.bitrate, data_bitrate=settings.data_bitrate)
        self.sensor = replace(sensor, can=link)
        self.simulated = truth_of is not None
        self.name = settings.name
        opener = BusOpener(settings, board_frames(sensor))
        kind = ListeningBoard if sensor.mapping else Board
        self.board = kind(self.sensor, opener, presence=opener.presence)
        """The connection of the board."""
        self._timeout = timeout
        self._truth_of = truth_of or (lambda _: None)
        self._first: Scan | None = None
        self._cleanup = ExitStack()

    def open(self) -> None:
        """Open the bus and wait for the first scan. Raises SourceError, one line, when none arrives in time."""
        self._cleanup.callback(self.board.close)
        try:
            self.board.open()
            self._first = self._next().snapshot()
        except BaseException:
            self.close()
            raise

    def close_with(self, close: Callable[[], object]) -> None:
        """Call a function after the board is closed."""
        self._cleanup.callback(close)

    def scans(self) -> Iterator[Delivered]:
        """Iterate over the scans. Raises SourceError when none arrives in time; iterate again to go on waiting."""
        return iter(self._read, None)

    def report(self) -> str:
        """Return the state in one line."""
        report = self.board.report()
        return f"{self.name}: {report.state}; {report.scans} scans, {report.frames_lost} frames lost"

    def close(self) -> None:
        """Stop the board and close the bus."""
        self._cleanup.close()

    def _read(self) -> Delivered:
        scan, self._first = self._first or self._next(), None
        truth = self._truth_of(scan.sequence)
        return scan, lambda: truth

    def _next(self) -> Scan:
        end = time.monotonic() + self._timeout
        while (left := end - time.monotonic()) > 0.0:
            scan = self.board.read(min(left, READ_TIMEOUT))
            if scan is not None:
                return scan
        raise SourceError(f"{self.name}: no scan within {self._timeout:g} s: {self.board.report().state}")


def bus_of(address: str, sensor: Sensor, bitrate: int, data_bitrate: int, options: Mapping[str, object]) -> BusSettings:
    """Return the bus of an address.

    Parameters
    ----------
    address : str
        ``interface:channel``.
    sensor : Sensor
        Source of bit rates that are 0 here, and of the type of frames.
    bitrate : int
        Nominal bit rate [bit/s].
    data_bitrate : int
        Bit rate of the CAN FD data phase [bit/s].
    options : mapping of str to object
        Further arguments of the interface.

    Raises
    ------
    ConfigError
        The address or an option cannot be used; one line.
    """
    interface, separator, channel = address.partition(":")
    if not separator:
        raise ConfigError(
            f"address must be interface:channel, such as slcan:/dev/ttyACM0, socketcan:can0 or {EMULATOR}:"
            f"{DEFAULT_SCENE}, got '{address}'; interfaces are {', '.join([EMULATOR, *interfaces()])}"
        )
    words = [f"{key}={value}" for key, value in options.items()]
    return bus_settings(interface, channel, sensor.can, bitrate=bitrate, data_bitrate=data_bitrate, options=words)


def emulated_feed(sensor: Sensor, scene: str, seed: int, error_model: ErrorModel, timeout: float) -> BoardFeed:
    """Return the feed of a simulated board behind an emulated slcan adapter, not opened yet.

    Parameters
    ----------
    sensor : Sensor
        Sensor description.
    scene : str
        Scene, path or name; '': the default one.
    seed : int
        Seed of everything random on the board.
    error_model : ErrorModel
        Sensor error model.
    timeout : float
        Longest time without a scan [s].
    """
    truths: OrderedDict[int, GroundTruth] = OrderedDict()
    with ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="posfet-"))
        channel = str(Path(folder) / "can0")
        loaded = load_scene(scene or DEFAULT_SCENE, sensor)
        peer = SimulatedBusPeer(sensor, loaded, seed, channel, error_model=error_model)

        def keep(scan: Scan, _stamp: int) -> None:
            if len(truths) >= KEPT_TRUTHS:
                truths.popitem(last=False)  # the scan was lost, or is read later than all others
            truths[scan.sequence] = ground_truth(peer.board.truth(), scan.sequence, sensor.layout)

        peer.on_scan = keep
        peer.open()
        stack.callback(peer.close)
        settings = bus_settings("slcan", channel, sensor.can)
        feed = BoardFeed(sensor, settings, timeout, lambda sequence: truths.pop(sequence, None))
        feed.name = f"{EMULATOR}:{loaded.name}"
        feed.close_with(stack.pop_all().close)
    return feed
