# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Decoding by a mapping to a DBC file, compared with the decoder of the own protocol on the same frames."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np

from benchmarks.outcome import Outcome, Table
from posfet_driver.bus.frame import Frame
from posfet_driver.protocol.decoder import Decoder
from posfet_driver.protocol.mapped_decoder import MappedDecoder
from posfet_driver.protocol.scan_codec import CLASSIC_TAXELS, FD_TAXELS, make_codec
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_model.sensor.frame_mapping import FrameMapping
from posfet_model.sensor.scan import Scan

ARRAYS = (("posfet_5x5", True), ("posfet_5x5", False), ("posfet_16x16", True), ("posfet_32x32", True))
FRAMES = 4000
"""Frames of one pass."""
PASSES = 7
LIMIT = 2.0
"""Allowed time of the mapped decoder, in that of the own one."""


def mapped(sensor: Sensor) -> Sensor:
    """Return the sensor with its own protocol described as a mapping; a classic one is that of a 5 x 5 array."""
    mapping = FrameMapping(
        source="benchmark",
        dbc=Path(str(files("posfet_driver") / "protocol" / "posfet.dbc")),
        counts=tuple(f"Count{place}" for place in range(FD_TAXELS)),
        block="BlockIndex",
        sequence=("Sequence",),
        time=("DeviceTime",),
        time_unit="us",
        temperatures=(),
        status=(),
        order=(),
    )
    if sensor.can.fd:
        return replace(sensor, mapping=mapping)
    blocks = range(-(-sensor.layout.taxels // CLASSIC_TAXELS))
    counts = tuple(f"Code{taxel}" for taxel in range(sensor.layout.taxels))
    counters = tuple(f"ScanCounter{block}" for block in blocks)
    classic = replace(mapping, counts=counts, block="", sequence=counters, time=())
    return replace(sensor, adc=replace(sensor.adc, bits=12), mapping=classic)


def batches(sensor: Sensor) -> tuple[list[list[Frame]], np.ndarray]:
    """Return the frames of consecutive scans with the same random counts, and these, shape [taxels]."""
    codec = make_codec(sensor)
    scan = Scan.empty(sensor.layout.id, sensor.layout.taxels)
    scan.counts[:] = np.random.default_rng(4).integers(0, 1 << 16, sensor.layout.taxels)
    scans = []
    for sequence in range(FRAMES // codec.blocks):
        scan.sequence, scan.device_time = sequence, round(sequence / sensor.can.scan_rate * 1e6)
        scans.append(codec.encode(scan, sensor.can.base_id))
    return scans, scan.counts


def scan_time(decoder: Decoder | MappedDecoder, scans: list[list[Frame]]) -> float:
    """Return the mean time of a scan [us]; the scans arrive at the rate of the sensor file."""
    period = decoder.scan_period * 1000
    decoder.start()
    begin = time.perf_counter()
    for sequence, frames in enumerate(scans):
        for _ in decoder.decode(frames, sequence * period, 0):
            pass
    return (time.perf_counter() - begin) / len(scans) * 1e6


def compare(sensor: Sensor) -> tuple[int, float, float, int]:
    """Return the frames per scan, the times of own and mapped decoder [us], and what is wrong or lost."""
    scans, counts = batches(sensor)
    times = [math.inf, math.inf]
    wrong = 0
    for _ in range(PASSES):
        own, by_mapping = Decoder(sensor), MappedDecoder(mapped(sensor))
        for index, decoder in enumerate((own, by_mapping)):
            times[index] = min(times[index], scan_time(decoder, scans))
            # 12 bits are extended to 16 by repetition here and by scaling there: at most one count apart
            step = 0 if sensor.can.fd else 16
            differ = np.abs(decoder.scan.counts.astype(int) - counts.astype(int)) > step
            missing = len(scans) - 1 - decoder.scans  # the first one may wait for a second that confirms it
            wrong = max(wrong, int(np.count_nonzero(differ)) + decoder.frames_lost + max(missing, 0))
    return len(scans[0]), *times, wrong


def measure(full: bool) -> Outcome:
    """Decode consecutive scans of each array with both."""
    del full
    rows = []
    values = {}
    for name, fd in ARRAYS:
        sensor = load_sensor(name)
        frames, own, by_mapping, wrong = compare(replace(sensor, can=replace(sensor.can, fd=fd)))
        size = name.removeprefix("posfet_")
        kind = "FD" if fd else "classic"
        rows.append((size.replace("x", " x "), kind, frames, own, by_mapping, by_mapping / own, wrong))
        values[f"decode_mapped_{size}_{kind.lower()}_ratio"] = by_mapping / own
    columns = ("array", "frames", "frames per scan", "own us per scan", "mapped us per scan", "ratio", "wrong or lost")
    note = (
        f"The same frames by the decoder of the own protocol, checksum included, and by a mapping to its DBC file; "
        f"allowed is a ratio of {LIMIT:g}."
    )
    return Outcome(values, [Table("Decoding by a mapping", columns, rows, note)])
