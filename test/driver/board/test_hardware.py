# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""One suite for every bus: virtual, the emulated adapter with both slcan implementations, a fake SocketCAN, socketcand,
UDP multicast, and real buses.

udp_multicast needs msgpack (pip install msgpack); its datagrams do not leave this machine (hop_limit 0).

POSFET_TEST_CAN=vcan0 python -m pytest test/driver/board/test_hardware.py
    also on that SocketCAN device, with an emulated board: modprobe vcan; ip link add vcan0 type vcan;
    ip link set vcan0 mtu 72 up
POSFET_TEST_BOARD=slcan:/dev/ttyACM0 POSFET_TEST_SENSOR=my_sensor.yaml python -m pytest (the same file)
    also on a real board, as interface:channel
"""

from __future__ import annotations

import os
import socket
import uuid
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import can
import pytest

from posfet_driver.board.board_client import Board
from posfet_driver.board.command_queue import CommandError
from posfet_driver.board.faults import FaultKind, Health
from posfet_driver.bus.frame import Frame
from posfet_driver.bus.open_bus import bus_settings, open_can_bus
from posfet_driver.bus.port_search import BusOpener
from posfet_driver.clock import Clock, SystemClock
from posfet_driver.protocol.identifiers import board_frames
from posfet_driver.protocol.messages import Command
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_model.sensor.scan import Scan
from posfet_sim.emulation.firmware import BoardFirmware
from posfet_sim.emulation.slcan_adapter import EmulatedAdapter
from support.clocks import PacedClock
from support.fake_board import (
    PATIENCE,
    FakeBoard,
    assert_marked,
    board_on_bus,
    read_scans,
    read_until,
    with_fd,
    with_layout,
)
from support.fake_socketcan import FakeSocketcan
from support.fake_socketcand import FakeSocketcand

EMULATED = with_layout(load_sensor(), 5, 5, scan_rate=200.0)
REAL_BUS = os.environ.get("POSFET_TEST_CAN", "")
REAL_BOARD = os.environ.get("POSFET_TEST_BOARD", "")
BUSES = [
    "virtual",
    "slcan",
    "slcan-python-can",
    "socketcan",
    "socketcand",
    pytest.param("udp_multicast", marks=pytest.mark.skipif(not find_spec("msgpack"), reason="msgpack is missing")),
    pytest.param("can", marks=pytest.mark.skipif(not REAL_BUS, reason="POSFET_TEST_CAN names no SocketCAN device")),
    pytest.param("board", marks=pytest.mark.skipif(not REAL_BOARD, reason="POSFET_TEST_BOARD names no board")),
]


@dataclass(frozen=True)
class Bench:
    """A connected board, and whether it sends marked scans."""

    board: Board
    sensor: Sensor
    emulated: bool
    clock: Clock

    def scans(self, count: int) -> Iterator[Scan]:
        for scan in read_scans(self.board, count):
            if self.emulated:
                assert_marked(scan)
            yield scan


@contextmanager
def reserved_port() -> Iterator[int]:
    """Yield a UDP port that the kernel gives to nobody else meanwhile; sockets that share ports can be bound to it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as holder:
        holder.bind(("", 0))  # not shared yet, so that it is nobody's
        holder.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        holder.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
        yield int(holder.getsockname()[1])


def plain_slcan_has_fd() -> bool:
    """Return whether python-can's own slcan knows CAN FD, as from 4.5 on."""
    from can.interfaces.slcan import slcanBus  # noqa: PLC0415

    return hasattr(slcanBus, "_DATA_BITRATES")


@pytest.fixture(params=[True, False], ids=["fd", "classic"])
def fd(request: pytest.FixtureRequest) -> bool:
    return bool(request.param)


