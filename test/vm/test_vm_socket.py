# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The socket of a real kernel: filters and time stamps, and that the fake one of the other tests behaves alike."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

import support.flood
from posfet.can import main
from posfet_driver.board.faults import FaultKind
from posfet_driver.bus.frame import CLASSIC
from posfet_driver.bus.open_bus import BusSettings, open_bus
from support.fake_board import PATIENCE
from support.fake_socketcan import Device, FakeSocketcan
from support.kernel_can import Interface, Wire, run, virtual_wire
from support.socket_behaviour import down_and_up, filtered, stalled_queue
from support.vm_bench import VmBench

pytestmark = pytest.mark.vm

OpenWire = Callable[..., Wire]
MakeBench = Callable[[Wire], VmBench]


@contextmanager
def flood(interface: Interface) -> Iterator[None]:
    """Send frames of other nodes on an interface, from another process."""
    with subprocess.Popen([sys.executable, support.flood.__file__, interface.name], stdin=subprocess.PIPE) as sender:
        try:
            yield
            assert sender.poll() is None
        finally:
            sender.communicate()


@pytest.mark.parametrize("fd", [True, False], ids=["fd", "classic"])
def test_frames_of_other_nodes_do_not_reach_the_driver_while_the_board_sends(bench: MakeBench, fd: bool) -> None:
    with virtual_wire(fd) as wire:
        made = bench(wire)
        made.scans()
        anyone, others = open_bus(made.settings(wire.driver)), 0

        def flooded() -> bool:
            nonlocal others
            others += sum(identifier >= support.flood.IDENTIFIER for identifier, *_ in anyone.read_frames(0.0))
            return others > 1000

        with flood(wire.board):
            made.until(flooded)
        anyone.shutdown()
        unrelated = made.board.report().counters["unrelated frames"]
        assert unrelated == 0 or (made.board.restarted and unrelated < others / 2)  # it was silent, on a busy machine
        assert made.count(FaultKind.RECEIVE_OVERFLOWS) == 0


def test_frames_of_other_nodes_tell_a_missing_board_from_a_silent_bus(bench: MakeBench) -> None:
    with virtual_wire(fd=True) as wire:
        made = bench(wire)
        made.scans()
        made.server.close()
        made.until(lambda: made.conditions == (FaultKind.NO_TRAFFIC,))
        with flood(wire.board):
            made.until(lambda: made.conditions == (FaultKind.BOARD_NOT_DETECTED,))
        made.server.open()
        made.until_healthy()


def test_list_finds_the_board_and_says_how_to_set_an_interface_up(
    bench: MakeBench, open_wire: OpenWire, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    classic = open_wire("kvaser_pci classic")
    classic.down()
    with virtual_wire(fd=True) as wire:
        bench(wire)
        assert main(["list", "--for", "2"]) == 0
    out = capsys.readouterr().out
    assert "0x100" in out
    for one in classic.interfaces:
        remedy = f"sudo ip link set {one.name} up type can bitrate 1000000 dbitrate 5000000 fd on"
        assert f"socketcan:{one.name}: the interface is down: {remedy}" in out


def test_the_stamp_of_a_frame_is_the_same_however_late_it_is_read() -> None:
    settings = BusSettings("socketcan", "vcan0", 1_000_000, 5_000_000, fd=True)
    with virtual_wire(fd=True), ExitStack() as stack:
        sender, early, late = (open_bus(settings) for _ in range(3))
        for bus in (sender, early, late):
            stack.callback(bus.shutdown)
        for _ in range(100):  # the kernel takes a moment to begin to stamp what arrives
            begin = time.time_ns()
            sender.write_frame((0x102, CLASSIC, bytes(8)))
            assert early.read_frames(PATIENCE)
            run("ip", "link", "show")
            assert late.read_frames(PATIENCE)
            assert begin < early.arrival_stamp <= late.arrival_stamp < time.time_ns()
            if early.arrival_stamp == late.arrival_stamp:
                return
        pytest.fail("the stamps are the times of the reads")


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Device]:
    """The emulation of the other tests, with one interface."""
    with monkeypatch.context() as patch:
        kernel = FakeSocketcan(patch, tmp_path / "net")
        yield kernel.add("can0")
        kernel.close()


def test_the_fake_interface_goes_down_and_up_as_a_real_one(request: pytest.FixtureRequest) -> None:
    def switch(up: bool) -> None:
        wire.up() if up else wire.down()

    with virtual_wire(fd=True) as wire:
        real = down_and_up(wire.driver.name, switch)
    assert "ENETDOWN" in real
    device = request.getfixturevalue("fake")
    assert down_and_up("can0", device.switch) == real


def test_the_fake_queue_keeps_frames_as_a_real_one(request: pytest.FixtureRequest, open_wire: OpenWire) -> None:
    interface = open_wire("kvaser_pci classic").driver
    real = stalled_queue(interface.name, lambda on: interface.inject("stall" if on else "resume"))
    device = request.getfixturevalue("fake")
    assert stalled_queue("can0", device.stall) == real


@pytest.mark.parametrize("base", [0x100, 0x3A5])
def test_the_fake_filter_accepts_what_a_real_one_does(request: pytest.FixtureRequest, base: int) -> None:
    with virtual_wire(fd=False) as wire:
        real = filtered(wire.driver.name, base)
    assert (base, 0) not in real
    assert (base + 1, 0) in real
    request.getfixturevalue("fake")
    assert filtered("can0", base) == real
