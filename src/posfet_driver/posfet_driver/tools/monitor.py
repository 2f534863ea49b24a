# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Live display of a bus: `posfet can monitor`. Sends nothing unless `--start` is given."""

from __future__ import annotations

import argparse
import contextlib
import math
from collections import Counter
from collections.abc import Iterator
from typing import Final

from rich.console import Console, Group
from rich.live import Live
from rich.table import Table

from posfet_driver.board.board_report import decoder_fault_counts
from posfet_driver.board.faults import FaultKind
from posfet_driver.bus.bus_load import BusLoad
from posfet_driver.bus.error_frame import ErrorCounts
from posfet_driver.bus.frame import ERROR, EXTENDED, Frame
from posfet_driver.bus.frame_bus import FrameBus
from posfet_driver.bus.open_bus import open_bus
from posfet_driver.clock import Clock
from posfet_driver.protocol.mapped_decoder import MappedDecoder, make_decoder
from posfet_driver.protocol.messages import (
    CLASSIC_BLOCK_OFFSET,
    COMMAND_OFFSET,
    FD_BLOCK_OFFSET,
    HEADER_OFFSET,
    IDENTITY_OFFSET,
    RESPONSE_OFFSET,
    STATUS_OFFSET,
)
from posfet_driver.tools.bus_options import bus_of
from posfet_driver.tools.one_shot import started
from posfet_model.sensor.description import Sensor

PERIOD: Final = 1.0
"""Update period of the display [s]."""
SHORTEST: Final = 0.1
"""Shortest time over which a rate is computed [s]."""
MAX_ROWS: Final = 24
"""Largest number of identifiers displayed."""
COLUMN: Final = 8
"""Width of one column of counts [characters]."""
_ALWAYS: Final = {FaultKind.INCOMPLETE_SCANS, FaultKind.LOST_SCANS, FaultKind.MALFORMED_FRAMES}
"""Faults that are displayed although none has occurred."""
_NAMES: Final = {
    COMMAND_OFFSET: "Command",
    RESPONSE_OFFSET: "Response",
    STATUS_OFFSET: "Status",
    FD_BLOCK_OFFSET: "ScanBlockFd",
    HEADER_OFFSET: "ScanHeader",
    IDENTITY_OFFSET: "Identity",
}


