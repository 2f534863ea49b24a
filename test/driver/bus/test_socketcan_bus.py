# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The SocketCAN bus: the same frames as python-can, and the errors that only the kernel reports."""

from __future__ import annotations

import errno
import logging
import socket
import struct
import time
from collections.abc import Iterator
from pathlib import Path

import can
import pytest
from can.interfaces.socketcan.socketcan import build_can_frame

from posfet_core.protocol import READ_LIMIT
from posfet_driver.board.board_client import Board
from posfet_driver.board.faults import FaultKind
from posfet_driver.bus.error_frame import BUS_OFF, CONTROLLER, NO_ACKNOWLEDGE, OVERFLOW, error_frame
from posfet_driver.bus.frame import CLASSIC, ERROR, EXTENDED, FD, RATE_SWITCH, REMOTE, Frame
from posfet_driver.bus.frame_bus import FrameBus
from posfet_driver.bus.message_conversion import frame_of, message_of
from posfet_driver.bus.open_bus import BusSettings, bus_settings, open_bus, open_can_bus
from posfet_driver.bus.port_search import BusOpener
from posfet_driver.protocol.identifiers import board_frames
from posfet_model.sensor.description import load_sensor
from posfet_sim.emulation.firmware import BoardFirmware
from support.clocks import PacedClock
from support.fake_board import PATIENCE, FakeBoard, board_on_bus, read_scans, read_until, with_fd, with_layout
from support.fake_socketcan import QUEUE_LENGTH, Device, DeviceSocket, FakeSocketcan
from support.frame_examples import FRAMES

SENSOR = with_layout(load_sensor(), 5, 5, scan_rate=200.0)
SETTINGS = bus_settings("socketcan", "can0", SENSOR.can)
BOARD = board_frames(SENSOR)
COMMAND, STATUS = (0x100, CLASSIC, bytes(8)), (0x102, CLASSIC, bytes(8))
OTHERS = [(0x0FF, CLASSIC, b"1"), (0x108, CLASSIC, b"2"), (0x102, EXTENDED, b"3"), (0x1234567, EXTENDED, b"4")]


