# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Cost of a scan over taxels, contacts and boards, with fitted exponents."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from benchmarks.outcome import Chart, Outcome, Point, Table
from benchmarks.timing import scan_microseconds
from posfet_driver.protocol.decoded import ScanReady
from posfet_driver.protocol.decoder import Decoder
from posfet_driver.protocol.scan_codec import make_codec
from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_model.sensor.scan import Scan
from posfet_model.sensor.signal_chain import ForwardSignalChain

SIDES = (5, 8, 16, 32, 64, 128)
CONTACTS = (0, 1, 2, 4, 8, 16, 32, 64)
BOARDS = (1, 2, 4, 8, 16)
REST, TIMED = 700, 150
"""Scans before the contact, and scans timed during it."""
CONTACTS_SIDE = 64


def array(side: int) -> Sensor:
    """Return a square array."""
    sensor = load_sensor()
    return replace(sensor, layout=replace(sensor.layout, rows=side, cols=side))


def forces(side: int, contacts: int) -> np.ndarray:
    """Return a force map with evenly spaced fingertips of 3 x 3 taxels [N]."""
    force = np.zeros((side, side))
    across = int(np.ceil(np.sqrt(contacts))) if contacts else 1
    for number in range(contacts):
        row, col = (int((part + 0.5) * side / across) for part in divmod(number, across))
        force[max(row - 1, 0) : row + 2, max(col - 1, 0) : col + 2] += 0.1
        force[row, col] += 0.3
    return force.reshape(-1)


class Player:
    """Precomputed counts of one board, and its reconstruction."""

    def __init__(self, sensor: Sensor, contacts: int, seed: int = 0) -> None:
        rng = np.random.default_rng(seed)
        chain = ForwardSignalChain(sensor, rng)
        step = 1 / sensor.can.scan_rate
        self.reconstructor = Reconstructor(sensor)
        self.scan = Scan.empty(sensor.layout.id, sensor.layout.taxels)
        self.scan.temperatures[:] = 25.0
        self.index = 0
        nothing, force = np.zeros(sensor.layout.taxels), forces(sensor.layout.rows, contacts)
        few = [chain.counts() for _ in range(32) if chain.advance(nothing, 25.0, step) is None]
        for index in range(REST):
            self.take(few[int(rng.integers(len(few)))] if index % 2 else few[index % len(few)])
        self.counts = []
        for index in range(TIMED):
            chain.advance(force * min((index + 1) / 20, 1.0), 25.0, step)
            self.counts.append(chain.counts())

    def take(self, counts: np.ndarray) -> None:
        """Reconstruct one scan."""
        self.scan.counts = counts
        self.index += 1
        self.scan.sequence, self.scan.device_time = self.index, self.index * 1000
        self.scan.stamp = self.index * 1_000_000
        self.reconstructor.process(self.scan)


def cost(sensor: Sensor, contacts: int) -> tuple[float, int]:
    """Return the cost of a scan during contact [us], and the number of contacts found at the end."""
    player = Player(sensor, contacts)
    times = []
    for counts in player.counts:
        begin = time.perf_counter_ns()
        player.take(counts)
        times.append(time.perf_counter_ns() - begin)
    return scan_microseconds(times[TIMED // 3 :]), len(player.reconstructor._result.contacts)


class FramePlayer:
    """Frames of one board, decoded and reconstructed as in the driver."""

    def __init__(self, sensor: Sensor, seed: int) -> None:
        self.player = Player(sensor, 1, seed)
        self.decoder = Decoder(sensor)
        self.decoder.start()
        codec = make_codec(sensor)
        self.frames = []
        for index, counts in enumerate(self.player.counts):
            scan = replace(self.player.scan, counts=counts, sequence=index, device_time=index * 1000)
            self.frames.append(codec.encode(scan, sensor.can.base_id))

    def play(self, index: int) -> None:
        """Process the frames of one scan."""
        for decoded in self.decoder.decode(self.frames[index], index * 1_000_000, 0):
            if isinstance(decoded, ScanReady):
                self.player.take(decoded.scan.counts)


def boards_cost(sensors: Sequence[Sensor]) -> float:
    """Return the time for one scan of each of several boards, in turn, decoding included [us]."""
    boards = [FramePlayer(sensor, seed) for seed, sensor in enumerate(sensors)]
    times = []
    for index in range(TIMED):
        begin = time.perf_counter_ns()
        for board in boards:
            board.play(index)
        times.append(time.perf_counter_ns() - begin)
    return scan_microseconds(times[TIMED // 3 :])


def exponent(x: Sequence[float], y: Sequence[float]) -> float:
    """Return the slope of the regression line through the logarithms."""
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


def measure(full: bool) -> Outcome:
    """Measure all three scalings."""
    taxels: list[Point] = []
    idle: list[Point] = []
    for side in SIDES:
        taxels.append((side * side, cost(array(side), 1)[0], ""))
        idle.append((side * side, cost(array(side), 0)[0], ""))
    counted = [(number, *cost(array(CONTACTS_SIDE), number)) for number in CONTACTS]
    none = counted[0][1]
    hand = boards_cost([array(5)] * 5 + [array(16)])
    boards = [(number, boards_cost([array(5)] * number)) for number in (BOARDS if full else BOARDS[::2])]
    values = {
        "scaling_taxels_exponent": exponent([x for x, _, _ in taxels], [y for _, y, _ in taxels]),
        "scaling_taxels_large_exponent": exponent([x for x, _, _ in taxels[-3:]], [y for _, y, _ in taxels[-3:]]),
        "scaling_contacts_exponent": exponent(
            [number for number, _, _ in counted[1:]], [max(times - none, 1e-3) for _, times, _ in counted[1:]]
        ),
        "scaling_boards_exponent": exponent([number for number, _ in boards], [times for _, times in boards]),
        "scaling_128x128_us": taxels[-1][1],
        "hand_cpu_pct": hand / 10,
    }
    tables = [
        Table(
            "Cost over the number of taxels",
            ("taxels", "one contact us per scan", "idle us per scan"),
            [(int(one[0]), one[1], other[1]) for one, other in zip(taxels, idle, strict=True)],
            f"Fitted exponent {values['scaling_taxels_exponent']:.2f}, of the three largest "
            f"{values['scaling_taxels_large_exponent']:.2f}.",
        ),
        Table(
            f"Cost over the number of contacts, {CONTACTS_SIDE} x {CONTACTS_SIDE}",
            ("contacts", "us per scan", "found"),
            counted,
            f"Fitted exponent of the added cost {values['scaling_contacts_exponent']:.2f}.",
        ),
        Table(
            "Cost over the number of boards in one thread, 5 x 5, frames to contacts",
            ("boards", "us for one scan of each", "% of a core at 1 kHz"),
            [*((str(number), times, times / 10) for number, times in boards),
             ("five fingers (5 x 5) and a palm (16 x 16)", hand, hand / 10)],
            f"Fitted exponent {values['scaling_boards_exponent']:.2f}. Without reading the bus and publishing.",
        ),
    ]  # fmt: skip
    series = {"one contact": taxels, "idle": idle}
    chart = Chart(
        "scaling_taxels", "Cost of a scan over the number of taxels", "taxels", "run time [us per scan]", series
    )
    return Outcome(values, tables, [chart])
