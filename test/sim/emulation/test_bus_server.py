# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A node connected to a bus of python-can: what it sends, what it answers, and what it reports when the bus fails."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from itertools import count

import can
import pytest

from posfet_driver.board.scan_source import SourceError
from posfet_driver.bus.frame import CLASSIC, FD, RATE_SWITCH, Frame
from posfet_driver.bus.open_bus import BusSettings
from posfet_model.config import ConfigError
from posfet_sim.emulation import bus_server
from posfet_sim.emulation.bus_server import BusServer
from support.clocks import PacedClock, SteppedClock

DEADLINE = 120.0
MILLISECOND = 1_000_000
_channels = count()


class CountingNode:
    """Sends a frame with its number every `interval` [ns], and answers each frame with its data reversed."""

    def __init__(self, interval: int = MILLISECOND, limit: int = 1 << 30) -> None:
        self.received: list[Frame] = []
        self.answered = threading.Event()
        self._interval, self._limit = interval, limit
        self._next, self._number = 0, 0

    def next_due(self) -> int:
        return self._next

    def due(self, now: int, until: int | None = None) -> list[Frame]:
        frames: list[Frame] = []
        while self._next <= now:
            if self._number < self._limit:
                frames.append((0x100, FD | RATE_SWITCH, self._number.to_bytes(4, "big") * 4))
                self._number += 1
            self._next = (self._next or now) + self._interval
        return frames

    def receive(self, frame: Frame, now: int) -> list[Frame]:
        self.received.append(frame)
        self.answered.set()
        return [(0x200, CLASSIC, frame[2][::-1])]


def settings() -> BusSettings:
    return BusSettings("virtual", f"bus server {next(_channels)}", 1_000_000, 5_000_000, True)


@pytest.fixture
def bus() -> Iterator[tuple[BusSettings, can.BusABC]]:
    chosen = settings()
    other = can.Bus(interface="virtual", channel=chosen.channel)
    yield chosen, other
    other.shutdown()


def messages(other: can.BusABC, identifier: int, number: int) -> list[can.Message]:
    """Return the first messages with this identifier."""
    found: list[can.Message] = []
    while len(found) < number:
        message = other.recv(DEADLINE)
        assert message is not None, "nothing came"
        found += [message] * (message.arbitration_id == identifier)
    return found


def test_what_is_due_reaches_the_bus_in_order(bus: tuple[BusSettings, can.BusABC]) -> None:
    chosen, other = bus
    server = BusServer(chosen, CountingNode(), PacedClock(main=False))
    server.open()
    try:
        found = messages(other, 0x100, 30)
    finally:
        server.close()
    assert [int.from_bytes(message.data[:4], "big") for message in found] == list(range(30))
    assert all(message.is_fd and message.bitrate_switch and len(message.data) == 16 for message in found)
    assert server.frames_sent >= 30
    assert server.frames_dropped == 0
    assert (server.disconnected, server.failure) == ("", "")


def test_a_frame_is_answered_although_nothing_is_due_for_long(bus: tuple[BusSettings, can.BusABC]) -> None:
    chosen, other = bus
    node = CountingNode(interval=10**18)
    server = BusServer(chosen, node, PacedClock(main=False))
    server.open()
    try:
        for number in range(3):
            other.send(can.Message(arbitration_id=0x101, data=[number, 7], is_extended_id=False))
            (answer,) = messages(other, 0x200, 1)
            assert list(answer.data) == [7, number]
    finally:
        server.close()
    assert [frame for frame in node.received if frame[0] == 0x101] == [
        (0x101, CLASSIC, bytes([number, 7])) for number in range(3)
    ]


def test_close_ends_the_thread_twice_and_open_serves_again(bus: tuple[BusSettings, can.BusABC]) -> None:
    chosen, other = bus
    before = set(threading.enumerate())
    server = BusServer(chosen, CountingNode(limit=1), PacedClock(main=False))
    server.close()  # nothing is open yet
    server.open()
    messages(other, 0x100, 1)
    server.close()
    server.close()
    assert set(threading.enumerate()) <= before
    other.send(can.Message(arbitration_id=0x101, data=[1], is_extended_id=False))
    assert other.recv(0) is None
    server.open()
    other.send(can.Message(arbitration_id=0x101, data=[2], is_extended_id=False))
    (answer,) = messages(other, 0x200, 1)
    server.close()
    assert list(answer.data) == [2]


class FailingBus:
    """A bus that accepts `room` frames and fails to read after `reads` calls."""

    unreadable = 0
    arrival_stamp = 0
    must_be_asked = False
    port, read_by_port = None, False

    def __init__(self, clock: SteppedClock, room: int, reads: int) -> None:
        self.failed = threading.Event()
        self.timeouts: list[float] = []
        self.closed = False
        self.incoming: list[Frame] = []
        self.written: list[Frame] = []
        self._clock, self._room, self._reads = clock, room, reads

    def read_frames(self, timeout: float) -> list[Frame]:
        self.timeouts.append(timeout)
        self._clock.now += round(timeout * 1e9)
        self._reads -= 1
        if self._reads < 0:
            self.failed.set()
            raise can.CanOperationError("cable\nout")
        frames, self.incoming = self.incoming, []
        return frames

    def refill(self, room: int) -> None:
        self._room = room

    def write_frame(self, frame: Frame) -> bool:
        if self._room == 0:
            raise can.CanOperationError("no room")
        self._room -= 1
        self.written.append(frame)
        return True

    def ask_state(self) -> None: ...

    def shutdown(self) -> None:
        self.closed = True


