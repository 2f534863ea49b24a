# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Lists the adapters and the boards detected on them: `posfet can list`. Sends nothing."""

from __future__ import annotations

import argparse
import glob
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final

import can
from rich.console import Console
from rich.table import Table

from posfet_driver.bus import can_interface
from posfet_driver.bus.bus_error import one_line
from posfet_driver.bus.frame import CLASSIC, Frame
from posfet_driver.bus.frame_bus import FrameBus
from posfet_driver.bus.open_bus import open_bus
from posfet_driver.clock import Clock
from posfet_driver.protocol.mapped_decoder import make_decoder
from posfet_driver.protocol.messages import IDENTITY_OFFSET, PROTOCOL_VERSION, STATUS_OFFSET, Identity, Status
from posfet_driver.tools.bus_options import EMULATOR, bus_of
from posfet_model.config import ConfigError

SERIAL_PORTS: Final = ("/dev/ttyACM*", "/dev/ttyUSB*")
HEARTBEATS_NEEDED: Final = 3
"""Consecutive heartbeats that identify a board: other data do not count."""


@dataclass
class DetectedBoard:
    """A board detected by its status frames."""

    base: int
    """Base identifier."""
    identity: Identity | None = None
    """Newest identity; None: unknown."""
    status: Status | None = None
    """Newest status."""
    in_order: int = 0
    """Consecutive heartbeats."""

    def process(self, status: Status) -> None:
        """Process a frame that may be a status."""
        follows = self.status is None or status.heartbeat == (self.status.heartbeat + 1) % 16
        self.in_order = self.in_order + 1 if follows else 0
        self.status = status

    def row(self) -> list[str]:
        """Return base identifier, layout, firmware and supply voltage as text."""
        identity, supply = self.identity, self.status.supply if self.status else math.nan
        layout, firmware = (str(identity.board.layout), identity.firmware) if identity else ("?", "?")
        return [f"0x{self.base:X}", layout, firmware, "?" if math.isnan(supply) else f"{supply:.2f}"]


def adapters() -> list[tuple[str, str]]:
    """Return interface and channel of every adapter of this machine."""
    ports = sorted(port for pattern in SERIAL_PORTS for port in glob.glob(pattern))
    return [("socketcan", name) for name in can_interface.names()] + [("slcan", port) for port in ports]


class BoardSearch:
    """Finds the boards whose status is among the frames of a bus."""

    def __init__(self) -> None:
        self._detected: dict[int, DetectedBoard] = {}
        self._identities: dict[int, Identity] = {}

    def process(self, frames: Iterable[Frame]) -> None:
        """Process frames in the order of their arrival."""
        for identifier, kind, data in frames:
            if kind != CLASSIC:
                continue
            if (status := Status.unpack(data)) is not None:
                base = identifier - STATUS_OFFSET
                self._detected.setdefault(base, DetectedBoard(base)).process(status)
            identity = Identity.unpack(data)
            if identity is not None and identity.board.protocol == PROTOCOL_VERSION:
                self._identities[identifier - IDENTITY_OFFSET] = identity

    def found(self) -> list[DetectedBoard]:
        """Return the boards, sorted by base identifier."""
        boards = [self._detected[base] for base in sorted(self._detected) if base >= 0]
        found = [board for board in boards if board.in_order >= HEARTBEATS_NEEDED]
        for board in found:
            board.identity = self._identities.get(board.base)
        return found


def listen(bus: FrameBus, seconds: float, clock: Clock) -> Iterator[list[Frame]]:
    """Read the frames that arrive within a time.

    Parameters
    ----------
    bus : FrameBus
        Open bus.
    seconds : float
        Listening time [s].
    clock : Clock
        Clock of the host.

    Yields
    ------
    list of Frame
        The frames of one read.
    """
    end = clock.monotonic() + round(seconds * 1e9)
    while (left := end - clock.monotonic()) > 0:
        yield bus.read_frames(left / 1e9)


def run_list(options: argparse.Namespace) -> int:
    """Run `posfet can list`; return the exit code. Raises the error of an adapter that the options name."""
    named = bool(options.interface)
    listed = [(options.interface, options.channel)] if named else adapters()
    table = Table("interface", "channel", "state", "base id", "layout", "firmware", "supply [V]", title="adapters")
    reasons: list[str] = []
    for interface, channel in listed:
        options.interface, options.channel = interface, channel
        shown = channel or ("a simulated board" if interface == EMULATOR else "")
        try:
            rows = _rows(options)
        except (can.CanError, ConfigError, OSError) as error:
            if named:
                raise
            reasons.append(one_line(error))
            rows = [["not usable", "", "", "", ""]]
        for row in rows:
            table.add_row(interface, shown, *row)
    console = Console(highlight=False, markup=False)
    if table.row_count:
        console.print(table)
        for reason in reasons:
            console.print(reason, soft_wrap=True)  # whole: it may hold a command to be copied
    else:
        console.print("no adapter found: no CAN network device, no /dev/ttyACM*, no /dev/ttyUSB*")
        console.print(f"A simulated board needs none: posfet can list -i {EMULATOR}")
    return 0


def _rows(options: argparse.Namespace) -> list[list[str]]:
    """Return the table rows of an adapter, one per board."""
    with bus_of(options) as (sensor, settings):
        search, decoder, frames = BoardSearch(), make_decoder(sensor), 0
        decoder.start()
        bus = open_bus(settings)
        try:
            for batch in listen(bus, options.seconds, options.clock):
                frames += len(batch)
                search.process(batch)
                for _ in decoder.decode(batch, options.clock.monotonic(), 0):
                    pass
        finally:
            bus.shutdown()
    found = [board.row() for board in search.found()]
    if sensor.mapping and decoder.scans:
        found.append(["own frames", str(sensor.layout.id), "?", "?"])
    if not found:
        return [[f"{frames} frames, no board", "", "", "", ""]]
    return [[f"{frames} frames", *row] for row in found]
