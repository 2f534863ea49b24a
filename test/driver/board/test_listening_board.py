# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A board that is only listened to: its scans, the faults of its bus, and that nothing is ever sent."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import can
import pytest

from posfet_driver.board.command_queue import CommandError
from posfet_driver.board.faults import FaultKind, Health
from posfet_driver.board.listening_board import ListeningBoard
from posfet_driver.board.transit_time import mapped_transit_times
from posfet_driver.bus.error_frame import CONTROLLER, error_frame
from posfet_driver.bus.frame import CLASSIC, Frame
from posfet_driver.bus.frame_bus import FrameBus
from posfet_driver.protocol.messages import Command
from posfet_model.config import ConfigError
from posfet_model.sensor.scan import Scan
from support.clocks import SteppedClock
from support.own_boards import BoardA, Transmitter, codes_of, counts_of_codes, sensor_a, sensor_b
from support.stepped import SteppedBus

A = BoardA()


def frames(index: int) -> list[Frame]:
    status = [A.status(30.0, 25.0, undervoltage=1)] if index % 100 == 50 else []
    return [*A.scan(index, codes_of(index)), *status]


class Bench:
    """A board of style A on a stepped bus."""

    def __init__(self, tmp_path: Path) -> None:
        self.clock = SteppedClock()
        self.transmitter = Transmitter(frames)
        self.bus = SteppedBus(self.clock, self.transmitter)
        self.opened = 0
        self.openable = True
        self.board = ListeningBoard(sensor_a(tmp_path), self._open, self.clock)

    def _open(self) -> FrameBus:
        self.opened += 1
        if not self.openable:
            raise can.CanInitializationError("no adapter")
        return self.bus

    def read(self, count: int) -> list[Scan]:
        """Return the next scans; fail when they do not arrive within a minute of the clock."""
        scans: list[Scan] = []
        end = self.clock.now + 60_000_000_000
        while len(scans) < count:
            assert self.clock.now < end, self.board.report()
            if scan := self.board.read(0.1):
                scans.append(scan.snapshot())
        return scans

    def wait(self, seconds: float) -> None:
        end = self.clock.now + round(seconds * 1e9)
        while self.clock.now < end:
            self.board.read(0.05)


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path)


def test_scans_and_report(bench: Bench) -> None:
    bench.board.open()
    assert bench.board.report().state == "waiting for scans"
    assert bench.board.report().health == Health.WARN
    for scan in bench.read(300):
        assert scan.counts.tolist() == counts_of_codes(codes_of(scan.sequence)).tolist()
    report = bench.board.report()
    assert (report.state, report.health, report.scans, report.frames_lost) == ("receiving scans", Health.OK, 300, 0)
    assert report.conditions == (FaultKind.SUPPLY_LOW,)
    assert report.values["temperature 1 [degC]"] == "30.00"
    assert report.values["sequence"] == "counter of the board, 8 bits"
    assert report.values["time"] == "estimated from arrivals and scan rate"
    assert report.values["lost scans"] == "exact while the counter tells"
    bench.board.close()
    assert bench.transmitter.received == []
    assert bench.bus.closed


def test_a_command_is_refused_in_one_line(bench: Bench) -> None:
    bench.board.open()
    for send in (bench.board.submit, bench.board.request):
        with pytest.raises(CommandError, match=r"^START: the driver only listens to a board with frames of its own"):
            send(Command.START)
    assert bench.transmitter.received == []


def test_a_silent_board_and_its_return(bench: Bench) -> None:
    bench.board.open()
    bench.read(10)
    bench.transmitter.silent = True
    bench.wait(3.0)
    report = bench.board.report()
    assert report.conditions == (FaultKind.NO_TRAFFIC,)
    assert report.health == Health.WARN
    assert "check power, cable, bit rate and the identifiers in classic_board.dbc" in report.state
    assert bench.opened > 1
    bench.transmitter.silent = False
    scan = bench.read(20)[-1]
    assert scan.counts.tolist() == counts_of_codes(codes_of(scan.sequence)).tolist()
    assert bench.board.report().conditions == (FaultKind.SUPPLY_LOW,) * bool(bench.board.decoder.flags)
    assert bench.board.report().state == "receiving scans"
    assert bench.transmitter.received == []


