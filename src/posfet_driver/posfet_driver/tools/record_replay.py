# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Records and replays the traffic of a bus in the formats of python-can: `posfet can record` and `replay`."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import can
from rich.console import Console
from rich.table import Table

from posfet_driver.board.board_report import decoder_fault_counts
from posfet_driver.board.faults import FaultKind
from posfet_driver.bus.bus_error import one_line
from posfet_driver.bus.error_frame import ErrorCounts
from posfet_driver.bus.message_conversion import frame_of
from posfet_driver.bus.open_bus import open_can_bus
from posfet_driver.bus.python_can_bus import PythonCanFrameBus
from posfet_driver.bus.recording import check_name, messages, recording
from posfet_driver.protocol.decoder import Decoder
from posfet_driver.protocol.mapped_decoder import MappedDecoder, make_decoder
from posfet_driver.protocol.messages import FD_BLOCK_OFFSET, HEADER_OFFSET
from posfet_driver.tools.bus_options import bus_of, sensor_of
from posfet_driver.tools.one_shot import started
from posfet_model.config import ConfigError
from posfet_model.sensor.description import Sensor

POLL: Final = 0.1
"""Longest wait for a frame [s]."""
LONGEST_BACKLOG: Final = 0.5
"""Delay of a recorded frame [s] from which all that are due are skipped: a process that was stopped, or a slow bus."""


class _RecordedBus:
    """A bus of python-can that records every message read from it, whoever reads: no response hides its neighbours."""

    def __init__(self, bus: can.BusABC, log: Callable[[can.Message], None]) -> None:
        self.send = bus.send
        self.messages = 0
        self._bus = bus
        self._log = log

    def recv(self, timeout: float | None = None) -> can.Message | None:
        message = self._bus.recv(timeout)
        if message is not None:
            self._log(message)
            self.messages += 1
        return message


def run_record(options: argparse.Namespace) -> int:
    """Run `posfet can record`; return the exit code: 0 when any frame was recorded."""
    check_name(options.file)
    if options.file.is_file():
        raise ConfigError(f"{options.file}: cannot be written: File exists; choose another name, or remove it")
    with bus_of(options) as (sensor, settings):
        bus = open_can_bus(settings)
        try:
            with recording(options.file) as log:
                recorded = _RecordedBus(bus, log)
                frame_bus = PythonCanFrameBus(recorded)
                with started(frame_bus, sensor, options), contextlib.suppress(KeyboardInterrupt):
                    clock = options.clock
                    end = clock.monotonic() / 1e9 + options.seconds
                    while (left := end - clock.monotonic() / 1e9) > 0:
                        frame_bus.read_frames(min(left, POLL))
        finally:
            bus.shutdown()
    Console(highlight=False, markup=False).print(f"{recorded.messages} frames in {options.file}", soft_wrap=True)
    return 0 if recorded.messages else 1


def decode(file: Path, decoder: Decoder | MappedDecoder, errors: ErrorCounts) -> None:
    """Decode a recording; when it is damaged, up to the damage.

    Parameters
    ----------
    file : Path
        The recording.
    decoder : Decoder or MappedDecoder
        Receives its frames.
    errors : ErrorCounts
        Counts its error frames.

    Raises
    ------
    ConfigError
        For a file that is damaged or without frames; one line.
    """
    decoder.start()
    for message in messages(file):
        try:
            frames = [frame_of(message)]
        except ValueError as error:
            raise ConfigError(f"{file}: damaged at {message.timestamp:.6f} s: {error}") from error
        errors.count(frames)
        for _ in decoder.decode(frames, round(message.timestamp * 1e9), 0):
            pass
    if not decoder.traffic.frames:
        raise ConfigError(f"{file}: contains no frame")


def run_replay(options: argparse.Namespace) -> int:
    """Run `posfet can replay`; return the exit code."""
    console = Console(highlight=False, markup=False)
    if options.decode:
        decoder, errors = make_decoder(sensor_of(options)), ErrorCounts()
        try:
            decode(options.file, decoder, errors)
        finally:
            if decoder.traffic.frames:
                console.print(_table(options.file, decoder, errors))
        if not decoder.scans:
            console.print("it contains no scan: compare --sensor and --fd with the board's", soft_wrap=True)
        return 0
    recorded = messages(options.file)
    first = next(recorded, None)
    if first is None:
        raise ConfigError(f"{options.file}: contains no frame")
    frames = skipped = 0
    with bus_of(options) as (sensor, settings):
        bus = open_can_bus(settings)
        try:
            clock = options.clock
            begin, behind = clock.monotonic(), False
            for message in _all(first, recorded):
                wait = (message.timestamp - first.timestamp) / options.speed - (clock.monotonic() - begin) / 1e9
                behind |= wait < -LONGEST_BACKLOG
                if behind and (wait < 0 or not _begins_scan(message, sensor)):
                    skipped += not message.is_error_frame
                    continue
                behind = False
                if wait > 0:
                    clock.sleep(wait)
                if not message.is_error_frame:
                    _send(bus, message)
                    frames += 1
        finally:
            bus.shutdown()
    missed = f", {skipped} skipped: the replay was more than {LONGEST_BACKLOG:g} s late" if skipped else ""
    console.print(f"{frames} frames sent{missed}", soft_wrap=True)
    return 0


def _begins_scan(message: can.Message, sensor: Sensor) -> bool:
    """Return whether the scans from this frame on are whole and can be numbered."""
    if sensor.mapping:
        return True
    if sensor.can.fd:
        return bool(message.arbitration_id == sensor.can.base_id + FD_BLOCK_OFFSET and message.data[8:9] == b"\0")
    return bool(message.arbitration_id == sensor.can.base_id + HEADER_OFFSET)


def _send(bus: can.BusABC, message: can.Message) -> None:
    """Send a frame. Raises can.CanError, one line, also for a frame that the bus cannot carry."""
    try:
        bus.send(message, timeout=POLL)
    except can.CanError:
        raise
    except Exception as error:
        raise can.CanOperationError(f"frame at {message.timestamp:.6f} s cannot be sent: {one_line(error)}") from error


def _all(first: can.Message, rest: Iterator[can.Message]) -> Iterator[Any]:
    yield first
    yield from rest


def _table(file: Path, decoder: Decoder | MappedDecoder, errors: ErrorCounts) -> Table:
    traffic = decoder.traffic
    table = Table("item", "count", title=str(file))
    for name, number in (
        ("frames", traffic.frames),
        ("complete scans", decoder.scans),
        *((fault.label, count) for fault, count in decoder_fault_counts(decoder).items()),
        ("unrelated frames", traffic.unrelated),
        (FaultKind.ERROR_FRAMES.label, errors.frames),
    ):
        table.add_row(name, str(number))
    return table
