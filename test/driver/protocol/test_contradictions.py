# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Boards, links and other hosts that contradict themselves: each cause of a wrong scan or stamp that was found."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import pytest

from posfet_core.protocol import AscendingStamps
from posfet_driver.bus.frame import CLASSIC, Frame
from posfet_driver.protocol.decoded import ScanReady
from posfet_driver.protocol.decoder import Decoder
from posfet_driver.protocol.messages import (
    COMMAND_OFFSET,
    IDENTITY_OFFSET,
    LONGEST_PERIOD,
    PROTOCOL_VERSION,
    RESPONSE_OFFSET,
    Command,
    Identification,
    Identity,
    Request,
    Response,
    Result,
)
from posfet_driver.protocol.scan_codec import make_codec
from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.scan import ScanStatus
from support.fake_board import make_scan, with_fd
from support.long_cases import crossed, long_cases

SENSOR = load_sensor()
SENSOR_CLASSIC = with_fd(SENSOR, False)
BASE = SENSOR.can.base_id
MILLISECOND = 1_000_000
ROUNDING = 20_000
FRAMES = {"fd": True, "classic": False}
BOTH = pytest.mark.parametrize("fd", FRAMES.values(), ids=FRAMES.keys())


class Tick(NamedTuple):
    """A tick of a board, and what the board states of it."""

    sequence: int
    time: float
    """When it was sampled [ms]."""
    number: int | None = None
    stated: float | None = None
    """Time that is stated [ms]."""
    header: bool | None = None

    def frames(self, fd: bool) -> list[Frame]:
        """Return the frames of its scan."""
        number = self.sequence if self.number is None else self.number
        scan = make_scan(with_fd(SENSOR, fd), self.sequence)
        scan.sequence = number
        scan.device_time = round(1000 * (self.time if self.stated is None else self.stated))
        header = number % 16 == 0 if self.header is None else self.header
        return make_codec(with_fd(SENSOR, fd)).encode(scan, BASE, header=header)


class Published(NamedTuple):
    """A scan that was published."""

    sequence: int
    error: float
    """Of its stamp [ms]."""
    bound: float
    """Of the error, as the scan states it [ms]; NaN: unknown."""
    common: float
    """Shortest delay of all scans until then [ms], by which the stamp may be late besides."""
    status: int

    @property
    def is_bounded(self) -> bool:
        """Whether the error is within the bound, or the scan states none."""
        return not (self.error < -self.bound or self.error > self.bound + self.common)


class Listener:
    """A decoder, and what it publishes."""

    def __init__(self, fd: bool, period: int = 1000) -> None:
        self.decoder = Decoder(with_fd(SENSOR, fd))
        self.decoder.set_period(period)
        self.decoder.start()
        self.scans: list[Published] = []
        self._fd = fd
        self._sampled: dict[bytes, float] = {}
        self._shortest = 1e9

    def batch(self, arrival: float, ticks: Iterable[Tick], *others: Frame) -> None:
        """Receive the scans of some ticks at a time [ms], after other frames."""
        frames = list(others)
        for tick in ticks:
            self._sampled[make_scan(SENSOR, tick.sequence).counts.tobytes()] = tick.time
            frames += tick.frames(self._fd)
        self.receive(arrival, frames)

    def receive(self, arrival: float, frames: list[Frame]) -> None:
        """Receive frames at a time [ms]."""
        for decoded in self.decoder.decode(frames, round(arrival * MILLISECOND), 0):
            if isinstance(decoded, ScanReady):
                scan = decoded.scan
                sampled = self._sampled[scan.counts.tobytes()]  # KeyError: made of two
                self._shortest = min(self._shortest, arrival - sampled)
                error, bound = scan.stamp / MILLISECOND - sampled, 1e3 * scan.stamp_uncertainty
                self.scans.append(Published(scan.sequence, error, bound, self._shortest, scan.status))

    def one_by_one(self, ticks: Iterable[Tick], delay: float = 0.0) -> None:
        """Receive each scan when it was sampled, or later [ms]."""
        for tick in ticks:
            self.batch(tick.time + delay, [tick])

    @property
    def unbounded(self) -> list[Published]:
        """Scans whose error is not within the bounds that were stated with them."""
        return [scan for scan in self.scans if not scan.is_bounded]

    @property
    def accounted(self) -> int:
        """Scans that were published, counted as lost, or as incomplete."""
        statistics = self.decoder.statistics
        return len(self.scans) + statistics.lost_scans + statistics.incomplete_scans


