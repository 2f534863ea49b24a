# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The loop that reads a bus without Python gives what Python makes of the same bytes, exactly."""

from __future__ import annotations

import fcntl
import os
import random
import select
import socket
import struct
import termios
import threading
import time
import tty
from abc import abstractmethod

import pytest

from posfet_core.protocol import ArrivalTime, FramePort, LinePort, LineReader, LoopControl, LoopEnd, SocketPort
from posfet_driver.bus.frame import ERROR, Frame
from posfet_model.sensor.description import Sensor
from reference.protocol import kernel_frames, slcan_lines
from support.decoder_pair import SENSOR, WALL, Pair, fields, run, seen
from support.frame_examples import LineStream, to_kernel
from support.long_cases import crossed, long_cases
from support.python_sink import LAST, REFUSED, TAKEN, CScan, PythonSink

PATIENCE = 120.0
"""After this time [s] a test has failed."""
LONGEST = 4000
"""Bytes that a terminal holds at once, nearly."""


def wait_for(condition: object) -> None:
    """Wait until a condition holds, a callable without arguments."""
    end = time.monotonic() + PATIENCE
    while not condition():  # type: ignore[operator]
        assert time.monotonic() < end


class LoopPair(Pair):
    """Gives bytes to the loop, and the frames in them, as Python reads them, to the decoder in Python."""

    port: FramePort

    def __init__(self, sensor: Sensor) -> None:
        super().__init__(sensor)
        self.noise = random.Random(11)
        self.found: list[object] = []
        self.handed = self.refused = 0
        self.sink = PythonSink(self._take)
        self.connect()
        self.loop = self.ours.make_loop(self.port, LoopControl(), ArrivalTime())

    @abstractmethod
    def connect(self) -> None:
        """Make the port."""

    @abstractmethod
    def send(self, frames: list[Frame]) -> list[Frame]:
        """Send bytes to the port; return the frames in them, as Python reads them."""

    def _take(self, scan: CScan) -> int:
        what = self.noise.choice([TAKEN] * 20 + [LAST, REFUSED])
        if what != REFUSED:
            assert scan.sensors == 2
            self.found.append(
                (scan.stamp, scan.sequence, scan.device_time, scan.status, tuple(scan.counts[: scan.taxels]))
            )
        return what

    def decode(self, frames: list[Frame], arrival: int, wall_offset: int, most: int = 0) -> None:
        del arrival, wall_offset, most  # the loop has its own clocks, and decodes all
        while frames:
            batch, frames = frames[:20], frames[20:]
            self.decode_batch(batch)

    def decode_batch(self, frames: list[Frame]) -> None:
        read = self.send(frames)
        self.found.clear()
        arrival, wall_offset, before = None, WALL, self.loop.arrival
        while (end := self.loop.run(self.sink.capsule, 0.0)) != LoopEnd.TIMEOUT:
            if end == LoopEnd.SCAN:
                self.refused += 1
                self.found.append(short(fields(self.ours.scan)))
            elif end == LoopEnd.MESSAGE:
                self.found.append(repr(self.ours.message(self.loop.message)))
            elif end == LoopEnd.HANDED:
                assert arrival is None and self.port.read(0.0) == read
                self.handed += 1
                arrival = time.monotonic_ns()
                self.found += map(short, map(seen, self.ours.decode(read, arrival, WALL)))
                self.clear_flags()
        if arrival is None and self.loop.arrival != before:
            arrival, wall_offset = self.loop.arrival, self.loop.wall_offset
        if arrival is not None:
            expected = [short(seen(result)) for result in self.theirs.decode(read, arrival, wall_offset)]
            assert self.found == expected
        else:
            assert read == []
        self.published = self.ours.scans
        self.compare()

    def clear_flags(self) -> None:
        """Note that the flags of the adapter were read."""


def short(found: object) -> object:
    """Return of a scan what a sink is given."""
    if not isinstance(found, tuple):
        return found
    stamp, sequence, device_time, status, _, _, counts, _ = found
    return stamp, sequence, device_time, status, struct.unpack(f"={len(counts) // 2}H", counts)


