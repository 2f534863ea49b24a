# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Every fault of the link and the board: distinguished, counted, reported with a remedy, and recovered from."""

from __future__ import annotations

import can
import numpy as np
import pytest

from posfet_driver.board.board_client import Board
from posfet_driver.board.board_report import MAX_CLOCK_UNCERTAINTY
from posfet_driver.board.fault_monitor import HOLD, FaultMonitor, changes, worst
from posfet_driver.board.faults import FaultKind, Health
from posfet_driver.protocol.decoder import Decoder
from posfet_driver.protocol.messages import STATUS_OFFSET
from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.scan import ScanStatus
from posfet_sim.emulation.firmware import BoardFirmware
from support.clocks import SteppedClock
from support.fake_board import FakeBoard, assert_marked, with_fd, with_layout
from support.fault_injector import FaultInjector, InjectedFault
from support.long_cases import crossed, long_cases
from support.paths import DOCS
from support.stepped import SteppedBus

RATE = 100.0
STATUS = load_sensor().can.base_id + STATUS_OFFSET
SENSORS = {
    True: with_layout(load_sensor(), 5, 12, scan_rate=RATE),
    False: with_layout(load_sensor(), 5, 5, scan_rate=RATE),
}
"""Three FD blocks, five classic ones."""
FRAMES = {"fd": True, "classic": False}
BOTH = pytest.mark.parametrize("fd", FRAMES.values(), ids=FRAMES.keys())
FIRST = pytest.mark.parametrize("fd", long_cases(FRAMES, ["fd"]))
"""Of what takes long, the same with classic frames is in the slow run."""
SECOND = 1_000_000_000
CADENCE = 1_000_000
"""Time between two batches of frames from the adapter [ns]."""
BACK = 500_000_000
"""Data flows this soon [ns] once the bus is back."""

EXPECTED = {
    InjectedFault.LOST: {FaultKind.LOST_SCANS},
    InjectedFault.INCOMPLETE: {FaultKind.INCOMPLETE_SCANS},
    InjectedFault.DUPLICATE: {FaultKind.DUPLICATE_FRAMES},
    InjectedFault.LATE: {FaultKind.LATE_FRAMES},
    InjectedFault.REORDERED: {FaultKind.REORDERED_FRAMES},
    InjectedFault.MALFORMED: {FaultKind.MALFORMED_FRAMES},
    InjectedFault.FROZEN_COUNTER: {FaultKind.FROZEN_COUNTER},
    InjectedFault.FROZEN_TIMESTAMP: {FaultKind.FROZEN_TIMESTAMP},
    InjectedFault.UNRELATED: {FaultKind.HIGH_BUS_LOAD},
    InjectedFault.ERRORS: {FaultKind.ERROR_FRAMES},
    InjectedFault.UNACKNOWLEDGED: {FaultKind.UNACKNOWLEDGED, FaultKind.NO_TRAFFIC},
    InjectedFault.OVERFLOW: {FaultKind.RECEIVE_OVERFLOWS},
    InjectedFault.ERROR_PASSIVE: {FaultKind.ERROR_PASSIVE, FaultKind.ERROR_FRAMES},
    InjectedFault.UNREADABLE: {FaultKind.BUS_ERRORS},
    InjectedFault.BUS_OFF: {FaultKind.BUS_OFF},
    InjectedFault.CABLE_UNPLUGGED: {FaultKind.NO_TRAFFIC},
    InjectedFault.BOARD_UNPLUGGED: {FaultKind.BOARD_NOT_DETECTED},
    InjectedFault.NO_RESPONSE: set(),
    InjectedFault.RESET: {FaultKind.BOARD_RESETS},
    InjectedFault.BROWN_OUT: {FaultKind.BROWN_OUTS, FaultKind.SUPPLY_LOW},
}
"""Minimum set of faults reported for each injected fault."""
ALONE = {
    InjectedFault.FROZEN_TIMESTAMP,
    InjectedFault.DUPLICATE,
    InjectedFault.REORDERED,
    InjectedFault.UNRELATED,
    InjectedFault.NO_RESPONSE,
    InjectedFault.RESET,
}
"""Injected faults for which nothing else is reported."""
WITH_CLASSIC = (
    InjectedFault.LOST,
    InjectedFault.INCOMPLETE,
    InjectedFault.REORDERED,
    InjectedFault.FROZEN_COUNTER,
    InjectedFault.UNREADABLE,
    InjectedFault.RESET,
)
"""Those that classic frames, which have fewer bits for the counter, show otherwise than FD frames."""


