# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The driver on interfaces of a real kernel: scans, and interfaces that are down, pulled out or without CAN FD."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from posfet_driver.board.faults import FaultKind, Health
from support.kernel_can import Interface, Wire, controllers, plug, run, unplug, virtual_wire
from support.vm_bench import VmBench

pytestmark = pytest.mark.vm

OpenWire = Callable[..., Wire]
REMEDY = "the interface is down: sudo "
MakeBench = Callable[[Wire], VmBench]


def test_scans_are_whole_and_missing_ones_are_counted(wire: Wire, bench: MakeBench) -> None:
    made = bench(wire)
    first, missed = made.scans(1), made.firmware.missed
    sequences = first + made.scans(60)
    report = made.board.report()
    assert sequences == sorted(set(sequences))
    missing = sequences[-1] - sequences[0] + 1 - len(sequences)
    assert (missing == 0) == (report.frames_lost == 0)
    if wire.driver == wire.board:  # emulated controllers may overflow on a busy machine
        assert missing <= made.firmware.missed - missed  # no frame is lost, but the board itself may be too late
    assert report.health == Health.OK
    assert report.counters["unrelated frames"] == 0
    present = set(report.conditions) - {FaultKind.SCAN_OVERRUN}  # the emulated board is late on a busy machine
    assert (present, made.board.bus.failed) == (set(), 0)  # a slow start may reopen the bus


def test_an_interface_that_goes_down_is_named_with_its_remedy_and_used_again(wire: Wire, bench: MakeBench) -> None:
    made = bench(wire)
    made.scans()
    wire.down()
    remedy = f"{REMEDY}ip link set {wire.driver.name} up {wire.driver.settings}".rstrip()
    made.until(lambda: remedy in made.state)
    assert made.conditions == (FaultKind.ADAPTER_DISCONNECTED,)
    wire.up()
    made.until_healthy()
    assert made.board.bus.failed == 1
    assert (made.server.disconnected, made.server.failure) == ("", "")


def test_the_remedy_sets_the_interface_up(wire: Wire, bench: MakeBench) -> None:
    made = bench(wire)
    wire.driver.down()
    made.until(lambda: REMEDY in made.state)
    run("sh", "-c", made.state.partition(REMEDY)[2])
    made.until_healthy()


@pytest.mark.parametrize("pulled", ["driver", "board"])
def test_a_controller_that_is_pulled_out_is_used_again(open_wire: OpenWire, bench: MakeBench, pulled: str) -> None:
    wire = open_wire("kvaser_pci classic")
    made = bench(wire)
    made.scans()
    interface: Interface = getattr(wire, pulled)
    address = next(address for address, name in controllers("kvaser_pci") if name == interface.name)
    unplug("kvaser_pci", address)
    if pulled == "driver":
        made.until(lambda: "No such device" in made.state)
        assert made.conditions == (FaultKind.ADAPTER_DISCONNECTED,)
    else:
        made.until(lambda: made.conditions == (FaultKind.NO_TRAFFIC,))
    plug("kvaser_pci", address)
    interface.up("restart-ms 0")
    made.until_healthy()


def test_an_interface_without_fd_is_named_with_its_remedy(bench: MakeBench) -> None:
    with virtual_wire(fd=True, mtu=16) as wire:
        run("ip", "link", "set", wire.driver.name, "down")
        run("ip", "link", "set", wire.driver.name, "mtu", "72", "up")
        made = bench(wire)
        made.scans()
        wire.down()
        run("ip", "link", "set", wire.driver.name, "mtu", "16", "up")
        made.until(lambda: "carries classic CAN only (mtu 16)" in made.state)
        assert made.conditions == (FaultKind.ADAPTER_DISCONNECTED,)
        run("sh", "-c", made.state.partition(": sudo ")[2].replace("sudo ", ""))
        made.until_healthy()


def test_a_classic_controller_is_refused_for_a_board_that_sends_fd(open_wire: OpenWire, bench: MakeBench) -> None:
    classic = open_wire("kvaser_pci classic")
    with virtual_wire(fd=True) as virtual:
        made = bench(Wire(classic.driver, virtual.board, fd=True))
        made.until(lambda: f"{classic.driver.name} up type can bitrate 1000000 dbitrate 5000000 fd on" in made.state)
        assert made.conditions == (FaultKind.ADAPTER_DISCONNECTED,)
