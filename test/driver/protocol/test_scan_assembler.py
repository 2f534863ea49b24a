"""The assembler passes on complete scans only; every fault is classified and counted."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from posfet_driver.bus.frame import Frame
from posfet_driver.protocol.scan_assembler import Assembler
from posfet_driver.protocol.scan_codec import make_codec
from posfet_driver.protocol.sequence_recovery import SequenceTracker
from posfet_model.sensor.description import load_sensor
from support.fake_board import make_scan, marked_counts, with_fd, with_layout

SENSOR = with_layout(load_sensor(), 5, 12)  # three FD blocks, twelve classic ones
BASE = SENSOR.can.base_id
BOTH = pytest.mark.parametrize("fd", [True, False], ids=["fd", "classic"])


class Line:
    """A board, a link with scripted faults, an assembler, and the sequences of its scans."""

    def __init__(self, fd: bool, first: int = 0) -> None:
        self.codec = make_codec(with_fd(SENSOR, fd))
        self.assembler = Assembler(self.codec)
        self.tracker = SequenceTracker(self.assembler)
        self.tracker.resync(first)
        self.published: list[int] = []

    @property
    def losses(self) -> dict[str, int]:
        losses = self.assembler.statistics
        return {name: value for name in losses.__slots__ if (value := getattr(losses, name))}

    def frames(self, sequence: int) -> list[Frame]:
        return self.codec.encode(make_scan(SENSOR, sequence), BASE)

    def feed(self, *frames: Frame) -> None:
        for identifier, kind, data in frames:
            if self.tracker.feed(identifier - BASE, kind, data):
                sequence = self.tracker.sequence
                self.published.append(sequence)
                np.testing.assert_array_equal(self.assembler.counts, marked_counts(sequence, SENSOR.layout.taxels))

    def send(self, *sequences: int) -> None:
        for sequence in sequences:
            self.feed(*self.frames(sequence))


@BOTH
def test_complete_scans_are_passed_on(fd: bool) -> None:
    line = Line(fd)
    line.send(*range(100))
    assert line.published == list(range(100))
    assert line.losses == {}


@BOTH
def test_blocks_of_a_scan_may_come_in_any_order(fd: bool) -> None:
    line = Line(fd)
    line.feed(*reversed(line.frames(0)))
    assert line.published == [0]
    assert line.losses == {"reordered": line.codec.blocks - 1}


@BOTH
@pytest.mark.parametrize("missing", [0, 1, -1])
def test_an_incomplete_scan_is_counted_and_discarded(fd: bool, missing: int) -> None:
    line = Line(fd)
    line.send(0)
    incomplete = line.frames(1)
    del incomplete[missing]
    line.feed(*incomplete)
    line.send(2)
    assert line.published == [0, 2]
    assert line.losses == {"incomplete_scans": 1, "missing_frames": 1}


@BOTH
def test_blocks_of_different_scans_are_not_combined(fd: bool) -> None:
    line = Line(fd)
    line.feed(*line.frames(0)[:1], *line.frames(1)[1:])
    line.send(2)
    blocks = line.codec.blocks
    assert line.published == [2]
    assert line.losses == {"incomplete_scans": 2, "missing_frames": blocks}


@BOTH
def test_lost_scans_are_counted(fd: bool) -> None:
    line = Line(fd)
    line.send(0, 5)
    assert line.published == [0, 5]
    assert line.losses == {"lost_scans": 4, "missing_frames": 4 * line.codec.blocks}


@BOTH
def test_duplicate_frames_have_no_effect(fd: bool) -> None:
    line = Line(fd)
    for frame in line.frames(0):
        line.feed(frame, frame)
    line.send(1)
    assert line.published == [0, 1]
    assert line.losses == {"duplicate": line.codec.blocks}


@BOTH
def test_a_late_frame_is_discarded(fd: bool) -> None:
    line = Line(fd)
    late, *rest = line.frames(1)
    line.send(0)
    line.feed(*rest)
    line.send(2)
    line.feed(late)
    line.send(3)
    assert line.published == [0, 2, 3]
    assert line.losses == {"incomplete_scans": 1, "missing_frames": 1, "late": 1}


@BOTH
@pytest.mark.parametrize("start", [0, 65_530, (1 << 32) - 5])
def test_counter_and_clock_wraps_are_unwrapped(fd: bool, start: int) -> None:
    line = Line(fd, start)
    times = []
    for sequence in range(start, start + 40):
        line.send(sequence)
        times.append(line.assembler.device_time)
    assert line.published == list(range(start, start + 40))
    assert line.losses == {}
    assert set(np.diff(times)) == ({1000} if fd else {0})


def test_the_clock_of_an_fd_board_wraps() -> None:
    line = Line(True)
    for sequence, time in enumerate([0xFFFF_FF00, 0xFFFF_FFFF + 1 + 744, 0xFFFF_FFFF + 1 + 1744]):
        line.feed(*line.codec.encode(make_scan(SENSOR, sequence, time), BASE))
    assert line.assembler.device_time == 0xFFFF_FF00 + 2000


@pytest.mark.parametrize("cut", [1, 5, 11])
@pytest.mark.parametrize("lost", [16, 32, 160])
def test_a_known_sequence_between_two_scans_separates_equal_classic_counters(cut: int, lost: int) -> None:
    line = Line(False)
    line.send(0)
    line.feed(*line.frames(1)[:cut])
    line.tracker.align(lost, 0x1_0000)
    line.feed(*line.frames(1 + lost)[cut:])
    line.send(2 + lost)
    assert line.published == [0, 2 + lost]
    assert line.losses["incomplete_scans"] == 2
    assert line.losses["lost_scans"] == lost - 1


def test_a_sequence_below_the_known_one_corrects_the_loss_count() -> None:
    line = Line(False)
    line.send(0)
    line.tracker.align(40, 0x1_0000)
    assert line.losses["lost_scans"] == 40
    line.tracker.align(5, 0x1_0000)
    line.send(6)
    assert line.published == [0, 6]
    assert line.losses["lost_scans"] == 5


def test_the_same_fd_counter_at_two_device_times_is_two_scans() -> None:
    line = Line(True)
    line.send(0)
    line.feed(*line.frames(1)[:1], *line.frames(1 + 0x1_0000)[1:])
    line.send(2)
    assert line.published == [0, 2]
    assert line.losses == {"incomplete_scans": 1, "missing_frames": 2, "frozen_counter": 2}


@BOTH
def test_a_restart_counts_the_lost_scans(fd: bool) -> None:
    line = Line(fd)
    line.send(0, 1)
    assert not line.tracker.resync(500)
    line.send(500)
    assert line.published == [0, 1, 500]
    assert line.losses["lost_scans"] == 498


@BOTH
def test_a_requested_pause_is_not_counted_as_loss(fd: bool) -> None:
    line = Line(fd)
    line.send(0, 1)
    assert not line.tracker.resync(500, count_gap=False)
    line.send(500)
    assert line.published == [0, 1, 500]
    assert line.losses == {}


@BOTH
def test_a_reset_restarts_the_sequence(fd: bool) -> None:
    line = Line(fd)
    line.send(*range(20))
    assert line.tracker.resync(3)
    line.send(3, 4)
    assert line.published[-2:] == [3, 4]
    assert line.losses == {}
    assert line.assembler.device_time == (4000 if fd else 0)


@pytest.mark.parametrize("stands", range(16))
def test_a_counter_frozen_from_the_start_yields_no_wrong_sequence(stands: int) -> None:
    line = Line(False, 100)
    for sequence in range(100, 120):
        line.feed(
            *(
                (number, kind, bytes([data[0] & 0xF0 | stands]) + data[1:])
                for number, kind, data in line.frames(sequence)
            )
        )
    assert line.published in ([], [100])  # `feed` compares the sequence with what was sent
    assert line.tracker.counter_frozen
    assert line.tracker.sequence in {99, 100}


def test_a_first_scan_other_than_the_announced_one_is_discarded() -> None:
    line = Line(False, 100)
    line.send(*range(102, 110))
    assert line.published == list(range(103, 110))
    assert line.losses == {"late": 12, "lost_scans": 3, "missing_frames": 36}


@settings(max_examples=300)
@given(
    fd=st.booleans(),
    start=st.sampled_from([0, 14, 65_500, (1 << 32) - 20]),
    faults=st.lists(
        st.tuples(st.integers(0, 479), st.sampled_from(["drop", "repeat", "spoil", "swap"])), max_size=40, unique=True
    ),
)
def test_published_and_lost_scans_add_up(fd: bool, start: int, faults: list[tuple[int, str]]) -> None:
    """Under arbitrary faults of single frames, every scan passed on was sent, and the counts add up."""
    line = Line(fd, start)
    count = 40
    frames = [frame for sequence in range(start, start + count) for frame in line.frames(sequence)]
    blocks = line.codec.blocks
    dropped = 0
    usable = len(frames) - blocks  # the last scan is complete and settles the loss count
    for position, fault in sorted({number % usable: fault for number, fault in faults}.items(), reverse=True):
        identifier, kind, data = frames[position]
        if fault == "drop":
            del frames[position]
            dropped += 1
        elif fault == "repeat":
            frames.insert(position, frames[position])
        elif fault == "spoil":
            frames[position] = identifier, kind, data[:-1]
        elif position + 1 < len(frames) - blocks:
            frames[position : position + 2] = frames[position + 1], frames[position]
    line.feed(*frames)
    assert line.published == sorted(set(line.published))
    assert set(line.published) <= set(range(start, start + count))
    assert line.published[-1] == start + count - 1
    assert len(line.published) + line.losses.get("incomplete_scans", 0) + line.losses.get("lost_scans", 0) == count
    assert line.losses.get("missing_frames", 0) >= dropped