class Bench:
    """A board client and a board with injected faults, in stepped time; reads a report every second like the node."""

    def __init__(self, fd: bool) -> None:
        sensor = with_fd(SENSORS[fd], fd)
        self.clock = SteppedClock()
        self.device = FakeBoard(sensor)
        self.injector = FaultInjector(lambda now: BoardFirmware(sensor, self.device, now), 0x100, 0)
        self.watch = FaultMonitor()
        self.faults: list[FaultKind] = []
        self.reported: list[str] = []
        self.health = Health.OK
        self.first = -1
        self.unplugged = False
        self.opening_time = 0
        self._report_time = 0
        self.buses: list[SteppedBus] = []
        self.board = Board(sensor, self._open_bus, self.clock)
        self.board.open()

    def _open_bus(self) -> SteppedBus:
        self.clock.now += self.opening_time
        if self.unplugged:
            raise can.CanInitializationError("no such device")
        self.buses.append(SteppedBus(self.clock, self.injector, CADENCE))
        return self.buses[-1]

    def run(self, seconds: float) -> int:
        """Advance the time [s]; return the number of scans received, each compared with what was sent."""
        end = self.clock.now + round(seconds * SECOND)
        scans = 0
        while self.clock.now < end:
            scan = self.board.read(0.01)
            if scan is not None:
                assert_marked(scan)
                self.first = scan.sequence if self.first < 0 else self.first
                scans += 1
            if self.clock.now >= self._report_time + SECOND:
                self._report()
        return scans

    def _report(self) -> None:
        self._report_time = self.clock.now
        report = self.board.report()
        faults = self.watch.present(report, self.clock.now)
        come, gone = changes(self.faults, faults)
        self.reported += [f"+{fault.label}" for fault in come] + [f"-{fault.label}" for fault in gone]
        self.faults = faults
        self.health = worst(faults, report.health)


@pytest.mark.parametrize(
    ("injected", "fd"),
    long_cases(
        crossed({injected.name: injected for injected in EXPECTED}, FRAMES),
        [*(f"{injected.name}-fd" for injected in EXPECTED), *(f"{injected.name}-classic" for injected in WITH_CLASSIC)],
    ),
)
def test_each_fault_is_reported_and_recovered_from(injected: InjectedFault, fd: bool) -> None:
    bench = Bench(fd)
    assert bench.run(3) > 2.9 * RATE
    assert (bench.faults, bench.health) == ([], Health.OK)
    bench.injector.fault = injected
    bench.run(4)
    if injected == InjectedFault.NO_RESPONSE:  # scans continue; the fault shows when a command is sent
        assert bench.faults == []
    expected = EXPECTED[injected]
    assert expected <= set(bench.faults), bench.faults
    if injected in ALONE:
        assert set(bench.faults) == expected
    if bench.faults:
        assert bench.health == max(fault.health for fault in bench.faults)
    bench.injector.fault = InjectedFault.NONE
    bench.injector.firmware.supply = 5.0
    bench.run(6)  # longer than the longest back-off
    before = bench.board.decoder.frames_lost
    assert bench.run(HOLD / SECOND + 2) > 6.9 * RATE
    assert bench.board.decoder.frames_lost == before
    assert (bench.faults, bench.health) == ([], Health.OK)
    assert all(bench.reported.count(word) == 1 for word in bench.reported), bench.reported  # once per fault
    losses, board = bench.board.decoder.statistics, bench.board
    if injected not in {
        InjectedFault.RESET,
        InjectedFault.BROWN_OUT,
        InjectedFault.FROZEN_COUNTER,
    }:  # these restart the sequence
        sent = board.decoder.sequence + 1 - bench.first
        assert board.decoder.scans + losses.incomplete_scans + losses.lost_scans == sent


@FIRST
@pytest.mark.parametrize(
    "injected",
    long_cases(
        [
            InjectedFault.CABLE_UNPLUGGED,
            InjectedFault.BOARD_UNPLUGGED,
            InjectedFault.UNREADABLE,
            InjectedFault.UNACKNOWLEDGED,
            InjectedFault.BUS_OFF,
            InjectedFault.RESET,
            InjectedFault.FROZEN_COUNTER,
        ],
        [
            InjectedFault.CABLE_UNPLUGGED,
            InjectedFault.BOARD_UNPLUGGED,
            InjectedFault.BUS_OFF,
            InjectedFault.FROZEN_COUNTER,
        ],
    ),
    ids=lambda injected: injected.name,
)
def test_data_flows_within_half_a_second_after_the_bus_returns(injected: InjectedFault, fd: bool) -> None:
    """At whatever phase of the repeated commands, and of the back-off, that is."""
    bench = Bench(fd)
    for length in (*np.arange(0.2, 1.6, 0.07), 12.0):
        bench.run(1)
        bench.injector.fault = injected
        bench.run(length)
        bench.injector.fault = InjectedFault.NONE
        back = bench.clock.now
        while bench.board.read(0.01) is None:
            assert bench.clock.now - back < BACK, bench.board.report()


