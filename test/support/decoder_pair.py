# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Random boards on random links, played to the compiled decoder and to the one in Python, which have to agree."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from typing import TypeVar

from posfet_driver.bus.frame import CLASSIC, ERROR, EXTENDED, FD, RATE_SWITCH, Frame
from posfet_driver.protocol.decoded import Decoded, ScanReady
from posfet_driver.protocol.decoder import Decoder, TransitTimes
from posfet_driver.protocol.messages import (
    COMMAND_OFFSET,
    IDENTITY_OFFSET,
    RESPONSE_OFFSET,
    STATUS_OFFSET,
    Command,
    Identification,
    Identity,
    Request,
    Response,
    Status,
)
from posfet_driver.protocol.scan_codec import make_codec
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_model.sensor.scan import Scan
from reference.protocol.decoder import Decoder as Reference
from support.fake_board import with_fd, with_layout
from support.fault_injector import sealed

SENSOR = load_sensor()
BASE = SENSOR.can.base_id
MILLISECOND = 1_000_000
WALL = 1_700_000_000_000_000_000
SIZES = ((1, 1), (5, 5), (5, 12), (16, 16))
PERIODS = (1, 250, 1000, 1000, 1000, 2000, 5000, 10_000_000)
COUNTERS = ("frames", "commands", "unrelated", "malformed", "status_lost", "status_repeated")
PROPERTIES = (
    "receiving",
    "scans",
    "blocks",
    "resets",
    "sequence",
    "frames_lost",
    "frozen_clock",
    "scan_period",
    "kept_period",
    "identity",
)
PairT = TypeVar("PairT", bound="Pair")


def fields(scan: Scan) -> tuple[object, ...]:
    """Return what a scan holds, NaN as a text."""
    uncertainty = "unknown" if math.isnan(scan.stamp_uncertainty) else scan.stamp_uncertainty
    own = scan.stamp, scan.sequence, scan.device_time, scan.status, scan.frames_lost, uncertainty
    return *own, scan.counts.tobytes(), scan.temperatures.tobytes()


def seen(decoded: Decoded) -> object:
    """Return what was decoded, as something that can be compared and that stays."""
    return fields(decoded.scan) if isinstance(decoded, ScanReady) else repr(decoded)


class Pair:
    """Both decoders: what is done to one is done to the other, and what they tell is compared."""

    def __init__(self, sensor: Sensor) -> None:
        self.ours, self.theirs = Decoder(sensor), Reference(sensor)
        self.published = 0

    def do(self, name: str, *arguments: object) -> None:
        for decoder in (self.ours, self.theirs):
            getattr(decoder, name)(*arguments)

    def set(self, name: str, value: object) -> None:
        for decoder in (self.ours, self.theirs):
            setattr(decoder, name, value)

    def set_transit_times(self, switched: float, unswitched: float) -> None:
        self.ours.transit_time.times = self.theirs.transit_time.times = TransitTimes(switched, unswitched)

    def decode(self, frames: list[Frame], arrival: int, wall_offset: int, most: int = 1_000_000) -> None:
        """Decode a batch, of which no more than `most` results are consumed."""
        ours, theirs = (decoder.decode(frames, arrival, wall_offset) for decoder in (self.ours, self.theirs))
        for _ in range(most):
            found, expected = next(ours, None), next(theirs, None)
            assert (found is None) == (expected is None)
            if found is None or expected is None:
                break
            assert seen(found) == seen(expected)
            self.published += isinstance(found, ScanReady)
        self.compare()

    def compare(self) -> None:
        ours, theirs = self.ours, self.theirs
        for name in theirs.statistics.__slots__:
            assert getattr(ours.statistics, name) == getattr(theirs.statistics, name), name
        for name in COUNTERS:
            assert getattr(ours.traffic, name) == getattr(theirs.traffic, name), name
        for name in PROPERTIES:
            assert getattr(ours, name) == getattr(theirs, name), name
        assert repr(ours.clock_uncertainty) == repr(theirs.clock_uncertainty)
        assert repr(ours.status) == repr(theirs.status)
        assert ours.assembler.complete == theirs.assembler.complete


