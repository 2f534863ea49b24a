"""The SocketCAN bus: the same frames as python-can, and the errors that only the kernel reports."""

from __future__ import annotations

import logging
import socket
import struct
from collections.abc import Iterator
from pathlib import Path

import can
import pytest
from can.interfaces.socketcan.socketcan import build_can_frame

from posfet_driver.board.board_client import Board
from posfet_driver.board.faults import FaultKind
from posfet_driver.bus.error_frame import BUS_OFF, CONTROLLER, NO_ACKNOWLEDGE, OVERFLOW, error_frame
from posfet_driver.bus.frame import CLASSIC, ERROR, Frame
from posfet_driver.bus.frame_bus import FrameBus
from posfet_driver.bus.message_conversion import frame_of, message_of
from posfet_driver.bus.open_bus import BusSettings, bus_settings, open_bus, open_can_bus
from posfet_driver.bus.port_search import BusOpener
from posfet_driver.bus.socketcan_bus import READ_LIMIT
from posfet_model.sensor.description import load_sensor
from posfet_sim.emulation.firmware import BoardFirmware
from support.clocks import PacedClock
from support.fake_board import PATIENCE, FakeBoard, board_on_bus, read_scans, read_until, with_layout
from support.fake_socketcan import Device, FakeSocketcan
from support.frame_examples import FRAMES

SENSOR = with_layout(load_sensor(), 5, 5, scan_rate=200.0)
SETTINGS = bus_settings("socketcan", "can0", SENSOR.can)


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
    device.queue_full = True
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


def test_a_device_failure_is_reported(device: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    bus = open_bus(SETTINGS)
    device.deliver(build_can_frame(message_of(FRAMES[0])))

    def fail(*_: object) -> bytes:
        raise OSError(100, "Network is down")

    monkeypatch.setattr(type(device.sockets[0]), "recv", fail)
    with pytest.raises(can.CanOperationError, match="Network is down"):
        bus.read_frames(PATIENCE)
    bus.shutdown()


class Bench:
    """A board client on can0, and a board whose cable can be unplugged."""

    def __init__(self, settings: BusSettings) -> None:
        opener = BusOpener(settings)
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
    device.queue_full = True
    read_until(bench.board, lambda: bench.board.report().fault_counts[FaultKind.UNACKNOWLEDGED] > 3)
    assert bench.board.report().conditions == (FaultKind.NO_TRAFFIC,)
    assert bench.board.bus.failed == 0
    device.queue_full = False
    bench.scans()
    bench.board.close()


def test_bus_off_is_reported_until_the_controller_recovers(device: Device) -> None:
    bench = Bench(SETTINGS)
    bench.board.open()
    bench.scans()
    device.carrier(False)
    read_until(bench.board, lambda: bench.board.report().fault_counts[FaultKind.BUS_OFF] > 2)
    assert bench.board.report().conditions == (FaultKind.BUS_OFF,)
    device.carrier(True)
    bench.scans()
    assert bench.board.report().conditions == ()
    bench.board.close()


def test_a_device_that_appears_later_is_opened(
    kernel: FakeSocketcan, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(logging.getLogger(), "handlers", [])  # as in a separate process
    bench = Bench(SETTINGS)
    bench.board.open()
    assert capsys.readouterr().err == ""
    assert bench.board.report().conditions == (FaultKind.ADAPTER_DISCONNECTED,)
    assert "No such device" in bench.board.report().state
    kernel.add("can0")
    bench.scans()
    bench.board.close()