class Lines(LoopPair):
    """The bytes are those of a slcan adapter on a terminal, in any pieces, with lines that are no frames."""

    def connect(self) -> None:
        self.master, self.slave = os.openpty()
        tty.setraw(self.slave)
        os.set_blocking(self.slave, False)
        self.readers = LineReader(), slcan_lines.LineReader()
        self.port = LinePort(self.slave, self.readers[0])
        self.stream = LineStream(self.noise)

    def send(self, frames: list[Frame]) -> list[Frame]:
        data = self.stream.piece(frames)
        assert len(data) < LONGEST
        os.write(self.master, data)
        wait_for(lambda: struct.unpack("i", fcntl.ioctl(self.slave, termios.FIONREAD, bytes(4))) == (len(data),))
        return self.readers[1].frames(data)

    def compare(self) -> None:
        ours, theirs = self.readers
        assert (ours.malformed, ours.refusals) == (theirs.malformed, theirs.refusals)
        super().compare()

    def clear_flags(self) -> None:
        ours, theirs = self.readers
        assert ours.flags == theirs.flags is not None
        ours.flags = theirs.flags = None

    def close(self) -> None:
        os.close(self.master)
        os.close(self.slave)


class Reads(LoopPair):
    """The bytes are those of a socket, a frame in each datagram."""

    def connect(self) -> None:
        self.ends = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.port = SocketPort(self.ends[1].fileno())

    def send(self, frames: list[Frame]) -> list[Frame]:
        reads = [to_kernel(frame) for frame in frames]
        for data in reads:
            self.ends[0].send(data)
        return [kernel_frames.parse_kernel_frame(data) for data in reads]

    def close(self) -> None:
        for end in self.ends:
            end.close()


@pytest.mark.parametrize(
    ("pair", "fd"),
    long_cases(
        crossed({"Lines": Lines, "Reads": Reads}, {"fd": True, "classic": False}), ["Lines-classic", "Reads-fd"]
    ),
)
def test_the_loop_gives_the_scans_messages_and_counters_of_the_frames(pair: type[Lines | Reads], fd: bool) -> None:
    published = handed = refused = 0
    for seed in range(100, 108):
        played = run(seed, fd, 300, pair)
        published, handed, refused = published + played.published, handed + played.handed, refused + played.refused
        played.close()
    assert published > 500 and handed > 3 and refused > 10


def test_a_batch_with_an_error_frame_is_handed_to_the_next_reader() -> None:
    pair = Reads(SENSOR)
    frames = [(1, 0, b"\0"), (4, ERROR, bytes(8)), (2, 0, b"\1")]
    pair.send(frames)
    assert pair.loop.run(pair.sink.capsule, PATIENCE) == LoopEnd.HANDED
    assert pair.port.read(0.0) == frames
    assert pair.port.read(0.0) == []
    pair.close()


def test_a_terminal_that_is_gone_is_told_to_the_next_reader() -> None:
    pair = Lines(SENSOR)
    os.close(pair.master)
    assert pair.loop.run(pair.sink.capsule, PATIENCE) == LoopEnd.HANDED
    with pytest.raises(EOFError, match="end of file"):
        pair.port.read(0.0)
    os.close(pair.slave)


def test_an_error_of_the_descriptor_is_told_to_the_next_reader() -> None:
    pair = Reads(SENSOR)
    pair.close()
    assert pair.loop.run(pair.sink.capsule, PATIENCE) == LoopEnd.HANDED
    with pytest.raises(OSError, match="Bad file descriptor"):
        pair.port.read(0.0)


def test_waking_ends_a_loop_that_waits_and_the_next_one_that_does_not() -> None:
    pair, control, ended = Reads(SENSOR), LoopControl(), threading.Event()
    loop = pair.ours.make_loop(pair.port, control, ArrivalTime())
    ends: list[LoopEnd] = []

    def wait() -> None:
        ends.append(loop.run(pair.sink.capsule, PATIENCE))
        ended.set()

    thread = threading.Thread(target=wait)
    thread.start()
    control.wake()
    assert ended.wait(PATIENCE)
    thread.join()
    control.wake()
    ends.append(loop.run(pair.sink.capsule, PATIENCE))
    assert ends == [LoopEnd.WOKEN, LoopEnd.WOKEN]
    assert loop.run(pair.sink.capsule, 0.0) == LoopEnd.TIMEOUT
    pair.close()


def test_the_stamp_of_the_kernel_is_the_arrival() -> None:
    near, far = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
    with near, far:
        near.bind(("127.0.0.1", 0))
        port = SocketPort(near.fileno())
        begin = sent = 0
        while not begin < port.stamp <= sent:  # the kernel takes a moment to begin to stamp what arrives
            begin = time.time_ns()
            far.sendto(to_kernel((1, 0, b"\0")), near.getsockname())
            sent = time.time_ns()
            assert select.select([near], [], [], PATIENCE)[0]
            assert port.read(0.0) == [(1, 0, b"\0")]
        assert port.read(0.0) == [] and port.stamp == 0