def test_blocks_of_two_classic_scans_that_are_16_apart_are_not_one_scan() -> None:
    """Their counters are the same; scan 56 has no header, and all between was lost."""
    heard = Listener(fd=False)
    heard.one_by_one(Tick(sequence, sequence) for sequence in range(40))
    heard._sampled |= {make_scan(SENSOR, sequence).counts.tobytes(): sequence for sequence in (40, 56)}
    heard.receive(40, Tick(40, 40).frames(False)[:3])
    heard.receive(56, Tick(56, 56).frames(False)[3:])
    heard.one_by_one(Tick(sequence, sequence) for sequence in range(57, 100))
    assert [scan.sequence for scan in heard.scans] == [*range(40), *range(64, 100)]
    assert heard.accounted == 100


def test_a_block_that_others_have_overtaken_completes_no_scan_16_later() -> None:
    """All frames are late, a burst is lost; the block before it arrives after the header behind it."""
    heard = Listener(fd=False)
    heard.one_by_one(Tick(sequence, sequence) for sequence in range(64))
    heard.one_by_one((Tick(sequence, sequence) for sequence in range(64, 86)), delay=7)
    *first, last = Tick(86, 86).frames(False)
    heard.receive(93, first)
    header, *blocks = Tick(96, 96).frames(False)
    heard.receive(103, [header, last, *blocks])
    for sequence in range(96, 103):
        heard._sampled[make_scan(SENSOR, sequence).counts.tobytes()] = sequence
    heard.one_by_one((Tick(sequence, sequence) for sequence in range(97, 102)), delay=7)
    heard.receive(109, Tick(102, 102).frames(False)[:4])
    heard.one_by_one((Tick(sequence, sequence) for sequence in range(103, 140)), delay=7)
    assert [scan.sequence for scan in heard.scans[-37:]] == list(range(103, 140))
    assert not {86, 102} & {scan.sequence for scan in heard.scans}
    assert heard.accounted == 140


def test_scans_that_waited_since_a_reset_are_stamped_by_the_least_delayed_header() -> None:
    """The host stood still for a second; of scans without a header the times are not certain."""
    heard = Listener(fd=False)
    heard.batch(1000, [Tick(sequence, sequence) for sequence in range(700)])
    heard.one_by_one(Tick(sequence, sequence) for sequence in range(1001, 1100))
    assert len(heard.scans) > 690
    assert not heard.unbounded


def test_a_header_that_was_sampled_late_delays_no_stamp_of_the_scans_that_wait_for_the_next() -> None:
    """They wait as the blocks of its own scan were lost."""
    heard = Listener(fd=False)
    heard.one_by_one(Tick(sequence, sequence) for sequence in range(40))
    heard.decoder.set_period(1500)
    heard.receive(49, Tick(48, 49).frames(False)[:1])
    heard.one_by_one(Tick(sequence, 48 + 1.5 * (sequence - 48)) for sequence in range(49, 80))
    assert [scan.sequence for scan in heard.scans] == [*range(40), *range(49, 80)]
    assert max(abs(scan.error) for scan in heard.scans) < 0.01
    assert not heard.unbounded


def test_a_block_that_a_stalled_adapter_holds_back_belongs_to_its_scan() -> None:
    heard = Listener(fd=False)
    heard.one_by_one(Tick(sequence, sequence) for sequence in range(40))
    heard._sampled[make_scan(SENSOR, 40).counts.tobytes()] = 40
    frames = Tick(40, 40).frames(False)
    heard.receive(40, frames[:3])
    heard.receive(60, frames[3:])
    heard.batch(60, [Tick(sequence, sequence) for sequence in range(41, 61)])
    heard.one_by_one(Tick(sequence, sequence) for sequence in range(61, 80))
    assert [scan.sequence for scan in heard.scans] == list(range(80))


