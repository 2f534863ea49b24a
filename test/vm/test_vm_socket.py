"""The socket of a real kernel: filters and time stamps, and that the fake one of the other tests behaves alike."""

from __future__ import annotations

import statistics
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
from posfet_driver.bus.open_bus import open_bus
from posfet_driver.clock import SystemClock
from posfet_driver.protocol.identifiers import board_frames
from support.fake_board import read_scans
from support.fake_socketcan import Device, FakeSocketcan
from support.kernel_can import Interface, Wire, virtual_wire
from support.socket_behaviour import down_and_up, filtered, stalled_queue
from support.vm_bench import RATE, VmBench

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


@contextmanager
def busy() -> Iterator[None]:
    """Keep a processor busy."""
    with subprocess.Popen([sys.executable, "-c", "while True: pass"]) as process:
        try:
            yield
        finally:
            process.kill()


def packets(interface: Interface) -> int:
    """Return the number of frames that the interface has received."""
    return int(Path(f"/sys/class/net/{interface.name}/statistics/rx_packets").read_text(encoding="ascii"))


@pytest.mark.parametrize("fd", [True, False], ids=["fd", "classic"])
def test_frames_of_other_nodes_do_not_reach_the_driver_while_the_board_sends(bench: MakeBench, fd: bool) -> None:
    with virtual_wire(fd) as wire:
        made = bench(wire)
        made.scans()
        with flood(wire.board):
            before, frames = packets(wire.board), made.board.decoder.traffic.frames
            made.until(lambda: packets(wire.board) - before > 2000)
            read = made.board.decoder.traffic.frames - frames
        assert read < 1500
        assert made.board.report().counters["unrelated frames"] == 0
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


def test_stamps_are_those_of_the_kernel_however_late_the_driver_reads(bench: MakeBench) -> None:
    with virtual_wire(fd=True) as wire:
        made = bench(wire)
        made.scans()
        made.until(lambda: made.board.bus.arrival_stamp > 0)
        made.board.close()
        bus = open_bus(made.settings(wire.driver), board_frames(made.sensor))
        late = 0
        while late < 50_000_000:
            begin = time.time_ns()
            run("sleep", "0.1")  # statuses of the board arrive meanwhile
            assert bus.read_frames(1.0)
            assert bus.arrival_stamp > begin - 100_000_000
            late = time.time_ns() - bus.arrival_stamp
        bus.shutdown()


def test_scans_are_stamped_right_although_the_processors_are_busy(bench: MakeBench) -> None:
    def errors(count: int) -> list[float]:
        """Return the delays of stamps after the acquisition [s]."""
        start, found = made.firmware.switched_on, []
        for scan in read_scans(made.board, count):
            monotonic = scan.stamp - (clock.wall() - clock.monotonic())
            found.append((monotonic - start) * 1e-9 - scan.sequence / RATE)
        return found

    clock = SystemClock()
    with virtual_wire(fd=True) as wire, ExitStack() as stack:
        made = bench(wire)
        made.scans(100)
        for _ in range(4):
            stack.enter_context(busy())
        assert statistics.median(errors(300)) < 0.02  # time slices of busy processors delay reads by up to 0.4 s


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
