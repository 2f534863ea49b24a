"""Recordings of a bus, in every format that python-can writes and reads: `posfet can record` and `replay`."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import can
from rich.console import Console
from rich.table import Table

from posfet_driver.bus.message_conversion import frame_of
from posfet_driver.bus.open_bus import one_line, open_can_bus
from posfet_driver.bus.python_can_bus import MessageFrames
from posfet_driver.bus.recording import check_name, messages, recording
from posfet_driver.protocol.decoder import Receiver
from posfet_driver.tools.bus_options import bus_of, sensor_of
from posfet_driver.tools.one_shot import started
from posfet_model.config import ConfigError

POLL: Final = 0.1
"""Longest wait for a frame [s]."""


def run_record(options: argparse.Namespace) -> int:
    """Run the action; return the exit code: 0 when any frame was recorded."""
    check_name(options.file)
    frames = 0
    with bus_of(options) as (sensor, settings):
        bus = open_can_bus(settings)
        try:
            with recording(options.file) as log, started(MessageFrames(bus), sensor, options):
                clock = options.clock
                end = clock.monotonic() / 1e9 + options.seconds
                with contextlib.suppress(KeyboardInterrupt):
                    while (left := end - clock.monotonic() / 1e9) > 0:
                        message = bus.recv(min(left, POLL))
                        if message is not None:
                            log(message)
                            frames += 1
        finally:
            bus.shutdown()
    Console(highlight=False, markup=False).print(f"{frames} frames in {options.file}", soft_wrap=True)
    return 0 if frames else 1


def decode(file: Path, receiver: Receiver) -> None:
    """Have `receiver` take a recording as if it had just been heard; what is before a broken place is taken, too."""
    receiver.listening = True
    for message in messages(file):
        for frame in receiver.begin_batch([frame_of(message)], round(message.timestamp * 1e9), 0):
            receiver.feed(frame)
    if not receiver.traffic.frames:
        raise ConfigError(f"{file}: no frame is in it")


def run_replay(options: argparse.Namespace) -> int:
    """Run the action; return the exit code."""
    console = Console(highlight=False, markup=False)
    if options.decode:
        receiver = Receiver(sensor_of(options))
        try:
            decode(options.file, receiver)
        finally:
            if receiver.traffic.frames:
                console.print(_table(options.file, receiver))
        if not receiver.scans:
            console.print("no scan is in it: compare --sensor and --fd with the board's", soft_wrap=True)
        return 0
    recorded = messages(options.file)
    first = next(recorded, None)
    if first is None:
        raise ConfigError(f"{options.file}: no frame is in it")
    frames = 0
    with bus_of(options) as (_, settings):
        bus = open_can_bus(settings)
        try:
            clock = options.clock
            begin = clock.monotonic()
            for message in _all(first, recorded):
                wait = (message.timestamp - first.timestamp) / options.speed - (clock.monotonic() - begin) / 1e9
                if wait > 0:
                    clock.sleep(wait)
                if not message.is_error_frame:
                    _send(bus, message)
                    frames += 1
        finally:
            bus.shutdown()
    console.print(f"{frames} frames sent")
    return 0


def _send(bus: can.BusABC, message: can.Message) -> None:
    """Send a frame. Raises can.CanError, one line, for one that the bus cannot carry, too."""
    try:
        bus.send(message, timeout=POLL)
    except ValueError as error:
        raise can.CanOperationError(f"frame at {message.timestamp:.6f} s cannot be sent: {one_line(error)}") from error


def _all(first: can.Message, rest: Iterator[can.Message]) -> Iterator[Any]:
    yield first
    yield from rest


def _table(file: Path, receiver: Receiver) -> Table:
    losses, traffic = receiver.assembler.losses, receiver.traffic
    table = Table("what", "number", title=str(file))
    for name, number in (
        ("frames", traffic.frames),
        ("whole scans", receiver.scans),
        ("torn scans", losses.torn_scans),
        ("lost scans", losses.lost_scans),
        ("repeated frames", losses.repeated),
        ("late frames", losses.late),
        ("reordered frames", losses.reordered),
        ("malformed frames", losses.malformed + traffic.malformed),
        ("foreign frames", traffic.foreign),
        ("error frames", receiver.errors.frames),
    ):
        table.add_row(name, str(number))
    return table
