# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Decoding of frames: the complete decoder of the driver, compared with cantools and the DBC of the board."""

from __future__ import annotations

from importlib.resources import files

import cantools
import numpy as np
from cantools.database.can import Message

from benchmarks.micro.mapped_decoding import PASSES, batches, scan_time
from benchmarks.outcome import Cell, Outcome, Table
from benchmarks.timing import microseconds
from posfet_driver.protocol.decoder import Decoder
from posfet_driver.protocol.scan_codec import FD_TAXELS
from posfet_model.sensor.description import Sensor, load_sensor

ARRAYS = ("posfet_5x5", "posfet_16x16", "posfet_32x32")
COUNTS = [f"Count{index}" for index in range(FD_TAXELS)]


def compare(sensor: Sensor, block: Message) -> tuple[int, float, float, int]:
    """Return the frames per scan, the times of the decoder and of cantools [us], and the number of wrong counts."""
    scans, counts = batches(sensor)
    theirs = np.zeros(len(scans[0]) * FD_TAXELS, np.uint16)

    def with_cantools() -> None:
        for _, _, data in scans[0]:
            signals = block.decode(data, decode_choices=False, scaling=False)
            first = signals["BlockIndex"] * FD_TAXELS
            theirs[first : first + FD_TAXELS] = [signals[name] for name in COUNTS]

    decoders = [Decoder(sensor) for _ in range(PASSES)]
    times = min(scan_time(decoder, scans) for decoder in decoders), microseconds(with_cantools)
    wrong = np.count_nonzero(decoders[-1].scan.counts != counts) + np.count_nonzero(theirs[: len(counts)] != counts)
    return len(scans[0]), *times, int(wrong) + decoders[-1].frames_lost


def measure(full: bool) -> Outcome:
    """Decode consecutive scans of each array."""
    del full
    database = cantools.database.load_file(str(files("posfet_driver") / "protocol" / "posfet.dbc"))
    rows: list[tuple[Cell, ...]] = []
    values = {}
    for name in ARRAYS:
        frames, ours, theirs, wrong = compare(load_sensor(name), database.get_message_by_name("ScanBlockFd"))
        size = name.removeprefix("posfet_")
        rows.append((size.replace("x", " x "), frames, ours, theirs, theirs / ours, wrong))
        values |= {f"decode_{size}_us": ours, f"decode_{size}_cantools_us": theirs}
    columns = ("array", "frames per scan", "decoder us per scan", "cantools us per scan", "speed-up", "wrong or lost")
    note = (
        "The decoder also checks each frame, detects incomplete, lost, duplicate and late ones, and synchronises the "
        "clock; cantools only decodes."
    )
    return Outcome(values, [Table("Frame decoding", columns, rows, note)])
