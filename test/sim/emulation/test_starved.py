# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A process that is starved for ten seconds: how late its scans are is bounded, and it is on time again within one.

In virtual time, in which every scan takes its share of the processor.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import pytest

from posfet_driver.board.faults import FaultKind, Health
from posfet_driver.bus.frame import CLASSIC, Frame
from posfet_driver.protocol.decoder import Decoder, ScanReady
from posfet_driver.protocol.messages import COMMAND_OFFSET, STATUS_OFFSET, Command, Request
from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.scan import Scan, ScanStatus
from posfet_sim.device.readout import Readout
from posfet_sim.device.simulated_board import SimulatedBoard
from posfet_sim.emulation.backlog import AT_ONCE, LATE, LONGEST_BACKLOG, first_due
from posfet_sim.emulation.bus_board import BusBoard
from posfet_sim.emulation.firmware import BoardFirmware
from posfet_sim.emulation.realtime_source import SimulationSource
from posfet_sim.recording.replay_source import ReplaySource
from posfet_sim.scene import SceneLoads, load_scene
from support.clocks import SteppedClock

SENSOR = load_sensor()
SECOND, MILLISECOND = 1_000_000_000, 1_000_000
PERIOD = MILLISECOND
STARVED = 10 * SECOND
BACK = SECOND
"""Time within which scans are on time again [ns]."""
AFTER = 3 * SECOND
"""Time for which scans are read afterwards [ns]."""
COSTS = {"a fifth": 5 * MILLISECOND, "a hundredth": 100 * MILLISECOND, "longer than the backlog": 700 * MILLISECOND}
"""Time that a scan takes while the process gets this share of what it needs [ns]."""
LONGEST_GAP = 8 * PERIOD
"""Longest interval between two scans of a board whose process gets a fifth, once it has been starved for a while
[ns]."""
RELIEVED = 400_000
"""Time that a scan takes afterwards [ns]: the machine is still busy."""


@dataclass
class Arrival:
    """One scan as it arrives."""

    sequence: int
    due: int
    at: int
    late: bool
    """Whether its status says so."""

    @property
    def delay(self) -> int:
        return self.at - self.due


def judge(arrivals: list[Arrival], relieved: int, bound: int) -> None:
    """Judge the scans of a starved process that was relieved at a time [ns]; no delay may exceed `bound` [ns]."""
    sequences = [each.sequence for each in arrivals]
    assert sequences == sorted(set(sequences))
    assert max(each.delay for each in arrivals) <= bound
    before = [each for each in arrivals if each.at <= relieved]
    assert any(each.late or each.delay > LATE * SECOND for each in before), "it was not starved"
    steady = [each for each in arrivals if each.at > relieved + BACK]
    assert len(steady) > 1000
    assert all(each.delay <= 2 * PERIOD for each in steady)
    assert not any(each.late for each in steady)
    assert [each.sequence for each in steady] == list(range(steady[0].sequence, steady[-1].sequence + 1))


def longest_gap(arrivals: list[Arrival]) -> int:
    """Return the longest interval between scans of the second half of the starved time [ns]."""
    starved = [each.due for each in arrivals if STARVED / 2 < each.at <= STARVED]
    return max(later - earlier for earlier, later in itertools.pairwise(starved))


@pytest.mark.parametrize("cost", COSTS.values(), ids=COSTS)
def test_the_board_in_this_process(cost: int) -> None:
    clock = SteppedClock(0, 0)
    source = SimulationSource(SENSOR, load_scene("press_slide_lift", SENSOR), 3, clock)
    source.open()
    arrivals = []
    while clock.now < STARVED + AFTER:
        scan = source.read(0.1)
        if scan is not None:
            late = bool(scan.status & ScanStatus.SCAN_OVERRUN)
            arrivals.append(Arrival(scan.sequence, scan.stamp, clock.now, late))
            clock.now += cost if clock.now < STARVED else RELIEVED
    judge(arrivals, STARVED, round(LONGEST_BACKLOG * SECOND))
    assert all(each.late for each in arrivals if each.delay > LATE * SECOND)
    if cost == COSTS["a fifth"]:
        assert longest_gap(arrivals) <= LONGEST_GAP
    lost = arrivals[-1].sequence + 1 - len(arrivals)
    assert lost > 0
    assert source.report().fault_counts == {FaultKind.SCAN_OVERRUN: lost}
    assert (source.report().health, source.report().scans) == (Health.OK, len(arrivals))


