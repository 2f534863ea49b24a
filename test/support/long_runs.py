# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Long random tests with a seed: scans under every fault, and random frames. Short ones are in test_long_runs.py.

In the folder test:

python -m support.long_runs --scans 1000000
python -m support.long_runs --frames 10000000
python -m support.long_runs --changed 600
"""

from __future__ import annotations

import argparse
import random
import time
from collections.abc import Iterator

from posfet_driver.board.board_client import Board
from posfet_driver.bus.frame import CLASSIC, ERROR, EXTENDED, FD, RATE_SWITCH, REMOTE, Frame
from posfet_driver.protocol.decoder import Decoder
from posfet_driver.protocol.messages import Command
from posfet_model.sensor.description import load_sensor
from posfet_sim.emulation.firmware import BoardFirmware
from support.clocks import SteppedClock
from support.fake_board import FakeBoard, assert_marked, with_fd
from support.fault_injector import FaultInjector, InjectedFault
from support.soak import Usage
from support.stepped import SteppedBus

SENSOR = load_sensor()
BASE = SENSOR.can.base_id
NEW_SEQUENCE = (InjectedFault.RESET, InjectedFault.BROWN_OUT)
"""Faults after which the count of scans restarts: the number of scans sent with the old sequence is unknown."""
COUNTED = tuple(fault for fault in InjectedFault if fault not in (*NEW_SEQUENCE, InjectedFault.NONE))
CADENCE = 500_000
"""Time between two batches of frames from the adapter [ns]."""
POOL = 2_000
"""Number of frames that are generated at once, and fed in ten different orders."""
LENGTHS = (0, 1, 7, 8, 8, 8, 12, 63, 64, 64, 64)
KINDS = (CLASSIC, CLASSIC, FD | RATE_SWITCH, FD | RATE_SWITCH, FD, EXTENDED, REMOTE, ERROR, FD | EXTENDED)


def scans_under_faults(scans: int, fd: bool, seed: int, faults: tuple[InjectedFault, ...] = COUNTED) -> dict[str, int]:
    """Let a board send scans under random faults, verify each received scan, and return the counts."""
    noise = random.Random(seed)
    clock = SteppedClock()
    injector = FaultInjector(lambda now: BoardFirmware(with_fd(SENSOR, fd), FakeBoard(SENSOR), now), BASE, 0, seed)
    board = Board(with_fd(SENSOR, fd), lambda: SteppedBus(clock, injector, CADENCE), clock)
    board.open()
    scan = None
    while scan is None:
        scan = board.read(0.01)
    first = last = scan.sequence
    sent, resets = 0, board.decoder.resets
    bag: list[InjectedFault] = []
    while sent < scans or injector.fault != InjectedFault.NONE:
        bag = bag or noise.sample(faults, len(faults))  # each once before any is repeated
        injector.fault = bag.pop() if injector.fault == InjectedFault.NONE else InjectedFault.NONE
        injector.firmware.supply = 5.0
        end = clock.now + round(noise.expovariate(5.0) * 1e9)
        while clock.now < end:
            if noise.random() < 0.001:
                clock.now += round(noise.expovariate(50.0) * 1e9)  # delay of the host
            scan = board.read(0.01)
            if scan is None:
                continue
            assert_marked(scan)
            assert scan.sequence > last or board.decoder.resets > resets
            last, resets = scan.sequence, board.decoder.resets
        sent = clock.now // 1_000_000
    _settle(board)
    statistics = board.decoder.statistics
    return {
        "sent": board.decoder.sequence + 1 - first,
        "published": board.decoder.scans,
        "incomplete": statistics.incomplete_scans,
        "lost": statistics.lost_scans,
        "reopened": board.bus.opened - 1,
        "restarted": board.restarted,
        "resets": board.decoder.resets,
    }


def _settle(board: Board) -> None:
    """Read without faults until complete scans and status frames account for every scan sent."""
    before = board.decoder.scans
    while board.decoder.scans < before + 1000:
        board.read(0.01)
    while not board.decoder.assembler.complete:
        board.read(0.001)


def any_frame(noise: random.Random, real: list[Frame]) -> Frame:
    """Return a random frame, or a real one with some bits flipped."""
    if noise.random() < 0.5:
        identifier, kind, data = noise.choice(real)
        mutated = bytearray(data)
        for _ in range(noise.randrange(4)):
            mutated[noise.randrange(len(mutated))] ^= 1 << noise.randrange(8)
        return identifier, kind, bytes(mutated)
    identifier = BASE + noise.randrange(-2, 15) if noise.random() < 0.8 else noise.randrange(1 << 29)
    return identifier, noise.choice(KINDS), noise.randbytes(noise.choice(LENGTHS))


def fuzz(frames: int, fd: bool, seed: int) -> tuple[int, int]:
    """Feed random and mutated frames to a decoder; return their number, and the growth of memory [byte]."""
    noise = random.Random(seed)
    firmware = BoardFirmware(with_fd(SENSOR, fd), FakeBoard(SENSOR), 0)
    firmware.running = True
    decoder = Decoder(with_fd(SENSOR, fd))
    decoder.start()
    taken, now, growth_from = 0, 50_000_000, 0
    while taken < frames:
        real = firmware.due(now)[-50:]
        pool = [any_frame(noise, real) for _ in range(min(frames, POOL))]
        for _ in range(10):
            batches = noise.sample(pool, len(pool))
            while batches:
                size = noise.randrange(1, 400)
                batch, batches = batches[:size], batches[size:]
                now += round(noise.expovariate(1e-6))
                for _ in decoder.decode(batch, now, 0):
                    pass
            taken += len(pool)
        if not growth_from and taken >= frames // 4:
            growth_from = Usage.now().memory
    return taken, Usage.now().memory - growth_from


class ChangedFrames:
    """A board of which each frame may be changed, lost, or followed by any other; responses keep their tags mostly."""

    def __init__(self, fd: bool, clock: SteppedClock, noise: random.Random) -> None:
        self.firmware = BoardFirmware(with_fd(SENSOR, fd), FakeBoard(SENSOR), clock.now)
        self.probability = 0.3
        self.commands = 0
        self._clock, self._noise = clock, noise

    def next_due(self) -> int:
        return min(self.firmware.next_due(), self._clock.now + 1_000_000)

    def due(self, now: int, until: int | None = None) -> list[Frame]:
        return list(self._changed(self.firmware.due(now)))

    def receive(self, frame: Frame, now: int) -> list[Frame]:
        self.commands += 1
        return list(self._changed(self.firmware.receive(frame, now)))

    def _changed(self, frames: list[Frame]) -> Iterator[Frame]:
        noise, probability = self._noise, self.probability
        for identifier, kind, data in frames:
            changed = bytearray(data)
            for _ in range(noise.randrange(1, 4) if noise.random() < probability else 0):
                changed[noise.randrange(len(changed))] ^= 1 << noise.randrange(8)
            if noise.random() >= 0.3 * probability:
                yield identifier, kind, bytes(changed)
            if noise.random() < 0.3 * probability:
                yield any_frame(noise, [(identifier, kind, data)])


def fuzz_board(seconds: float, fd: bool, seed: int) -> dict[str, float]:
    """Let a driver find, start and read a board of changed frames, while users send commands and the bus fails.

    Asserts that no counter falls, that the board is not flooded with commands, and that scans flow at the end, when the
    board tells the truth again; returns how many scans were published and lost, and the time to the first of these [s].
    """
    noise, clock = random.Random(seed), SteppedClock()
    link, buses = ChangedFrames(fd, clock, noise), list[SteppedBus]()

    def open_bus() -> SteppedBus:
        if noise.random() < 0.2:
            raise OSError("not there")
        buses.append(SteppedBus(clock, link))
        return buses[-1]

    board = Board(with_fd(SENSOR, fd), open_bus, clock)
    board.open()
    counters: dict[str, int] = {}
    end = round(seconds * 1e9)
    while clock.now < end:
        if noise.random() < 0.01:
            link.probability = noise.choice((0.0, 0.01, 0.3, 0.9))
        if noise.random() < 0.002:
            command = noise.choice([command for command in Command if command != Command.STOP])
            board.submit(command, noise.choice((0, 1, 499, 1000, 2000, 0xFFFF_FFFF)))
        if noise.random() < 0.0005 and buses:
            buses[-1].broken = True
        if noise.random() < 0.001:
            clock.now += round(noise.expovariate(1.0) * 1e9)  # delay of the host
        board.read(0.01)
        report = board.report()
        named = {**report.fault_counts, **report.counters, "frames lost": report.frames_lost, "scans": report.scans}
        before, counters = counters, {str(name): count for name, count in named.items()}
        assert all(count >= before.get(name, 0) for name, count in counters.items()), (before, counters)
    assert link.commands < 20 * seconds + 20
    link.probability = 0.0
    told = clock.now
    while board.read(0.01) is None or board.report().state != "receiving scans":
        assert clock.now < told + 10_000_000_000, board.report()
    recovery, lost = (clock.now - told) / 1e9, board.decoder.statistics.lost_scans
    assert lost <= 5 * clock.now / 1e6 + 1000, f"{lost} scans lost in {clock.now / 1e9:.1f} s"  # a tick takes 1 ms
    return {"scans": board.decoder.scans, "lost": lost, "recovery": recovery}


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--scans", type=int, default=0)
    parser.add_argument("--frames", type=int, default=0)
    parser.add_argument("--changed", type=float, default=0.0, metavar="SECONDS", help="a board of changed frames")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    for fd in (True, False):
        name = "FD" if fd else "classic"
        begin = time.monotonic()
        if options.scans:
            counts = scans_under_faults(options.scans, fd, options.seed)
            print(name, counts, f"{time.monotonic() - begin:.0f} s", flush=True)
            assert counts["sent"] == counts["published"] + counts["incomplete"] + counts["lost"]
            begin = time.monotonic()
            counts = scans_under_faults(options.scans // 10, fd, options.seed, COUNTED + NEW_SEQUENCE)
            print(name, "with resets", counts, f"{time.monotonic() - begin:.0f} s", flush=True)
        if options.frames:
            taken, growth = fuzz(options.frames, fd, options.seed)
            print(name, f"{taken} frames, memory grew by {growth} bytes, {time.monotonic() - begin:.0f} s", flush=True)
            assert growth < 1 << 20
        if options.changed:
            found = fuzz_board(options.changed, fd, options.seed)
            print(name, f"{options.changed:g} s of changed frames: {found}", flush=True)


if __name__ == "__main__":
    main()
