"""Hours of faults, one every few seconds, on the emulated adapter: `make soak`, `python -m support.soak`.

Every scan that comes out is held to the one that was sent. After each fault data has to flow again; memory, threads and
file descriptors have to stay what they were. Prints a line a minute and a verdict; the exit code is 1 when it is bad.
"""

from __future__ import annotations

import argparse
import gc
import os
import random
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from posfet_driver.board.board_client import Board
from posfet_driver.bus.open_bus import bus_settings
from posfet_driver.bus.port_search import BusOpener
from posfet_driver.clock import SystemClock
from posfet_model.command_line import positive
from posfet_model.sensor.description import Sensor, load_sensor, with_frames
from posfet_model.sensor.scan import Scan
from posfet_sim.emulation.firmware import BoardFirmware
from posfet_sim.emulation.slcan_adapter import EmulatedAdapter
from support.fault_injector import FaultInjector, Trouble

UNPLUGGED: Final = "adapter gone"
RENAMED: Final = "adapter gone, back under another name"
WRONG_SPEED: Final = "wrong bitrate"
_ERROR_FRAMES: Final = {Trouble.ERRORS, Trouble.UNACKNOWLEDGED, Trouble.OVERFLOW, Trouble.UNREADABLE, Trouble.BUS_OFF}
FAULTS: Final = (
    *(trouble for trouble in Trouble if trouble is not Trouble.NONE and trouble not in _ERROR_FRAMES),
    UNPLUGGED,
    RENAMED,
    WRONG_SPEED,
)
"""Every fault but those that need error frames, which slcan does not carry."""
RECOVERY: Final = 10.0
"""Time after a fault in which data has to flow again [s]."""
PROMPT: Final = 0.5
"""Time within which data is meant to flow again [s]; how often it did is told."""
WARM_UP: Final = 10.0
"""Time after which memory, threads and descriptors are first looked at [s]."""
GROWTH_LIMIT: Final = 4 << 20
"""Growth of resident memory [byte] from which it is not called flat: a page here and there, whatever the time."""


def marked(index: int, taxels: int) -> np.ndarray[tuple[int], np.dtype[np.uint16]]:
    """Return counts that tell the number of their scan, modulo 4096."""
    codes = (index * 7 + np.arange(taxels) * 129) % 4096
    return (codes << 4 | codes >> 8).astype(np.uint16)


class MarkedBoard:
    """Makes marked scans."""

    def __init__(self, sensor: Sensor) -> None:
        self._sensor = sensor

    def scan(self, index: int, out: Scan) -> None:
        """Compute scan number `index`."""
        out.counts[:] = marked(index, self._sensor.layout.taxels)
        out.device_time = round(index / self._sensor.can.scan_rate * 1e6)
        out.temperatures[:] = 25.0
        out.status = 0


@dataclass(frozen=True)
class Usage:
    """What a process holds."""

    memory: int
    """Resident memory [byte]."""
    threads: int
    descriptors: int

    @classmethod
    def now(cls) -> Usage:
        """Return what this process holds now."""
        gc.collect()
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
        return cls(pages * os.sysconf("SC_PAGE_SIZE"), threading.active_count(), len(os.listdir("/proc/self/fd")))


@dataclass
class Verdict:
    """What came of a soak."""

    faults: Counter[str] = field(default_factory=Counter)
    scans: int = 0
    wrong: int = 0
    """Scans that were not sent under their number like this."""
    not_recovered: list[str] = field(default_factory=list)
    recoveries: list[float] = field(default_factory=list)
    """Time from the end of each fault to the next scan [s]."""
    slowest: dict[str, float] = field(default_factory=dict)
    """Longest time from the end of a fault to the next scan [s], by fault."""
    before: Usage | None = None
    after: Usage | None = None

    def complaints(self) -> list[str]:
        """Return what is bad, one line each."""
        bad = [f"not recovered within {RECOVERY:g} s: {name}" for name in self.not_recovered]
        if self.wrong:
            bad.append(f"{self.wrong} scans were not the ones sent")
        if self.before and self.after:
            growth = self.after.memory - self.before.memory
            if growth > GROWTH_LIMIT:
                bad.append(f"memory grew by {growth} bytes")
            if self.after.threads > self.before.threads:
                bad.append(f"threads grew from {self.before.threads} to {self.after.threads}")
            if self.after.descriptors > self.before.descriptors:
                bad.append(f"file descriptors grew from {self.before.descriptors} to {self.after.descriptors}")
        return bad


