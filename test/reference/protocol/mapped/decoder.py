# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Reference of the decoder for boards with frames of their own, in Python and NumPy."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

from posfet_core.protocol import ScanStatistics, Traffic, WallOffset
from posfet_driver.bus.frame import ERROR, EXTENDED, Frame
from posfet_driver.protocol.decoded import Decoded, ScanReady
from posfet_driver.protocol.frame_tables import NO_BLOCK, load_tables
from posfet_driver.protocol.messages import Identity, Status
from posfet_model._lib.units import NANOSECONDS
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import Scan, ScanStatus
from reference.protocol.mapped.assembler import MappedAssembler
from reference.protocol.mapped.counts import CountGather
from reference.protocol.mapped.numbering import MappedNumbering
from reference.protocol.mapped.readers import Message, ReadPart, reader
from reference.protocol.transit_time import TransitTime

_TIME_ESTIMATED: Final = int(ScanStatus.TIME_ESTIMATED)  # a flag is ten times as slow as a number
_SEQUENCE_ESTIMATED: Final = int(ScanStatus.SEQUENCE_ESTIMATED)
_BOARD_RESET: Final = int(ScanStatus.BOARD_RESET)


class MappedDecoder:
    """Decodes the frames of a bus and picks out those that the sensor file names.

    Its interface is that of `Decoder` without commands: it only listens.

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
        self._messages = {
            key: Message(
                message.length,
                message.sent_length,
                reader(message.select) if message.select else None,
                {value: ReadPart(part) for value, part in message.parts.items()},
                message.unrelated,
            )
            for key, message in self.tables.messages.items()
        }
        self._assembler = MappedAssembler(self.tables, period)
        self._counts = CountGather(self.tables.counts, self._assembler.wire)
        self._numbering = MappedNumbering(self.tables, period, self._assembler)
        self.statistics: ScanStatistics = self._assembler.statistics
        """Frames and scans that were lost or rejected, by cause."""
        self.traffic = Traffic()
        self.scan = Scan.empty(sensor.layout.id, sensor.layout.taxels)
        """The newest complete scan; overwritten by the next one."""
        self.receiving = False
        """Whether scans are received; otherwise they are ignored and not counted."""
        self.scans = 0
        """Number of complete scans."""
        self.resets = 0
        """Number of times the board restarted between two scans, as far as counter or time show it."""
        self.identity: Identity | None = None
        """Never known."""
        self.flags = 0
        """Bits of ScanStatus that the newest frames set."""
        self.scan_period = round(period / 1e3)
        """Scan period of the sensor file [us]: the board does not tell."""
        self.kept_period = self.scan_period
        """The same: the scans measure none."""
        self.transit_time = TransitTime()
        """Longest time that the frames of a scan occupy the bus."""
        self._estimated = 0 if self.tables.sequence_bits else _SEQUENCE_ESTIMATED
        steps_tell = self.tables.timed and self.tables.tick <= period
        self._gaps_show = self.tables.sequenced or steps_tell or self.tables.blocks == 1
        self._overflowed = False
        self._wall_offset = WallOffset()
        self._ready = ScanReady(self.scan)

    @property
    def blocks(self) -> int:
        """Number of frames of a scan."""
        return self.tables.blocks

    @property
    def sequence(self) -> int:
        """Sequence of the newest scan; -1 before the first."""
        return self._numbering.sequence

    @property
    def status(self) -> Status:
        """Temperatures and flags as a status; what the mapping lacks is unknown."""
        first, second = self.scan.temperatures.tolist()
        return Status((first, second), math.nan, self.flags, scanning=True, boot=0, heartbeat=0)

    @property
    def frames_lost(self) -> int:
        """Frames of the board that did not arrive or could not be used; an estimate without a sequence."""
        statistics = self.statistics  # a malformed frame is missing in its scan
        return statistics.missing_frames + statistics.frozen_counter + self.traffic.malformed

    @property
    def clock_uncertainty(self) -> float:
        """Possible error of the clock offset by drift or a step [s]; NaN without a board's time."""
        return self._numbering.clock_uncertainty / NANOSECONDS if self.tables.time_bits else math.nan

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
        return self._numbering.frozen_clock

    def start(self) -> None:
        """Receive scans from now on, whatever their sequence: the bus was opened."""
        self.receiving = True
        self.transit_time.restart()
        self._assembler.forget()

    def note_overflow(self) -> None:
        """Note that frames were lost within the next batch: it is discarded when its frames do not tell where."""
        self._overflowed = not self._gaps_show

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
        self.traffic.frames += len(frames)
        self._wall_offset.read(wall_offset)
        if not frames:
            return iter(())
        if self._overflowed:
            self._overflowed = False
            self._assembler.abandon()
            return iter(())
        if self._assembler.collecting and not self._gaps_show:
            of_board = sum((frame[0], frame[1]) in self.tables.messages for frame in frames)
            if self._numbering.frames_are_missing(arrival, of_board):
                self._assembler.abandon()
        self._numbering.begin_batch(arrival, len(frames))
        return self._decode(frames)

    def _decode(self, frames: list[Frame]) -> Iterator[Decoded]:
        messages, add, accept = self._messages, self._assembler.add, self._numbering.accept
        for identifier, kind, data in frames:
            message = messages.get((identifier, kind))
            if message is None:
                self._count(identifier, kind)
                continue
            if len(data) != message.length:
                if len(data) != message.sent_length:
                    self.statistics.malformed += 1
                    continue
                data = data[: message.length]  # noqa: PLW2901  # without what CAN fills up
            self.transit_time.see(kind)
            select = message.select
            part = message.parts.get(select(data) if select else 0)
            if part is None:
                self._count_unused(message, data)
                continue
            if part.readings:
                self._read(part, data)
            if part.block != NO_BLOCK and self.receiving and add(part, data) and accept():
                self._complete()
                yield self._ready

    def _count_unused(self, message: Message, data: bytes) -> None:
        """Count a frame whose multiplexer, or number of the block, selects nothing that the mapping uses."""
        if message.select and message.select(data) in message.unrelated:
            self.traffic.unrelated += 1
        else:
            self.statistics.malformed += 1

    def _read(self, part: ReadPart, data: bytes) -> None:
        for reading in part.readings:
            value = reading.read(data)
            if not reading.flag:
                self.scan.temperatures[reading.temperature] = value
            elif value:
                self.flags |= reading.flag
            else:
                self.flags &= ~reading.flag

    def _complete(self) -> None:
        """Complete the scan: counts, sequence, time and status."""
        scan, numbering = self.scan, self._numbering
        self._counts.decode(scan.counts)
        scan.sequence = numbering.sequence
        scan.status = self.flags | self._estimated
        if self.tables.time_bits and not numbering.clock_frozen:
            scan.device_time = numbering.device_time
        else:
            scan.device_time = 0
            scan.status |= _TIME_ESTIMATED
        scan.stamp = numbering.stamp() + self._wall_offset.value
        scan.stamp_uncertainty = (
            math.nan
            if scan.status & _TIME_ESTIMATED
            else self.transit_time.current + self.clock_uncertainty + self.tables.tick / NANOSECONDS
        )
        if numbering.was_reset:
            scan.status |= _BOARD_RESET
            self.resets += 1
        scan.frames_lost = self.frames_lost
        self.scans += 1

    def _count(self, identifier: int, kind: int) -> None:
        """Count a frame that is no message of the board."""
        if kind & ERROR:
            return  # error frames are counted by the bus
        if (identifier, bool(kind & EXTENDED)) in self.tables.identifiers:
            self.statistics.malformed += 1
        else:
            self.traffic.unrelated += 1
