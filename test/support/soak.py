# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Soak test: hours of faults on the emulated adapter, one every few seconds (`make soak`, `python -m support.soak`).

Every received scan is compared with the one that was sent. After each fault data has to flow again; memory, threads and
file descriptors must not grow. Prints a line per minute and a verdict; the exit code is 1 on failure.

With `--paced` the time stands still while the board or its reader wait for a processor. What is measured then is the
driver's own, whatever else the machine does, and data has to flow again within `TARGET_RECOVERY`.
"""

from __future__ import annotations

import argparse
import gc
import os
import random
import sys
import tempfile
import threading
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
from posfet_model._lib.units import NANOSECONDS
from posfet_model.command_line import positive
from posfet_model.sensor.description import Sensor, load_sensor, with_frames
from posfet_model.sensor.scan import Scan
from posfet_sim.emulation.firmware import BoardFirmware
from posfet_sim.emulation.slcan_adapter import EmulatedAdapter
from support.clocks import POLL, PacedClock
from support.fault_injector import NEED_ERROR_FRAMES, FaultInjector, InjectedFault

UNPLUGGED: Final = "adapter unplugged"
RENAMED: Final = "adapter unplugged, back under another name"
WRONG_BITRATE: Final = "wrong bitrate"
FAULTS: Final = (
    *(fault for fault in InjectedFault if fault is not InjectedFault.NONE and fault not in NEED_ERROR_FRAMES),
    UNPLUGGED,
    RENAMED,
    WRONG_BITRATE,
)
"""Every fault except those that need error frames, which slcan does not carry."""
RECOVERY: Final = 10.0
"""Maximum time from the end of a fault to the next scan [s]."""
TARGET_RECOVERY: Final = 0.5
"""Target time from the end of a fault to the next scan [s], and the maximum in paced time; the report says how often it
is met."""
READ_TIME: Final = 0.1
"""Longest time of one read [s]; `POLL` in paced time, while the bus is open."""
WARM_UP: Final = 10.0
"""Time before the first measurement of memory, threads and descriptors [s]."""
GROWTH_LIMIT: Final = 4 << 20
"""Maximum growth of resident memory [byte]: some pages, whatever the duration."""


def marked(index: int, taxels: int) -> np.ndarray[tuple[int], np.dtype[np.uint16]]:
    """Return counts that encode the index of their scan, modulo 4096."""
    codes = (index * 7 + np.arange(taxels) * 129) % 4096
    return (codes << 4 | codes >> 8).astype(np.uint16)


class MarkedBoard:
    """Source of scans with encoded index."""

    def __init__(self, sensor: Sensor) -> None:
        self._sensor = sensor

    def scan(self, index: int, out: Scan) -> None:
        """Compute scan `index`."""
        out.counts[:] = marked(index, self._sensor.layout.taxels)
        out.device_time = round(index / self._sensor.can.scan_rate * 1e6)
        out.temperatures[:] = 25.0
        out.status = 0


@dataclass(frozen=True)
class Usage:
    """Resources of a process."""

    memory: int
    """Resident memory [byte]."""
    threads: int
    descriptors: int

    @classmethod
    def now(cls) -> Usage:
        """Return the resources of this process now."""
        gc.collect()
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
        return cls(pages * os.sysconf("SC_PAGE_SIZE"), threading.active_count(), len(os.listdir("/proc/self/fd")))


@dataclass
class Verdict:
    """Result of a soak test."""

    limit: float = RECOVERY
    """Maximum time from the end of a fault to the next scan [s]."""
    faults: Counter[str] = field(default_factory=Counter)
    scans: int = 0
    wrong: int = 0
    """Number of scans that differ from the sent one of the same sequence."""
    not_recovered: list[str] = field(default_factory=list)
    recoveries: list[float] = field(default_factory=list)
    """Time from the end of each fault to the next scan [s]."""
    slowest: dict[str, float] = field(default_factory=dict)
    """Longest time from the end of a fault to the next scan [s], by fault."""
    before: Usage | None = None
    after: Usage | None = None

    def failures(self) -> list[str]:
        """Return the failures, one line each."""
        bad = [f"not recovered within {self.limit:g} s: {name}" for name in self.not_recovered]
        if self.wrong:
            bad.append(f"{self.wrong} scans differ from those sent")
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
    """A board with faults behind an adapter with faults, and the driver under test, in real or in paced time."""

    def __init__(self, folder: Path, fd: bool, seed: int, paced: bool) -> None:
        self.verdict = Verdict(TARGET_RECOVERY if paced else RECOVERY)
        self._sensor = with_frames(load_sensor(), str(fd).lower())
        self._folder = folder
        self._random = random.Random(seed)
        self._clock = PacedClock() if paced else SystemClock()
        self._paced = paced
        self._injector = FaultInjector(self._firmware, self._sensor.can.base_id, self._clock.monotonic(), seed)
        self._name = 0
        self._adapter = self._plug_in()
        opener = BusOpener(bus_settings("slcan", str(folder / "can*"), self._sensor.can))
        self._board = Board(self._sensor, opener, self._clock, opener.presence)

    def run(self, seconds: float, period: float) -> Verdict:
        """Inject a fault about every `period` [s] for `seconds` [s]."""
        verdict = self.verdict
        begin = report = self._now()
        with self:
            self._read(min(WARM_UP, seconds / 4))
            while self._now() - begin < seconds:
                fault, length = self._random.choice(FAULTS), self._random.uniform(0.1, 0.5) * period
                self.one_fault(fault, length)
                self._read(period - length)
                if verdict.before is None and self._now() - begin > min(WARM_UP, seconds / 4) * 3:
                    verdict.before = Usage.now()
                if self._now() - report > 60:
                    report = self._now()
                    print(f"{report - begin:7.0f} s  {self._line()}", flush=True)
            verdict.after = Usage.now()
        return verdict

    def __enter__(self) -> Soak:
        self._board.open()
        return self

    def __exit__(self, *_: object) -> None:
        self._board.close()
        self._adapter.close()

    def _now(self) -> float:
        return self._clock.monotonic() / NANOSECONDS

    def _firmware(self, now: int) -> BoardFirmware:
        return BoardFirmware(self._sensor, MarkedBoard(self._sensor), now)

    def _plug_in(self) -> EmulatedAdapter:
        adapter = EmulatedAdapter(self._folder / f"can{self._name}", self._injector, self._clock)
        adapter.open()
        return adapter

    def one_fault(self, fault: InjectedFault | str, length: float) -> None:
        """Inject a fault for a time [s], and wait for data."""
        name = fault.value if isinstance(fault, InjectedFault) else fault
        self.verdict.faults[name] += 1
        if isinstance(fault, InjectedFault):
            self._injector.fault = fault
            self._read(length)
            self._injector.fault = InjectedFault.NONE
            self._injector.firmware.supply = 5.0
        elif fault == WRONG_BITRATE:
            self._adapter.speeds = (b"S4",)
            self._read(length)
            self._adapter.speeds = ()
        else:
            self._adapter.close()
            self._read(length)
            self._name += fault == RENAMED
            self._adapter = self._plug_in()
        self._wait_for_data(name)

    def _wait_for_data(self, name: str) -> None:
        """Wait for the next complete scan after a fault."""
        begin = self._now()
        scans = self.verdict.scans
        while self.verdict.scans == scans:
            self._read(0.001)
            if self._adapter.failure:
                raise RuntimeError(f"the emulated adapter has ended: {self._adapter.failure}")
            if self._now() - begin > self.verdict.limit:
                self.verdict.not_recovered.append(f"{name}: {self._board.report().state}")
                return
        slowest, took = self.verdict.slowest, self._now() - begin
        slowest[name] = max(slowest.get(name, 0.0), took)
        self.verdict.recoveries.append(took)

    def _read(self, seconds: float) -> None:
        end = self._now() + seconds
        while (left := end - self._now()) > 0:
            longest = POLL if self._paced and self._board.bus.is_open else READ_TIME
            scan = self._board.read(min(left, longest))
            if scan is not None:
                self.verdict.scans += 1
                self._check(scan)

    def _check(self, scan: Scan) -> None:
        self.verdict.wrong += not np.array_equal(scan.counts, marked(scan.sequence, len(scan.counts)))

    def _line(self) -> str:
        usage, losses = Usage.now(), self._board.decoder.statistics
        return (
            f"{self.verdict.scans} scans, {sum(self.verdict.faults.values())} faults, "
            f"incomplete {losses.incomplete_scans}, lost {losses.lost_scans}, {usage.memory / 1e6:.1f} MB, "
            f"{usage.threads} threads, {usage.descriptors} descriptors"
        )


def describe(verdict: Verdict) -> str:
    """Return the verdict as text."""
    lines = [f"{verdict.scans} scans, {sum(verdict.faults.values())} faults, {verdict.wrong} wrong scans"]
    lines += [
        f"  {name}: {count} times, data back after {verdict.slowest.get(name, float('nan')):.3f} s at most"
        for name, count in sorted(verdict.faults.items())
    ]
    in_time = sum(took <= TARGET_RECOVERY for took in verdict.recoveries)
    lines.append(f"data back within {TARGET_RECOVERY:g} s after {in_time} of {len(verdict.recoveries)} faults")
    if verdict.before and verdict.after:
        before, after = verdict.before, verdict.after
        lines.append(
            f"memory {before.memory / 1e6:.1f} -> {after.memory / 1e6:.1f} MB, threads {before.threads} -> "
            f"{after.threads}, descriptors {before.descriptors} -> {after.descriptors}"
        )
    return "\n".join(lines + [f"BAD: {line}" for line in verdict.failures()])


def main(words: Sequence[str] | None = None) -> int:
    """Run a soak test; return the exit code."""
    parser = argparse.ArgumentParser(prog="support.soak", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--for", dest="seconds", type=positive, default=1800.0, help="duration [s] (default: 1800)")
    parser.add_argument("--every", type=positive, default=3.0, help="period of the faults [s] (default: 3)")
    parser.add_argument("--classic", action="store_true", help="classic frames instead of CAN FD")
    parser.add_argument("--paced", action="store_true", help="in time that stands still while the machine is too busy")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(words)
    with tempfile.TemporaryDirectory(prefix="posfet-soak-") as folder:
        soak = Soak(Path(folder), not options.classic, options.seed, options.paced)
        verdict = soak.run(options.seconds, options.every)
    print(describe(verdict))
    return 1 if verdict.failures() else 0


if __name__ == "__main__":
    sys.exit(main())