@pytest.fixture
def kernel(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[FakeSocketcan]:
    kernel = FakeSocketcan(monkeypatch, tmp_path / "net")
    yield kernel
    kernel.close()


@pytest.fixture
def device(kernel: FakeSocketcan) -> Device:
    return kernel.add("can0")


def read(bus: FrameBus, count: int) -> list[Frame]:
    """Return the next frames, which have been sent."""
    frames: list[Frame] = []
    while len(frames) < count:
        come = bus.read_frames(PATIENCE)
        assert come
        frames += come
    return frames


def test_frames_equal_those_read_by_python_can(device: Device) -> None:
    messages = [message_of(frame) for frame in FRAMES]
    bus, theirs = open_bus(SETTINGS), open_can_bus(SETTINGS)
    with theirs:
        for message in messages:
            device.deliver(build_can_frame(message))
        received = [theirs.recv(PATIENCE) for _ in messages]
        assert read(bus, len(messages)) == [frame_of(message) for message in received if message] == FRAMES
        bus.shutdown()


def test_error_frames_equal_those_read_by_python_can(device: Device) -> None:
    classes, data = CONTROLLER | BUS_OFF, bytes([0, OVERFLOW, 0, 0, 0, 0, 0, 0])
    bus, theirs = open_bus(SETTINGS), open_can_bus(SETTINGS)
    with theirs:
        device.deliver(struct.pack("=IB3x8s", classes | 0x2000_0000, 8, data))
        received = theirs.recv(PATIENCE)
        assert received
        assert read(bus, 1) == [frame_of(received)] == [(classes, ERROR, data)]
        bus.shutdown()


def test_the_stamp_is_the_time_at_which_the_newest_frame_arrived(device: Device) -> None:
    bus = open_bus(SETTINGS)
    bus.read_frames(0.0)
    assert bus.arrival_stamp == 0
    begin, sent, after = time.time_ns(), 0, 0
    while not begin < bus.arrival_stamp <= sent:  # the kernel takes a moment to begin to stamp what arrives
        for frame in FRAMES:
            begin = time.time_ns()
            device.deliver(build_can_frame(message_of(frame)))
        sent = time.time_ns()
        read(bus, len(FRAMES))
        after = time.time_ns()
        assert begin < bus.arrival_stamp <= after
    bus.read_frames(0.0)
    assert bus.arrival_stamp == 0
    bus.shutdown()


@pytest.mark.parametrize("frame", FRAMES, ids=lambda frame: f"kind {frame[1]}, {len(frame[2])} bytes")
def test_sent_frames_arrive(device: Device, frame: Frame) -> None:
    bus, far_end = open_bus(SETTINGS), open_bus(SETTINGS)
    bus.write_frame(frame)
    assert read(far_end, 1) == [frame]
    assert bus.read_frames(0.0) == []
    bus.shutdown()
    far_end.shutdown()
    assert device.sockets == []


def test_receive_queue_overflow_is_reported_once(device: Device) -> None:
    bus = open_bus(SETTINGS)
    device.sockets[0].setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 16)
    data = build_can_frame(message_of((0x103, CLASSIC, bytes(8))))
    for _ in range(1000):
        device.deliver(data)
    frames = bus.read_frames(PATIENCE)
    assert 10 < len(frames) < READ_LIMIT
    assert frames[-1] == error_frame(CONTROLLER, OVERFLOW)
    assert frames.count(frames[-1]) == 1
    device.deliver(data)
    assert bus.read_frames(PATIENCE) == [(0x103, CLASSIC, bytes(8))]
    bus.shutdown()


def test_the_receive_buffer_is_larger_than_the_default(device: Device) -> None:
    bus = open_bus(SETTINGS)
    before = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    with before:
        usual = before.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
    assert device.sockets[0].getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) > 1.5 * usual
    bus.shutdown()


def test_a_full_transmit_queue_is_reported_as_unacknowledged_and_keeps_the_bus_open(device: Device) -> None:
    bus = open_bus(SETTINGS)
    device.stall(True)
    for _ in range(QUEUE_LENGTH + 1):
        assert bus.read_frames(0.0) == []
        bus.write_frame(FRAMES[0])
    assert bus.read_frames(0.0) == [error_frame(NO_ACKNOWLEDGE)]
    assert bus.read_frames(0.0) == []
    bus.shutdown()


def test_the_bus_off_state_of_the_controller_is_reported(device: Device) -> None:
    bus = open_bus(SETTINGS)
    bus.ask_state()
    assert bus.read_frames(0.0) == []
    device.carrier(False)
    bus.ask_state()
    assert bus.read_frames(0.0) == [error_frame(BUS_OFF)]
    bus.shutdown()


def test_an_interface_that_goes_down_fails_reads_and_writes(device: Device) -> None:
    reader, writer = open_bus(SETTINGS), open_bus(SETTINGS)
    device.deliver(build_can_frame(message_of(FRAMES[0])))
    device.switch(False)
    with pytest.raises(can.CanOperationError, match="Network is down"):
        reader.read_frames(PATIENCE)
    with pytest.raises(can.CanOperationError, match="Network is down"):
        writer.write_frame(FRAMES[0])
    reader.shutdown()
    writer.shutdown()