class Monitor:
    """Counts the frames of a bus and decodes the scans of one board as a passive listener.

    Parameters
    ----------
    sensor : Sensor
        Array and frames of the board.
    clock : Clock
        Clock of the host.
    """

    def __init__(self, sensor: Sensor, clock: Clock) -> None:
        self.decoder = make_decoder(sensor)
        self.decoder.start()
        self.errors = ErrorCounts()
        self.load = BusLoad(sensor.can.bitrate, sensor.can.data_bitrate)
        self.counts: Counter[tuple[int, int]] = Counter()
        self.rates: dict[tuple[int, int], float] = {}
        self.scan_rate = 0.0
        self._sensor = sensor
        self._before: Counter[tuple[int, int]] = Counter()
        self._scans = 0
        self._clock = clock
        self._time = clock.monotonic()

    def process(self, frames: list[Frame]) -> None:
        """Process the frames of one read."""
        now = self._clock.monotonic()
        self.load.add(frames, now)
        self.counts.update((identifier, kind) for identifier, kind, _ in frames)
        self.errors.count(frames)
        for _ in self.decoder.decode(frames, now, 0):
            pass

    def tick(self) -> None:
        """Compute the rates since the previous tick."""
        now = self._clock.monotonic()
        span = max(now - self._time, 1) / 1e9
        self.rates = {key: (count - self._before[key]) / span for key, count in self.counts.items()}
        self.scan_rate = (self.decoder.scans - self._scans) / span
        self._before, self._scans, self._time = self.counts.copy(), self.decoder.scans, now

    def line(self) -> str:
        """Return the state in one line."""
        decoder, status = self.decoder, self.decoder.status
        counts = decoder_fault_counts(decoder).items()
        faults = [f"{fault.label} {count}" for fault, count in counts if count or fault in _ALWAYS]
        return (
            f"{sum(self.rates.values()):7.0f} frames/s  load {_known(100 * self.load.load, 5)} %  "
            f"{self.scan_rate:7.1f} scans/s  "
            f"{'  '.join(faults)}  "
            f"unrelated frames {decoder.traffic.unrelated}  {FaultKind.ERROR_FRAMES.label} {self.errors.frames}  "
            f"{_known(status.temperatures[0], 0)} degC  {_known(status.supply, 0, 2)} V"
        )

    def display(self, width: int) -> Group:
        """Return tables of all identifiers and of the newest scan, for a terminal of `width` columns."""
        table = Table("identifier", "message", "frames", "rate [1/s]")
        for key in sorted(self.counts)[:MAX_ROWS]:
            table.add_row(
                self._name(*key)[0], self._name(*key)[1], str(self.counts[key]), f"{self.rates.get(key, 0):.1f}"
            )
        if len(self.counts) > MAX_ROWS:
            table.add_row("...", f"{len(self.counts) - MAX_ROWS} more", "", "")
        if not self.counts:
            return Group(self.line(), "no frame yet: check adapter, cable, bit rate and the board's power")
        if not self.decoder.scans:
            return Group(self.line(), table, "no complete scan yet; --start starts a stopped board")
        layout = self._sensor.layout
        counts = self.decoder.scan.counts
        needed = COLUMN * layout.cols + 1
        if needed > width:
            text = f"newest scan: {counts.min()} to {counts.max()} counts; the terminal needs {needed} columns for all"
            return Group(self.line(), table, text)
        grid = Table(*[f"col {col}" for col in range(layout.cols)], title="newest scan [counts]")
        for row in counts.reshape(layout.rows, layout.cols):
            grid.add_row(*[str(count) for count in row])
        return Group(self.line(), table, grid)

    def _name(self, identifier: int, kind: int) -> tuple[str, str]:
        if kind & ERROR:
            return "-", "error frame"
        extended = bool(kind & EXTENDED)
        text = f"0x{identifier:08X}" if extended else f"0x{identifier:03X}"
        if isinstance(self.decoder, MappedDecoder):
            return text, self.decoder.tables.names.get((identifier, extended), "")
        offset = identifier - self._sensor.can.base_id
        if extended:
            return text, ""
        block = offset - CLASSIC_BLOCK_OFFSET
        name = f"ScanBlock{block}" if 0 <= block < self.decoder.blocks else _NAMES.get(offset, "")
        return text, name


def _known(value: float, width: int, digits: int = 1) -> str:
    """Return a number as text, "?" when it is unknown."""
    return f"{'?':>{width}}" if math.isnan(value) else f"{value:{width}.{digits}f}"


def run_monitor(options: argparse.Namespace) -> int:
    """Run `posfet can monitor`; return the exit code: 0 when any frame was received."""
    console = Console(highlight=False, markup=False)
    with bus_of(options) as (sensor, settings):
        bus = open_bus(settings)
        monitor = Monitor(sensor, options.clock)
        try:
            with started(bus, sensor, options), contextlib.suppress(KeyboardInterrupt):
                if console.is_terminal:
                    with Live(console=console, auto_refresh=False) as live:
                        for _ in _ticks(bus, monitor, options.seconds, options.clock):
                            live.update(monitor.display(console.width), refresh=True)
                else:
                    for _ in _ticks(bus, monitor, options.seconds, options.clock):
                        console.print(monitor.line(), soft_wrap=True)
        finally:
            bus.shutdown()
    if not console.is_terminal:
        console.print(monitor.display(console.width))
    return 0 if monitor.counts else 1


def _ticks(bus: FrameBus, monitor: Monitor, seconds: float, clock: Clock) -> Iterator[None]:
    """Read the bus; yield once per period, and at the end."""

    def time() -> float:
        return clock.monotonic() / 1e9

    newest = time()
    end, due = newest + seconds, newest + PERIOD
    while (now := time()) < end:
        monitor.process(bus.read_frames(max(min(due, end) - now, 0.0)))
        if (now := time()) >= due:
            newest, due = now, max(due + PERIOD, now + SHORTEST)  # what a pause has missed is not made up for
            monitor.tick()
            yield
    if end - newest > SHORTEST or not monitor.rates:
        monitor.tick()
        yield
