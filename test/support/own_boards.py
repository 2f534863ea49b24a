# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Two invented boards with protocols of their own and of unlike style, whose frames cantools encodes.

A: classic CAN, 29-bit identifiers, Motorola byte order, codes of 10 bits, rows by multiplexer, a counter of 8 bits in
every frame, temperatures and flags in a frame of their own. B: CAN FD, little-endian, signed millivolts with an offset,
no counter, time in ms modulo 2^16 in every frame.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from pathlib import Path

import cantools
import numpy as np

from posfet_driver import protocol
from posfet_driver.bus.frame import CLASSIC, EXTENDED, FD, RATE_SWITCH, Frame
from posfet_model.sensor import description
from posfet_model.sensor.description import Sensor, load_sensor
from support.paths import DATA

FOLDER = DATA / "protocol"
PROTOCOL_A = """
protocol:
  dbc: {folder}/classic_board.dbc
  counts: "T{{row}}{{col}}"
  numbered_from: 1
  sequence: RollingCounter
  temperatures: [ChipTemperature, BoardTemperature]
  status: {{Undervoltage: supply_low, Overheated: overtemperature}}
"""
PROTOCOL_B = """
protocol:
  dbc: {folder}/fd_board.dbc
  counts: "Voltage{{taxel:02}}"
  time: Uptime
"""
PROTOCOL_OWN = """
protocol:
  dbc: {dbc}
  counts: "Count{{place}}"
  block: BlockIndex
  counts_per_frame: 26
  sequence: Sequence
  time: DeviceTime
  time_unit: us
  temperatures: [Temperature1, Temperature2]
  status: {{SupplyLow: supply_low}}
"""
SHIPPED = Path(description.__file__).parent / "sensors" / "posfet_5x5.yaml"


def sensor_text(protocol: str, fd: bool, bits: int, changes: dict[str, str] | None = None) -> str:
    """Return the shipped sensor file with another protocol."""
    text = SHIPPED.read_text(encoding="utf-8").replace("  base_id: 0x100\n", "")
    text = re.sub(r"fd: true", f"fd: {str(fd).lower()}", text)
    text = re.sub(r"bits: 16 ", f"bits: {bits} ", text)
    for old, new in (changes or {}).items():
        assert old in text, old
        text = text.replace(old, new)
    return text + protocol.format(folder=FOLDER)


def write_sensor(path: Path, protocol: str, fd: bool, bits: int, changes: dict[str, str] | None = None) -> Sensor:
    """Write a sensor file and load it."""
    path.write_text(sensor_text(protocol, fd, bits, changes), encoding="utf-8")
    return load_sensor(path)


def own_protocol(path: Path, name: str) -> Sensor:
    """Write a shipped sensor as one with a mapping to the DBC file of this project's protocol, CAN FD; load it."""
    text = (description.SENSOR_FOLDER / f"{name}.yaml").read_text(encoding="utf-8").replace("  base_id: 0x100\n", "")
    path.write_text(text + PROTOCOL_OWN.format(dbc=Path(protocol.__file__).parent / "posfet.dbc"), encoding="utf-8")
    return load_sensor(path)


def sensor_a(folder: Path, **changes: str) -> Sensor:
    return write_sensor(folder / "a.yaml", PROTOCOL_A, False, 10, changes)


def sensor_b(folder: Path, **changes: str) -> Sensor:
    return write_sensor(folder / "b.yaml", PROTOCOL_B, True, 16, changes)


class BoardA:
    """Encodes the frames of board A."""

    database = cantools.database.load_file(FOLDER / "classic_board.dbc")
    row = database.get_message_by_name("TactileRow")
    climate = database.get_message_by_name("Climate")

    def scan(self, sequence: int, codes: Iterable[int]) -> list[Frame]:
        """Return the frames of a scan; `codes` are 25 numbers of 10 bits."""
        grid = np.reshape(list(codes), (5, 5)).tolist()
        return [
            (
                self.row.frame_id,
                CLASSIC | EXTENDED,
                self.row.encode(
                    {"RowIndex": row, "RollingCounter": sequence % 256}
                    | {f"T{row + 1}{col + 1}": grid[row][col] for col in range(5)}
                ),
            )
            for row in range(5)
        ]

    def status(self, chip: float, board: float, undervoltage: int = 0, overheated: int = 0) -> Frame:
        values = {"ChipTemperature": chip, "BoardTemperature": board}
        values |= {"Undervoltage": undervoltage, "Overheated": overheated}
        return (self.climate.frame_id, CLASSIC | EXTENDED, self.climate.encode(values))


class BoardB:
    """Encodes the frames of board B."""

    database = cantools.database.load_file(FOLDER / "fd_board.dbc")

    def scan(self, time: int, millivolts: Iterable[float]) -> list[Frame]:
        """Return the frames of a scan; `time` in ms."""
        volts = list(millivolts)
        frames = []
        for name, taxels in (("Upper", range(15)), ("Lower", range(15, 25))):
            message = self.database.get_message_by_name(name)
            values = {"Uptime": time % 65536} | {f"Voltage{taxel:02}": volts[taxel] for taxel in taxels}
            frames.append((message.frame_id, FD | RATE_SWITCH, message.encode(values, strict=False)))
        return frames


def codes_of(index: int) -> np.ndarray:
    """Return codes of 10 bits, different for any two scans less than 1024 apart."""
    return (index * 7 + np.arange(25) * 37) % 1024


def counts_of_codes(codes: np.ndarray) -> np.ndarray:
    """Return the counts by the rule of the documents: the DBC's 0 to 1023 over the ADC's range."""
    return np.rint(np.asarray(codes) * (65535 / 1023)).astype(np.uint16)


def millivolts_of(index: int) -> np.ndarray:
    """Return voltages [mV] in steps of 0.25 mV, different for any two scans less than 16384 apart."""
    return -2000.0 + 0.25 * ((index * 5 + np.arange(25) * 601) % 16384)


def counts_of_millivolts(millivolts: np.ndarray) -> np.ndarray:
    """Return the counts by the rule of the documents: the place in -5 V to 5 V."""
    return np.rint((np.asarray(millivolts) * 1e-3 + 5.0) / 10.0 * 65535).astype(np.uint16)


class Transmitter:
    """A board that sends scan after scan and takes note of what is sent to it, which should be nothing."""

    def __init__(self, scan: Callable[[int], list[Frame]], start: int = 0, period: int = 1_000_000) -> None:
        self.received: list[Frame] = []
        self.silent = False
        self._scan = scan
        self._start, self._period = start, period
        self._next = 0

    def next_due(self) -> int:
        return self._start + self._next * self._period

    def due(self, now: int, until: int | None = None) -> list[Frame]:
        frames = []
        while self.next_due() <= now:
            frames += [] if self.silent else self._scan(self._next)
            self._next += 1
        return frames

    def receive(self, frame: Frame, now: int) -> list[Frame]:
        self.received.append(frame)
        return []
