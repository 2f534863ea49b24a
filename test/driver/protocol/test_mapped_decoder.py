# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Boards with frames of their own: counts as cantools encodes them, and every fault of a bus."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path

import cantools
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from posfet_driver.bus.frame import CLASSIC, ERROR, EXTENDED, FD, Frame
from posfet_driver.protocol.decoder import Decoder
from posfet_driver.protocol.mapped_decoder import MappedDecoder, make_decoder
from posfet_driver.protocol.scan_codec import make_codec
from posfet_model.config import ConfigError
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_model.sensor.frame_mapping import FrameMapping
from posfet_model.sensor.scan import Scan, ScanStatus
from support.own_boards import (
    BoardA,
    BoardB,
    codes_of,
    counts_of_codes,
    counts_of_millivolts,
    millivolts_of,
    own_protocol,
    sensor_a,
    sensor_b,
)

PERIOD = 1_000_000
"""Scan period of both boards [ns]."""
A, B = BoardA(), BoardB()


@dataclass
class Listener:
    """Decodes batches and keeps the scans."""

    decoder: MappedDecoder
    scans: list[Scan] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.decoder.start()

    def read(self, frames: Iterable[Frame], arrival: int) -> None:
        for _ in self.decoder.decode(list(frames), arrival, 0):
            self.scans.append(self.decoder.scan.snapshot())

    @property
    def sequences(self) -> list[int]:
        return [scan.sequence for scan in self.scans]


def frames_a(index: int, sequence: int | None = None) -> list[Frame]:
    return A.scan(index if sequence is None else sequence, codes_of(index))


def frames_b(index: int, time: int | None = None) -> list[Frame]:
    return B.scan(index if time is None else time, millivolts_of(index))


@dataclass(frozen=True)
class Style:
    """One of the boards."""

    frames: Callable[[int], list[Frame]]
    counts: Callable[[int], np.ndarray]
    sensor: Callable[[Path], Sensor]


STYLES = {
    "A": Style(frames_a, lambda index: counts_of_codes(codes_of(index)), sensor_a),
    "B": Style(frames_b, lambda index: counts_of_millivolts(millivolts_of(index)), sensor_b),
}


@pytest.fixture(params=STYLES)
def style(request: pytest.FixtureRequest) -> Style:
    return STYLES[request.param]


@pytest.fixture
def listener(style: Style, tmp_path: Path) -> Listener:
    return Listener(MappedDecoder(style.sensor(tmp_path)))


@pytest.fixture
def listener_a(tmp_path: Path) -> Listener:
    return Listener(MappedDecoder(sensor_a(tmp_path)))


@pytest.fixture
def listener_b(tmp_path: Path) -> Listener:
    return Listener(MappedDecoder(sensor_b(tmp_path)))


def assert_whole(listener: Listener, style: Style) -> None:
    """Assert that no scan was mixed from two: its counts are those of its sequence."""
    for scan in listener.scans:
        np.testing.assert_array_equal(scan.counts, style.counts(scan.sequence))


def test_every_scan_of_both_boards(listener: Listener, style: Style) -> None:
    for index in range(600):
        listener.read(style.frames(index), index * PERIOD)
    assert listener.sequences == list(range(600))
    assert_whole(listener, style)
    assert listener.decoder.frames_lost == 0


