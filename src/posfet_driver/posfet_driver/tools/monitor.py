"""What is on a bus, live: `posfet can monitor`. Sends nothing unless told to start the board."""

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

from posfet_driver.bus.bus_load import BusLoad
from posfet_driver.bus.frame import ERROR, EXTENDED, Frame
from posfet_driver.bus.frame_bus import FrameBus
from posfet_driver.bus.open_bus import open_bus
from posfet_driver.clock import Clock
from posfet_driver.protocol.decoder import Receiver
from posfet_driver.protocol.messages import FD_BLOCK_OFFSET
from posfet_driver.tools.bus_options import bus_of
from posfet_driver.tools.one_shot import started
from posfet_model.sensor.description import Sensor

PERIOD: Final = 1.0
"""Time between two pictures [s]."""
SHORTEST: Final = 0.1
"""Time for which a rate says anything [s]."""
MOST_ROWS: Final = 24
COLUMN: Final = 8
"""Width of one column of counts."""
_NAMES: Final = {0: "Command", 1: "Response", 2: "Status", FD_BLOCK_OFFSET: "ScanBlockFd"}


class Monitor:
    """Counts what is heard, and listens to one board's scans without knowing their whole number."""

    def __init__(self, sensor: Sensor, clock: Clock) -> None:
        self.receiver = Receiver(sensor)
        self.receiver.listening = True
        self.load = BusLoad(sensor.can.bitrate, sensor.can.data_bitrate)
        self.counts: Counter[tuple[int, int]] = Counter()
        self.rates: dict[tuple[int, int], float] = {}
        self.scan_rate = 0.0
        self._sensor = sensor
        self._before: Counter[tuple[int, int]] = Counter()
        self._scans = 0
        self._clock = clock
        self._time = clock.monotonic()

    def take(self, frames: list[Frame]) -> None:
        """Take the frames of one read."""
        now = self._clock.monotonic()
        self.load.add(frames, now)
        self.counts.update((identifier, kind) for identifier, kind, _ in frames)
        for frame in self.receiver.begin_batch(frames, now, 0):
            self.receiver.feed(frame)

    def tick(self) -> None:
        """Take the rates since the last tick."""
        now = self._clock.monotonic()
        span = max(now - self._time, 1) / 1e9
        self.rates = {key: (count - self._before[key]) / span for key, count in self.counts.items()}
        self.scan_rate = (self.receiver.scans - self._scans) / span
        self._before, self._scans, self._time = self.counts.copy(), self.receiver.scans, now

    def line(self) -> str:
        """Return the state in one line."""
        receiver = self.receiver
        losses, status = receiver.assembler.losses, receiver.status
        return (
            f"{sum(self.rates.values()):7.0f} frames/s  load {_known(100 * self.load.load, 5)} %  "
            f"{self.scan_rate:7.1f} scans/s  "
            f"torn {losses.torn_scans}  lost {losses.lost_scans}  malformed {losses.malformed}  "
            f"foreign {receiver.traffic.foreign}  error frames {receiver.errors.frames}  "
            f"{_known(status.temperatures[0], 0)} degC  {_known(status.supply, 0, 2)} V"
        )

    def picture(self, width: int) -> Group:
        """Return the state as tables for a terminal of that many columns: every identifier, and the newest scan."""
        table = Table("identifier", "message", "frames", "rate [1/s]")
        for key in sorted(self.counts)[:MOST_ROWS]:
            table.add_row(
                self._name(*key)[0], self._name(*key)[1], str(self.counts[key]), f"{self.rates.get(key, 0):.1f}"
            )
        if len(self.counts) > MOST_ROWS:
            table.add_row("...", f"{len(self.counts) - MOST_ROWS} more", "", "")
        if not self.counts:
            return Group(self.line(), "no frame yet: check adapter, cable, bitrate and the board's power")
        if not self.receiver.scans:
            return Group(self.line(), table, "no whole scan yet; --start starts a board that stands still")
        layout = self._sensor.layout
        counts = self.receiver.scan.counts
        needed = COLUMN * layout.cols + 1
        if needed > width:
            told = f"newest scan: {counts.min()} to {counts.max()} counts; the terminal needs {needed} columns for all"
            return Group(self.line(), table, told)
        grid = Table(*[f"col {col}" for col in range(layout.cols)], title="newest scan [counts]")
        for row in counts.reshape(layout.rows, layout.cols):
            grid.add_row(*[str(count) for count in row])
        return Group(self.line(), table, grid)

    def _name(self, identifier: int, kind: int) -> tuple[str, str]:
        if kind & ERROR:
            return "-", "error frame"
        offset = identifier - self._sensor.can.base_id
        if kind & EXTENDED:
            return f"0x{identifier:08X}", ""
        last = 8 + self.receiver.assembler.codec.blocks
        name = f"ScanBlock{offset - 8}" if 8 <= offset < last else _NAMES.get(offset, "")
        return f"0x{identifier:03X}", name


def _known(value: float, width: int, digits: int = 1) -> str:
    """Return a number as text, "?" when it is not known."""
    return f"{'?':>{width}}" if math.isnan(value) else f"{value:{width}.{digits}f}"


def run_monitor(options: argparse.Namespace) -> int:
    """Run the action; return the exit code: 0 when any frame was heard."""
    console = Console(highlight=False, markup=False)
    with bus_of(options) as (sensor, settings):
        bus = open_bus(settings)
        monitor = Monitor(sensor, options.clock)
        try:
            with started(bus, sensor, options), contextlib.suppress(KeyboardInterrupt):
                if console.is_terminal:
                    with Live(console=console, auto_refresh=False) as live:
                        for _ in _ticks(bus, monitor, options.seconds, options.clock):
                            live.update(monitor.picture(console.width), refresh=True)
                else:
                    for _ in _ticks(bus, monitor, options.seconds, options.clock):
                        console.print(monitor.line(), soft_wrap=True)
        finally:
            bus.shutdown()
    if not console.is_terminal:
        console.print(monitor.picture(console.width))
    return 0 if monitor.counts else 1


def _ticks(bus: FrameBus, monitor: Monitor, seconds: float, clock: Clock) -> Iterator[None]:
    """Read the bus; yield once a period, and at the end."""

    def time() -> float:
        return clock.monotonic() / 1e9

    end = time() + seconds
    due = time() + PERIOD
    while (now := time()) < end:
        monitor.take(bus.read_frames(max(min(due, end) - now, 0.0)))
        if time() >= due:
            due += PERIOD
            monitor.tick()
            yield
    if end - (due - PERIOD) > SHORTEST or not monitor.rates:
        monitor.tick()
        yield
