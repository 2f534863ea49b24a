# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The compiled decoder for boards with frames of their own agrees exactly with its reference in Python."""

from __future__ import annotations

import random
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from posfet_core import protocol as core
from posfet_driver.bus.frame import CLASSIC, ERROR, EXTENDED, FD, RATE_SWITCH, Frame
from posfet_driver.protocol.bit_field import BitField
from posfet_driver.protocol.mapped_decoder import MappedDecoder
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_model.sensor.frame_mapping import FrameMapping
from posfet_model.sensor.scan import ScanStatus
from reference.protocol.mapped.decoder import MappedDecoder as Reference
from support.decoder_pair import fields
from support.own_boards import own_protocol, sensor_a, sensor_b

PERIOD = 1_000_000
WALL = 1_700_000_000_000_000_000
PROPERTIES = ("receiving", "scans", "resets", "sequence", "flags", "frames_lost", "frozen_clock", "clock_uncertainty")
TRAFFIC = ("frames", "commands", "unrelated", "malformed")
KINDS = (CLASSIC, EXTENDED, FD, FD | RATE_SWITCH, FD | RATE_SWITCH | EXTENDED, ERROR)
SPREAD = """VERSION ""

BU_: X

BO_ 256 Head: 8 X
 SG_ Number : 3|{counter}@1+ (1,0) [0|0] "" X

BO_ 257 Body: 8 X
 SG_ C0 : 7|12@0+ (2,-5) [0|3000] "" X
 SG_ C1 : 19|11@1- (1,0) [0|0] "" X
 SG_ Warm : 33|9@1- (0.5,10) [-50|90] "" X
 SG_ Fault : 63|1@1+ (1,0) [0|0] "" X

BO_ 258 Tail: 8 X
 SG_ Clock : 7|{clock}@0+ ({tick},0) [0|0] "us" X
"""
"""A board with a counter in the first frame, counts in the second, and a time in the last."""


class Pair:
    """Both decoders: what is done to one is done to the other, and what they tell is compared."""

    def __init__(self, sensor: Sensor) -> None:
        self.ours, self.theirs = MappedDecoder(sensor), Reference(sensor)
        self.ours.transit_time.times = self.theirs.transit_time.times = core.TransitTimes(1e-4, 3e-4)
        self.published = 0
        self.flagged = 0
        self.do("start")

    def do(self, name: str) -> None:
        for decoder in (self.ours, self.theirs):
            getattr(decoder, name)()

    def decode(self, frames: list[Frame], arrival: int, wall_offset: int = WALL, most: int = 1_000_000) -> None:
        """Decode a batch, of which no more than `most` scans are consumed."""
        ours, theirs = (decoder.decode(frames, arrival, wall_offset) for decoder in (self.ours, self.theirs))
        for _ in range(most):
            found, expected = next(ours, None), next(theirs, None)
            assert (found is None) == (expected is None)
            if found is None:
                break
            assert fields(self.ours.scan) == fields(self.theirs.scan)
            self.published += 1
            self.flagged |= self.ours.scan.status
        self.compare()

    def compare(self) -> None:
        ours, theirs = self.ours, self.theirs
        for name in theirs.statistics.__slots__:
            assert getattr(ours.statistics, name) == getattr(theirs.statistics, name), name
        for name in TRAFFIC:
            assert getattr(ours.traffic, name) == getattr(theirs.traffic, name), name
        for name in PROPERTIES:
            assert repr(getattr(ours, name)) == repr(getattr(theirs, name)), name
        assert ours.status == theirs.status or repr(ours.status) == repr(theirs.status)


