"""Decoding of frames: the complete decoder of the driver, compared with cantools and the DBC of the board."""

from __future__ import annotations

from importlib.resources import files
from itertools import count

import cantools
import numpy as np
from cantools.database.can import Message

from benchmarks.outcome import Cell, Outcome, Table
from benchmarks.timing import microseconds
from posfet_driver.bus.frame import Frame
from posfet_driver.protocol.decoder import Decoder
from posfet_driver.protocol.scan_codec import FD_TAXELS, make_codec
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_model.sensor.scan import Scan

ARRAYS = ("posfet_5x5", "posfet_16x16", "posfet_32x32")
SCANS = 1 << 16
"""Number of scans after which the counter wraps."""
COUNTS = [f"Count{index}" for index in range(FD_TAXELS)]


def frames_of(sensor: Sensor) -> tuple[list[Frame], np.ndarray]:
    """Return the CAN FD frames of one scan with random counts, and the counts, shape [taxels]."""
    scan = Scan.empty(sensor.layout.id, sensor.layout.taxels)
    scan.counts[:] = np.random.default_rng(4).integers(0, 1 << 16, sensor.layout.taxels)
    return make_codec(sensor).encode(scan, sensor.can.base_id), scan.counts


def compare(sensor: Sensor, block: Message) -> tuple[int, float, float, int]:
    """Return the frames per scan, the times of the decoder and of cantools [us], and the number of wrong counts."""
    frames, counts = frames_of(sensor)
    decoder, numbers = Decoder(sensor), count()
    decoder.start()
    theirs = np.zeros(len(frames) * FD_TAXELS, np.uint16)

    def with_decoder() -> None:
        number = next(numbers)
        header = (1000 * number % (1 << 32)).to_bytes(4, "little") + (number % SCANS).to_bytes(2, "little")
        batch = [(identifier, kind, header + data[6:]) for identifier, kind, data in frames]
        for _ in decoder.decode(batch, 1_000_000 * number, 0):
            pass

    def with_cantools() -> None:
        for _, _, data in frames:
            signals = block.decode(data, decode_choices=False, scaling=False)
            first = signals["BlockIndex"] * FD_TAXELS
            theirs[first : first + FD_TAXELS] = [signals[name] for name in COUNTS]

    times = microseconds(with_decoder), microseconds(with_cantools)
    wrong = np.count_nonzero(decoder.scan.counts != counts) + np.count_nonzero(theirs[: len(counts)] != counts)
    return len(frames), *times, int(wrong) + decoder.frames_lost


def measure(full: bool) -> Outcome:
    """Decode one scan of each array in a loop, each time with the next sequence."""
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
        "The decoder also detects incomplete, lost, duplicate and late frames and synchronises the clock; cantools "
        "only decodes. Writing the next sequence into the frames is included in the time of the decoder."
    )
    return Outcome(values, [Table("Frame decoding", columns, rows, note)])