def test_frames_need_not_arrive_one_batch_per_scan(listener: Listener, style: Style) -> None:
    frames = [frame for index in range(300) for frame in style.frames(index)]
    per_scan = len(frames) // 300
    for begin in range(0, len(frames), 7):
        batch = frames[begin : begin + 7]
        listener.read(batch, (begin + len(batch)) // per_scan * PERIOD)
    assert listener.sequences == list(range(300))
    assert_whole(listener, style)


def test_what_a_board_does_not_send_is_flagged(listener_a: Listener, listener_b: Listener) -> None:
    listener_a.read(frames_a(0), 0)
    listener_b.read(frames_b(0), 0)
    assert listener_a.scans[0].status == ScanStatus.TIME_ESTIMATED
    assert listener_b.scans[0].status == ScanStatus.SEQUENCE_ESTIMATED
    assert listener_a.decoder.origin == {
        "sequence": "counter of the board, 8 bits",
        "time": "estimated from arrivals and scan rate",
        "lost scans": "exact while the counter tells",
    }
    assert listener_b.decoder.origin["sequence"] == "estimated from the board's time"
    assert listener_b.decoder.origin["time"] == "clock of the board, steps of 1000 us"


@pytest.mark.parametrize("index", [0, 2, 4])
def test_a_lost_frame_costs_its_scan(listener_a: Listener, index: int) -> None:
    for sequence in range(10):
        frames = frames_a(sequence)
        listener_a.read(frames[:index] + frames[index + 1 :] if sequence == 5 else frames, sequence * PERIOD)
    assert listener_a.sequences == [0, 1, 2, 3, 4, 6, 7, 8, 9]
    statistics = listener_a.decoder.statistics
    assert (statistics.incomplete_scans, statistics.lost_scans, statistics.missing_frames) == (1, 0, 1)


@pytest.mark.parametrize("lost", [0, 1])
def test_a_lost_frame_without_a_counter(listener_b: Listener, lost: int) -> None:
    for index in range(10):
        frames = frames_b(index)
        listener_b.read(frames[:lost] + frames[lost + 1 :] if index == 5 else frames, index * PERIOD)
    assert listener_b.sequences == [0, 1, 2, 3, 4, 6, 7, 8, 9]
    assert_whole(listener_b, STYLES["B"])
    statistics = listener_b.decoder.statistics
    assert statistics.incomplete_scans + statistics.lost_scans == 1


@settings(max_examples=25)
@given(st.lists(st.integers(0, 119), max_size=60, unique=True))
def test_no_scan_is_mixed_from_two_whatever_is_lost(tmp_path_factory: pytest.TempPathFactory, lost: list[int]) -> None:
    """Each frame of these boards holds the counter, or the time in steps of one period."""
    for style in STYLES.values():
        listener = Listener(MappedDecoder(style.sensor(tmp_path_factory.mktemp("sensor"))))
        frames = [(index, frame) for index in range(24) for frame in style.frames(index)]
        for number, (index, frame) in enumerate(frames):
            if number not in lost:
                listener.read([frame], index * PERIOD + number % 5 * 1000)
        known = [scan.counts.tolist() for scan in listener.scans]
        whole = [style.counts(index).tolist() for index in range(24)]
        assert all(counts in whole for counts in known)
        statistics = listener.decoder.statistics
        if listener.scans:
            begun = listener.scans[-1].sequence - listener.scans[0].sequence + 1
            assert len(listener.scans) + statistics.lost_scans + statistics.incomplete_scans >= begun


def test_lost_scans_are_counted(listener: Listener, style: Style) -> None:
    for index in (0, 1, 2, 6, 7):
        listener.read(style.frames(index), index * PERIOD)
    assert listener.sequences == [0, 1, 2, 6, 7]
    assert listener.decoder.statistics.lost_scans == 3
    assert listener.scans[-1].frames_lost == 3 * listener.decoder.blocks


def test_doubled_frames_are_counted_and_ignored(listener: Listener, style: Style) -> None:
    for index in range(10):
        listener.read([frame for frame in style.frames(index) for _ in range(2)], index * PERIOD)
    assert listener.sequences == list(range(10))
    assert_whole(listener, style)
    assert listener.decoder.statistics.duplicate == 10 * listener.decoder.blocks
    assert listener.decoder.frames_lost == 0


def test_reordered_frames_with_a_counter(listener_a: Listener) -> None:
    for index in range(10):
        frames = frames_a(index)
        listener_a.read([frames[1], frames[0], *frames[2:]], index * PERIOD)
    assert listener_a.sequences == list(range(10))
    assert_whole(listener_a, STYLES["A"])
    assert listener_a.decoder.statistics.reordered == 10


def test_reordered_frames_without_a_counter_are_no_scan(listener_b: Listener) -> None:
    for index in range(10):
        listener_b.read(frames_b(index)[:: -1 if index == 5 else 1], index * PERIOD)
    assert listener_b.sequences == [0, 1, 2, 3, 4, 6, 7, 8, 9]
    assert_whole(listener_b, STYLES["B"])


def test_late_frames_are_ignored(listener_a: Listener) -> None:
    late = frames_a(3)[4]
    for index in range(8):
        frames = frames_a(index)
        listener_a.read(frames[:4] if index == 3 else frames, index * PERIOD)
    listener_a.read([late], 8 * PERIOD)
    assert listener_a.sequences == [0, 1, 2, 4, 5, 6, 7]
    assert listener_a.decoder.statistics.late == 1


def test_a_scan_that_comes_late_without_a_counter_is_ignored(listener_b: Listener) -> None:
    for index in (0, 1, 2, 4, 5, 3, 6):
        listener_b.read(frames_b(index), max(index, 5) * PERIOD)
    assert listener_b.sequences == [0, 1, 2, 4, 5, 6]
    assert listener_b.decoder.statistics.late == 1
    assert listener_b.decoder.resets == 0


def test_truncated_and_foreign_frames(listener: Listener, style: Style) -> None:
    identifier, kind, data = style.frames(0)[0]
    other = FD | EXTENDED if kind == CLASSIC | EXTENDED else CLASSIC
    listener.read([(identifier, kind, data[:-1]), (identifier, other, data[:8])], 0)
    assert listener.decoder.statistics.malformed == 2
    listener.read([(0x7F, CLASSIC, b"\x01"), (identifier ^ 0x55, kind, data), (0, ERROR, bytes(8))], 0)
    assert listener.decoder.traffic.unrelated == 2
    assert listener.scans == []


def test_a_frame_of_a_wrong_length_is_one_lost_frame(listener: Listener, style: Style) -> None:
    for index in range(10):
        frames = style.frames(index)
        if index == 5:
            identifier, kind, data = frames[-1]
            frames[-1] = identifier, kind, data[:-1]
        listener.read(frames, index * PERIOD)
    assert len(listener.scans) == 9
    assert (listener.decoder.statistics.malformed, listener.decoder.frames_lost) == (1, 1)


def test_a_value_of_the_multiplexer_that_the_dbc_does_not_have(listener_a: Listener) -> None:
    identifier, kind, data = frames_a(0)[0]
    listener_a.read([(identifier, kind, bytes([0xF0 | data[0]]) + data[1:])], 0)
    assert listener_a.decoder.statistics.malformed == 1


def test_temperatures_and_flags_from_a_frame_of_their_own(listener_a: Listener) -> None:
    assert np.isnan(listener_a.decoder.scan.temperatures).all()
    listener_a.read([A.status(31.5, -12.25, undervoltage=1), *frames_a(0)], 0)
    assert listener_a.scans[0].temperatures.tolist() == [31.5, -12.25]
    assert listener_a.scans[0].status == ScanStatus.SUPPLY_LOW | ScanStatus.TIME_ESTIMATED
    listener_a.read([A.status(31.5, -12.25, overheated=1), *frames_a(1)], PERIOD)
    assert listener_a.scans[1].status == ScanStatus.OVERTEMPERATURE | ScanStatus.TIME_ESTIMATED
    identifier, kind, _ = A.status(0, 0)
    listener_a.read([(identifier, kind, bytes([0xFF] * 6)), *frames_a(2)], 2 * PERIOD)  # 215.9 degC, beyond the DBC
    assert np.isnan(listener_a.scans[2].temperatures).all()


def test_a_long_pause_is_longer_than_the_counter_tells(listener_a: Listener) -> None:
    """After 1000 scans the counter of 8 bits is ahead by 232: the arrival tells the rest."""
    for index in (*range(50), *range(1050, 1150)):
        listener_a.read(frames_a(index), index * PERIOD)
    assert listener_a.sequences == [*range(50), *range(1050, 1150)]
    assert listener_a.decoder.statistics.lost_scans == 1000


@pytest.mark.parametrize("gap", [100, 248, 254, 255, 256, 400, 511, 512, 700])
def test_incomplete_scans_tell_how_often_the_counter_has_turned(listener_a: Listener, gap: int) -> None:
    for index in range(50 + gap + 50):
        whole = not 50 <= index < 50 + gap
        listener_a.read(frames_a(index)[: None if whole else 4], index * PERIOD)
    assert listener_a.sequences == [*range(50), *range(50 + gap, 50 + gap + 50)]
    statistics = listener_a.decoder.statistics
    assert (statistics.incomplete_scans, statistics.lost_scans, statistics.late) == (gap, 0, 0)


def test_frames_that_overtake_others_are_no_turn_of_the_counter(listener_a: Listener) -> None:
    for index in range(400):
        overtaken = frames_a(index - 20)[:1] if index % 40 == 39 else []
        listener_a.read([*overtaken, *frames_a(index)], index * PERIOD)
    assert listener_a.sequences == list(range(400))
    assert listener_a.decoder.statistics.lost_scans == 0


def test_frames_that_were_delayed_are_no_loss(listener: Listener, style: Style) -> None:
    """A host that stands still for 0.2 s finds all frames in its queue."""
    for index in range(100):
        listener.read(style.frames(index), index * PERIOD)
    listener.read([frame for index in range(100, 300) for frame in style.frames(index)], 300 * PERIOD)
    for index in range(300, 500):
        listener.read(style.frames(index), index * PERIOD)
    assert listener.sequences == list(range(500))
    assert listener.decoder.statistics.lost_scans == 0


def test_a_pause_longer_than_the_boards_time_tells(listener_b: Listener) -> None:
    """The time of 16 bits wraps after 65.5 s."""
    pause = 100_000
    for index in (*range(50), *range(pause, pause + 100)):
        listener_b.read(frames_b(index), index * PERIOD)
    assert listener_b.sequences[49:51] == [49, pause]
    assert listener_b.scans[-1].device_time == (pause + 99) * 1000
    assert listener_b.scans[-1].stamp == pytest.approx((pause + 99) * PERIOD, abs=2 * PERIOD)


def test_time_unwraps(listener_b: Listener) -> None:
    for index in range(65500, 65600):
        listener_b.read(frames_b(index, time=index), index * PERIOD)
    assert [scan.device_time for scan in listener_b.scans] == [1000 * index for index in range(65500, 65600)]


def test_steps_of_the_clock_as_long_as_a_period_are_no_loss(listener_b: Listener) -> None:
    """Of a clock that runs beside the scan timer, some steps hold no scan and some hold two."""
    for index in range(400):
        listener_b.read(frames_b(index, time=int(index * 1.0 + 0.5 + 0.49 * (-1) ** (index // 50))), index * PERIOD)
    assert listener_b.sequences == list(range(400))


@pytest.mark.parametrize("restart", [0, 3])
def test_a_board_that_restarts(listener_b: Listener, restart: int) -> None:
    for index in range(1000):
        listener_b.read(frames_b(index, 40_000 + index), index * PERIOD)
    for index in range(20):
        listener_b.read(frames_b(index, restart + index), (1500 + index) * PERIOD)
    first = listener_b.scans[1000]
    assert first.status == ScanStatus.SEQUENCE_ESTIMATED | ScanStatus.BOARD_RESET
    assert first.device_time == 1000 * restart
    assert listener_b.decoder.resets == 1
    assert listener_b.sequences == list(range(1020))
    assert first.stamp == 1500 * PERIOD


def test_a_counter_that_restarts(listener_a: Listener) -> None:
    """When it is further ahead than scans fit into the time since the previous one."""
    for index in range(150):
        listener_a.read(frames_a(index), index * PERIOD)
    for index in range(20):
        listener_a.read(frames_a(index), (160 + index) * PERIOD)
    reset = listener_a.scans[150]
    assert reset.sequence == 0
    assert reset.status == ScanStatus.TIME_ESTIMATED | ScanStatus.BOARD_RESET
    assert listener_a.sequences[150:] == list(range(20))


def test_a_frozen_counter_is_reported(listener_a: Listener) -> None:
    for index in range(20):
        listener_a.read(frames_a(index, sequence=7), index * PERIOD)
    assert len(listener_a.scans) == 1
    assert listener_a.decoder.statistics.frozen_counter > 10


def test_a_frozen_clock_is_replaced_by_arrivals(listener_b: Listener) -> None:
    for index in range(50):
        listener_b.read(frames_b(index, min(index, 10)), index * PERIOD)
    frozen = listener_b.scans[-1]
    assert frozen.status & ScanStatus.TIME_ESTIMATED
    assert frozen.device_time == 0
    assert frozen.stamp == pytest.approx(49 * PERIOD, abs=PERIOD)
    assert math.isnan(frozen.stamp_uncertainty)
    assert all(
        abs(scan.stamp - index * PERIOD) <= 1e9 * scan.stamp_uncertainty
        for index, scan in enumerate(listener_b.scans[:11])
    )
    assert listener_b.decoder.frozen_clock > 30


def no_counter_no_time(tmp_path: Path) -> MappedDecoder:
    sensor = sensor_b(tmp_path)
    mapping = sensor.mapping
    assert mapping is not None
    return MappedDecoder(replace(sensor, mapping=replace(mapping, time=())))


class TestNeitherCounterNorTime:
    def test_all_is_estimated(self, tmp_path: Path) -> None:
        listener = Listener(no_counter_no_time(tmp_path))
        for index in range(100):
            listener.read(frames_b(index), index * PERIOD)
        assert listener.sequences == list(range(100))
        assert listener.scans[0].status == ScanStatus.SEQUENCE_ESTIMATED | ScanStatus.TIME_ESTIMATED
        assert listener.decoder.origin["sequence"] == "estimated from arrivals"
        assert [scan.stamp for scan in listener.scans] == [index * PERIOD for index in range(100)]
        assert all(math.isnan(scan.stamp_uncertainty) for scan in listener.scans)

    def test_an_incomplete_scan_counts(self, tmp_path: Path) -> None:
        listener = Listener(no_counter_no_time(tmp_path))
        for index in range(100):
            frames = frames_b(index)
            listener.read(frames[:1] if index == 50 else frames, index * PERIOD)
        assert listener.sequences == [*range(50), *range(51, 100)]

    def test_a_pause_is_counted_by_its_duration(self, tmp_path: Path) -> None:
        listener = Listener(no_counter_no_time(tmp_path))
        for index in (*range(100), *range(2100, 2200)):
            listener.read(frames_b(index), index * PERIOD)
        assert listener.sequences[100] == pytest.approx(2100, abs=2)
        assert listener.decoder.statistics.lost_scans == pytest.approx(2000, abs=12)

    def test_one_lost_scan_is_noticed_later(self, tmp_path: Path) -> None:
        listener = Listener(no_counter_no_time(tmp_path))
        for index in (*range(100), *range(101, 300)):
            listener.read(frames_b(index), index * PERIOD)
        assert listener.sequences[-1] == 299
        assert listener.decoder.statistics.lost_scans == 1

    @pytest.mark.parametrize("pause", [1, 2, 5, 1000])
    def test_half_a_scan_before_a_pause_and_half_after_it_are_no_scan(self, tmp_path: Path, pause: int) -> None:
        listener = Listener(no_counter_no_time(tmp_path))
        listener.read(frames_b(0), 0)
        listener.read(frames_b(1)[:1], PERIOD)
        listener.read(frames_b(1 + pause)[1:], (1 + pause) * PERIOD)
        listener.read(frames_b(2 + pause), (2 + pause) * PERIOD)
        known = [STYLES["B"].counts(index).tolist() for index in (0, 2 + pause)]
        assert [scan.counts.tolist() for scan in listener.scans] == known

    def test_a_batch_with_an_overflow_is_discarded(self, tmp_path: Path) -> None:
        """As many frames lost in a row as a scan has: nothing in the frames shows it."""
        listener = Listener(no_counter_no_time(tmp_path))
        listener.read([*frames_b(0), frames_b(1)[0]], 0)
        listener.decoder.note_overflow()
        listener.read([frames_b(2)[1], *frames_b(3)], 3 * PERIOD)
        listener.read(frames_b(4), 4 * PERIOD)
        known = [STYLES["B"].counts(index).tolist() for index in (0, 4)]
        assert [scan.counts.tolist() for scan in listener.scans] == known
        with_time = Listener(MappedDecoder(sensor_b(tmp_path)))
        with_time.decoder.note_overflow()
        with_time.read(frames_b(0), 0)
        assert len(with_time.scans) == 1

    def test_a_scan_in_two_batches_is_one(self, tmp_path: Path) -> None:
        """An adapter that delivers every 10 ms cuts many scans in two."""
        listener = Listener(no_counter_no_time(tmp_path))
        frames = [frame for index in range(200) for frame in frames_b(index)]
        for begin in range(0, 400, 19):
            batch = frames[begin : begin + 19]
            listener.read(batch, (begin + len(batch)) * PERIOD // 2)
        assert listener.sequences == list(range(200))
        assert_whole(listener, STYLES["B"])


def test_the_bus_was_closed_in_between(listener: Listener, style: Style) -> None:
    blocks = listener.decoder.blocks
    listener.read(style.frames(0), 0)
    listener.read(style.frames(1)[: blocks - 1], PERIOD)
    listener.decoder.start()
    listener.read(style.frames(20)[blocks - 1 :], 20 * PERIOD)
    listener.read(style.frames(21), 21 * PERIOD)
    assert listener.sequences == [0, 21]
    assert_whole(listener, style)


@pytest.mark.parametrize("first", [1, 4])
def test_the_scan_in_which_it_begins_to_listen_is_no_loss(style: Style, tmp_path: Path, first: int) -> None:
    listener = Listener(MappedDecoder(style.sensor(tmp_path)))
    first = min(first, listener.decoder.blocks - 1)
    listener.read([*style.frames(3)[first:], *style.frames(4)], 0)
    listener.read([*style.frames(5)[:-1], *style.frames(6)], 2 * PERIOD)
    assert [scan.counts.tolist() for scan in listener.scans] == [style.counts(index).tolist() for index in (4, 6)]
    statistics = listener.decoder.statistics
    assert (statistics.incomplete_scans, statistics.missing_frames, statistics.late) == (1, 1, 0)
    listener.decoder.start()  # after the bus was closed
    listener.read([*style.frames(7)[first:], *style.frames(8)], 4 * PERIOD)
    assert statistics.incomplete_scans == 1


def test_nothing_is_received_before_the_start(tmp_path: Path) -> None:
    decoder = MappedDecoder(sensor_a(tmp_path))
    assert list(decoder.decode(frames_a(0), 0, 0)) == []
    assert decoder.statistics.missing_frames == 0


def test_the_protocol_of_this_project_as_a_mapping(tmp_path: Path) -> None:
    """Its DBC file describes it as any other, frames numbered by a signal included."""
    plain = load_sensor("posfet_16x16")
    sensor = own_protocol(tmp_path / "own.yaml", "posfet_16x16")
    own, mapped = Decoder(plain), make_decoder(sensor)
    assert isinstance(mapped, MappedDecoder)
    codec, scan = make_codec(plain), Scan.empty(plain.layout.id, plain.layout.taxels)
    random = np.random.default_rng(1)
    own.start()
    mapped.start()
    for index in range(20):
        scan.sequence, scan.device_time = 70_000 + index, 1000 * index
        scan.counts[:] = random.integers(0, 65536, 256)
        frames = codec.encode(scan, plain.can.base_id)
        found = [len(list(decoder.decode(frames, index * PERIOD, 0))) for decoder in (own, mapped)]
        if index == 0:  # the own decoder waits for a second scan
            continue
        assert found == [1, 1]
        for decoder in (own, mapped):
            np.testing.assert_array_equal(decoder.scan.counts, scan.counts)
        assert mapped.scan.sequence == own.scan.sequence
        assert mapped.scan.device_time == own.scan.device_time
        assert mapped.scan.stamp == own.scan.stamp


def test_such_a_sensor_has_no_frames_of_the_project(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"posfet_5x5: the board has frames of its own"):
        Decoder(sensor_a(tmp_path))


@st.composite
def dbc_messages(draw: st.DrawFn) -> tuple[str, int]:
    """Return a DBC file with random count signals C0, C1, ... and their number."""
    lines, number = ['VERSION ""', "BU_: X"], 0
    for message in range(draw(st.integers(1, 3))):
        big = draw(st.booleans())
        lines.append(f"BO_ {0x100 + message} M{message}: 8 X")
        position = draw(st.integers(0, 12))
        while position + (length := draw(st.integers(8, 16))) <= 64:
            start = 8 * (position // 8) + 7 - position % 8 if big else position
            sign = draw(st.sampled_from("+-"))
            scale, offset = draw(st.sampled_from([(1, 0), (0.5, -100), (-2, 7), (0.001, 0)]))
            limits = draw(st.sampled_from(["0|0", "-20|200"]))
            unit = draw(st.sampled_from(["", "mV", "V"]))
            lines.append(
                f' SG_ C{number} : {start}|{length}@{0 if big else 1}{sign} ({scale},{offset}) [{limits}] "{unit}" X'
            )
            number += 1
            position += length + draw(st.integers(0, 5))
    return "\n".join(lines) + "\n", number


@settings(max_examples=50)
@given(dbc_messages(), st.randoms(use_true_random=False))
def test_counts_are_those_of_the_rule_for_any_signals(
    tmp_path_factory: pytest.TempPathFactory, dbc: tuple[str, int], random: object
) -> None:
    text, number = dbc
    path = tmp_path_factory.mktemp("dbc") / "any.dbc"
    path.write_text(text, encoding="ascii")
    mapping = FrameMapping("any", path, tuple(f"C{i}" for i in range(number)), "", (), (), "", (), (), ())
    sensor = load_sensor()
    layout = replace(sensor.layout, rows=1, cols=number)
    adc = replace(sensor.adc, bits=8)
    decoder = MappedDecoder(replace(sensor, layout=layout, adc=adc, mapping=mapping))
    decoder.start()
    frames: list[Frame] = []
    expected: list[float] = []
    for message in cantools.database.load_string(text, "dbc").messages:
        data = bytes(random.randrange(256) for _ in range(8))  # type: ignore[attr-defined]
        frames.append((message.frame_id, CLASSIC, data))
        values = message.decode(data)
        for signal in sorted(message.signals, key=lambda signal: int(signal.name[1:])):
            expected.append(place(signal, float(values[signal.name]), adc.low, adc.high))
    assert len(list(decoder.decode(frames, 0, 0))) == 1
    np.testing.assert_allclose(decoder.scan.counts, expected, atol=0.501, rtol=0)


def place(signal: cantools.database.can.Signal, value: float, low: float, high: float) -> float:
    """Return the count of a physical value by the rule of docs/own-frames.md, not rounded."""
    if signal.unit:
        value *= {"mV": 1e-3, "V": 1.0}[signal.unit]
    elif signal.minimum is not None:
        low, high = signal.minimum, signal.maximum
    else:
        least, most = (
            (-(1 << signal.length - 1), (1 << signal.length - 1) - 1)
            if signal.is_signed
            else (0, (1 << signal.length) - 1)
        )
        low, high = sorted(raw * signal.scale + signal.offset for raw in (least, most))
    return min(max((value - low) / (high - low), 0.0), 1.0) * 65535


SPREAD = """VERSION ""

BU_: X

BO_ 256 Head: 8 X
 SG_ Number : 0|4@1+ (1,0) [0|15] "" X
 SG_ Serial : 8|32@1+ (1,0) [0|0] "" X
 SG_ Ticks : 40|16@1+ (0.5,0) [0|0] "ms" X

BO_ 257 Body: 2 X
 SG_ C0 : 0|16@1+ (1,0) [0|0] "" X

BO_ 258 Tail: 7 X
 SG_ C1 : 0|16@1+ (1,0) [0|0] "" X
 SG_ Number : 16|4@1+ (1,0) [0|15] "" X
 SG_ Micros : 24|32@1+ (1,0) [0|0] "us" X
"""
"""A board whose header and tail hold counters and times of several lengths."""


class TestCounterAndTimeInSomeFrames:
    @pytest.fixture
    def listen(self, tmp_path: Path) -> Callable[..., Listener]:
        path = tmp_path / "spread.dbc"
        path.write_text(SPREAD, encoding="ascii")
        sensor = load_sensor()
        layout = replace(sensor.layout, rows=1, cols=2)

        def make(sequence: tuple[str, ...], time: tuple[str, ...]) -> Listener:
            order = ("Head", "Body", "Tail") if (*sequence, *time) != ("Tail.Number", "Micros") else ()
            mapping = FrameMapping("any", path, ("C0", "C1"), "", sequence, time, "", (), (), order)
            return Listener(MappedDecoder(replace(sensor, layout=layout, mapping=mapping)))

        return make

    def frames(self, index: int) -> list[Frame]:
        head = (index % 16).to_bytes(1, "little") + (1000 + index).to_bytes(4, "little")
        head += (2 * index % 65536).to_bytes(2, "little") + b"\0"
        tail = (index % 65536).to_bytes(2, "little") + (index % 16).to_bytes(1, "little")
        tail += (1000 * index % (1 << 32)).to_bytes(4, "little")
        return [(256, CLASSIC, head), (257, CLASSIC, (index % 65536).to_bytes(2, "little")), (258, CLASSIC, tail)]

    def test_scans_whose_counters_differ_are_not_mixed(self, listen: Callable[..., Listener]) -> None:
        """As many frames in a row as a scan has are lost: Tail of 5, Head and Body of 6."""
        listener = listen(("Head.Number", "Tail.Number"), ())
        for index in range(10):
            part = {5: slice(0, 2), 6: slice(2, 3)}.get(index, slice(0, 3))
            listener.read(self.frames(index)[part], (5 if index == 6 else index) * PERIOD)
        assert listener.sequences == [0, 1, 2, 3, 4, 7, 8, 9]
        assert all(scan.counts.tolist() == [scan.sequence] * 2 for scan in listener.scans)

    @pytest.mark.parametrize("pause", [16, 17, 30, 100, 3000])
    def test_the_time_tells_how_often_a_short_counter_has_wrapped(
        self, listen: Callable[..., Listener], pause: int
    ) -> None:
        listener = listen(("Tail.Number",), ("Micros",))
        indices = [*range(10), *range(9 + pause, 20 + pause)]
        for index in indices:
            listener.read(self.frames(index)[1:], index * PERIOD)
        assert listener.sequences[9:12] == [9, 9 + pause, 10 + pause]
        assert [scan.device_time for scan in listener.scans] == [1000 * index for index in indices]

    def test_a_scan_that_comes_late_is_ignored(self, listen: Callable[..., Listener]) -> None:
        listener = listen(("Tail.Number",), ("Micros",))
        for index in (0, 1, 2, 4, 5, 3, 6):
            listener.read(self.frames(index)[1:], max(index, 5) * PERIOD)
        assert listener.sequences == [0, 1, 2, 4, 5, 6]
        assert listener.decoder.statistics.late == 1

    def test_the_counter_tells_how_often_a_short_time_has_wrapped(self, listen: Callable[..., Listener]) -> None:
        """The time wraps after 32.8 s, the counter after 50 days."""
        listener = listen(("Serial",), ("Ticks",))
        for index in (*range(10), *range(100_000, 100_010)):
            listener.read(self.frames(index), index * PERIOD)
        assert listener.sequences[9:11] == [1009, 101_000]
        assert listener.scans[-1].device_time == 100_009_000
        assert listener.decoder.statistics.lost_scans == 100_000 - 10
