"""Frames to counts: the driver's receiver, with all that it looks after, beside cantools with the board's DBC."""

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
"""The counter of scans begins anew after so many."""
COUNTS = [f"Count{index}" for index in range(FD_TAXELS)]


def frames_of(sensor: Sensor) -> tuple[list[Frame], np.ndarray]:
    """Return the CAN FD frames of one scan with any counts, and the counts, shape [taxels]."""
    scan = Scan.empty(sensor.layout.id, sensor.layout.taxels)
    scan.counts[:] = np.random.default_rng(4).integers(0, 1 << 16, sensor.layout.taxels)
    return make_codec(sensor).encode(scan, sensor.can.base_id), scan.counts


def compare(sensor: Sensor, block: Message) -> tuple[int, float, float, int]:
    """Return the frames of a scan, what it takes the receiver and cantools [us], and counts that came out wrong."""
    frames, counts = frames_of(sensor)
    decoder, numbers = Decoder(sensor), count()
    decoder.resync(0, count_gap=False)
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

    taken = microseconds(with_decoder), microseconds(with_cantools)
    wrong = np.count_nonzero(decoder.scan.counts != counts) + np.count_nonzero(theirs[: len(counts)] != counts)
    return len(frames), *taken, int(wrong) + decoder.frames_lost


def measure(full: bool) -> Outcome:
    """Decode one scan of each array again and again, each time under the next number."""
    del full
    database = cantools.database.load_file(str(files("posfet_driver") / "protocol" / "posfet.dbc"))
    rows: list[tuple[Cell, ...]] = []
    values = {}
    for name in ARRAYS:
        frames, ours, theirs, wrong = compare(load_sensor(name), database.get_message_by_name("ScanBlockFd"))
        size = name.removeprefix("posfet_")
        rows.append((size.replace("x", " x "), frames, ours, theirs, theirs / ours, wrong))
        values |= {f"decode_{size}_us": ours, f"decode_{size}_cantools_us": theirs}
    columns = ("array", "frames a scan", "receiver us a scan", "cantools us a scan", "times", "wrong or lost")
    note = (
        "The receiver also tells what is torn, lost, repeated or late and maps the board's clock; cantools only "
        "decodes. Writing the next number into the frames is part of the receiver's time."
    )
    return Outcome(values, [Table("Frames to counts", columns, rows, note)])