SLOW = {"20 times too slow": 20 * MILLISECOND, "40 times too slow": 40 * MILLISECOND}
"""Time that it takes to make a scan, or a step over scans that are missed [ns]."""


@pytest.fixture
def making_costs(monkeypatch: pytest.MonkeyPatch) -> Callable[[Callable[[int], None]], None]:
    """Return a function that lets each scan and step that a simulated board computes call another with their number."""
    outputs = Readout.outputs

    def charge(spend: Callable[[int], None]) -> None:
        def costly(readout: Readout, charge: Any, steps: Any) -> Any:
            spend(len(steps))
            return outputs(readout, charge, steps)

        monkeypatch.setattr(Readout, "outputs", costly)

    return charge


@pytest.mark.parametrize("cost", SLOW.values(), ids=SLOW)
def test_making_scans_is_too_slow_in_this_process(
    cost: int, making_costs: Callable[[Callable[[int], None]], None]
) -> None:
    clock = SteppedClock(0, 0)
    source = SimulationSource(SENSOR, load_scene("press_slide_lift", SENSOR), 3, clock)
    source.open()

    def spend(scans: int) -> None:
        clock.now += scans * cost if clock.now < STARVED else 0

    making_costs(spend)
    arrivals = []
    while clock.now < STARVED + AFTER:
        scan = source.read(0.1)
        if scan is not None:
            late = bool(scan.status & ScanStatus.SCAN_OVERRUN)
            arrivals.append(Arrival(scan.sequence, scan.stamp, clock.now, late))
    judge_slow(arrivals, cost)


@pytest.mark.parametrize("cost", SLOW.values(), ids=SLOW)
def test_making_scans_is_too_slow_behind_an_adapter(
    cost: int, making_costs: Callable[[Callable[[int], None]], None]
) -> None:
    now = 0
    node = BusBoard(SimulatedBoard(SENSOR, SceneLoads(load_scene("press_slide_lift", SENSOR), SENSOR), 3), 3, 0)
    decoder = Decoder(SENSOR)
    decoder.start()
    node.receive((SENSOR.can.base_id + COMMAND_OFFSET, CLASSIC, Request(Command.START, 0, 0).pack()), 0)

    def spend(scans: int) -> None:
        nonlocal now
        now += scans * cost if now < STARVED else 0

    making_costs(spend)
    arrivals = []
    while now < STARVED + AFTER:
        frames = first_due(node, now)
        arrivals += [Arrival(sequence, sequence * PERIOD, now, late) for sequence, late in sent(decoder, frames, now)]
        due = node.next_due()
        now = max(now, due)
    judge_slow(arrivals, cost)


def judge_slow(arrivals: list[Arrival], cost: int) -> None:
    """Judge the scans of a board whose scans take so long to make [ns]."""
    thinned = [each for each in arrivals if STARVED / 2 < each.at <= STARVED]
    assert max(each.delay for each in thinned) <= LONGEST_BACKLOG * SECOND + 3 * cost
    assert longest_gap(arrivals) <= 3 * cost
    judge(arrivals, STARVED, SECOND)


class Costly:
    """A board whose scans take their time."""

    def __init__(self) -> None:
        self.cost = 0
        self.spent = 0

    def scan(self, index: int, out: Scan) -> None:
        self.spent += self.cost


def sent(decoder: Decoder, frames: list[Frame], now: int) -> Iterator[tuple[int, bool]]:
    """Return sequence of each scan in a batch of frames, and whether it is flagged."""
    for found in decoder.decode(frames, now, 0):
        if isinstance(found, ScanReady):
            yield found.scan.sequence, bool(found.scan.status & ScanStatus.SCAN_OVERRUN)


