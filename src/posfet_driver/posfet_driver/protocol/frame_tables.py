# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Tables to decode the frames of a board with a protocol of its own, made from its DBC file when a sensor is loaded."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from posfet_driver.bus.frame import CLASSIC, EXTENDED, FD, RATE_SWITCH
from posfet_driver.protocol.bit_field import MAX_LENGTH, BitField
from posfet_driver.protocol.count_table import CountTable, check_count
from posfet_driver.protocol.signal_names import Found, SignalNames
from posfet_model._lib.units import NANOSECONDS
from posfet_model.config import ConfigError
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.frame_mapping import TIME_UNITS, FrameMapping

NO_BLOCK: Final = -1
"""Block of frames without counts, sequence and time of a scan."""

_CLASSIC_BYTES: Final = 8
_SHORTEST_COUNTER: Final = 2  # bits: with one, a lost scan looks like a counter that stands still
_FD_LENGTHS: Final = (12, 16, 20, 24, 32, 48, 64)
_LEAST_PERIODS: Final = 4
_LONGEST_TICK: Final = 1e12  # [ns]
_NOT_CELSIUS: Final = {"K", "F", "kelvin", "Kelvin", "degF", "°F"}


@dataclass(frozen=True, slots=True)
class Reading:
    """A signal besides the scan, which is kept until the next one."""

    field: BitField
    temperature: int = -1
    """Index of the temperature sensor; -1: it is a flag."""
    flag: int = 0
    """Bit of ScanStatus that is set when the signal is not 0."""
    sign: int = 0
    """Bit of the sign; 0: none."""
    scale: float = 1.0
    offset: float = 0.0
    low: float = -math.inf
    """Least value [degC]; what is outside is unknown."""
    high: float = math.inf
    """Greatest value [degC]."""


@dataclass(slots=True)
class Part:
    """What the frames with one identifier, and one value of its multiplexer, hold."""

    block: int = NO_BLOCK
    """Position among the frames of a scan."""
    sequence: BitField | None = None
    time: BitField | None = None
    readings: list[Reading] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class MappedMessage:
    """A message of the DBC that the mapping uses."""

    name: str
    length: int
    """Length of its data [byte]."""
    sent_length: int
    """Length in which CAN sends it, filled up [byte]."""
    select: BitField | None
    """The multiplexer, or the number of the block; None: it has only one part, 0."""
    parts: Mapping[int, Part]
    unrelated: frozenset[int]
    """Values of the multiplexer for signals that the mapping does not use."""


@dataclass(frozen=True, slots=True)
class FrameTables:
    """All that is needed to decode the frames of a board."""

    messages: Mapping[tuple[int, int], MappedMessage]
    """By identifier and kind of the frame."""
    identifiers: frozenset[tuple[int, bool]]
    """Identifiers of these messages, and whether they have 29 bits."""
    names: Mapping[tuple[int, bool], str]
    """Names of these messages."""
    blocks: int
    """Number of frames of a scan."""
    slots: tuple[int, ...]
    """Length of each block [byte]."""
    sent: tuple[tuple[int, bool], ...]
    """Length in which CAN sends each block [byte], and whether its identifier has 29 bits."""
    counts: CountTable
    sequence_bits: int
    """Length of the sequence [bit]; 0: the board sends none."""
    sequenced: bool
    """Whether all blocks hold the sequence."""
    time_bits: int
    """Length of the time [bit]; 0: the board sends none."""
    timed: bool
    """Whether all blocks hold the time."""
    tick: float
    """Step of the time [ns]."""


def load_tables(sensor: Sensor) -> FrameTables:
    """Return the tables of a sensor with frames of its own.

    Parameters
    ----------
    sensor : Sensor
        The sensor; its `mapping` is not None.

    Returns
    -------
    FrameTables
        The tables.

    Raises
    ------
    ConfigError
        When the mapping does not fit the DBC file or the array; one line that names sensor file, key and signal.
    """
    if sensor.mapping is None:
        raise ConfigError("protocol: this sensor has no frames of its own")
    return _Builder(sensor, sensor.mapping).tables()


