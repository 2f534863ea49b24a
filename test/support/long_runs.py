"""Long runs, seeded: scans under faults of every kind, and frames of any kind. Short ones are in test_long_runs.py.

In the folder test:

python -m support.long_runs --scans 1000000
python -m support.long_runs --frames 10000000
"""

from __future__ import annotations

import argparse
import random
import time

from posfet_driver.board.board_client import Board
from posfet_driver.bus.frame import CLASSIC, ERROR, EXTENDED, FD, RATE_SWITCH, REMOTE, Frame
from posfet_driver.protocol.decoder import Decoder
from posfet_model.sensor.description import load_sensor
from posfet_sim.emulation.firmware import BoardFirmware
from support.fake_board import FakeBoard, assert_marked, with_fd
from support.fault_injector import FaultInjector, Trouble
from support.soak import Usage
from support.stepped import SteppedBus, SteppedClock

SENSOR = load_sensor()
BASE = SENSOR.can.base_id
NEW_NUMBERS = (Trouble.RESET, Trouble.BROWN_OUT)
"""Troubles after which the account begins anew: what was sent under the old numbers cannot be known."""
COUNTED = tuple(trouble for trouble in Trouble if trouble not in (*NEW_NUMBERS, Trouble.NONE))
CADENCE = 500_000
"""Time between two batches of frames from the adapter [ns]."""
POOL = 2_000
"""Frames that are made at a time, and poured in ten orders."""
LENGTHS = (0, 1, 7, 8, 8, 8, 12, 63, 64, 64, 64)
KINDS = (CLASSIC, CLASSIC, FD | RATE_SWITCH, FD | RATE_SWITCH, FD, EXTENDED, REMOTE, ERROR, FD | EXTENDED)


def scans_under_faults(scans: int, fd: bool, seed: int, troubles: tuple[Trouble, ...] = COUNTED) -> dict[str, int]:
    """Let a board send `scans` scans under random troubles; return the account. Each scan is held to the one sent."""
    noise = random.Random(seed)
    clock = SteppedClock()
    injector = FaultInjector(lambda now: BoardFirmware(with_fd(SENSOR, fd), FakeBoard(SENSOR), now), BASE, 0, seed)
    board = Board(with_fd(SENSOR, fd), lambda: SteppedBus(clock, injector, CADENCE), clock)
    board.open()
    scan = None
    while scan is None:
        scan = board.read(0.01)
    first = last = scan.sequence
    sent, resets = 0, board.resets
    bag: list[Trouble] = []
    while sent < scans or injector.trouble != Trouble.NONE:
        bag = bag or noise.sample(troubles, len(troubles))  # each once before any comes again
        injector.trouble = bag.pop() if injector.trouble == Trouble.NONE else Trouble.NONE
        injector.firmware.supply = 5.0
        end = clock.now + round(noise.expovariate(5.0) * 1e9)
        while clock.now < end:
            if noise.random() < 0.001:
                clock.now += round(noise.expovariate(50.0) * 1e9)  # the host is held up
            scan = board.read(0.01)
            if scan is None:
                continue
            assert_marked(scan)
            assert scan.sequence > last or board.resets > resets
            last, resets = scan.sequence, board.resets
        sent = clock.now // 1_000_000
    _settle(board)
    statistics = board.decoder.statistics
    return {
        "sent": board.decoder.sequence + 1 - first,
        "published": board.decoder.scans,
        "torn": statistics.incomplete_scans,
        "lost": statistics.lost_scans,
        "reopened": board.bus.opened - 1,
        "restarted": board.restarted,
        "resets": board.resets,
    }


def _settle(board: Board) -> None:
    """Let all be well again, until the account is closed by whole scans and status frames."""
    before = board.decoder.scans
    while board.decoder.scans < before + 1000:
        board.read(0.01)
    while not board.decoder.assembler.complete:
        board.read(0.001)


def any_frame(noise: random.Random, real: list[Frame]) -> Frame:
    """Return a random frame, or a real one with some bits flipped."""
    if noise.random() < 0.5:
        identifier, kind, data = noise.choice(real)
        spoiled = bytearray(data)
        for _ in range(noise.randrange(4)):
            spoiled[noise.randrange(len(spoiled))] ^= 1 << noise.randrange(8)
        return identifier, kind, bytes(spoiled)
    identifier = BASE + noise.randrange(-2, 15) if noise.random() < 0.8 else noise.randrange(1 << 29)
    return identifier, noise.choice(KINDS), noise.randbytes(noise.choice(LENGTHS))


def fuzz(frames: int, fd: bool, seed: int) -> tuple[int, int]:
    """Pour random and mutated frames into a decoder; return how many it took, and growth of memory [byte]."""
    noise = random.Random(seed)
    firmware = BoardFirmware(with_fd(SENSOR, fd), FakeBoard(SENSOR), 0)
    firmware.running = True
    decoder = Decoder(with_fd(SENSOR, fd))
    decoder.resync(0, count_gap=False)
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


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--scans", type=int, default=0)
    parser.add_argument("--frames", type=int, default=0)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    for fd in (True, False):
        name = "FD" if fd else "classic"
        begin = time.monotonic()
        if options.scans:
            account = scans_under_faults(options.scans, fd, options.seed)
            print(name, account, f"{time.monotonic() - begin:.0f} s", flush=True)
            assert account["sent"] == account["published"] + account["torn"] + account["lost"]
            begin = time.monotonic()
            account = scans_under_faults(options.scans // 10, fd, options.seed, COUNTED + NEW_NUMBERS)
            print(name, "with resets", account, f"{time.monotonic() - begin:.0f} s", flush=True)
        if options.frames:
            taken, growth = fuzz(options.frames, fd, options.seed)
            print(name, f"{taken} frames, memory grew by {growth} bytes, {time.monotonic() - begin:.0f} s", flush=True)
            assert growth < 1 << 20


if __name__ == "__main__":
    main()
