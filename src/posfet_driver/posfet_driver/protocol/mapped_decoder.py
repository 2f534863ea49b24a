# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Decodes the frames of a board with its own protocol into scans, by tables made from its DBC file."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

from posfet_core import protocol as core
from posfet_driver.bus.frame import Frame
from posfet_driver.protocol.bit_field import BitField
from posfet_driver.protocol.decoded import Decoded, ScanReady, Traffic
from posfet_driver.protocol.decoder import Decoder
from posfet_driver.protocol.frame_tables import FrameTables, Part, load_tables
from posfet_driver.protocol.messages import Identity, Status
from posfet_model._lib.units import NANOSECONDS
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import Scan

LATE: Final = 8
"""Scans behind the newest one whose frames count as late; more, and the board's time has gone on or restarted."""
_UNRELATED: Final = -1  # part of a value of the multiplexer that the mapping does not use


class MappedDecoder:
    """Decodes the frames of a bus and picks out those that the sensor file names.

    The compiled `posfet_core.protocol.MappedDecoder` does it; this class reads the DBC file and gives the results the
    form that Python uses. Its interface is that of `Decoder` without commands: it only listens.

    Parameters
    ----------
    sensor : Sensor
        Array, and mapping to the DBC file.

    Raises
    ------
    ConfigError
        When cantools is not installed, the DBC file cannot be read, or the mapping does not fit it.
    """

    def __init__(self, sensor: Sensor) -> None:
        self.tables = load_tables(sensor)
        period = NANOSECONDS / sensor.can.scan_rate
        self._core = core.MappedDecoder(_compiled(self.tables, period))
        self.statistics: core.ScanStatistics = self._core.statistics
        """Frames and scans that were lost or rejected, by cause."""
        self.traffic: Traffic = self._core.traffic
        self.transit_time: core.TransitTime = self._core.transit_time
        """Longest time that the frames of a scan occupy the bus."""
        self.scan = Scan.empty(sensor.layout.id, sensor.layout.taxels)
        """The newest complete scan; overwritten by the next one."""
        self.scan.counts, self.scan.temperatures = self._core.counts, self._core.temperatures
        self.identity: Identity | None = None
        """Never known."""
        self.scan_period = round(period / 1e3)
        """Scan period of the sensor file [us]: the board does not tell."""
        self.kept_period = self.scan_period
        """The same: the scans measure none."""
        self._ready = ScanReady(self.scan)

    @property
    def receiving(self) -> bool:
        """Whether scans are received; otherwise they are ignored and not counted."""
        return self._core.receiving

    @receiving.setter
    def receiving(self, receiving: bool) -> None:
        """Receive scans, or ignore them."""
        self._core.receiving = receiving

    @property
    def blocks(self) -> int:
        """Number of frames of a scan."""
        return self.tables.blocks

    @property
    def scans(self) -> int:
        """Number of complete scans."""
        return self._core.scans

    @property
    def resets(self) -> int:
        """Number of times the board restarted between two scans, as far as counter or time show it."""
        return self._core.resets

    @property
    def flags(self) -> int:
        """Bits of ScanStatus that the newest frames set."""
        return self._core.flags

    @property
    def sequence(self) -> int:
        """Sequence of the newest scan; -1 before the first."""
        return self._core.sequence

    @property
    def status(self) -> Status:
        """Temperatures and flags as a status; what the mapping lacks is unknown."""
        first, second = self.scan.temperatures.tolist()
        return Status((first, second), math.nan, self.flags, scanning=True, boot=0, heartbeat=0)

    @property
    def frames_lost(self) -> int:
        """Frames of the board that did not arrive or could not be used; an estimate without a sequence."""
        return self._core.frames_lost

    @property
    def clock_uncertainty(self) -> float:
        """Possible error of the clock offset by drift or a step [s]; NaN without a board's time."""
        return self._core.clock_uncertainty

    @property
    def origin(self) -> dict[str, str]:
        """Where sequence, time and the count of lost scans come from, by name."""
        tables = self.tables
        step = f"steps of {tables.tick / 1e3:g} us"
        if tables.sequence_bits:
            sequence, lost = f"counter of the board, {tables.sequence_bits} bits", "exact while the counter tells"
        else:
            source = "the board's time" if tables.time_bits else "arrivals"
            sequence, lost = f"estimated from {source}", "estimated"
        time = f"clock of the board, {step}" if tables.time_bits else "estimated from arrivals and scan rate"
        return {"sequence": sequence, "time": time, "lost scans": lost}

    @property
    def frozen_clock(self) -> int:
        """Number of scans that repeat the device time for longer than its steps explain."""
        return self._core.frozen_clock

    def start(self) -> None:
        """Receive scans from now on, whatever their sequence: the bus was opened."""
        self._core.start()

    def note_overflow(self) -> None:
        """Note that frames were lost within the next batch: it is discarded when its frames do not tell where."""
        self._core.note_overflow()

    def decode(self, frames: list[Frame], arrival: int, wall_offset: int) -> Iterator[Decoded]:
        """Decode a batch of frames, one step of the iterator at a time.

        Parameters
        ----------
        frames : list of Frame
            Frames in the order of their arrival.
        arrival : int
            Monotonic time at which they were read [ns].
        wall_offset : int
            Wall time less monotonic time [ns].

        Returns
        -------
        Iterator of ScanReady
            The complete scans. Exhaust it before the next batch; what is not consumed is dropped.
        """
        return self._decode(self._core.begin_batch(frames, arrival, wall_offset))

    def _decode(self, batch: core.Batch) -> Iterator[Decoded]:
        advance, scan, ready = self._core.advance, self.scan, self._ready
        while advance(batch, scan):
            yield ready


