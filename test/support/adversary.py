# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""An adversary of the driver: every fault of a board, its link, and the host's schedule, and lies of the board, in
virtual time. Each published scan is judged by what the board has sampled. A short run is in test_adversary.py.

In the folder test:

python -m support.adversary --scans 1000000 --seed 0
python -m support.adversary --only "FD 5x5 1 kHz" --fault "lie: frozen time" --fault "foreign commands"
"""

from __future__ import annotations

import argparse
import math
import os
import random
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Final, NamedTuple

from posfet_driver.board.board_client import Board
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_model.sensor.scan import Scan, ScanStatus
from support.adversary_link import KEPT, Link, LoggedBoard, Sampled
from support.clocks import SteppedClock
from support.fake_board import with_fd, with_layout
from support.reference_board import make
from support.soak import Usage

LINK_FAULTS: Final = (
    "frames lost",
    "bursts lost",
    "frames doubled",
    "frames reordered",
    "frames delayed",
    "jitter",
    "frames truncated",
    "frames corrupted",
    "foreign traffic",
    "foreign commands",
    "error frames",
    "overflow reported",
    "cable out",
    "unplugged",
    "adapter stalls",
    "answers late",
    "answers lost",
    "commands lost",
    "deaf board",
)
BOARD_FAULTS: Final = ("reset", "reset, same number", "brown-out", "bus blocked", "board stalls", "ADC fails")
HOST_FAULTS: Final = ("host delayed", "host stopped")
LIES: Final = (
    "lie: rate",
    "lie: answers",
    "lie: identity",
    "lie: period",
    "lie: not scanning",
    "lie: sequence",
    "lie: frozen sequence",
    "lie: time",
    "lie: frozen time",
)
FAULTS: Final = LINK_FAULTS + BOARD_FAULTS + HOST_FAULTS + LIES
ABOUT_SEQUENCE: Final = {"lie: sequence", "lie: frozen sequence"}
ABOUT_TICKS: Final = {*ABOUT_SEQUENCE, "reset, same number"}
"""Lies across which scans are not accounted for."""
PERIODS: Final = (1000, 1000, 2000, 5000)
"""Scan periods [us]; those that other hosts set are among them."""
SHORTEST_PERIOD: Final = 500_000
"""The shortest one that the board keeps [ns]: more scans than such periods are not lost, whatever it states."""
SECOND: Final = 1_000_000_000
NUMBERED_AGAIN: Final = SECOND // 5
"""Time after the last fault or lie within which a scan may have a false number [ns]."""
HEADER: Final = 16
"""Classic scans of which one has a header."""
SENT_LATER: Final = SECOND
"""Time for which a board keeps a scan while the bus is blocked [ns]: a lie is made of what is sent."""
COUNTER: Final = 16
"""Scans by which the counter of classic blocks can mislead besides [1]."""
REPLUGGED: Final = SECOND // 2
RECOVERED: Final = 2 * SECOND
"""Time from the end of a fault to the next scan [ns]."""
QUIET: Final = SECOND * 3 // 10
"""Time without faults after which scans are accounted for [ns]."""
STRETCH: Final = 16
"""Least number of ticks that are accounted for at once."""
SAMPLES: Final = 24
"""Times at which the memory is measured."""
QUARTERS: Final = range(0, SAMPLES, SAMPLES // 4)
GROWTH_LIMIT: Final = 2 << 20
"""Maximum growth of resident memory from the third quarter of a run to the last [byte], by their medians: the log of
the board, of which `KEPT` scans are kept, and the frames that wait have filled by then."""
FILLING: Final = 16 << 20
"""The same of a run that is too short for that [byte]."""
DRIFTED: Final = 5000
"""Time in which two clocks that the mapping follows can differ by one unit more: a delay that grows more slowly is not
distinguished from their drift."""
WIDE: Final = 2e-3
"""Bound of a stamp above which it is counted [s]."""


@dataclass
class Findings:
    """What a run has found."""

    published: int = 0
    sampled: int = 0
    """Ticks of the board's scan timer in stretches that were accounted for."""
    lost: int = 0
    incomplete: int = 0
    stretches: int = 0
    false_numbers: int = 0
    """Scans with the number of a lie about it, while it lasts or shortly after."""
    mixed: int = 0
    """Classic scans of blocks of two scans, to which a lie has given one number and of which frames were lost."""
    unbounded: int = 0
    """Scans whose stamps had no bound: the board's clock stood still."""
    uncertain: int = 0
    """Scans whose stamps had a bound above `WIDE`."""
    largest_error: int = 0
    """Of a stamp that was judged [ns]."""
    slowest: Counter[str] = field(default_factory=Counter)
    """Longest time to the next scan after a fault [ns]."""
    memory: list[int] = field(default_factory=list)
    """Median of the resident memory in each quarter of the run [byte]."""
    faults: Counter[str] = field(default_factory=Counter)
    failures: Counter[str] = field(default_factory=Counter)
    examples: list[str] = field(default_factory=list)

    def fail(self, kind: str, text: str) -> None:
        """Note a broken promise; the first few of each kind in full."""
        self.failures[kind] += 1
        if self.failures[kind] <= 3:
            self.examples.append(f"{kind}: {text}")