class _Builder:
    """Finds the signals and checks that they fit together."""

    def __init__(self, sensor: Sensor, mapping: FrameMapping) -> None:
        self._sensor, self._mapping = sensor, mapping
        self._names = SignalNames(mapping)
        self._used: dict[tuple[str, str], str] = {}  # key of the mapping by names of message and signal
        self._parts: dict[str, dict[int, Part]] = {}  # by message and value of its multiplexer
        self._select: dict[str, Any] = {}  # signal by message

    def tables(self) -> FrameTables:
        taxels = self._taxels()
        sequence, sequence_bits = self._scan_signals("sequence", self._mapping.sequence)
        time, time_bits = self._scan_signals("time", self._mapping.time)
        blocks = self._number_blocks()
        self._set("sequence", sequence)
        self._set("time", time)
        self._add_readings()
        messages = {self._names.message("counts", name): parts for name, parts in self._parts.items()}
        entries = {message.name: self._entry(message, parts) for message, parts in messages.items()}
        offsets, length = [], 0
        for message in blocks:
            offsets.append(length)
            length += message.length
        placed = [(offsets[part.block], BitField.of_signal(signal), signal) for part, signal in taxels]
        used = {(message.frame_id, bool(message.is_extended_frame)): message.name for message in messages}
        scan_parts = [part for parts in self._parts.values() for part in parts.values() if part.block != NO_BLOCK]
        return FrameTables(
            messages={
                (message.frame_id, kind): entries[message.name] for message in messages for kind in self._kinds(message)
            },
            identifiers=frozenset(used),
            names=used,
            blocks=len(blocks),
            slots=tuple(message.length for message in blocks),
            sent=tuple((_sent_length(message.length), bool(message.is_extended_frame)) for message in blocks),
            counts=CountTable(self._mapping, placed, self._sensor.adc),
            sequence_bits=sequence_bits,
            sequenced=all(part.sequence for part in scan_parts),
            time_bits=time_bits,
            timed=all(part.time for part in scan_parts),
            tick=self._tick(time),
        )

    def _use(self, key: str, found: Found) -> Found:
        """Note that a signal is used; it can be used once."""
        names = found.message.name, found.signal.name
        if names in self._used:
            where = "" if self._used[names] == key else f", also for {self._used[names]}"
            raise self._mapping.error(key, f"signal {found.name} is used twice{where}")
        if found.signal.length > MAX_LENGTH:
            bits = found.signal.length
            raise self._mapping.error(key, f"signal {found.name} has {bits} bits, at most {MAX_LENGTH} are read")
        self._used[names] = key
        return found

    def _taxels(self) -> list[tuple[Part, Any]]:
        """Return the part and the signal of each taxel."""
        mapping = self._mapping
        found = [self._use("counts", self._names.one("counts", name)) for name in mapping.counts]
        for item in found:
            check_count(mapping, item.signal, self._sensor.adc)
        if mapping.block:
            return self._numbered_taxels(found)
        taxels = []
        plain: dict[str, bool] = {}
        for item in found:
            ids = item.signal.multiplexer_ids or []
            if len(ids) > 1:
                raise mapping.error("counts", f"signal {item.name} belongs to several values of its multiplexer")
            if plain.setdefault(item.message.name, not ids) != (not ids):
                raise mapping.error("counts", f"message {item.message.name}: all counts or none must be multiplexed")
            taxels.append((self._part("counts", item, ids[0] if ids else 0), item.signal))
        return taxels

    def _numbered_taxels(self, found: list[Found]) -> list[tuple[Part, Any]]:
        """Return part and signal of each taxel where a signal numbers the frames of a scan."""
        mapping, message = self._mapping, found[0].message
        number = self._use("block", self._names.one("block", f"{message.name}.{mapping.block.rpartition('.')[2]}"))
        for item in found:
            if item.message is not message or item.signal.multiplexer_ids:
                raise mapping.error("counts", f"with block, all must be plain signals of {message.name}: {item.name}")
        places, taxels = len(found), self._sensor.layout.taxels
        blocks = -(-taxels // places)
        if blocks > 1 << number.signal.length:
            raise mapping.error(
                "block", f"{blocks} frames need more than the {number.signal.length} bits of {number.name}"
            )
        self._select[message.name] = number.signal
        parts = [self._parts.setdefault(message.name, {}).setdefault(block, Part()) for block in range(blocks)]
        return [(parts[taxel // places], found[taxel % places].signal) for taxel in range(taxels)]

    def _part(self, key: str, found: Found, value: int) -> Part:
        """Return the part of a message, and of one value of its multiplexer, that a signal is in."""
        message, signal = found.message, found.signal
        if signal.multiplexer_ids:
            select = message.get_signal_by_name(signal.multiplexer_signal)
            if select.multiplexer_ids or self._select.setdefault(message.name, select) is not select:
                raise self._mapping.error(key, f"signal {found.name} depends on several multiplexers")
        return self._parts.setdefault(message.name, {}).setdefault(value, Part())

    def _scan_signals(self, key: str, names: tuple[str, ...]) -> tuple[list[Found], int]:
        """Return the signals of the sequence or the time in the messages of a scan, and their length [bit]."""
        result: list[Found] = []
        for name in names:
            found = self._names.all(key, name)
            with_counts = [item for item in found if item.message.name in self._parts]
            result += with_counts or [self._names.one(key, name)]
        for item in result:
            self._use(key, item)
            signal = item.signal
            if signal.is_float or signal.is_signed or signal.length > 64 or not float(signal.scale) > 0:
                raise self._mapping.error(key, f"signal {item.name} must be a whole number without sign, scale above 0")
            if key == "sequence" and signal.length < _SHORTEST_COUNTER:
                reason = f"signal {item.name} has {signal.length} bits, a counter needs {_SHORTEST_COUNTER} or more"
                raise self._mapping.error(key, reason)
            if (signal.length, signal.scale) != (result[0].signal.length, result[0].signal.scale):
                raise self._mapping.error(key, f"signals {result[0].name} and {item.name} differ in length or scale")
            if item.message.name not in self._parts:  # a frame of its own is part of the scan
                self._part(key, item, signal.multiplexer_ids[0] if signal.multiplexer_ids else 0)
        return result, result[0].signal.length if result else 0

    def _number_blocks(self) -> list[Any]:
        """Return the message of each frame of a scan, in the order of sending, and number their parts."""
        mapping = self._mapping
        names = list(self._parts)
        if mapping.order:
            for name in mapping.order:
                self._names.message("order", name)
            if sorted(mapping.order) != sorted(names):
                raise mapping.error("order", f"must name each message of a scan once: {', '.join(names)}")
            names = list(mapping.order)
        else:  # those without counts, found after the others, come first
            names.sort(key=lambda name: any(used[0] == name and key == "counts" for used, key in self._used.items()))
        blocks: list[Any] = []
        for name in names:
            for part in self._parts[name].values():
                part.block = len(blocks)
                blocks.append(self._names.message("counts", name))
        return blocks

    def _set(self, attribute: str, found: list[Found]) -> None:
        """Let the parts of the messages of a scan read sequence or time."""
        for item in found:
            place, ids = BitField.of_signal(item.signal), item.signal.multiplexer_ids
            parts = [part for value, part in self._parts[item.message.name].items() if not ids or value in ids]
            if not parts:
                raise self._mapping.error(attribute, f"signal {item.name} is in no frame with counts")
            for part in parts:
                setattr(part, attribute, place)

    def _add_readings(self) -> None:
        mapping = self._mapping
        readings = []
        for index, name in enumerate(mapping.temperatures):
            found = self._use("temperatures", self._names.one("temperatures", name))
            if found.signal.is_float or found.signal.unit in _NOT_CELSIUS:
                raise mapping.error("temperatures", f"signal {found.name} must be a whole number, scaled to degC")
            readings.append((found, self._temperature(index, found.signal)))
        for name, flag in mapping.status:
            found = self._use("status", self._names.one("status", name))
            readings.append((found, Reading(BitField.of_signal(found.signal), flag=int(flag))))
        readings.sort(key=lambda item: not item[0].signal.multiplexer_ids)  # those without go into all parts
        for found, reading in readings:
            if ids := found.signal.multiplexer_ids:
                parts = [self._part("status" if reading.flag else "temperatures", found, value) for value in ids]
            else:
                parts = list(self._parts.setdefault(found.message.name, {0: Part()}).values())
            for part in parts:
                part.readings.append(reading)

    @staticmethod
    def _temperature(index: int, signal: Any) -> Reading:
        return Reading(
            BitField.of_signal(signal),
            temperature=index,
            sign=1 << signal.length - 1 if signal.is_signed else 0,
            scale=float(signal.scale),
            offset=float(signal.offset),
            low=-math.inf if signal.minimum is None else float(signal.minimum),
            high=math.inf if signal.maximum is None else float(signal.maximum),
        )

    def _entry(self, message: Any, parts: dict[int, Part]) -> MappedMessage:
        select = self._select.get(message.name)
        if select and select.length > MAX_LENGTH:
            reason = f"signal {select.name} has {select.length} bits, a multiplexer has at most {MAX_LENGTH}"
            raise self._mapping.error("counts", reason)
        values = {value for signal in message.signals for value in signal.multiplexer_ids or []}
        return MappedMessage(
            name=message.name,
            length=message.length,
            sent_length=_sent_length(message.length),
            select=BitField.of_signal(select) if select else None,
            parts=parts,
            unrelated=frozenset(values - set(parts)),
        )

    def _kinds(self, message: Any) -> Iterator[int]:
        """Yield the kinds that frames of a message may have."""
        link, extended = self._sensor.can, EXTENDED if message.is_extended_frame else 0
        if message.length > _CLASSIC_BYTES and not link.fd:
            reason = f"message {message.name} has {message.length} bytes, which needs can.fd: true"
            raise self._mapping.error("dbc", reason)
        if message.length <= _CLASSIC_BYTES:
            yield CLASSIC | extended
        if link.fd:
            yield from (FD | extended, FD | RATE_SWITCH | extended)

    def _tick(self, found: list[Found]) -> float:
        """Return the step of the time [ns]."""
        if not found:
            return 0.0
        signal = found[0].signal
        unit = self._mapping.time_unit or signal.unit
        if unit not in TIME_UNITS:
            known = ", ".join(TIME_UNITS)
            raise self._mapping.error("time_unit", f"missing, must be one of {known}: signal {found[0].name} has none")
        tick = float(signal.scale) * TIME_UNITS[unit]
        if tick > _LONGEST_TICK:
            raise self._mapping.error(
                "time", f"signal {found[0].name} has steps of {tick / NANOSECONDS:g} s, at most 1000"
            )
        wrap, period = tick * 2**signal.length, NANOSECONDS / self._sensor.can.scan_rate
        if wrap < _LEAST_PERIODS * period:
            reason = f"signal {found[0].name} wraps after {wrap / 1e6:g} ms, less than {_LEAST_PERIODS} scan periods"
            raise self._mapping.error("time", reason)
        return tick


def _sent_length(length: int) -> int:
    """Return the length with which CAN sends so many bytes; beyond 8 only some lengths exist."""
    return length if length <= _CLASSIC_BYTES else next(sent for sent in _FD_LENGTHS if sent >= length)