@pytest.mark.parametrize("fd", [True, False], ids=["FD", "classic"])
@pytest.mark.parametrize("cost", [COSTS["a fifth"], COSTS["a hundredth"]], ids=["a fifth", "a hundredth"])
def test_the_board_behind_an_adapter_or_on_a_bus(cost: int, fd: bool) -> None:
    """Adapter and server of a bus both send what `first_due` returns."""
    sensor, board, now = replace(SENSOR, can=replace(SENSOR.can, fd=fd)), Costly(), 0
    firmware, decoder = BoardFirmware(sensor, board, 0), Decoder(sensor)
    decoder.start()
    base = sensor.can.base_id
    firmware.receive((base + COMMAND_OFFSET, CLASSIC, Request(Command.START, 0, 0).pack()), 0)
    arrivals, turns, statuses = [], 0, [0]
    while now < STARVED + AFTER:
        board.cost, board.spent = (cost if now < STARVED else RELIEVED), 0
        frames = first_due(firmware, now)
        if any(identifier == base + STATUS_OFFSET for identifier, _, _ in frames):
            statuses.append(now)
        begun, now = now, now + board.spent
        turns = max(turns, now - begun)
        arrivals += [Arrival(sequence, sequence * PERIOD, now, late) for sequence, late in sent(decoder, frames, now)]
        now = max(now, firmware.next_due())
    # While the backlog builds up, a status waits for the scans before it; scans that are thinned out keep none waiting.
    steady = [at for at in statuses if STARVED / 2 < at <= STARVED]
    silence = max(later - earlier for earlier, later in itertools.pairwise(steady))
    assert silence <= (SECOND // 5 if fd else round(LONGEST_BACKLOG * SECOND)) + turns, "temperatures are as old"
    # A scan is late by the backlog, and by those that are computed with it.
    at_once = round(AT_ONCE * SECOND / PERIOD) + 1
    assert turns <= at_once * cost, "a command waits no longer"
    judge(arrivals, STARVED, round(LONGEST_BACKLOG * SECOND) + at_once * cost)
    if cost == COSTS["a fifth"] and fd:
        assert longest_gap(arrivals) <= at_once * cost
    assert firmware.missed > 0
    if fd:  # of classic frames, those of a scan without a header are lost besides
        assert firmware.missed == arrivals[-1].sequence + 1 - len(arrivals) == decoder.statistics.lost_scans


class Recorded:
    """A recording of many scans."""

    recording = SimpleNamespace(path="a.mcap")
    topic = SimpleNamespace(name="/tactile/raw")
    problem = ""

    def __init__(self, count: int) -> None:
        self._count = count

    def __len__(self) -> int:
        return self._count

    def scans(self) -> Iterator[Scan]:
        for sequence in range(self._count):
            scan = Scan.empty(SENSOR.layout.id, SENSOR.layout.taxels)
            scan.sequence, scan.stamp = sequence, SECOND + sequence * PERIOD
            yield scan


def replayed(count: int) -> tuple[ReplaySource, SteppedClock]:
    clock = SteppedClock(7 * SECOND)
    recorded: Any = Recorded(count)
    source = ReplaySource(recorded, 1.0, simulated=True, clock=clock)
    source.open()
    return source, clock


@pytest.mark.parametrize("cost", COSTS.values(), ids=COSTS)
def test_a_recording_is_replayed_later_but_whole_and_at_its_pace(cost: int) -> None:
    source, clock = replayed(30_000)
    relieved, arrivals = clock.now + STARVED, []
    while clock.now < relieved + AFTER:
        scan = source.read(0.1)
        assert scan is not None
        arrivals.append((scan.sequence, clock.now))
        clock.now += cost if clock.now < relieved else RELIEVED
    assert [sequence for sequence, _ in arrivals] == list(range(len(arrivals)))
    steady = [at for _, at in arrivals if at > relieved + BACK]
    assert {later - earlier for earlier, later in itertools.pairwise(steady)} == {PERIOD}
    delayed = float(source.report().values["delayed, this machine was too slow [s]"])
    assert delayed == pytest.approx((arrivals[-1][1] - 7 * SECOND - len(arrivals) * PERIOD) / SECOND, abs=0.6)


def test_a_replay_that_was_stopped_goes_on_at_its_pace() -> None:
    source, clock = replayed(400)
    for _ in range(100):
        source.read(0.1)
    assert "delayed, this machine was too slow [s]" not in source.report().values
    clock.now += 3600 * SECOND
    back, at = clock.now, []
    for _ in range(300):
        source.read(0.1)
        at.append(clock.now - back)
    assert at == [number * PERIOD for number in range(300)]
    assert source.report().values["delayed, this machine was too slow [s]"] == "3600.0"


def test_a_short_delay_of_a_replay_is_made_up_for() -> None:
    source, clock = replayed(2000)
    source.read(0.1)
    begin = clock.now
    clock.now += 400 * MILLISECOND
    for _ in range(1000):
        source.read(0.1)
    assert clock.now == begin + 1000 * PERIOD
