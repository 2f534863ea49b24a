# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The assembler passes on complete scans only; every fault is classified and counted."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from posfet_core.protocol import Assembler, ClassicScans, ClockSync, FdScans
from posfet_driver.bus.frame import Frame
from posfet_driver.protocol.messages import CLASSIC_BLOCK_OFFSET, HEADER_OFFSET
from posfet_driver.protocol.scan_codec import make_codec
from posfet_model.sensor.description import load_sensor
from support.fake_board import make_scan, marked_counts, with_fd, with_layout
from support.fault_injector import sealed

SENSOR = with_layout(load_sensor(), 5, 12)  # three FD blocks, twelve classic ones
BASE = SENSOR.can.base_id
BOTH = pytest.mark.parametrize("fd", [True, False], ids=["fd", "classic"])


class Line:
    """A board, a link with scripted faults, an assembler, and the sequences of its scans, counted from `first`."""

    def __init__(self, fd: bool, first: int = 32) -> None:
        self.fd = fd
        self.first = first
        self.boot = 0
        self.codec = make_codec(with_fd(SENSOR, fd))
        self.assembler = Assembler(fd, self.codec.taxels)
        self.sync = ClockSync()
        self.scans = FdScans(self.assembler, self.sync) if fd else ClassicScans(self.assembler, self.sync)
        self.scans.announce(1000.0, True)
        self.published: list[int] = []
        self.times: list[int] = []
        self.send(-2, -1)
        assert self.published == [-2, -1]
        assert self.losses == {}
        self.published, self.times = [], []

    @property
    def losses(self) -> dict[str, int]:
        losses = self.assembler.statistics
        return {name: value for name in losses.__slots__ if (value := getattr(losses, name))}

    def frames(self, sequence: int, header: bool | None = None, time: int | None = None) -> list[Frame]:
        """Return the frames of a scan; a classic one has a header before the first and each 16th."""
        sequence += self.first
        wanted = sequence % 16 == 0 or sequence == self.first - 2 if header is None else header
        scan = make_scan(SENSOR, sequence, sequence * 1000 if time is None else time)
        return self.codec.encode(scan, BASE, self.boot, wanted)

    def feed(self, *frames: Frame, now: int = 0) -> None:
        for identifier, kind, data in frames:
            offset = identifier - BASE
            if self.fd:
                complete = self.scans.feed(kind, data, now)
            elif offset == HEADER_OFFSET:
                self.scans.feed_header(kind, data, now)
                continue
            else:
                complete = self.scans.feed(offset - CLASSIC_BLOCK_OFFSET, kind, data, now)
            if complete and not (isinstance(self.scans, ClassicScans) and self.scans.doubtful):
                sequence = self.scans.sequence
                self.published.append(sequence - self.first)
                self.times.append(self.scans.time)
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
    line.feed(*reversed(line.frames(0, header=False)))
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
    line.feed(*line.frames(0, header=False)[:1], *line.frames(1, header=False)[1:])
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
    assert line.losses == {"duplicate": line.codec.blocks + (not fd)}


@BOTH
def test_a_late_frame_is_discarded(fd: bool) -> None:
    line = Line(fd)
    line.send(0)
    late, *rest = line.frames(1)
    line.feed(*rest)
    line.send(2)
    line.feed(late)
    line.send(3)
    assert line.published == [0, 2, 3]
    assert line.losses == {"incomplete_scans": 1, "missing_frames": 1, "late": 1}


@BOTH
@pytest.mark.parametrize("start", [16, 65_530, (1 << 32) - 5])
def test_sequence_and_clock_are_unwrapped(fd: bool, start: int) -> None:
    line = Line(fd, start)
    line.send(*range(40))
    assert line.published == list(range(40))
    assert line.losses == {}
    assert set(np.diff(line.times)) == {1000}


@BOTH
def test_the_same_sequence_at_two_device_times_is_a_frozen_counter(fd: bool) -> None:
    line = Line(fd)
    line.send(0)
    frozen = [
        (identifier, kind, sealed(kind, data[:20] + b"??" + data[22:]) if fd else data[:3] + b"??" + data[5:])
        for identifier, kind, data in line.frames(0, header=False, time=33_000)
    ]
    line.feed(*frozen)
    line.send(1, 2)
    assert line.losses["frozen_counter"] == 1
    assert line.published == ([0, 1, 2] if fd else [0])


@BOTH
def test_a_restart_counts_the_lost_scans(fd: bool) -> None:
    line = Line(fd)
    line.send(0, 1)
    line.scans.start()
    line.feed(*line.frames(500, header=True))
    assert line.published == [0, 1, 500]
    assert line.losses["lost_scans"] == 498


@BOTH
def test_a_requested_pause_is_not_counted_as_loss(fd: bool) -> None:
    line = Line(fd)
    line.send(0, 1)
    line.scans.numbering.forget_gap()
    line.scans.start()
    line.feed(*line.frames(500, header=True))
    assert line.published == [0, 1, 500]
    assert line.losses == {}