def test_a_removed_interface_is_reported_while_the_filter_is_set(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(one: DeviceSocket, level: int, *_: object) -> None:
        if level == socket.SOL_CAN_RAW:
            raise OSError(errno.ENODEV, "No such device")

    bus = open_bus(SETTINGS, BOARD)
    device.deliver(build_can_frame(message_of(STATUS)))
    monkeypatch.setattr(DeviceSocket, "setsockopt", fail)
    with pytest.raises(can.CanOperationError, match="No such device"):
        read(bus, 1)
    bus.shutdown()


@pytest.mark.parametrize(
    ("fd", "virtual", "settings"),
    [
        (True, False, "up type can bitrate 1000000 dbitrate 5000000 fd on"),
        (False, False, "up type can bitrate 1000000"),
        (True, True, "up"),
    ],
)
def test_an_interface_that_is_down_is_not_opened(
    kernel: FakeSocketcan, tmp_path: Path, fd: bool, virtual: bool, settings: str
) -> None:
    kernel.add("can0").switch(False)
    if virtual:
        (tmp_path / "net" / "can0" / "device").rmdir()
    with pytest.raises(can.CanInitializationError) as error:
        open_bus(bus_settings("socketcan", "can0", with_fd(SENSOR, fd).can))
    assert str(error.value) == f"socketcan:can0: the interface is down: sudo ip link set can0 {settings}"


@pytest.mark.parametrize("virtual", [False, True])
def test_an_interface_without_fd_is_not_opened_for_a_board_that_sends_it(
    kernel: FakeSocketcan, tmp_path: Path, virtual: bool
) -> None:
    kernel.add("can0", fd=False)
    if virtual:
        (tmp_path / "net" / "can0" / "device").rmdir()
    settings = "mtu 72 up" if virtual else "up type can bitrate 1000000 dbitrate 5000000 fd on"
    with pytest.raises(can.CanInitializationError) as error:
        open_bus(SETTINGS)
    assert str(error.value) == (
        "socketcan:can0: the board sends CAN FD, the interface carries classic CAN only (mtu 16): "
        f"sudo ip link set can0 down; sudo ip link set can0 {settings}"
    )
    open_bus(bus_settings("socketcan", "can0", with_fd(SENSOR, False).can)).shutdown()


def test_commands_that_an_earlier_socket_left_in_the_queue_are_not_received(device: Device) -> None:
    device.stall(True)
    earlier = open_bus(SETTINGS, BOARD)
    earlier.write_frame(COMMAND)
    earlier.shutdown()
    bus, anyone = open_bus(SETTINGS, BOARD), open_bus(SETTINGS)
    device.stall(False)
    device.deliver(build_can_frame(message_of(OTHERS[0])))
    assert read(anyone, 2) == [COMMAND, OTHERS[0]]
    assert read(bus, 1) == OTHERS[:1]
    bus.shutdown()
    anyone.shutdown()


def test_frames_of_other_nodes_are_received_only_while_the_board_is_silent(device: Device) -> None:
    def deliver(frames: list[Frame]) -> None:
        for frame in frames:
            device.deliver(build_can_frame(message_of(frame)))

    scan = (0x103, FD | RATE_SWITCH, bytes(64))
    bus = open_bus(SETTINGS, BOARD)
    deliver([*OTHERS, STATUS])
    assert read(bus, 5) == [*OTHERS, STATUS]
    deliver([*OTHERS, scan])
    assert read(bus, 1) == [scan]
    bus.ask_state()
    deliver(OTHERS)
    assert read(bus, 4) == OTHERS
    bus.shutdown()


@pytest.mark.parametrize(("base", "blocks"), [(0x100, 5), (0x0F9, 1), (0x3A5, 300), (0, 1300)])
def test_the_filter_receives_all_identifiers_of_the_board_and_no_other(device: Device, base: int, blocks: int) -> None:
    sensor = with_layout(SENSOR, blocks, 5, fd=False, base_id=base)
    bus = open_bus(SETTINGS, board_frames(sensor))
    received = range(base + 1, base + 8 + blocks)
    device.deliver(build_can_frame(message_of((base + 2, CLASSIC, bytes(8)))))
    read(bus, 1)
    (one,) = device.sockets
    frames = [(identifier, kind, b"") for identifier in range(0x800) for kind in (CLASSIC, EXTENDED)]
    accepted = [frame[:2] for frame in frames if one.accepts(build_can_frame(message_of(frame)))]
    assert accepted == [(identifier, CLASSIC) for identifier in received]
    assert one.accepts(build_can_frame(message_of((base + 2, REMOTE, bytes(8)))))  # counted as malformed
    assert len(one.filters) < 20
    bus.shutdown()


class Bench:
    """A board client on can0, and a board whose cable can be unplugged."""

    def __init__(self, settings: BusSettings) -> None:
        opener = BusOpener(settings, BOARD)
        self.clock = PacedClock()
        self.board = Board(SENSOR, opener, self.clock, opener.presence)
        self.firmware = BoardFirmware(SENSOR, FakeBoard(SENSOR), self.clock.monotonic())
        self.settings = settings

    def scans(self) -> None:
        """Plug in the cable and wait for scans."""
        with open_can_bus(self.settings) as far_end, board_on_bus(far_end, self.firmware, self.clock):
            list(read_scans(self.board, 5))


def test_an_unplugged_cable_is_not_reported_as_a_disconnected_adapter(device: Device) -> None:
    bench = Bench(SETTINGS)
    bench.board.open()
    bench.scans()
    device.queue_length = 2
    device.stall(True)
    read_until(bench.board, lambda: bench.board.report().fault_counts[FaultKind.UNACKNOWLEDGED] > 3)
    assert bench.board.report().conditions == (FaultKind.NO_TRAFFIC,)
    assert bench.board.bus.failed == 0
    device.stall(False)
    bench.scans()
    assert bench.board.report().counters["unrelated frames"] == 0
    bench.board.close()


def test_an_interface_that_goes_down_and_up_is_used_again(device: Device) -> None:
    bench = Bench(SETTINGS)
    bench.board.open()
    bench.scans()
    device.switch(False)
    read_until(bench.board, lambda: "sudo ip link set can0 up" in bench.board.report().state)
    assert bench.board.report().conditions == (FaultKind.ADAPTER_DISCONNECTED,)
    device.switch(True)
    bench.scans()
    assert bench.board.bus.failed == 1
    bench.board.close()


def test_an_interface_that_gets_fd_later_is_used(kernel: FakeSocketcan, tmp_path: Path) -> None:
    kernel.add("can0", fd=False)
    bench = Bench(SETTINGS)
    bench.board.open()
    assert "fd on" in bench.board.report().state
    (tmp_path / "net" / "can0" / "mtu").write_text("72\n")
    bench.scans()
    bench.board.close()


def test_bus_off_is_reported_until_the_controller_recovers(device: Device) -> None:
    bench = Bench(SETTINGS)
    bench.board.open()
    bench.scans()
    device.carrier(False)
    read_until(bench.board, lambda: bench.board.report().counters["bus reopened"] > 2)
    report = bench.board.report()
    assert report.conditions == (FaultKind.BUS_OFF,)
    assert (report.fault_counts[FaultKind.BUS_OFF], report.counters["bus losses"]) == (1, 1)
    device.carrier(True)
    bench.scans()
    assert bench.board.report().conditions == ()
    bench.board.close()


def test_a_device_that_appears_later_is_opened(
    kernel: FakeSocketcan, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(logging.getLogger(), "handlers", [])  # as in a separate process, ...
    for name in [name for name in logging.Logger.manager.loggerDict if name.startswith("can.")]:
        monkeypatch.setattr(logging.getLogger(name), "propagate", True)  # ... which has not imported launch
    bench = Bench(SETTINGS)
    bench.board.open()
    assert capsys.readouterr().err == ""
    assert bench.board.report().conditions == (FaultKind.ADAPTER_DISCONNECTED,)
    assert "No such device" in bench.board.report().state
    kernel.add("can0")
    bench.scans()
    bench.board.close()