@pytest.fixture(params=BUSES)
def bench(request: pytest.FixtureRequest, tmp_path: Path, fd: bool, monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    bus_kind = request.param
    clock: Clock = SystemClock() if bus_kind in {"board", "can"} else PacedClock()
    sensor = EMULATED
    with ExitStack() as stack:
        firmware = BoardFirmware(with_fd(sensor, fd), FakeBoard(sensor), clock.monotonic())
        interface, channel, options = bus_kind, "", []
        if bus_kind in {"slcan", "slcan-python-can"}:
            adapter = EmulatedAdapter(tmp_path / "can0", firmware, clock)
            adapter.open()
            stack.callback(adapter.close)
            channel = str(adapter.link)
            options = [] if bus_kind == "slcan" else ["sleep_after_open=0.0"]
            if fd and bus_kind == "slcan-python-can" and not plain_slcan_has_fd():
                pytest.skip("this python-can has no CAN FD on slcan")
        elif bus_kind == "socketcand":
            if fd:
                pytest.skip("socketcand carries classic frames only")
            daemon = FakeSocketcand(firmware, clock)
            daemon.open()
            stack.callback(daemon.close)
            channel, options = "can0", ["host=127.0.0.1", f"port={daemon.port}", "tcp_tune=true"]
        elif bus_kind == "board":
            interface, _, channel = REAL_BOARD.partition(":")
            sensor = load_sensor(os.environ.get("POSFET_TEST_SENSOR") or "posfet_5x5")
            if sensor.can.fd != fd:
                pytest.skip("the board has the other frames")
        else:
            if bus_kind == "virtual":
                channel = uuid.uuid4().hex
            elif bus_kind == "socketcan":
                kernel = FakeSocketcan(monkeypatch, tmp_path / "net")
                stack.callback(kernel.close)
                kernel.add("can0")
                channel = "can0"
            elif bus_kind == "udp_multicast":
                channel, options = "239.74.163.2", ["hop_limit=0", f"port={stack.enter_context(reserved_port())}"]
            else:
                interface, channel = "socketcan", REAL_BUS
            settings = bus_settings(interface, channel, with_fd(sensor, fd).can, options=options)
            far_end: can.BusABC = stack.enter_context(open_can_bus(settings))
            stack.enter_context(board_on_bus(far_end, firmware, clock))
        sensor = with_fd(sensor, fd)
        opener = BusOpener(bus_settings(interface, channel, sensor.can, options=options), board_frames(sensor))
        board = Board(sensor, opener, clock, opener.presence)
        stack.callback(board.close)
        board.open()
        yield Bench(board, sensor, bus_kind != "board", clock)


def test_scans_are_complete_and_in_order(bench: Bench) -> None:
    sequences = [scan.sequence for scan in bench.scans(100)]
    assert sequences == list(range(sequences[0], sequences[0] + 100))
    report = bench.board.report()
    assert (report.health, report.frames_lost, report.conditions) == (Health.OK, 0, ())


def test_stamps_are_evenly_spaced(bench: Bench) -> None:
    stamps = [scan.stamp for scan in bench.scans(50)]
    assert stamps == sorted(stamps)
    assert abs(stamps[-1] - bench.clock.wall()) < PATIENCE * 1e9
    assert bench.board.stamp_uncertainty < 0.01


def test_the_board_identifies_itself(bench: Bench) -> None:
    list(bench.scans(1))
    value = bench.board.request(Command.IDENTIFY, timeout=PATIENCE).value
    assert value & 0xFFFF == bench.sensor.layout.id


def test_a_rejected_command_reports_the_reason(bench: Bench) -> None:
    list(bench.scans(1))
    with pytest.raises(CommandError, match="SET_RATE: refused by the board: bad argument"):
        bench.board.request(Command.SET_RATE, 1, timeout=PATIENCE)
    list(bench.scans(10))
    assert bench.board.restarted == 0


def test_the_board_stops_and_starts(bench: Bench) -> None:
    list(bench.scans(5))
    bench.board.request(Command.STOP, timeout=PATIENCE)
    assert bench.board.read(0.05) is None
    assert bench.board.report().state == "stopped on request"
    bench.board.request(Command.START, timeout=PATIENCE)
    list(bench.scans(5))
    assert bench.board.report().frames_lost == 0


def test_the_bus_is_reopened_after_a_failure(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    read = bench.board.bus.read

    def fail(timeout: float) -> list[Frame]:
        monkeypatch.setattr(bench.board.bus, "read", read)
        raise can.CanOperationError("pulled")

    list(bench.scans(5))
    monkeypatch.setattr(bench.board.bus, "read", fail)
    read_until(bench.board, lambda: bench.board.report().conditions == (FaultKind.ADAPTER_DISCONNECTED,))
    list(bench.scans(5))
    assert bench.board.bus.failed == 1
    assert bench.board.report().health == Health.OK