def serve(
    monkeypatch: pytest.MonkeyPatch, node: CountingNode, room: int, reads: int, incoming: tuple[Frame, ...] = ()
) -> tuple[BusServer, FailingBus]:
    """Serve a failing bus in stepped time until it has failed."""
    clock = SteppedClock(now=1_000_000_000)
    made = FailingBus(clock, room, reads)
    made.incoming += incoming
    buses = [made]

    def open_once(_: BusSettings) -> FailingBus:
        if not buses:
            raise can.CanInitializationError("out for good")
        return buses.pop()

    monkeypatch.setattr(bus_server, "open_bus", open_once)
    server = BusServer(settings(), node, clock)
    server.open()
    assert made.failed.wait(DEADLINE)
    server.close()
    return server, made


def test_what_the_bus_has_no_room_for_waits_and_what_follows_is_dropped_and_counted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    server, made = serve(monkeypatch, CountingNode(limit=10), room=4, reads=10)
    # One frame is due in each of the ten rounds; the fifth waits until the bus is closed.
    assert (server.frames_sent, server.frames_dropped) == (4, 6)
    assert made.closed


def test_answers_wait_for_room_while_scans_fill_the_bus(monkeypatch: pytest.MonkeyPatch) -> None:
    """A slow process sends the scans of 40 ms at once: more than the send queue of an interface holds."""
    commands: list[Frame] = [(0x101, CLASSIC, bytes([number])) for number in range(3)]
    clock = SteppedClock(now=1_000_000_000)
    made = FailingBus(clock, room=0, reads=40)
    read = made.read_frames

    def read_slowly(timeout: float) -> list[Frame]:
        made.refill(10)
        if len(made.timeouts) % 10 == 5 and commands:
            made.incoming.append(commands.pop())
        frames = read(timeout)
        clock.now += 40 * MILLISECOND
        return frames

    monkeypatch.setattr(made, "read_frames", read_slowly)
    monkeypatch.setattr(bus_server, "open_bus", lambda _: made)
    server = BusServer(settings(), CountingNode(), clock)
    server.open()
    assert made.failed.wait(DEADLINE)
    server.close()
    assert [data for identifier, _, data in made.written if identifier == 0x200] == [b"\x02", b"\x01", b"\x00"]
    assert server.frames_dropped > 500


def test_what_was_due_before_a_command_is_sent_before_its_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    command: Frame = (0x101, CLASSIC, b"\x01\x02")
    _, made = serve(monkeypatch, CountingNode(), room=100, reads=1, incoming=(command, command))
    assert [identifier for identifier, _, _ in made.written] == [0x100, 0x200, 0x200]
    assert made.written[1] == (0x200, CLASSIC, b"\x02\x01")


def test_a_bus_that_fails_is_opened_again(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = SteppedClock(now=1_000_000_000)
    first, second = FailingBus(clock, room=100, reads=1), FailingBus(clock, room=100, reads=50)
    attempts: list[tuple[str, int]] = []

    def open_next(_: BusSettings) -> FailingBus:
        attempts.append((server.disconnected, server.frames_dropped))
        if len(attempts) in {1, 4}:
            return first if len(attempts) == 1 else second
        raise can.CanInitializationError("still\nout")

    monkeypatch.setattr(bus_server, "open_bus", open_next)
    server = BusServer(settings(), CountingNode(20 * MILLISECOND), clock)
    server.open()
    assert second.failed.wait(DEADLINE)
    server.close()
    assert [failure for failure, _ in attempts[:4]] == ["", "cable out", "still out", "still out"]
    assert first.closed
    assert second.closed
    before, after = ([int.from_bytes(data[:4], "big") for _, _, data in bus.written] for bus in (first, second))
    assert before == [0]
    _, lost = attempts[3]
    assert lost >= 15  # three waits of 100 ms
    assert after == list(range(1 + lost, 1 + lost + len(after)))
    assert len(after) > 5


def test_an_error_of_the_node_ends_the_service_with_its_reason_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    made = FailingBus(SteppedClock(), 1, 1)
    monkeypatch.setattr(bus_server, "open_bus", lambda _: made)
    node = CountingNode()
    ended = threading.Event()

    def fail(now: int, until: int | None = None) -> list[Frame]:
        ended.set()
        raise ZeroDivisionError("no\nsuch number")

    node.due = fail
    server = BusServer(settings(), node, SteppedClock())
    server.open()
    assert ended.wait(DEADLINE)
    server.close()
    assert server.failure == "ZeroDivisionError: no such number"
    assert made.closed


def test_the_bus_is_read_until_the_next_frame_is_due_but_not_for_long(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bus_server, "IDLE", 0.1)  # every test shortens it, as other threads wait for its thread
    _, often = serve(monkeypatch, CountingNode(20 * MILLISECOND), room=100, reads=5)
    assert often.timeouts == pytest.approx([0.0] + [0.02] * 5)
    _, seldom = serve(monkeypatch, CountingNode(250 * MILLISECOND), room=100, reads=6)
    assert seldom.timeouts == pytest.approx([0.0, 0.1, 0.1, 0.05, 0.1, 0.1, 0.05])


def test_a_bus_that_cannot_be_opened_now_is_an_error_of_the_source(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: BusSettings) -> None:
        raise can.CanInitializationError("no such\n device")

    monkeypatch.setattr(bus_server, "open_bus", fail)
    server = BusServer(settings(), CountingNode())
    with pytest.raises(SourceError, match=r"^no such device$"):
        server.open()
    server.close()


def test_invalid_settings_are_an_error_of_the_configuration() -> None:
    with pytest.raises(ConfigError, match="CAN interface must be one of"):
        BusServer(BusSettings("no such interface", "0", 1, 1, True), CountingNode()).open()