def _compiled(tables: FrameTables, period: float) -> core.MappedTables:
    """Return the tables of a board with a scan period [ns] as the compiled decoder reads them."""
    compiled = core.MappedTables()
    compiled.period, compiled.slots = period, list(tables.slots)
    compiled.sequence_bits, compiled.sequenced = tables.sequence_bits, tables.sequenced
    compiled.time_bits, compiled.timed, compiled.tick = tables.time_bits, tables.timed, tables.tick
    compiled.ticks_back = ticks_back(tables, period)
    messages = {message.name: message for message in tables.messages.values()}
    parts: list[core.MappedPart] = []
    entries: list[core.MappedMessage] = []
    for message in messages.values():
        indices = [(value, len(parts) + index) for index, value in enumerate(message.parts)]
        indices += [(value, _UNRELATED) for value in message.unrelated]
        parts += map(_part, message.parts.values())
        entries.append(core.MappedMessage(message.length, message.sent_length, _field(message.select), indices))
    compiled.parts, compiled.messages = parts, entries
    numbers = {name: number for number, name in enumerate(messages)}
    compiled.set_kinds([(*key, numbers[message.name]) for key, message in tables.messages.items()])
    compiled.identifiers = list(tables.identifiers)
    compiled.counts = [core.CountPlace(offset, field.compiled(), base) for offset, field, base in tables.counts.places]
    compiled.set_table(tables.counts.table)
    return compiled


def ticks_back(tables: FrameTables, period: float) -> float:
    """Return the steps of the board's time ahead beyond which it has gone back: a scan is late.

    Parameters
    ----------
    tables : FrameTables
        Length and step of the time.
    period : float
        Scan period [ns].
    """
    wrap = 1 << tables.time_bits
    late = LATE * period // tables.tick if tables.time_bits else 0
    return float(wrap - min(late, wrap // 4))


def _field(field: BitField | None) -> core.BitField | None:
    return field.compiled() if field else None


def _part(part: Part) -> core.MappedPart:
    readings = [
        core.SignalReading(
            each.field.compiled(), each.temperature, each.flag, each.sign, each.scale, each.offset, each.low, each.high
        )
        for each in part.readings
    ]
    return core.MappedPart(part.block, _field(part.sequence), _field(part.time), readings)


def make_decoder(sensor: Sensor) -> Decoder | MappedDecoder:
    """Return the decoder for the board of a sensor file, which has to be started. Raises ConfigError as they do."""
    return MappedDecoder(sensor) if sensor.mapping else Decoder(sensor)
