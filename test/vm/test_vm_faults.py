# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Faults of a CAN controller and of its queue on a real kernel: bus-off, errors, a stalled queue, a slow one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from posfet_driver.board.faults import FaultKind
from support.kernel_can import Wire, run, virtual_wire
from support.vm_bench import VmBench

pytestmark = pytest.mark.vm

OpenWire = Callable[..., Wire]
MakeBench = Callable[[Wire], VmBench]


@contextmanager
def slow_wire(fd: bool, delay: int) -> Iterator[Wire]:
    """Yield a virtual interface on which every frame takes `delay` [ms]."""
    with virtual_wire(fd) as wire:
        run("tc", "qdisc", "add", "dev", wire.driver.name, "root", "netem", "delay", f"{delay}ms", "limit", "10000")
        yield wire


@pytest.fixture(params=["kvaser_pci classic", "ctucanfd_pci fd"])
def controllers(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.mark.parametrize("restart", [100, 1500])
def test_a_controller_that_is_bus_off_recovers_by_itself(
    open_wire: OpenWire, bench: MakeBench, controllers: str, restart: int
) -> None:
    wire = open_wire(controllers, f"restart-ms {restart}")
    made = bench(wire)
    made.scans()
    wire.driver.inject("bus-off")
    made.until(lambda: made.board.bus.failed > 0)
    assert made.count(FaultKind.BUS_OFF) > 0
    made.until_healthy()


def test_a_controller_that_stays_bus_off_is_reported_until_it_is_restarted(
    open_wire: OpenWire, bench: MakeBench, controllers: str
) -> None:
    wire = open_wire(controllers, "restart-ms 0")
    made = bench(wire)
    made.scans()
    wire.driver.inject("bus-off")
    made.until(lambda: made.board.bus.errors.bus_off > 2)
    assert made.conditions == (FaultKind.BUS_OFF,)
    run("ip", "link", "set", wire.driver.name, "type", "can", "restart")
    made.until_healthy()


def test_errors_of_the_controller_are_counted(open_wire: OpenWire, bench: MakeBench, controllers: str) -> None:
    wire = open_wire(controllers)
    made = bench(wire)
    made.scans()
    wire.driver.inject("bit-error")
    wire.driver.inject("passive")
    made.until(lambda: made.count(FaultKind.ERROR_FRAMES) >= 2)
    assert (made.board.report().counters["bit errors"], made.count(FaultKind.ERROR_PASSIVE)) == (1, 1)
    made.until_healthy()


def test_own_commands_that_leave_a_stalled_queue_late_are_not_taken_for_another_node(
    open_wire: OpenWire, bench: MakeBench, controllers: str
) -> None:
    made = bench(wire := open_wire(controllers))
    made.scans()
    wire.driver.inject("stall")
    made.server.close()
    made.until(lambda: made.count(FaultKind.UNACKNOWLEDGED) > 0 and made.board.bus.opened > 1)
    assert made.conditions == (FaultKind.NO_TRAFFIC,)
    wire.driver.inject("resume")
    opened = made.board.bus.opened
    made.until(lambda: made.board.bus.opened > opened)
    assert made.conditions == (FaultKind.NO_TRAFFIC,)
    made.server.open()
    made.until_healthy()
    assert made.board.report().counters["unrelated frames"] == 0


@pytest.mark.parametrize("fd", [True, False], ids=["fd", "classic"])
def test_a_board_behind_a_slow_link_is_received(bench: MakeBench, fd: bool) -> None:
    with slow_wire(fd, 50) as wire:
        sequences = bench(wire).scans(20)
    assert sequences == list(range(sequences[0], sequences[0] + 20))


def test_a_board_that_answers_later_than_commands_are_repeated_is_received(
    bench: MakeBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("support.fake_board.PATIENCE", 30.0)
    with slow_wire(True, 250) as wire:
        sequences = bench(wire).scans(20)
    assert sequences == list(range(sequences[0], sequences[0] + 20))