def spread(folder: Path, counter: int, clock: int, tick: float, parts: tuple[bool, bool]) -> Sensor:
    """Return a sensor of two taxels whose board sends a counter, a time, or both."""
    path = folder / f"spread_{counter}_{clock}_{tick}.dbc"
    path.write_text(SPREAD.format(counter=counter, clock=clock, tick=tick), encoding="ascii")
    sensor = load_sensor()
    sequence, time = (("Number",) if parts[0] else ()), (("Clock",) if parts[1] else ())
    status = (("Fault", ScanStatus.ADC_FAULT),)
    mapping = FrameMapping("any", path, ("C0", "C1"), "", sequence, time, "", ("Warm",), status, ())
    return replace(
        sensor, layout=replace(sensor.layout, rows=1, cols=2), adc=replace(sensor.adc, bits=8), mapping=mapping
    )


def one_frame(sensor: Sensor) -> Sensor:
    """Return the sensor of board B with the counts of its first frame alone, and no time."""
    mapping = sensor.mapping
    assert mapping is not None
    counts = tuple(name for name in mapping.counts[:12])
    return replace(
        sensor, layout=replace(sensor.layout, rows=1, cols=12), mapping=replace(mapping, counts=counts, time=())
    )


@pytest.fixture(scope="module")
def sensors(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Sensor]:
    """Return boards of each kind: with counter, time, both or neither, in all frames or some, and of one frame."""
    folder = tmp_path_factory.mktemp("boards")
    board_b = sensor_b(folder)
    mapping = board_b.mapping
    assert mapping is not None
    return {
        "counter": sensor_a(folder),
        "time": board_b,
        "neither": replace(board_b, mapping=replace(mapping, time=())),
        "one frame": one_frame(board_b),
        "both": own_protocol(folder / "own.yaml", "posfet_16x16"),
        "both in one frame": own_protocol(folder / "small.yaml", "posfet_5x5"),
        "both in some frames": spread(folder, 4, 32, 1, (True, True)),
        "long counter, short time": spread(folder, 61, 12, 500, (True, True)),
        "time in some frames": spread(folder, 8, 64, 0.25, (False, True)),
        "short counter in some frames": spread(folder, 2, 16, 1, (True, False)),
    }


BOARDS = (
    "counter",
    "time",
    "neither",
    "one frame",
    "both",
    "both in one frame",
    "both in some frames",
    "long counter, short time",
    "time in some frames",
    "short counter in some frames",
)
RESETS_DO_NOT_SHOW = {"neither", "one frame", "short counter in some frames"}


def place(data: bytearray, field: BitField, value: int) -> None:
    """Write a value into the bits of a frame."""
    number = int.from_bytes(data[field.first : field.end], field.order)
    number = number & ~(field.mask << field.shift) | (value & field.mask) << field.shift
    data[field.first : field.end] = number.to_bytes(field.end - field.first, field.order)


class Board:
    """A board that sends scans of any content under a counter and a time that do what they want to."""

    def __init__(self, decoder: MappedDecoder, noise: random.Random) -> None:
        self.tables, self.noise = decoder.tables, noise
        self.sequence = noise.choice([0, 0, 7, 250, (1 << 32) - 20])
        self.time = float(noise.choice([0, 60_000_000_000, 12_345_678]))
        self.held = self.repeated = 0
        self.other = [
            (key, message, value)
            for key, message in self.tables.messages.items()
            for value, part in message.parts.items()
            if part.block < 0
        ]
        of_scan = {
            part.block: (key, message, value)
            for key, message in self.tables.messages.items()
            for value, part in message.parts.items()
            if part.block >= 0
        }
        self.blocks = [of_scan[block] for block in range(self.tables.blocks)]

    def _frame(self, key: tuple[int, int], message: Any, value: int) -> Frame:
        data = bytearray(self.noise.randbytes(message.length))
        part = message.parts[value]
        if message.select:
            place(data, message.select, value)
        if part.sequence:
            place(data, part.sequence, self.sequence)
        if part.time:
            place(data, part.time, int(self.time / self.tables.tick))
        return *key, bytes(data) + bytes(message.sent_length - message.length)

    def frames(self) -> list[Frame]:
        """Return the frames of one scan, and at times another message before them."""
        noise = self.noise
        self.held, self.repeated = max(self.held - 1, 0), max(self.repeated - 1, 0)
        self.sequence += not self.repeated
        self.time += 0 if self.held else PERIOD
        before = [self._frame(*noise.choice(self.other))] if self.other and noise.random() < 0.1 else []
        return before + [self._frame(*block) for block in self.blocks]

    def change(self) -> int:
        """Do what boards do that fail, are reset, or lose scans; return the time that passes meanwhile [ns]."""
        noise = self.noise
        passed = 0
        match noise.randrange(7):
            case 0:
                self.held = noise.choice([1, 2, 5, 40])
            case 1:
                self.repeated = noise.choice([1, 3, 20])
            case 2:
                self.sequence, self.time = 0, 0.0
            case 3:
                self.sequence += noise.choice([1, 3, 15, 16, 17, 255, 256, 300, -1, -5, -9, -200])
            case 4:
                self.time += noise.choice([1e5, -1e5, 4e7, -4e7, 6.5e10, 1e12])
            case 5:
                ticks = noise.choice([1, 2, 5, 16, 40, 250, 256, 300, 5000, 70_000])
                self.sequence, self.time, passed = self.sequence + ticks, self.time + ticks * PERIOD, ticks * PERIOD
            case 6:
                passed = noise.choice([10, 300, 2000]) * PERIOD
        self.sequence, self.time = max(self.sequence, 0), max(self.time, 0.0)
        return passed