class Account(NamedTuple):
    """What has become of the ticks until a scan."""

    time: int
    """Time at which the scan was published [ns]."""
    sequence: int
    published: int
    lost: int
    incomplete: int


class Judge:
    """Compares published scans with what the board has sampled."""

    def __init__(self, board: Board, link: Link, hardware: LoggedBoard, fd: bool) -> None:
        self.findings = Findings()
        self.boots = {0: 0}
        """Number of each power-on that the board states."""
        self.newest = 0
        """Time at which the newest scan was acquired [ns]."""
        self._board, self._link, self._hardware, self._fd = board, link, hardware, fd
        self._power_on = 0
        self._last = -1
        self._lost = 0
        self._counters: dict[str, int] = {}
        self._delays: dict[int, tuple[int, int]] = {}  # shortest in each tenth of a second, and when that was [ns]
        self._number_lies: list[tuple[int, int, int]] = []  # begin and end [ns], and the jump
        self._base: Account | None = None  # with which the stretch began
        self._newest_account: Account | None = None
        self.quiet_since = 0
        self._transit = round(board.decoder.transit_time.times.switched * SECOND)
        self._stamp = 0  # of the previous scan
        self._flagged = False  # a reset, since the last scan that was found

    def lie_begins(self, begin: int, jump: int) -> None:
        """Note that the board lies about its sequence from a time [ns] on."""
        self._number_lies = [*self._number_lies[-3:], (begin, 1 << 62, jump)]

    def lies_end(self, end: int) -> None:
        """Note that the board tells its sequence from a time [ns] on."""
        self._number_lies = [(begin, min(last, end), jump) for begin, last, jump in self._number_lies]

    def end_stretch(self) -> None:
        """Account for nothing across this moment."""
        self._base = self._newest_account = None

    def judge(self, scan: Scan, calm: bool) -> None:
        """Judge a scan that was just published."""
        found, now = self.findings, self._link.clock.now
        found.published += 1
        if scan.frames_lost < self._lost:
            found.fail("counter fell", self._at(scan, f"frames_lost {self._lost} -> {scan.frames_lost}"))
        self._lost = scan.frames_lost
        self._flagged |= bool(scan.status & ScanStatus.BOARD_RESET)
        sent = self._find(scan, scan.sequence)
        if sent is None:
            self._last = -1
            self.end_stretch()
            if calm and now - self.quiet_since > NUMBERED_AGAIN:
                found.fail(
                    "misnumbered", self._at(scan, f"{(now - self.quiet_since) / 1e9:.3f} s after the last fault")
                )
            elif not self._is_false_number(scan):
                self._find_error(scan)
            return
        if sent.power_on != self._power_on:
            if self.boots[sent.power_on] != self.boots[self._power_on] and not self._flagged:
                found.fail("reset without a flag", self._at(scan, f"power-on {self._power_on} -> {sent.power_on}"))
            self._power_on, self._last = sent.power_on, -1
            self.end_stretch()
            self._delays.clear()
        self._flagged = False
        if scan.status & ScanStatus.BOARD_RESET:
            self._delays.clear()  # the mapping of the clock begins anew
        self.newest = sent.time
        lied = any(begin <= sent.time <= end + NUMBERED_AGAIN for begin, end, _ in self._number_lies)
        if scan.sequence <= self._last and not lied:
            found.fail("sequence fell", self._at(scan, f"after {self._last}"))
        self._last = scan.sequence
        self._judge_stamp(scan, sent, calm)
        if found.published % 16 == 0:
            self.judge_counters()
        self._account(scan, calm and now - self.quiet_since > QUIET)

    def judge_counters(self) -> None:
        """Compare all counters of the report with the previous ones."""
        report = self._board.report()
        named = *report.fault_counts.items(), *report.counters.items(), ("scans", report.scans)
        counters = {str(name): value for name, value in named}
        for name, value in self._counters.items():
            if counters[name] < value:
                self.findings.fail("counter fell", f"{name}: {value} -> {counters[name]}")
        self._counters = counters
        ticks = self._link.clock.now // SHORTEST_PERIOD
        if (lost := self._board.decoder.statistics.lost_scans) > ticks:
            self.findings.fail("invented losses", f"{lost} scans lost in {ticks} ticks at most")

    def _find(self, scan: Scan, sequence: int) -> Sampled | None:
        """Return what the board has sampled, of this sequence and with these counts, nearest to the stamp."""
        now = self._link.clock.now
        same = [
            sampled
            for sampled in self._hardware.sampled.get(sequence, ())
            if sampled.power_on >= self._power_on and sampled.time <= now and self._equal(scan, sampled)
        ]
        if scan.status & ScanStatus.BOARD_RESET:  # numbers and noise of a power-on may be those of the one before
            same = [sampled for sampled in same if sampled.power_on > self._power_on] or same
        return min(same, key=lambda sampled: abs(sampled.time - scan.stamp), default=None)

    def _equal(self, scan: Scan, sampled: Sampled) -> bool:
        sent = [int(word) for word in sampled.counts.split()]
        if not self._fd:
            sent = [count & 0xFFF0 | count >> 12 for count in sent]
        return bool(scan.counts.tolist() == sent)

    def _is_in_lie(self, time: int) -> bool:
        return any(begin - SENT_LATER <= time <= end + NUMBERED_AGAIN for begin, end, _ in self._number_lies)

    def _is_false_number(self, scan: Scan) -> bool:
        """Return whether a scan has the number that the board has lied about, and no other error."""
        for number in self._true_numbers(scan):
            sent = self._find(scan, number)
            if sent and self._is_in_lie(sent.time):
                self.findings.false_numbers += 1
                return True
        return False

    def _true_numbers(self, scan: Scan) -> Iterator[int]:
        """Return the numbers that a scan may have had before the board has lied about them."""
        if self._fd:
            for stated in self._link.stated:
                yield from stated.get(scan.sequence & 0xFFFFFFFF, ())
            return
        for _, _, jump in self._number_lies:
            for wrong in range(jump - COUNTER, jump + COUNTER + 1):
                yield (scan.sequence - wrong) & 0xFFFFFFFF

    def _find_error(self, scan: Scan) -> None:
        """Count a scan whose number is false without a lie about it."""
        wraps = range(-64 * COUNTER, 64 * COUNTER + 1, COUNTER)
        if not self._fd and any(self._find(scan, scan.sequence + wrap) for wrap in wraps):
            self.findings.fail("misnumbered", self._at(scan, "by a wrap of its counter"))
            return
        same = [
            sampled for others in self._hardware.sampled.values() for sampled in others if self._equal(scan, sampled)
        ]  # several, as the noise of each power-on is the same
        if not self._fd and any(self._is_in_lie(sampled.time) for sampled in same):
            self.findings.false_numbers += 1
            return
        if same:
            where = [
                (number, sampled.power_on - self._power_on, sampled.time)
                for number, others in self._hardware.sampled.items()
                for sampled in others
                if sampled in same
            ]
            self.findings.fail("misnumbered", self._at(scan, f"its counts are those of {where}"))
            return
        if not self._fd and self._is_in_lie(self._link.clock.now):
            self.findings.mixed += 1
            return
        self.findings.fail("never sampled", self._at(scan, "was never sampled"))

    def _judge_stamp(self, scan: Scan, sent: Sampled, calm: bool) -> None:
        found, now = self.findings, self._link.clock.now
        tenth, delay = now // (SECOND // 10), (now - sent.time, now)
        told = not scan.status & ScanStatus.TIME_ESTIMATED if self._fd else scan.sequence % HEADER == 0
        if told or not sent.late or not self._delays:  # else it seems to be delayed since its tick
            self._delays[tenth] = min(self._delays.get(tenth, delay), delay)
        while len(self._delays) > 1 and (oldest := next(iter(self._delays))) < tenth - 9:
            del self._delays[oldest]
        if not self._stamp <= scan.stamp <= now:
            found.fail("stamp fell or is of the future", self._at(scan, f"{self._stamp} -> {scan.stamp}, now {now}"))
        self._stamp = scan.stamp
        if math.isnan(scan.stamp_uncertainty):
            found.unbounded += 1
            return
        bound = round(scan.stamp_uncertainty * SECOND)
        found.uncertain += scan.stamp_uncertainty > WIDE
        common = min(delay + (now - time) // DRIFTED for delay, time in self._delays.values())
        common = max(common - self._transit, 0)
        error = scan.stamp - sent.time
        if not -bound <= error <= bound + common:
            found.fail(
                "stamp",
                self._at(scan, f"error {error / 1e6:.3f} ms, bound {bound / 1e6:.3f} + {common / 1e6:.3f} ms"),
            )
        if calm:
            found.largest_error = max(found.largest_error, abs(error))

    def _account(self, scan: Scan, known: bool) -> None:
        """Compare gaps with losses since the last time that all was known.

        Scans that were held back are published at one time, and what is missing between them is counted with the first:
        the account is that of the last.
        """
        found, statistics, now = self.findings, self._board.decoder.statistics, self._link.clock.now
        account, self._newest_account = self._newest_account, None
        if known:
            losses = statistics.lost_scans, statistics.incomplete_scans
            self._newest_account = Account(now, scan.sequence, found.published, *losses)
        if account is None or account.time == now:
            return
        base = self._base
        if base is not None and account.sequence - base.sequence < STRETCH:
            return
        self._base = account
        if base is None:
            return
        _, span, published, lost, incomplete = (new - old for new, old in zip(account, base, strict=True))
        found.stretches += 1
        found.sampled += span
        found.lost += lost
        found.incomplete += incomplete
        if span != published + lost + incomplete:
            text = f"span {span}, published {published}, lost {lost}, incomplete {incomplete}"
            found.fail("silent loss", self._at(scan, text))

    def _at(self, scan: Scan, text: str) -> str:
        return f"scan {scan.sequence} status {scan.status} at {self._link.clock.now / 1e9:.3f} s: {text}"


class Adversary:
    """A driver, a board and a link between them."""

    def __init__(self, program: Path, folder: Path, sensor: Sensor, seed: int, faults: Sequence[str] = FAULTS) -> None:
        self.faults = faults
        """Those that `run` chooses from."""
        self.noise = random.Random(seed)
        self.clock = SteppedClock()
        layout = f"{sensor.layout.rows}x{sensor.layout.cols}"
        form = "fd" if sensor.can.fd else "classic"
        options = ["--format", form, "--layout", layout, "--period", "500", "--noise", "5000", "--seed", str(seed)]
        scale = 1 + self.noise.uniform(-80e-6, 80e-6)
        self.hardware = LoggedBoard(program, folder, scale, *options)
        self.link = Link(self.clock, self.hardware, sensor.can.fd, self.noise)
        self.board = Board(sensor, self.link.open, self.clock, self.link.presence)
        self.judge = Judge(self.board, self.link, self.hardware, sensor.can.fd)
        self.history: list[str] = []
        self._fd = sensor.can.fd
        self._boot = 0

    def run(self, scans: int) -> Findings:
        """Publish and judge a number of scans."""
        found = self.judge.findings
        self.board.open()
        self.read(SECOND, calm=True)
        bag: list[str] = []
        used: list[Usage] = []
        while found.published < scans:
            chosen = []
            for _ in range(self.noise.choice((1, 1, 2, 3))):
                bag = bag or self.noise.sample(self.faults, len(self.faults))  # each once before any is repeated
                chosen.append(bag.pop())
            self.fault(chosen)
            if found.published > len(used) * scans // SAMPLES:
                used.append(Usage.now())
        self.judge.judge_counters()
        used += [Usage.now()] * max(SAMPLES - len(used), 1)  # a short run has few faults
        found.memory = [round(median(usage.memory for usage in used[part:][: SAMPLES // 4])) for part in QUARTERS]
        limit = GROWTH_LIMIT if scans >= 4 * KEPT else FILLING
        if found.memory[-1] - found.memory[-2] > limit or used[-1].descriptors > used[0].descriptors:
            found.fail("growth", f"memory in the quarters of the run {found.memory}, {used[0]} -> {used[-1]}")
        self.board.close()
        code = self.hardware.close()
        if code:
            found.fail("firmware", f"exit code {code}")
        return found

    def read(self, duration: int, calm: bool) -> None:
        """Read for a time [ns]."""
        end, clock, judge = self.clock.now + duration, self.clock, self.judge
        while clock.now < end:
            scan = self.board.read(min(0.02, (end - clock.now) / 1e9))
            if scan is not None:
                judge.judge(scan, calm)

    def fault(self, names: list[str]) -> None:
        """Let faults begin one after the other, end together, and data flow again."""
        noise, link, judge, found = self.noise, self.link, self.judge, self.judge.findings
        link.lookahead = noise.randrange(1_000_000, 20_000_000)
        link.cadence = noise.choice((1, 125_000, 1_000_000, 4_000_000))
        link.room = noise.choice((200, 1000, 4000))
        begin = self.clock.now
        self.history = [*self.history[-5:], f"{begin / 1e9:.3f} s {names}"]
        examples = len(found.examples)
        for name in names:
            found.faults[name] += 1
            self._begin(name)
            self.read(round(noise.expovariate(6.0) * SECOND), calm=False)
        self.read(round(noise.expovariate(6.0) * SECOND), calm=False)
        link.end()
        link.run(max(self.clock.now, self.hardware.host_time(self.hardware.now)))
        end = self.clock.now
        judge.quiet_since = max(end, self.hardware.host_time(self.hardware.now))  # its last frame under a fault
        judge.lies_end(judge.quiet_since)
        if not ABOUT_TICKS.isdisjoint(names):
            judge.end_stretch()
        self._recover(names, end)
        self.read(round(noise.uniform(0.2, 0.8) * SECOND), calm=True)
        for index in range(examples, len(found.examples)):
            found.examples[index] += f"; faults {self.history}"

    def _recover(self, names: list[str], end: int) -> None:
        found, judge = self.judge.findings, self.judge
        replugged = not {"unplugged", "cable out"}.isdisjoint(names) and len(names) == 1
        limit = REPLUGGED if replugged else RECOVERED
        while judge.newest < end and self.clock.now < end + 20 * SECOND:
            self.read(1_000_000, calm=True)
        took = self.clock.now - end
        for name in names if len(names) == 1 else ["several"]:
            found.slowest[name] = max(found.slowest[name], took)
        if took > limit:
            found.fail("recovery", f"{names}: {took / 1e9:.3f} s, {self.board.report().state}")

    def _begin(self, name: str) -> None:  # noqa: PLR0912  # a table of faults in all but name
        noise, link, hardware = self.noise, self.link, self.hardware
        if name in {"reset", "reset, same number", "brown-out"}:
            if name == "brown-out":
                hardware.command("V 2500")
                self.read(SECOND // 5, calm=False)
            if name != "reset, same number":
                self._boot = (self._boot + noise.choice((1, 1, 1, 7))) % 16
            self.judge.end_stretch()
            link.power_cycle(self._boot)
            self.judge.boots[hardware.power_on] = self._boot
            hardware.command("V 3300")
        elif name == "ADC fails":
            hardware.command("A 1")
            self.read(SECOND // 10, calm=False)
            hardware.command("A 0")
        elif name == "board stalls":
            link.stall_board(self.clock.now + noise.randrange(2_000_000, 300_000_000))
        elif name == "host delayed":
            for _ in range(5):
                link.stand_still(round(noise.expovariate(20.0) * SECOND))
                self.read(SECOND // 50, calm=False)
        elif name == "host stopped":
            wraps = noise.random() < 0.2  # 16 bits of milliseconds
            longest = 70.0 if noise.random() < 0.2 else 3.0
            link.stand_still(65_536_000_000 if wraps else round(noise.uniform(1.0, longest) * SECOND))
        elif name == "foreign commands":
            for _ in range(3):
                command = noise.choice((1, 2, 3, 4, 5, 9))
                link.foreign(command, noise.choice((*PERIODS, 0, 499)) if command == 3 else 0)
                self.read(SECOND // 20, calm=False)
        else:
            link.begin(name)
            if name in ABOUT_SEQUENCE:
                self.judge.lie_begins(self.clock.now, link.jump)
                self.judge.lie_begins(self.clock.now, 0)  # seen in classic counters, which have 4 bits
            if name == "bus blocked":
                hardware.command("B 1")


def variants() -> dict[str, Sensor]:
    """Return the sensors of a campaign by name."""
    sensor = load_sensor()
    return {
        "FD 5x5 1 kHz": with_fd(sensor, True),
        "classic 5x5 1 kHz": with_fd(sensor, False),
        "FD 8x8 500 Hz": with_fd(with_layout(sensor, 8, 8, scan_rate=500.0), True),
        "classic 5x5 250 Hz": with_fd(with_layout(sensor, 5, 5, scan_rate=250.0), False),
    }


def campaign(program: Path, name: str, scans: int, seed: int, faults: Sequence[str] = FAULTS) -> Findings:
    """Run one variant."""
    with tempfile.TemporaryDirectory(prefix="posfet-adversary-") as folder:
        return Adversary(program, Path(folder), variants()[name], seed, faults).run(scans)


def _timed(program: Path, name: str, scans: int, seed: int, faults: Sequence[str]) -> tuple[str, Findings, float]:
    """Run one variant; return its name, what was found, and the processor time of this process and the board's [s]."""
    begin = os.times()
    found = campaign(program, name, scans, seed, faults)
    return name, found, sum(os.times()[:4]) - sum(begin[:4])


def describe(name: str, found: Findings, seconds: float) -> str:
    """Return the findings as text."""
    slowest = ", ".join(f"{fault} {took / 1e9:.3f}" for fault, took in sorted(found.slowest.items()))
    lines = [
        f"{name}: {found.published} scans published, {sum(found.faults.values())} faults, "
        f"{seconds:.0f} s of processor time",
        f"  accounted for: {found.sampled} ticks in {found.stretches} stretches, {found.lost} lost, "
        f"{found.incomplete} incomplete",
        f"  false numbers of lies {found.false_numbers}, mixed by lies {found.mixed}",
        f"  stamps: without a bound {found.unbounded}, with one above {1e3 * WIDE:g} ms {found.uncertain}, "
        f"largest error after faults {found.largest_error / 1e6:.3f} ms",
        f"  memory in the quarters of the run [MB]: {', '.join(f'{memory / 1e6:.1f}' for memory in found.memory)}",
        f"  longest time to the next scan [s]: {slowest}",
    ]
    return "\n".join([*lines, *(f"BAD: {kind}: {count}" for kind, count in found.failures.items()), *found.examples])


def main(words: Sequence[str] | None = None) -> int:
    """Run a campaign over all variants; return the exit code."""
    parser = argparse.ArgumentParser(prog="support.adversary", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scans", type=int, default=1_000_000, help="scans of all variants (default: 1e6)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="variants at a time (default: one per core)")
    parser.add_argument("--only", choices=list(variants()), help="one variant")
    parser.add_argument("--fault", choices=FAULTS, action="append", dest="faults", metavar="NAME", help="only these")
    options = parser.parse_args(words)
    names = [options.only] if options.only else list(variants())
    scans, faults = options.scans // len(names), options.faults or FAULTS
    bad = 0
    with tempfile.TemporaryDirectory(prefix="posfet-firmware-") as folder, ProcessPoolExecutor(options.jobs) as pool:
        program = Path(folder) / "posfet_board"
        make(Path(folder), str(program))
        runs = [pool.submit(_timed, program, name, scans, options.seed, faults) for name in names]
        for run in as_completed(runs):
            name, found, seconds = run.result()
            print(describe(name, found, seconds), flush=True)
            bad += len(found.failures)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