@BOTH
@pytest.mark.parametrize("boot", [0, 5])
def test_a_reset_restarts_the_sequence(fd: bool, boot: int) -> None:
    line = Line(fd, 100)
    line.send(*range(20))
    line.boot, line.first = boot, 0
    line.scans.start()
    line.feed(*line.frames(3, header=True))
    line.send(4, 5)
    assert line.scans.numbering.restarted
    assert line.published[-2:] == [4, 5]
    assert line.losses == {}
    assert line.times[-2:] == [4000, 5000]


@BOTH
def test_late_frames_of_the_previous_boot_are_not_used(fd: bool) -> None:
    line = Line(fd, 100)
    line.send(*range(3))
    late = line.frames(3, header=True)
    line.send(3)
    line.boot, line.first = 1, 0
    line.feed(*line.frames(0, header=True))
    line.send(1)
    line.feed(*late[:1])
    line.send(2)
    assert line.published[-2:] == [1, 2]
    assert line.losses == {"late": 1}


@pytest.mark.parametrize("ahead", [1 << 20, 1 << 24, 1 << 30, 1 << 31, (1 << 32) - 1000])
def test_a_sequence_that_jumps_is_used_only_when_it_goes_on(ahead: int) -> None:
    line = Line(True, 100)
    line.send(*range(10))
    line.feed(*line.frames(10 + ahead, time=110_000))
    line.send(11, 12)
    assert line.published[-2:] == [11, 12]
    assert line.losses == {"lost_scans": 1, "missing_frames": line.codec.blocks}


@pytest.mark.parametrize("time", [0, 1 << 27], ids=["true time", "false time"])
@pytest.mark.parametrize("ahead", [1 << 20, 1 << 22, 1 << 24, 1 << 30, 1 << 31])
def test_a_classic_header_whose_sequence_jumps_is_passed_over(ahead: int, time: int) -> None:
    line = Line(False)
    line.send(*range(16))
    header = line.frames(16 + ahead, header=True, time=48_000 + time)[0]
    line.feed(header)
    line.send(*range(16, 60))
    assert line.published[-28:] == list(range(32, 60))
    assert line.losses.pop("lost_scans", 0) <= 16
    assert line.losses["implausible"] == 1


def test_a_board_that_keeps_to_its_jump_is_followed_and_flagged_and_nothing_counts_as_lost() -> None:
    line = Line(True, 100)
    line.send(*range(10))
    for sequence in range(10, 13):
        line.feed(*line.frames(sequence + 4096, time=100_000 + sequence * 1000))
    assert line.published[-2:] == [11 + 4096, 12 + 4096]
    assert line.scans.numbering.restarted
    assert line.losses == {"implausible": 1}


def test_after_a_clock_that_stands_still_no_scan_is_lost() -> None:
    line = Line(True, 100)
    for sequence in range(20):
        line.feed(*line.frames(sequence, time=104_000 if 5 <= sequence < 15 else 100_000 + 1000 * sequence))
    assert line.published == list(range(20))
    assert line.scans.clock.repeated == 8  # from the third repetition on the clock is frozen
    assert not line.scans.clock.frozen


@pytest.mark.parametrize("stands", range(16))
def test_a_classic_counter_that_is_frozen_yields_no_wrong_sequence(stands: int) -> None:
    line = Line(False)
    for sequence in range(40):
        line.feed(
            *(
                (number, kind, data if number == BASE + HEADER_OFFSET else bytes([data[0] & 0xF0 | stands]) + data[1:])
                for number, kind, data in line.frames(sequence)
            ),
            now=sequence * 1_000_000,
        )
    assert len(line.published) <= 3
    assert line.losses.get("frozen_counter", 0) + line.losses.get("late", 0) >= 3


@settings(max_examples=120)
@given(
    fd=st.booleans(),
    start=st.sampled_from([2, 14, 65_500, (1 << 32) - 20]),
    faults=st.lists(
        st.tuples(st.integers(0, 479), st.sampled_from(["drop", "repeat", "spoil", "swap"])), max_size=40, unique=True
    ),
)
def test_published_and_lost_scans_add_up(fd: bool, start: int, faults: list[tuple[int, str]]) -> None:
    """Under arbitrary faults of single frames, every scan passed on was sent, and the counts add up."""
    line = Line(fd, start)
    count = 40
    frames = [frame for sequence in range(count) for frame in line.frames(sequence)]
    blocks = line.codec.blocks
    dropped = 0
    usable = len(frames) - blocks  # the last scan is complete and settles the loss count
    for position, fault in sorted({number % usable: fault for number, fault in faults}.items(), reverse=True):
        identifier, kind, data = frames[position]
        if fault == "drop":
            del frames[position]
            dropped += identifier != BASE + HEADER_OFFSET
        elif fault == "repeat":
            frames.insert(position, frames[position])
        elif fault == "spoil":
            frames[position] = identifier, kind, data[:-1]
        elif position + 1 < len(frames) - blocks:
            frames[position : position + 2] = frames[position + 1], frames[position]
    line.feed(*frames)
    assert line.published == sorted(set(line.published))
    assert set(line.published) <= set(range(count))
    assert line.published[-1] == count - 1
    assert len(line.published) + line.losses.get("incomplete_scans", 0) + line.losses.get("lost_scans", 0) == count
    assert line.losses.get("missing_frames", 0) >= dropped
