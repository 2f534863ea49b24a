"""Frames a second that each slcan reader takes from the same byte stream: `python -m benchmarks.micro.slcan_readers`.

A process of its own writes the stream to a pseudo-terminal as fast as it is taken. Readers: python-can's own, the same
with our buffered reader (`slcan_upstream.py`), and our bus, through recv() and through read_frames().
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
"""Frames that each reader is given."""
STREAMS = {"classic": (0x108, CLASSIC, bytes(range(8))), "FD, 64 bytes": (0x103, FD | RATE_SWITCH, bytes(range(64)))}


@dataclass(frozen=True)
class Reader:
    """How to open a bus and take frames from it; `take` returns how many it took."""

    open: Callable[[str], can.BusABC]
    take: Callable[[can.BusABC], int]


def recv(bus: can.BusABC) -> int:
    """Take one message."""
    return int(bus.recv(1.0) is not None)


READERS = {
    "python-can": Reader(lambda port: can.Bus(interface="slcan", channel=port, sleep_after_open=0), recv),
    "buffered": Reader(lambda port: BufferedSlcanBus(port, sleep_after_open=0), recv),
    "recv": Reader(lambda port: SlcanBus(port, fd=True), recv),
    "read_frames": Reader(lambda port: SlcanBus(port, fd=True), lambda bus: len(bus.read_frames(1.0))),
}


def rate(reader: Reader, line: bytes, frames: int) -> float:
    """Return frames a second."""
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
    taken, begin = 0, time.perf_counter()
    try:
        while taken < frames:
            taken += reader.take(bus)
        seconds = time.perf_counter() - begin
    finally:
        os.kill(writer, 9)
        os.waitpid(writer, 0)
        bus.shutdown()
        os.close(master)
        os.close(slave)
    return taken / seconds


def measure(full: bool) -> Outcome:
    """Let each reader take the same streams."""
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
        "`read_frames` is what the driver uses; `recv` makes a can.Message of each frame, as python-can's readers do."
    )
    return Outcome(values, [Table("slcan readers", ("frames", "reader", "k frames/s", "times"), rows, note)])


def main() -> None:
    """Print a table."""
    scale = float(sys.argv[1]) if len(sys.argv) > 1 else 1.0
    print(f"| {'frames':12} | {'reader':11} | {'k frames/s':>10} | {'times':>6} |\n|---|---|---|---|")
    for name, frame in STREAMS.items():
        own = 0.0
        for reader, count in FRAMES.items():
            speed = rate(READERS[reader], encode_line(frame), max(int(scale * count), 200))
            own = own or speed
            print(f"| {name:12} | {reader:11} | {speed / 1e3:10.2f} | {speed / own:6.0f} |", flush=True)


if __name__ == "__main__":
    main()