@FIRST
@pytest.mark.parametrize("opening_time", long_cases([0, 60_000_000], [60_000_000]))
def test_data_flows_within_half_a_second_after_an_adapter_without_presence_is_plugged_in(
    opening_time: int, fd: bool
) -> None:
    """At whatever phase of the attempts to open it, however long it was away; each attempt takes `opening_time`."""
    bench = Bench(fd)
    bench.opening_time = opening_time
    for length in (*np.arange(0.2, 1.6, 0.07), *np.arange(12.0, 12.4, 0.03)):
        bench.run(1)
        bench.unplugged = bench.buses[-1].broken = True
        bench.run(length)
        assert FaultKind.ADAPTER_DISCONNECTED in bench.faults or length < 1
        bench.unplugged = False
        back = bench.clock.now
        while bench.board.read(0.01) is None:
            assert bench.clock.now - back < BACK, bench.board.report()


@FIRST
def test_a_board_ignoring_commands_is_distinguished_from_one_without_traffic(fd: bool) -> None:
    bench = Bench(fd)
    bench.run(1)
    bench.injector.fault = InjectedFault.NO_RESPONSE
    bench.injector.firmware.running = False
    bench.run(3)
    assert FaultKind.NOT_RESPONDING in bench.faults
    bench.injector.fault = InjectedFault.NONE
    assert bench.run(3) > 2 * RATE


@BOTH
def test_high_bus_load_of_unrelated_frames_does_not_hide_a_missing_board(fd: bool) -> None:
    bench = Bench(fd)
    bench.run(1)
    bench.injector.fault = InjectedFault.UNRELATED
    bench.injector.firmware.running = False
    assert bench.run(3) > 2 * RATE
    assert bench.board.restarted == 1


@pytest.mark.parametrize(
    ("flag", "fault"),
    [
        (ScanStatus.ADC_FAULT, FaultKind.ADC_FAULT),
        (ScanStatus.OVERTEMPERATURE, FaultKind.OVERTEMPERATURE),
        (ScanStatus.SCAN_OVERRUN, FaultKind.SCAN_OVERRUN),
    ],
)
def test_status_flags_of_the_board_are_reported(flag: ScanStatus, fault: FaultKind) -> None:
    bench = Bench(True)
    bench.run(1)
    bench.device.status = flag
    bench.run(2)
    assert bench.faults == [fault]


@BOTH
def test_a_board_whose_status_frames_stop_is_reported_and_what_they_said_is_unknown(fd: bool) -> None:
    bench = Bench(fd)
    bench.device.status = ScanStatus.OVERTEMPERATURE
    bench.run(2)
    assert bench.faults == [FaultKind.OVERTEMPERATURE]
    due = bench.injector.due
    bench.injector.due = lambda *times: [frame for frame in due(*times) if frame[0] != STATUS]  # type: ignore[method-assign]
    bench.run(0.9)
    assert FaultKind.NO_STATUS not in bench.board.report().conditions
    assert bench.run(2) > 1.9 * RATE
    assert (bench.faults, bench.health) == ([FaultKind.NO_STATUS], Health.WARN)
    scan, values = bench.board.decoder.scan, bench.board.report().values
    assert np.isnan(scan.temperatures).all()
    assert scan.status == (ScanStatus.OVERTEMPERATURE if fd else 0)  # FD blocks state it themselves
    assert (values["temperature 1 [degC]"], values["board flags"]) == ("nan", "unknown")
    bench.injector.due = due  # type: ignore[method-assign]
    bench.run(2)
    assert bench.faults == [FaultKind.OVERTEMPERATURE]
    assert bench.board.decoder.scan.temperatures == pytest.approx(bench.device.temperature)


@FIRST
def test_what_a_board_has_said_is_not_reported_while_the_bus_is_closed(fd: bool) -> None:
    bench = Bench(fd)
    bench.device.status = ScanStatus.OVERTEMPERATURE
    bench.run(2)
    bench.unplugged = bench.buses[-1].broken = True
    bench.run(2)
    assert bench.faults == [FaultKind.ADAPTER_DISCONNECTED]
    values = bench.board.report().values
    assert (values["temperature 1 [degC]"], values["board flags"]) == ("nan", "unknown")


@FIRST
def test_the_load_of_a_bus_that_was_closed_is_unknown(fd: bool) -> None:
    bench = Bench(fd)
    bench.injector.fault = InjectedFault.UNRELATED
    bench.run(3)
    assert FaultKind.HIGH_BUS_LOAD in bench.faults
    bench.unplugged = bench.buses[-1].broken = True
    bench.run(2)
    assert bench.faults == [FaultKind.ADAPTER_DISCONNECTED]
    assert bench.board.report().values["bus load by received frames [%]"] == "nan"