class Soak:
    """A board with faults behind an adapter with faults, and the driver that has to live with them."""

    def __init__(self, folder: Path, fd: bool, seed: int) -> None:
        self.verdict = Verdict()
        self._sensor = with_frames(load_sensor(), str(fd).lower())
        self._folder = folder
        self._random = random.Random(seed)
        self._clock = SystemClock()
        self._injector = FaultInjector(self._firmware, self._sensor.can.base_id, self._clock.monotonic(), seed)
        self._name = 0
        self._adapter = self._plug_in()
        opener = BusOpener(bus_settings("slcan", str(folder / "can*"), self._sensor.can))
        self._board = Board(self._sensor, opener, presence=opener.presence)

    def run(self, seconds: float, period: float) -> Verdict:
        """Let a fault happen about every `period` [s] for `seconds` [s]."""
        verdict = self.verdict
        begin = report = time.monotonic()
        self._board.open()
        try:
            self._read(min(WARM_UP, seconds / 4))
            while time.monotonic() - begin < seconds:
                self._one_fault(self._random.choice(FAULTS), period)
                if verdict.before is None and time.monotonic() - begin > min(WARM_UP, seconds / 4) * 3:
                    verdict.before = Usage.now()
                if time.monotonic() - report > 60:
                    report = time.monotonic()
                    print(f"{report - begin:7.0f} s  {self._line()}", flush=True)
            verdict.after = Usage.now()
        finally:
            self._board.close()
            self._adapter.close()
        return verdict

    def _firmware(self, now: int) -> BoardFirmware:
        return BoardFirmware(self._sensor, MarkedBoard(self._sensor), now)

    def _plug_in(self) -> EmulatedAdapter:
        adapter = EmulatedAdapter(self._folder / f"can{self._name}", self._injector, self._clock)
        adapter.open()
        return adapter

    def _one_fault(self, fault: Trouble | str, period: float) -> None:
        name = fault.value if isinstance(fault, Trouble) else fault
        self.verdict.faults[name] += 1
        length = self._random.uniform(0.1, 0.5) * period
        if isinstance(fault, Trouble):
            self._injector.trouble = fault
            self._read(length)
            self._injector.trouble = Trouble.NONE
            self._injector.firmware.supply = 5.0
        elif fault == WRONG_SPEED:
            self._adapter.speeds = (b"S4",)
            self._read(length)
            self._adapter.speeds = ()
        else:
            self._adapter.close()
            self._read(length)
            self._name += fault == RENAMED
            self._adapter = self._plug_in()
        self._wait_for_data(name)
        self._read(period - length)

    def _wait_for_data(self, name: str) -> None:
        """Wait for scans to come whole again after a fault."""
        begin = time.monotonic()
        scans = self.verdict.scans
        while self.verdict.scans == scans:
            self._read(0.001)
            if time.monotonic() - begin > RECOVERY:
                self.verdict.not_recovered.append(f"{name}: {self._board.report().state}")
                return
        slowest, took = self.verdict.slowest, time.monotonic() - begin
        slowest[name] = max(slowest.get(name, 0.0), took)
        self.verdict.recoveries.append(took)

    def _read(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            scan = self._board.read(min(left, 0.1))
            if scan is not None:
                self.verdict.scans += 1
                self._check(scan)

    def _check(self, scan: Scan) -> None:
        self.verdict.wrong += not np.array_equal(scan.counts, marked(scan.sequence, len(scan.counts)))

    def _line(self) -> str:
        usage, losses = Usage.now(), self._board.decoder.statistics
        return (
            f"{self.verdict.scans} scans, {sum(self.verdict.faults.values())} faults, torn {losses.incomplete_scans}, "
            f"lost {losses.lost_scans}, {usage.memory / 1e6:.1f} MB, {usage.threads} threads, "
            f"{usage.descriptors} descriptors"
        )


def describe(verdict: Verdict) -> str:
    """Return the verdict for people."""
    lines = [f"{verdict.scans} scans, {sum(verdict.faults.values())} faults, {verdict.wrong} wrong scans"]
    lines += [
        f"  {name}: {count} times, data back after {verdict.slowest.get(name, float('nan')):.3f} s at most"
        for name, count in sorted(verdict.faults.items())
    ]
    prompt = sum(took <= PROMPT for took in verdict.recoveries)
    lines.append(f"data back within {PROMPT:g} s after {prompt} of {len(verdict.recoveries)} faults")
    if verdict.before and verdict.after:
        before, after = verdict.before, verdict.after
        lines.append(
            f"memory {before.memory / 1e6:.1f} -> {after.memory / 1e6:.1f} MB, threads {before.threads} -> "
            f"{after.threads}, descriptors {before.descriptors} -> {after.descriptors}"
        )
    return "\n".join(lines + [f"BAD: {line}" for line in verdict.complaints()])


def main(words: Sequence[str] | None = None) -> int:
    """Run a soak; return the exit code."""
    parser = argparse.ArgumentParser(prog="support.soak", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--for", dest="seconds", type=positive, default=1800.0, help="how long [s] (default: 1800)")
    parser.add_argument("--every", type=positive, default=3.0, help="time between two faults [s] (default: 3)")
    parser.add_argument("--classic", action="store_true", help="classic frames instead of CAN FD")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(words)
    with tempfile.TemporaryDirectory(prefix="posfet-soak-") as folder:
        verdict = Soak(Path(folder), not options.classic, options.seed).run(options.seconds, options.every)
    print(describe(verdict))
    return 1 if verdict.complaints() else 0


if __name__ == "__main__":
    sys.exit(main())