def spoil(frames: list[Frame], noise: random.Random, share: float) -> list[Frame]:
    """Lose, double, delay, truncate and relabel a share of the frames."""
    sent: list[Frame] = []
    for identifier, kind, data in frames:
        if noise.random() >= share:
            sent.append((identifier, kind, data))
            continue
        match noise.randrange(7):
            case 0 | 1:
                continue
            case 2:
                sent += [(identifier, kind, data)] * 2
            case 3:
                sent.insert(max(len(sent) - noise.randrange(9), 0), (identifier, kind, data))
            case 4:
                sent.append((identifier, kind, data[: noise.randrange(len(data) + 1)]))
            case 5:
                sent.append((identifier ^ noise.choice([0, 1, 64]), noise.choice(KINDS), data))
            case 6:
                changed = bytearray(data)
                changed[noise.randrange(len(data))] ^= 1 << noise.randrange(8)
                sent.append((identifier, kind, bytes(changed)))
    return sent


def run(sensor: Sensor, seed: int, batches: int) -> Pair:
    """Let a board send on a bad link, and both decoders read; return them."""
    noise = random.Random(seed)
    pair = Pair(sensor)
    board = Board(pair.ours, noise)
    now = noise.choice([0, 5_000_000_000_000])
    share = noise.choice([0.0, 0.01, 0.2])
    for _ in range(batches):
        frames: list[Frame] = []
        for _ in range(noise.choice([0, 1, 1, 1, 1, 2, 7, 30])):
            if noise.random() < 0.04:
                now += board.change()
            now += PERIOD
            frames += spoil(board.frames(), noise, share)
        if frames and noise.random() < 0.1:  # the rest of the last scan comes with the next batch
            del frames[-noise.randrange(1, len(frames) + 1) :]
        delay = noise.choice([0, 20_000, 20_000, 900_000, 300_000_000 if noise.random() < 0.05 else 0])
        match noise.randrange(60):
            case 0:
                pair.do("start")
            case 1:
                pair.do("note_overflow")
        now += delay
        pair.decode(frames, now, WALL + noise.choice([0, 0, -300]), 1_000_000 if noise.random() < 0.98 else 1)
    return pair


