# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Frames per second of each slcan reader on the same byte stream: `python -m benchmarks.micro.slcan_readers`.

A separate process writes the stream to a pseudo-terminal as fast as it is read. Readers: that of python-can, the same
with buffering (`buffered_slcan.py`), and the slcan bus of the driver, through recv() and through read_frames().
"""

from __future__ import annotations

import os
import sys
import time
import tty
from collections.abc import Callable
from dataclasses import dataclass

import can

from benchmarks.micro.buffered_slcan import BufferedSlcanBus
from benchmarks.outcome import Outcome, Table
from posfet_driver.bus.frame import CLASSIC, FD, RATE_SWITCH
from posfet_driver.bus.slcan_bus import SlcanBus
from posfet_driver.bus.slcan_codec import encode_line

FRAMES = {"python-can": 2_000, "buffered": 50_000, "recv": 100_000, "read_frames": 300_000}
"""Number of frames for each reader."""
STREAMS = {"classic": (0x108, CLASSIC, bytes(range(8))), "FD, 64 bytes": (0x103, FD | RATE_SWITCH, bytes(range(64)))}


@dataclass(frozen=True)
class Reader:
    """How to open a bus and read frames from it; `read` returns the number of frames."""

    open: Callable[[str], can.BusABC]
    read: Callable[[can.BusABC], int]


def recv(bus: can.BusABC) -> int:
    """Receive one message."""
    return int(bus.recv(1.0) is not None)


READERS = {
    "python-can": Reader(lambda port: can.Bus(interface="slcan", channel=port, sleep_after_open=0), recv),
    "buffered": Reader(lambda port: BufferedSlcanBus(port, sleep_after_open=0), recv),
    "recv": Reader(lambda port: SlcanBus(port, fd=True), recv),
    "read_frames": Reader(lambda port: SlcanBus(port, fd=True), lambda bus: len(bus.read_frames(1.0))),
}


def rate(reader: Reader, line: bytes, frames: int) -> float:
    """Return the frames per second."""
    master, slave = os.openpty()
    tty.setraw(slave)
    bus = reader.open(os.ttyname(slave))
    writer = os.fork()
    if writer == 0:
        for _ in range(frames // 100 + 1):
            data = line * 100
            while data:
                data = data[os.write(master, data) :]
        os._exit(0)
    received, begin = 0, time.perf_counter()
    try:
        while received < frames:
            received += reader.read(bus)
        seconds = time.perf_counter() - begin
    finally:
        os.kill(writer, 9)
        os.waitpid(writer, 0)
        bus.shutdown()
        os.close(master)
        os.close(slave)
    return received / seconds


def measure(full: bool) -> Outcome:
    """Measure each reader on the same streams."""
    scale = 1.0 if full else 0.5
    rates = {
        name: {
            reader: rate(READERS[reader], encode_line(frame), int(scale * count)) for reader, count in FRAMES.items()
        }
        for name, frame in STREAMS.items()
    }
    rows = [
        (name, reader, found / 1e3, found / speeds["python-can"])
        for name, speeds in rates.items()
        for reader, found in speeds.items()
    ]
    flexible = rates["FD, 64 bytes"]
    values = {
        "slcan_fd_ratio": flexible["read_frames"] / flexible["python-can"],
        "slcan_fd_ratio_messages": flexible["recv"] / flexible["python-can"],
        "slcan_fd_frames_per_s": flexible["read_frames"],
        "slcan_classic_ratio": rates["classic"]["read_frames"] / rates["classic"]["python-can"],
    }
    note = (
        "`read_frames` is what the driver uses; `recv` creates a can.Message for each frame, like the readers "
        "of python-can."
    )
    return Outcome(values, [Table("slcan readers", ("frames", "reader", "k frames/s", "speed-up"), rows, note)])


def main() -> None:
    """Print a table."""
    scale = float(sys.argv[1]) if len(sys.argv) > 1 else 1.0
    print(f"| {'frames':12} | {'reader':11} | {'k frames/s':>10} | {'speed-up':>8} |\n|---|---|---|---|")
    for name, frame in STREAMS.items():
        own = 0.0
        for reader, count in FRAMES.items():
            speed = rate(READERS[reader], encode_line(frame), max(int(scale * count), 200))
            own = own or speed
            print(f"| {name:12} | {reader:11} | {speed / 1e3:10.2f} | {speed / own:8.0f} |", flush=True)


if __name__ == "__main__":
    main()
