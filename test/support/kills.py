# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Kills the process of a board again and again, at random moments, and checks that the driver is back each time.

In the folder test:

python -m support.kills --kills 1000
"""

from __future__ import annotations

import argparse
import random
import subprocess
import tempfile
import time
from pathlib import Path

from posfet_driver.board.board_client import Board
from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.scan import Scan
from support.fake_board import PATIENCE, slcan_opener, with_fd
from support.reference_board import make
from support.soak import Usage

LONGEST_RUN = 0.2
"""Longest time between the first scan and the kill [s]."""


def next_scan(board: Board) -> Scan:
    """Return the next scan; fail after a time-out."""
    end = time.monotonic() + PATIENCE
    while (scan := board.read(0.1)) is None:
        assert time.monotonic() < end, board.report()
    return scan


def kills(number: int, fd: bool, seed: int) -> tuple[float, Usage, Usage]:
    """Kill the board `number` times; return the longest time to data [s], and the usage before and after."""
    noise = random.Random(seed)
    longest, before = 0.0, None
    with tempfile.TemporaryDirectory() as folder:
        make(Path(folder) / "build")
        program, link = Path(folder) / "build" / "posfet_board", Path(folder) / "can0"
        board = Board(with_fd(load_sensor(), fd), slcan_opener(link, fd))
        board.open()
        for kill in range(number):
            options = ["--format", "fd" if fd else "classic", "--link", str(link), "--boot", str(kill % 16)]
            process = subprocess.Popen([str(program), *options], stdout=subprocess.PIPE)
            try:
                assert process.stdout is not None
                process.stdout.readline()
                begin = time.monotonic()
                last = next_scan(board).sequence
                longest = max(longest, time.monotonic() - begin)
                before = before or Usage.now()
                end = time.monotonic() + noise.random() * LONGEST_RUN
                while time.monotonic() < end:
                    scan = board.read(0.05)
                    if scan is not None:
                        assert scan.sequence > last
                        last = scan.sequence
            finally:
                process.kill()
                process.communicate()
                link.unlink(missing_ok=True)
            while board.bus.is_open:
                board.read(0.02)
        board.close()
        assert board.decoder.resets == number - 1
        assert before is not None
        return longest, before, Usage.now()


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--kills", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    for fd in (True, False):
        longest, before, after = kills(options.kills // 2, fd, options.seed)
        name = "FD" if fd else "classic"
        print(
            f"{name}: {options.kills // 2} kills, data back after {longest:.3f} s at most; {before} -> {after}",
            flush=True,
        )


if __name__ == "__main__":
    main()