def test_counters_that_are_one_too_high_put_no_later_stamp_out_of_its_bound() -> None:
    """Their times are a period too late; frames arrive up to 4 ms late, and a second ends before the lie does."""
    heard = Listener(fd=False, period=5000)
    for sequence in range(32, 400):
        false = sequence + 177 if 204 <= sequence < 240 else None
        heard.batch(4 * (5 * sequence // 4 + 1), [Tick(sequence, 5 * sequence, false, header=sequence % 16 == 0)])
        if sequence == 240:
            heard.scans.clear()  # until here numbers may be false
    assert heard.scans[-1].sequence == 399
    assert len(heard.scans) > 140
    assert not heard.unbounded


@BOTH
def test_the_time_by_the_sequence_is_counted_from_the_tick_not_from_a_late_sample(fd: bool) -> None:
    """The board samples scan 64 late, and then lies about its time."""
    heard = Listener(fd)
    heard.one_by_one(Tick(sequence, sequence) for sequence in range(64))
    heard.batch(65.5, [Tick(64, 64.8)])
    lie = [Tick(sequence, sequence, stated=sequence + 90_000) for sequence in range(65, 200)]
    heard.one_by_one(lie, delay=1.5)
    late = [scan for scan in heard.scans if scan.sequence > 64]
    assert len(late) > 100
    assert max(abs(scan.error) for scan in late) < 0.05
    assert not heard.unbounded


@BOTH
def test_the_bound_covers_the_time_of_a_sequence_that_jumps_while_all_frames_are_late(fd: bool) -> None:
    """The adapter stalls: the arrival does not tell whether sequence or time has jumped; later frames are 1 ms late."""
    heard = Listener(fd)
    heard.one_by_one(Tick(sequence, sequence) for sequence in range(1000))
    stalled = [Tick(sequence, sequence) for sequence in range(1000, 1320)]
    jumped = [Tick(sequence, sequence, number=sequence + 20) for sequence in range(1320, 1700)]
    heard.batch(1700, stalled + jumped)
    heard.one_by_one((Tick(sequence, sequence) for sequence in range(1700, 2400)), delay=1.0)
    assert len(heard.scans) > 1900
    assert not heard.unbounded


def test_a_step_from_a_repeated_time_measures_no_period() -> None:
    """The board stands still, repeats its time once, and then its clock is behind."""
    heard = Listener(fd=True)
    heard.one_by_one(Tick(sequence, sequence) for sequence in range(100))
    heard.batch(241, [Tick(241, 241, stated=99)])
    heard.one_by_one(Tick(sequence, sequence, stated=sequence - 18) for sequence in range(251, 400))
    assert [scan.sequence for scan in heard.scans] == [*range(100), *range(251, 400)]
    assert not any(scan.status & ScanStatus.BOARD_RESET for scan in heard.scans)
    assert max(abs(scan.error) for scan in heard.scans) < 0.05


@BOTH
def test_a_frozen_clock_is_counted_on_by_the_period_that_was_measured(fd: bool) -> None:
    """The board sends every 2 ms, 4 ms are announced; after 200 scans its clock stands still."""
    heard = Listener(fd, period=4000)
    heard.one_by_one(Tick(sequence, 2 * sequence) for sequence in range(200))
    measured = len(heard.scans)
    heard.one_by_one(Tick(sequence, 2 * sequence, stated=398) for sequence in range(200, 400))
    assert len(heard.scans) > measured + 150
    assert max(abs(scan.error) for scan in heard.scans[measured:]) < 0.1


@pytest.mark.parametrize("period", [2, 5])
def test_a_period_that_another_host_sets_unanswered_spoils_no_classic_stamp(period: int) -> None:
    """Its command is heard, the board's response and the first headers are lost; frames arrive up to 3 ms late."""
    heard = Listener(fd=False)
    heard.one_by_one(Tick(sequence, sequence) for sequence in range(200))
    heard.receive(199, [(BASE + COMMAND_OFFSET, CLASSIC, Request(Command.SET_RATE, 9, 1000 * period).pack())])
    for sequence in range(200, 400):
        time = 200 + period * (sequence - 200)
        lost = {"header": False} if sequence < 212 else {}
        heard.batch(time + (1, 3, 2)[sequence % 3], [Tick(sequence, time, **lost)])
    assert heard.scans[-1].sequence >= 384
    assert not heard.unbounded
    assert heard.accounted + 16 >= 400


@BOTH
@pytest.mark.parametrize("period", [1, 499, 2000, 9_000_000, LONGEST_PERIOD])
def test_a_period_that_only_an_identity_states_spoils_no_stamp(fd: bool, period: int) -> None:
    """The scans do not keep it; the next identity states what they keep."""
    heard = Listener(fd)
    heard.one_by_one(Tick(sequence, sequence) for sequence in range(200))
    for stated in (period, 1000):
        identity = Identity(Identification(SENSOR.layout.id, PROTOCOL_VERSION, fd, 1), 0, stated)
        first = heard.scans[-1].sequence + 1
        heard.receive(first - 0.5, [(BASE + IDENTITY_OFFSET, CLASSIC, identity.pack())])
        heard.one_by_one(Tick(sequence, sequence) for sequence in range(first, 400 if stated == period else 600))
    assert heard.scans[-1].sequence >= 584
    assert not heard.unbounded
    assert heard.accounted + 16 >= 600
    assert heard.decoder.statistics.lost_scans <= 32


def test_a_late_response_to_an_earlier_command_spoils_no_classic_stamp() -> None:
    """Another host has set 5 ms; then comes the response to the driver's own command, which announces 1 ms."""
    heard = Listener(fd=False)
    heard.one_by_one(Tick(sequence, sequence) for sequence in range(64))
    command = BASE + COMMAND_OFFSET, CLASSIC, Request(Command.SET_RATE, 9, 5000).pack()
    responses = [
        (BASE + RESPONSE_OFFSET, CLASSIC, Response(Command.SET_RATE, tag, Result.OK, period).pack())
        for tag, period in ((9, 5000), (4, 1000))
    ]
    heard.receive(63, [command, responses[0]])
    changed = [Tick(sequence, 64 + 5 * (sequence - 64)) for sequence in range(64, 300)]
    heard.one_by_one(changed[:40])
    heard.receive(260, [responses[1]])
    heard.one_by_one(changed[40:])
    assert heard.scans[-1].sequence >= 284
    assert not heard.unbounded
    assert max(abs(scan.error) for scan in heard.scans) < 0.05


@pytest.mark.parametrize("phase", [0, 1, 8, 15])
@pytest.mark.parametrize("lost", [0, 1, 100])
def test_no_classic_scan_is_dropped_when_another_host_sets_the_period(phase: int, lost: int) -> None:
    """The first scan at the new period has a header, and the next may be lost."""
    heard, first = Listener(fd=False), 208 + phase
    heard.one_by_one(Tick(sequence, sequence) for sequence in range(first))
    command = BASE + COMMAND_OFFSET, CLASSIC, Request(Command.SET_RATE, 9, 2000).pack()
    response = BASE + RESPONSE_OFFSET, CLASSIC, Response(Command.SET_RATE, 9, Result.OK, 2000).pack()
    heard.receive(first - 0.5, [command, response])
    changed = [
        Tick(sequence, first - 1 + 2 * (sequence - first + 1), header=(sequence == first) or None)
        for sequence in range(first, 600)
    ]
    heard.one_by_one(changed[:17])
    for tick in changed[17 : 17 + lost]:  # or all that follow, for a while
        heard._sampled[make_scan(SENSOR, tick.sequence).counts.tobytes()] = tick.time
    heard.one_by_one(changed[17 + lost :])
    missing = lost + (32 if lost else 0)
    assert heard.scans[-1].sequence == 599
    assert len(heard.scans) >= 600 - missing
    assert heard.accounted == 600
    assert not heard.unbounded


@pytest.mark.parametrize("phase", [0, 9, 15])
@pytest.mark.parametrize("missed", [1, 7, 8, 16, 40])
def test_no_classic_scan_is_dropped_after_ticks_that_the_board_has_missed(phase: int, missed: int) -> None:
    heard, first = Listener(fd=False), 200 + phase + missed
    heard.one_by_one(Tick(sequence, sequence) for sequence in range(first - missed))
    heard.one_by_one(Tick(sequence, sequence, header=(sequence == first) or None) for sequence in range(first, 600))
    assert [scan.sequence for scan in heard.scans] == [*range(first - missed), *range(first, 600)]
    assert heard.decoder.statistics.lost_scans == missed
    assert not heard.unbounded


def test_an_overflow_leaves_no_classic_scan_with_a_number_that_only_its_arrival_tells() -> None:
    """The host stood still after a reset: what the kernel had kept arrives with the scans of two seconds later."""
    heard = Listener(fd=False)
    heard.decoder.note_overflow()
    heard.batch(2000, [Tick(sequence, sequence) for sequence in range(99)])
    heard.one_by_one(Tick(sequence, sequence) for sequence in range(2003, 2100))
    assert {scan.sequence for scan in heard.scans} == {*range(96), *range(2016, 2100)}
    assert heard.accounted == 2100


def test_two_scans_at_the_same_time_are_within_the_bound() -> None:
    """A shorter period than the time since the last tick: the next scan is sampled at once."""
    heard = Listener(fd=True, period=2000)
    heard.one_by_one(Tick(sequence, 2 * sequence) for sequence in range(50))
    heard.batch(104, [Tick(50, 100.8), Tick(51, 100.8)])
    heard.one_by_one(Tick(sequence, 100.8 + 2 * (sequence - 51)) for sequence in range(52, 100))
    assert [scan.sequence for scan in heard.scans] == list(range(100))
    assert not heard.unbounded


def test_a_time_after_its_arrival_holds_back_no_later_stamp() -> None:
    """As that of a scan which waited on a clock that was set back meanwhile."""
    stamps = AscendingStamps()
    assert stamps.stamp(time=5_000 * MILLISECOND, device_time=1000, arrival=1 * MILLISECOND) == 1 * MILLISECOND
    assert stamps.stamp(time=2 * MILLISECOND, device_time=2000, arrival=3 * MILLISECOND) == 2 * MILLISECOND
    assert stamps.excess == 0


@pytest.mark.parametrize("lost", [0, 1, 40])
def test_a_first_header_that_was_sampled_late_puts_no_stamp_out_of_its_bound(lost: int) -> None:
    """Its blocks are lost: the scans that follow teach the mapping times that are ahead of the board's clock."""
    heard = Listener(fd=False)
    heard.receive(0.9, Tick(0, 0.9).frames(False)[:1])
    heard.one_by_one(Tick(sequence, sequence + 0.3 * (sequence == 25)) for sequence in range(1 + lost, 3000))
    assert heard.scans[-1].sequence == 2999
    assert not heard.unbounded
    assert max(scan.bound for scan in heard.scans) > 0.9
    assert max(scan.bound for scan in heard.scans[-500:]) < 0.3


def test_a_classic_scan_that_was_sampled_late_is_within_its_bound() -> None:
    """No header tells it, but it arrives late by as much."""
    heard = Listener(fd=False)
    heard.one_by_one(Tick(sequence, sequence + 0.9 * (sequence % 16 == 9)) for sequence in range(200))
    assert [scan.sequence for scan in heard.scans] == list(range(200))
    assert min(scan.error for scan in heard.scans) < -0.8
    assert not heard.unbounded
    assert max(scan.bound for scan in heard.scans if scan.sequence % 16 != 9 and scan.sequence > 16) < 0.1


@BOTH
@pytest.mark.parametrize("opened", [True, False])
def test_a_reset_that_all_else_hides_puts_no_stamp_out_of_its_bound(fd: bool, opened: bool) -> None:
    """The number of the power-on repeats, and sequence and time are ahead of the last ones by the same."""
    heard = Listener(fd)
    heard.one_by_one(Tick(sequence, sequence) for sequence in range(1600))
    if opened:
        heard.decoder.start()
    heard.one_by_one(Tick(sequence, sequence + 700, stated=sequence) for sequence in range(1664, 2910))
    assert heard.scans[-1].sequence >= 2890
    assert min(scan.error for scan in heard.scans) < -690
    assert not heard.unbounded


@BOTH
def test_a_clock_that_stands_still_leaves_a_stamp_without_a_bound(fd: bool) -> None:
    heard = Listener(fd)
    heard.one_by_one(Tick(sequence, sequence) for sequence in range(96))
    heard.one_by_one(Tick(sequence, sequence, stated=95) for sequence in range(96, 196))
    heard.one_by_one(Tick(sequence, sequence) for sequence in range(196, 300))
    unknown = [scan.sequence for scan in heard.scans if math.isnan(scan.bound)]
    assert unknown[0] == 96
    assert 195 <= unknown[-1] < 208
    assert unknown == list(range(unknown[0], unknown[-1] + 1))
    assert not heard.unbounded


def test_a_classic_scan_that_waits_until_the_clock_runs_again_has_no_bound() -> None:
    """The clock stands still at 5 ms instead of 1 ms: it is counted on too slowly, and all scans seem to be late."""
    heard = Listener(fd=False)
    heard.one_by_one(Tick(sequence, sequence) for sequence in range(112))
    heard.one_by_one(Tick(sequence, 112 + 5 * (sequence - 112), stated=96) for sequence in range(112, 128))
    heard.one_by_one(Tick(sequence, 192 + sequence - 128, stated=96) for sequence in range(128, 160))
    waiting = heard.scans[-1].sequence + 1
    heard.one_by_one(Tick(sequence, 192 + sequence - 128) for sequence in range(160, 300))
    counted = [scan for scan in heard.scans if waiting <= scan.sequence < 160]
    assert [scan.sequence for scan in counted] == list(range(144, 160))
    assert max(scan.error for scan in counted) < -60
    assert all(math.isnan(scan.bound) for scan in counted)
    assert not heard.unbounded


@BOTH
def test_what_was_not_sent_at_an_earlier_period_is_lost_though_the_clock_stands_still(fd: bool) -> None:
    """Another host has stopped the board at 1 ms; it is set to 5 ms and started again, and its clock runs."""
    heard = Listener(fd)
    heard.one_by_one(Tick(sequence, sequence, stated=min(sequence, 50)) for sequence in range(100))
    heard.decoder.doubt_sequence()
    heard.decoder.set_period(5000)
    heard.decoder.start()
    heard.one_by_one(Tick(400 + number, 400 + 5 * number, header=number % 16 == 0) for number in range(100))
    assert heard.scans[-1].sequence >= 480
    assert not any(scan.status & ScanStatus.BOARD_RESET for scan in heard.scans)
    assert heard.accounted >= 480


@BOTH
def test_what_a_host_missed_that_stood_still_is_lost_though_the_clock_of_the_board_stands_still(fd: bool) -> None:
    """The kernel has kept the oldest scans."""
    heard = Listener(fd)
    heard.one_by_one(Tick(sequence, sequence) for sequence in range(100))
    heard.batch(32_000, [Tick(sequence, sequence, stated=96) for sequence in range(100, 300)])
    heard.one_by_one(Tick(sequence, sequence, stated=96) for sequence in range(32_000, 32_200))
    assert heard.scans[-1].sequence >= 32_190
    assert not any(scan.status & ScanStatus.BOARD_RESET for scan in heard.scans)
    assert heard.accounted >= 32_190
    assert heard.decoder.statistics.implausible == 0


def test_a_reset_is_flagged_when_the_scan_that_would_have_carried_the_flag_is_dropped() -> None:
    """An overflow has the first classic scan of a power-on wait for the next header; a restart drops it."""
    heard = Listener(fd=False)
    heard.one_by_one(Tick(tick, tick) for tick in range(40))
    assert not any(scan.status & ScanStatus.BOARD_RESET for scan in heard.scans)
    heard.decoder.note_overflow()
    codec, published = make_codec(SENSOR_CLASSIC), len(heard.scans)

    def of_next_power_on(sequence: int) -> list[Frame]:
        scan = make_scan(SENSOR_CLASSIC, sequence)
        scan.device_time = 1000 * sequence
        return codec.encode(scan, BASE, boot=1, header=sequence % 16 == 0)

    published_status = []
    for sequence in range(40):
        frames = of_next_power_on(sequence)
        for decoded in heard.decoder.decode(frames, (100 + sequence) * MILLISECOND, 0):
            assert isinstance(decoded, ScanReady)
            published_status.append((decoded.scan.sequence, decoded.scan.status))
        if sequence == 5:
            assert (published_status, len(heard.scans)) == ([], published)
            heard.decoder.start()
    sequences = [sequence for sequence, _ in published_status]
    assert sequences == list(range(16, 40))
    flagged = [sequence for sequence, status in published_status if status & ScanStatus.BOARD_RESET]
    assert flagged == [16]


@pytest.mark.parametrize(
    ("missing", "jump", "fd"),
    long_cases(
        crossed([0, 1, 20], [-40.0, 3.0, 19.0, 90_000.0], FRAMES),
        [
            *("0--40.0-fd", "20-3.0-fd", "1-19.0-fd", "0-90000.0-fd"),
            *("20--40.0-classic", "1-3.0-classic", "0-19.0-classic", "20-90000.0-classic"),
        ],
    ),
)
def test_a_jump_of_the_clock_is_bounded_though_only_an_identity_states_the_period(
    missing: int, jump: float, fd: bool
) -> None:
    """The period stated is false: counted on by it, the time is that of the future."""
    heard = Listener(fd)
    heard.one_by_one(Tick(sequence, sequence) for sequence in range(200))
    identity = Identity(Identification(SENSOR.layout.id, PROTOCOL_VERSION, fd, 1), 0, 20_000)
    heard.receive(199.5, [(BASE + IDENTITY_OFFSET, CLASSIC, identity.pack())])
    for sequence in range(200 + missing, 2000):
        heard.batch(sequence + (sequence % 7 > 0), [Tick(sequence, sequence, stated=sequence + jump)])
    assert heard.scans[-1].sequence >= 1984
    assert not heard.unbounded
    bounds = [scan.bound for scan in heard.scans if scan.sequence > 1700 and not math.isnan(scan.bound)]
    assert len(bounds) > 200
    assert max(bounds) < 8.0


@pytest.mark.parametrize(
    ("first", "fd"), long_cases(crossed([401, 402, 403], FRAMES), ["401-fd", "402-classic", "403-classic"])
)
def test_a_clock_that_runs_again_is_bounded_though_only_an_identity_states_the_period(first: int, fd: bool) -> None:
    """It has stood still; counted on by the period stated, the time was that of the future. Frames come by fours."""
    heard = Listener(fd)
    heard.one_by_one(Tick(sequence, sequence) for sequence in range(201))
    identity = Identity(Identification(SENSOR.layout.id, PROTOCOL_VERSION, fd, 1), 0, LONGEST_PERIOD)
    heard.receive(200.5, [(BASE + IDENTITY_OFFSET, CLASSIC, identity.pack())])
    for last in range(204, 2000, 4):
        ticks = range(last - 3, last + 1)
        heard.batch(last, [Tick(tick, tick, stated=200 if tick < first else None) for tick in ticks])
    assert heard.scans[-1].sequence >= 1980
    assert not heard.unbounded
    bounds = [scan.bound for scan in heard.scans if scan.sequence > 1700]
    assert len(bounds) > 200
    assert max(bounds) < 8.0


@pytest.mark.parametrize("gap", [0, 8, 40])
def test_what_a_host_missed_that_stood_still_is_lost_though_only_an_identity_states_the_period(gap: int) -> None:
    """The kernel has kept the oldest scans: they seem to be as new as the false period makes them."""
    heard = Listener(fd=False)
    heard.one_by_one(Tick(sequence, sequence) for sequence in range(100))
    identity = Identity(Identification(SENSOR.layout.id, PROTOCOL_VERSION, False, 1), 0, 20_000)
    heard.receive(99.5, [(BASE + IDENTITY_OFFSET, CLASSIC, identity.pack())])
    kept = [*range(100, 120), *range(120 + gap, 340)]
    heard.batch(3000, [Tick(sequence, sequence) for sequence in kept])
    heard.one_by_one(Tick(sequence, sequence) for sequence in range(3000, 3200))
    assert heard.scans[-1].sequence >= 3180
    assert not any(scan.status & ScanStatus.BOARD_RESET for scan in heard.scans)
    assert heard.accounted >= 3180
    assert not heard.unbounded