def test_frames_of_others_only(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench.transmitter, "_scan", lambda index: [(0x55, CLASSIC, bytes(8))])
    bench.board.open()
    bench.wait(2.0)
    assert bench.board.report().conditions == (FaultKind.BOARD_NOT_DETECTED,)


def test_frames_that_give_no_scan(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench.transmitter, "_scan", lambda index: frames(index)[:4])
    bench.board.open()
    bench.wait(2.0)
    report = bench.board.report()
    assert report.conditions == (FaultKind.NO_SCANS,)
    assert "compare classic_board.dbc" in report.state
    assert report.fault_counts[FaultKind.INCOMPLETE_SCANS] > 1000


def test_a_cable_that_is_pulled_and_put_back(bench: Bench) -> None:
    bench.board.open()
    bench.read(100)
    bench.bus.broken = True
    bench.openable = False
    bench.wait(5.0)
    report = bench.board.report()
    assert report.conditions[0] == FaultKind.ADAPTER_DISCONNECTED
    assert report.state == "CAN bus unavailable, retrying: no adapter"
    assert report.health == Health.ERROR
    bench.bus.broken = False
    bench.openable = True
    missed = sum(frame[0] == A.row.frame_id for frame in bench.transmitter.due(bench.clock.now)) // 5
    scan = bench.read(100)[-1]
    assert scan.counts.tolist() == counts_of_codes(codes_of(scan.sequence)).tolist()
    assert bench.board.report().counters["bus losses"] == 1
    assert bench.board.decoder.statistics.lost_scans == pytest.approx(missed, abs=2)


def test_an_overflow_is_told_to_the_decoder(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[int] = []
    monkeypatch.setattr(bench.board.decoder, "note_overflow", lambda: told.append(bench.clock.now))
    overflow = error_frame(CONTROLLER, 0x01)
    monkeypatch.setattr(
        bench.transmitter, "_scan", lambda index: [overflow, *frames(index)] if index == 20 else frames(index)
    )
    bench.board.open()
    bench.read(50)
    assert len(told) == 1


def test_a_bus_that_can_never_be_opened(tmp_path: Path) -> None:
    def refuse() -> FrameBus:
        raise ConfigError("no such interface")

    board = ListeningBoard(sensor_a(tmp_path), refuse, SteppedClock())
    with pytest.raises(ConfigError, match="no such interface"):
        board.open()


def test_a_closed_board_waits(bench: Bench) -> None:
    assert bench.board.read(0.1) is None
    bench.board.open()
    bench.read(1)
    bench.board.close()
    bench.board.close()
    assert bench.board.read(0.1) is None
    assert bench.board.report().health == Health.STALE
    bench.board.open()
    assert bench.read(1)


def test_transit_time_of_a_scan(bench: Bench, tmp_path: Path) -> None:
    """Five frames of 8 bytes with 29-bit identifiers take at most 160 us each at 1 Mbit/s; two FD frames less.

    Where CAN FD is allowed, frames of 8 bytes may come as classic ones all the same.
    """
    link = sensor_a(tmp_path).can
    for fd in (False, True):
        longest = mapped_transit_times(replace(link, fd=fd), bench.board.decoder.tables)
        assert longest.switched == pytest.approx(5 * 160e-6)
    sensor = sensor_b(tmp_path)
    board = ListeningBoard(sensor, lambda: bench.bus, bench.clock)
    times = mapped_transit_times(sensor.can, board.decoder.tables)
    assert 100e-6 < times.switched < 300e-6 < times.unswitched
    assert board.decoder.transit_time.times.unswitched == times.unswitched


def test_the_bus_load_is_named_by_what_it_counts(bench: Bench) -> None:
    """A bus may filter for the board: frames that are not received are in no sum."""
    bench.board.open()
    bench.read(3500)
    assert float(bench.board.report().values["bus load by received frames [%]"]) == pytest.approx(75.0, abs=10.0)