class Board:
    """A board that states what it wants to, on a link that does what it wants to."""

    def __init__(self, sensor: Sensor, noise: random.Random) -> None:
        self.codec = make_codec(sensor)
        self.noise = noise
        self.scan = Scan.empty(sensor.layout.id, sensor.layout.taxels)
        self.sequence = noise.choice([0, 0, 7, (1 << 28) // 1000, (1 << 32) - 40, (1 << 31) - 9])
        self.time = noise.choice([0, 1000, (1 << 28) - 30_000, (1 << 32) - 30_000, 12_345_678])
        self.period = 1000
        self.boot = noise.randrange(16)
        self.heartbeat = 0
        self.stands = self.repeats = 0  # ticks for which clock and counter stand still

    def frames(self) -> list[Frame]:
        """Return the frames of a tick."""
        noise, scan = self.noise, self.scan
        self.repeats, self.stands = max(self.repeats - 1, 0), max(self.stands - 1, 0)
        self.sequence += not self.repeats
        self.time += 0 if self.stands else self.period
        scan.counts[:] = noise.randrange(1 << 16)
        scan.counts[noise.randrange(len(scan.counts))] = noise.randrange(1 << 16)
        late = noise.choice([0, 0, 0, 0, noise.randrange(self.period)])
        scan.sequence, scan.device_time, scan.status = self.sequence, self.time + late, noise.choice([0, 0, 0, 5])
        return self.codec.encode(scan, BASE, self.boot, self.sequence % 16 == 0 or noise.random() < 0.02)

    def message(self) -> Frame:
        """Return a status, an identity, a response, or a command of another host."""
        noise = self.noise
        kind = noise.randrange(6)
        boot = self.boot if noise.random() < 0.9 else noise.randrange(16)
        if kind < 3:
            self.heartbeat += noise.choice([0, 1, 1, 1, 2])
            flags = noise.choice([0, 0, 2, 15])
            temperatures = noise.choice([(23.5, 24.0), (math.nan, 30.0)])
            status = Status(temperatures, 3.3, flags, True, boot, self.heartbeat & 15, noise.random() < 0.2)
            return BASE + STATUS_OFFSET, CLASSIC, status.pack()
        if kind == 3:
            period = noise.choice([self.period, self.period, noise.choice(PERIODS), 0])
            return BASE + IDENTITY_OFFSET, CLASSIC, Identity(Identification(1, 2, self.codec.fd, 1), 2, period).pack()
        if kind == 4:
            value = noise.choice([*PERIODS, 0, 1 << 31])
            command = noise.choice([Command.SET_RATE, Command.START])
            return BASE + RESPONSE_OFFSET, CLASSIC, Response(command, 1, noise.choice([0, 0, 2]), value, boot).pack()
        return BASE + COMMAND_OFFSET, CLASSIC, Request(noise.choice(list(Command)), 5, 1000).pack()

    def change(self) -> None:
        """Do what boards do that fail, are reset, or lie."""
        noise = self.noise
        match noise.randrange(8):
            case 0:
                self.period = noise.choice(PERIODS[:-1])
            case 1:
                self.boot, self.sequence, self.time = (self.boot + noise.randrange(2)) & 15, noise.randrange(3), 0
            case 2:
                self.stands = noise.choice([1, 2, 5, 30])
            case 3:
                self.repeats = noise.choice([1, 3, 20])
            case 4:
                self.sequence += noise.choice([1, 15, 16, 17, 64, 300, 1 << 20, 1 << 31, -1, -5, -20, -70])
            case 5:
                self.time += noise.choice([500, -500, 40_000, -40_000, 1 << 20, 1 << 27, -100_000_000])
            case 6:
                ticks = noise.choice([1, 3, 14, 15, 16, 17, 40, 200, 5000])
                self.sequence, self.time = self.sequence + ticks, self.time + ticks * self.period
            case 7:
                self.sequence, self.time = self.sequence + (1 << 20), self.time + (self.period << 20)
        self.sequence, self.time = max(self.sequence, 0), max(self.time, 0)


def spoil(frames: list[Frame], noise: random.Random, share: float) -> list[Frame]:
    """Lose, double, delay, truncate, relabel and corrupt a share of the frames."""
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
                sent.append((identifier, kind, data[: noise.randrange(len(data))]))
            case 5:
                sent.append((identifier, kind ^ noise.choice([EXTENDED, ERROR, FD, RATE_SWITCH]), data))
            case 6:
                place = noise.randrange(len(data))
                data = data[:place] + bytes([noise.randrange(256)]) + data[place + 1 :]  # noqa: PLW2901
                sent.append((identifier, kind, sealed(kind, data) if noise.random() < 0.7 else data))
    return sent


def run(seed: int, fd: bool, batches: int, make_pair: Callable[[Sensor], PairT]) -> PairT:
    """Play a random story to both decoders."""
    noise = random.Random(seed)
    sensor = with_layout(with_fd(SENSOR, fd), *noise.choice(SIZES))
    pair, board = make_pair(sensor), Board(sensor, noise)
    pair.set_transit_times(noise.choice([0.0, 0.0004]), 0.0007)
    if noise.random() < 0.9:
        pair.do("start")
    now = noise.choice([0, 1, 10**9, 86_400 * 10**9, 9 * 10**15 + 1, 1_700_000_000 * 10**9])
    share, trouble = noise.choice([0.0, 0.01, 0.2]), noise.choice([0.0, 0.005, 0.05])
    waiting: list[Frame] = []
    sent: list[bytes] = []
    for _ in range(batches):
        now += max(board.period * 1000 + round(noise.gauss(0, 20_000)), 0)
        frames = board.frames()
        if noise.random() < 0.1:
            frames.insert(noise.randrange(len(frames) + 1), board.message())
        waiting += spoil(frames, noise, share)
        if noise.random() < trouble:
            board.change()
        if noise.random() < trouble:
            name = noise.choice(
                [
                    "start",
                    "doubt_sequence",
                    "forget_gap",
                    "note_overflow",
                    "forget_status",
                    "sent",
                    "period",
                    "receiving",
                ]
            )
            if name == "sent":
                sent.append(Request(noise.choice(list(Command)), noise.randrange(256), 1000).pack())
                pair.do("sent", sent[-1])
            elif name == "period":
                pair.do("set_period", noise.choice([board.period, noise.choice(PERIODS)]), noise.random() < 0.6)
            elif name == "receiving":
                pair.set("receiving", noise.random() < 0.7)
            else:
                pair.do(name)
        if sent and noise.random() < 0.05:
            waiting.append((BASE + COMMAND_OFFSET, CLASSIC, noise.choice(sent)))
        if noise.random() < trouble:
            now += round(noise.expovariate(1 / (20 * MILLISECOND)) * noise.choice([1, 1, 30, 1000]))
            continue  # the host is late
        delay = round(noise.expovariate(1 / 100_000))
        held_up = noise.choice([0, 0, 0, 5 * MILLISECOND])
        pair.decode(waiting, now + delay, WALL + held_up, noise.choice([1_000_000] * 50 + [0, 1, 3]))
        waiting = []
    return pair