@pytest.mark.parametrize("name", BOARDS)
def test_both_decoders_agree_in_every_field_and_counter(sensors: dict[str, Sensor], name: str) -> None:
    sensor = sensors[name]
    published, resets, flagged = 0, 0, 0
    counted = Counter[str]()
    for seed in range(3):
        pair = run(sensor, seed, 150)
        published, resets, flagged = published + pair.published, resets + pair.ours.resets, flagged | pair.flagged
        statistics = pair.ours.statistics
        counted += Counter({each: getattr(statistics, each) for each in statistics.__slots__})
    assert published > 375
    assert (resets > 0) == bool(flagged & ScanStatus.BOARD_RESET) == (name not in RESETS_DO_NOT_SHOW)
    assert counted["lost_scans"] > 0
    assert counted["malformed"] > 0
    if pair.ours.blocks > 1:
        assert counted["incomplete_scans"] > 0


@settings(max_examples=30)
@given(data=st.data(), name=st.sampled_from(BOARDS))
def test_both_decoders_agree_on_arbitrary_frames(sensors: dict[str, Sensor], data: st.DataObject, name: str) -> None:
    pair = Pair(sensors[name])
    keys = sorted(pair.ours.tables.messages)
    lengths = sorted({message.sent_length for message in pair.ours.tables.messages.values()} | {0, 1, 8, 64})
    frame = st.builds(
        lambda key, payload: (*key, payload),
        st.one_of(st.sampled_from(keys), st.tuples(st.integers(0, 0x1FFF_FFFF), st.sampled_from(KINDS))),
        st.sampled_from(lengths).flatmap(lambda size: st.binary(min_size=size, max_size=size)),
    )
    arrivals = data.draw(st.lists(st.integers(-(1 << 62), 1 << 62), min_size=1, max_size=5))
    for arrival in sorted(arrivals):
        pair.decode(data.draw(st.lists(frame, max_size=20)), arrival)


@given(
    first=st.integers(0, 3),
    length=st.integers(1, 64),
    shift=st.integers(0, 7),
    order=st.sampled_from(["little", "big"]),
    data=st.binary(min_size=12, max_size=12),
)
def test_bits_of_a_signal(first: int, length: int, shift: int, order: Any, data: bytes) -> None:
    field = BitField(first, first + (shift + length + 7) // 8, order, shift, length)
    expected = int.from_bytes(data[field.first : field.end], order) >> shift & field.mask
    assert field.compiled().read(data) == expected


def test_tables_that_do_not_fit_together_are_refused(tmp_path: Path) -> None:
    """A frame is read without a look at its end."""
    field = core.BitField(0, 2, False, 0, 16)
    tables = core.MappedTables()
    tables.slots, tables.counts = [8], [core.CountPlace(0, field, 0)]
    core.MappedDecoder(tables)
    with pytest.raises(ValueError, match="do not hold"):
        field.read(b"1")
    for name, value in {
        "slots": [],
        "counts": [core.CountPlace(7, field, 0)],
        "period": 0.0,
        "sequence_bits": 65,
        "parts": [core.MappedPart(1, None, None, [])],
        "messages": [core.MappedMessage(8, 8, None, [(0, 0)])],
    }.items():
        before = getattr(tables, name)
        setattr(tables, name, value)
        with pytest.raises(ValueError, match="the tables do not fit together"):
            core.MappedDecoder(tables)
        setattr(tables, name, before)
    tables.set_kinds([(256, 0, 0)])
    with pytest.raises(ValueError, match="the tables do not fit together"):
        core.MappedDecoder(tables)


@pytest.mark.parametrize("frame", [(256, CLASSIC), (256, CLASSIC, bytearray(8)), (1.0, CLASSIC, bytes(8)), "frame"])
def test_what_is_no_frame_is_named(tmp_path: Path, frame: Any) -> None:
    decoder = MappedDecoder(sensor_a(tmp_path))
    with pytest.raises(TypeError, match="a frame must be a tuple of identifier, kind and bytes"):
        list(decoder.decode([frame], 0, 0))


def test_counts_stay_after_the_decoder_is_gone(tmp_path: Path) -> None:
    counts = MappedDecoder(sensor_a(tmp_path)).scan.counts
    np.testing.assert_array_equal(counts, np.zeros(len(counts), np.uint16))
