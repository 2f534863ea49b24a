# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Every slcan reader verified against that of python-can on the same bytes: frames, replies, malformed lines."""

from __future__ import annotations

import os
import random
import select
import time
import tty
from collections.abc import Callable, Iterator

import can
import pytest

from posfet_driver.bus.frame import EXTENDED, FD, Frame
from posfet_driver.bus.message_conversion import frame_of
from posfet_driver.bus.slcan_bus import SlcanBus
from posfet_driver.bus.slcan_codec import encode_line
from support.fake_board import PATIENCE
from support.frame_examples import FRAMES

pytest.importorskip("serial", reason="needs pyserial")
slcan = pytest.importorskip("can.interfaces.slcan")
BufferedSlcanBus = pytest.importorskip("benchmarks.micro.buffered_slcan").BufferedSlcanBus
if not hasattr(slcan.slcanBus, "_DATA_BITRATES"):
    pytest.skip("python-can's own slcan has CAN FD from 4.5 on", allow_module_level=True)

REPLIES = [b"\r", b"\a", b"z\r", b"Z\r", b"V1013\r", b"NPSFT\r", b"F00\r"]
BROKEN = [b"t12\r", b"t1238001122\r", b"tXYZ10\r", b"q123\r", b"T0000012310\r", b"t12G1FF\r"]

OPENERS: dict[str, Callable[[str], can.BusABC]] = {
    "python-can": lambda port: slcan.slcanBus(port, sleep_after_open=0),
    "buffered": lambda port: BufferedSlcanBus(port, sleep_after_open=0),
    "ours": lambda port: SlcanBus(port, fd=True),
}


class Port:
    """A pseudo-terminal with one bus connected to it."""

    def __init__(self, reader: str) -> None:
        self.master, self.slave = os.openpty()
        tty.setraw(self.slave)
        self.bus = OPENERS[reader](os.ttyname(self.slave))

    def close(self) -> None:
        self.bus.shutdown()
        os.close(self.master)
        os.close(self.slave)

    def receive(self, pieces: list[bytes], last: Frame) -> list[Frame | str]:
        """Write bytes in chunks; return the frames and exception types received, up to the frame `last`."""
        out: list[Frame | str] = []
        for piece in pieces:
            os.write(self.master, piece)
            self._take(out, 0.0)
        os.write(self.master, encode_line(last))
        end = time.monotonic() + PATIENCE
        while out[-1:] != [last]:
            self._take(out, 0.1)
            assert time.monotonic() < end, out
        return out[:-1]

    def _take(self, out: list[Frame | str], timeout: float) -> None:
        """Return what is available, or wait for one item."""
        while True:
            try:
                message = self.bus.recv(timeout)
            except (ValueError, IndexError, can.CanError) as error:
                out.append(type(error).__name__)
                return
            if message is None:
                return
            out.append(frame_of(message))
            if timeout:
                return


@pytest.fixture
def ports() -> Iterator[dict[str, Port]]:
    ports = {name: Port(name) for name in OPENERS}
    yield ports
    for port in ports.values():
        port.close()


def pieces(noise: random.Random, data: bytes) -> list[bytes]:
    cuts = sorted(noise.randrange(len(data)) for _ in range(len(data) // 40))
    return [data[low:high] for low, high in zip([0, *cuts], [*cuts, len(data)], strict=True) if high > low]


LAST: Frame = (0x7AB, 0, b"\xab\xcd")


@pytest.mark.parametrize("seed", range(3))
def test_all_readers_receive_the_same_frames_among_replies(ports: dict[str, Port], seed: int) -> None:
    noise = random.Random(seed)
    sent = [noise.choice(FRAMES) for _ in range(30)]
    lines = [encode_line(frame) for frame in sent]
    for _ in range(20):
        lines.insert(noise.randrange(len(lines)), noise.choice(REPLIES))
    stream = pieces(noise, b"".join(lines))
    for name, port in ports.items():
        assert port.receive(stream, LAST) == sent, name


def test_the_buffered_reader_handles_malformed_lines_like_python_can(ports: dict[str, Port]) -> None:
    for line in BROKEN:
        stream = [encode_line(FRAMES[0]) + line + encode_line(FRAMES[2])]
        assert ports["buffered"].receive(stream, LAST) == ports["python-can"].receive(stream, LAST), line


def test_slcan_bus_counts_malformed_lines_and_continues(ports: dict[str, Port]) -> None:
    ours = ports["ours"]
    for count, line in enumerate(BROKEN, 1):
        assert ours.receive([encode_line(FRAMES[0]) + line + encode_line(FRAMES[2])], LAST) == [FRAMES[0], FRAMES[2]]
        assert ours.bus.unreadable == count


def test_all_buses_send_the_same_lines(ports: dict[str, Port]) -> None:
    for frame in FRAMES:
        identifier, kind, data = frame
        message = can.Message(
            arbitration_id=identifier,
            is_extended_id=bool(kind & EXTENDED),
            is_fd=bool(kind & FD),
            is_remote_frame=bool(kind & 2),
            bitrate_switch=bool(kind & 16),
            dlc=len(data),
            data=None if kind & 2 else data,
        )
        lines = {}
        for name, port in ports.items():
            while select_readable(port.master):
                os.read(port.master, 4096)
            port.bus.send(message)
            lines[name] = os.read(port.master, 4096)
        assert set(lines.values()) == {encode_line(frame)}, lines


def select_readable(descriptor: int) -> bool:
    return bool(select.select([descriptor], [], [], 0)[0])


def test_flush_discards_received_frames(ports: dict[str, Port]) -> None:
    bus = ports["buffered"].bus
    os.write(ports["buffered"].master, encode_line(FRAMES[0]) * 3)
    assert bus.recv(PATIENCE) is not None
    bus.flush()
    assert bus.recv(0) is None