@FIRST
def test_a_board_that_does_not_scan_has_no_overrun_and_no_uncertain_stamps(fd: bool) -> None:
    bench = Bench(fd)
    bench.device.status = ScanStatus.SCAN_OVERRUN
    bench.run(2)
    bench.injector.fault = InjectedFault.CABLE_UNPLUGGED
    bench.run(60)
    assert bench.board.report().conditions == (FaultKind.NO_TRAFFIC,)


@BOTH
def test_wrong_version_of_the_protocol_and_layout_are_rejected_and_reported(fd: bool) -> None:
    bench = Bench(fd)
    bench.run(1)
    bench.injector.firmware.protocol = 1
    bench.injector.firmware.running = False
    bench.run(2)
    assert bench.faults == [FaultKind.WRONG_PROTOCOL]
    assert bench.board.report().state == "the board implements version 1 of the protocol, this driver 2"
    bench.injector.firmware.protocol = 2
    bench.run(2)
    bench.injector.firmware.layout_id = 9  # another board was connected, and sends
    bench.run(2)
    assert FaultKind.WRONG_LAYOUT in bench.faults
    bench.injector.firmware.layout_id = SENSORS[fd].layout.id
    assert bench.run(3) > RATE


@FIRST
def test_the_right_board_is_used_half_a_second_after_it_took_the_place_of_a_wrong_one(fd: bool) -> None:
    bench = Bench(fd)
    bench.run(1)
    for length in np.arange(1.0, 2.0, 0.07):
        bench.injector.firmware.layout_id = 9
        bench.injector.firmware.running = False
        bench.run(length)
        assert FaultKind.WRONG_LAYOUT in bench.faults
        bench.injector.firmware.layout_id = SENSORS[fd].layout.id
        back = bench.clock.now
        while bench.board.read(0.01) is None:
            assert bench.clock.now - back < BACK, bench.board.report()


def test_a_reset_at_low_supply_voltage_is_reported_as_brown_out() -> None:
    counters = {}
    for injected in (InjectedFault.RESET, InjectedFault.BROWN_OUT):
        bench = Bench(True)
        bench.run(1)
        bench.injector.fault = injected
        bench.run(2)
        counters[injected] = (bench.board.decoder.resets, bench.board.brown_outs)
    assert counters == {InjectedFault.RESET: (1, 0), InjectedFault.BROWN_OUT: (1, 1)}


def test_a_clock_offset_that_is_too_uncertain_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(True)
    bench.run(1)
    for uncertainty, faults in ((MAX_CLOCK_UNCERTAINTY, []), (1.01 * MAX_CLOCK_UNCERTAINTY, ["clock sync degraded"])):
        monkeypatch.setattr(Decoder, "clock_uncertainty", uncertainty)
        bench.run(2)
        assert [fault.label for fault in bench.faults] == faults


def test_what_an_adapter_delivers_and_nobody_can_parse_is_reported() -> None:
    bench = Bench(True)
    bench.run(1)
    bench.buses[-1].unreadable = 7
    bench.run(2)
    assert bench.faults == [FaultKind.UNREADABLE]
    assert bench.board.report().fault_counts[FaultKind.UNREADABLE] == 7


@FIRST
def test_one_bus_off_is_counted_once(fd: bool) -> None:
    bench = Bench(fd)
    for times in (1, 2):
        bench.injector.fault = InjectedFault.NONE
        bench.run(8)
        bench.injector.fault = InjectedFault.BUS_OFF
        bench.run(3)
        report = bench.board.report()
        assert (report.fault_counts[FaultKind.BUS_OFF], report.counters["bus losses"]) == (times, times)
        assert report.counters["bus reopened"] > 2


def test_stamps_advance_while_the_board_clock_is_frozen() -> None:
    bench = Bench(True)
    bench.run(1)
    estimated = []
    for injected in (InjectedFault.FROZEN_TIMESTAMP, InjectedFault.NONE):
        bench.injector.fault = injected
        for number in range(400):
            scan = bench.board.read(0.01)
            assert scan is not None
            assert abs(scan.stamp - bench.clock.now) < 2 * SECOND / RATE
            if number > 3:
                estimated.append(bool(scan.status & ScanStatus.TIME_ESTIMATED))
    assert estimated == [True] * 396 + [False] * 396


def test_every_fault_is_documented() -> None:
    text = (DOCS / "faults.md").read_text(encoding="utf-8")
    for fault in FaultKind:
        assert f"| {fault.label} | {fault.health.name.lower()} | {fault.meaning} | {fault.remedy} |" in text
