# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""`posfet calibrate --guided`: the steps on the rig with live values, then the fit."""

from __future__ import annotations

import contextlib
import select
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

from posfet_driver.board.board_client import Board
from posfet_driver.board.listening_board import ListeningBoard
from posfet_driver.board.scan_source import SourceError
from posfet_driver.bus.open_bus import bus_settings
from posfet_driver.bus.port_search import BusOpener
from posfet_driver.clock import Clock, SystemClock
from posfet_driver.protocol.identifiers import board_frames
from posfet_model.config import ConfigError
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import Scan
from posfet_sim.calibration.bench_recording import last_force
from posfet_sim.calibration.guide import Guide
from posfet_sim.recording.mcap_file import MessageFile
from posfet_sim.recording.message_definitions import schema_text
from posfet_sim.recording.scan_messages import RAW, ScanMessage

READ_TIMEOUT: Final = 0.2
"""Longest wait for a scan [s]."""
SHOW_EVERY: Final = 100
"""Number of scans for each update of the display."""
FIRST_SCAN: Final = 10.0
"""Time in which the first scan must arrive [s]."""


@contextlib.contextmanager
def scans_of(
    sensor: Sensor, interface: str, channel: str, clock: Clock | None = None
) -> Iterator[Iterator[Scan | None]]:
    """Yield the scans of a board on a bus; None where none arrived in time.

    Parameters
    ----------
    sensor : Sensor
        Sensor description.
    interface : str
        Interface of python-can.
    channel : str
        Its channel.
    clock : Clock, optional
        Clock of the host; default: that of this machine.

    Yields
    ------
    iterator of Scan or None
        The scans, each overwritten by the next one.

    Raises
    ------
    ConfigError
        The bus cannot be opened; one line.
    """
    opener = BusOpener(bus_settings(interface, channel, sensor.can), board_frames(sensor))
    kind = ListeningBoard if sensor.mapping else Board
    board = kind(sensor, opener, clock or SystemClock(), opener.presence)
    try:
        board.open()
    except SourceError as error:
        raise ConfigError(str(error)) from error

    def scans() -> Iterator[Scan | None]:
        waited, arrived = 0.0, False
        while True:
            scan = board.read(READ_TIMEOUT)
            arrived |= scan is not None
            waited += 0.0 if arrived else READ_TIMEOUT
            if waited > FIRST_SCAN:
                raise ConfigError(f"{interface} {channel}: no scan: {board.report().state}; see posfet can selftest")
            yield scan

    try:
        yield scans()
    finally:
        board.close()


def run(
    sensor: Sensor,
    scans: Iterator[Scan | None],
    recording: Path,
    reference: Path | None = None,
    key: Callable[[], str] | None = None,
) -> Guide:
    """Go through the steps, show them, and record the scans; return the guide at its end.

    Parameters
    ----------
    sensor : Sensor
        Sensor description.
    scans : iterator of Scan or None
        Scans of the board as they arrive.
    recording : Path
        MCAP file that gets them; it must not exist.
    reference : Path, optional
        File of the rig, which it may still be writing: its newest force is compared with that of the board.
    key : callable, optional
        Returns a line that was typed: 'q' ends, any other goes on to the next step; '' for none. Default: reads from
        the terminal.

    Raises
    ------
    ConfigError
        A file cannot be written, or the user ended; one line.
    """
    guide, message, count = Guide(sensor), ScanMessage(sensor.layout.rows, sensor.layout.cols), 0
    file = MessageFile(recording, "posfet calibrate")
    try:
        topic = file.add_topic("/tactile/raw", RAW, schema_text(RAW))
        with _display() as show:
            for scan in scans:
                if scan is not None:
                    file.add(topic, scan.stamp, message.fill(scan), scan.sequence)
                    guide.add(scan)
                    count += 1
                if count % SHOW_EVERY == 0 or scan is None:
                    show(guide, last_force(reference) if reference else None)
                    typed = (key or _key)()
                    if typed.strip().lower() == "q":
                        raise ConfigError(f"ended by you; what was recorded is in {recording}")
                    if typed:
                        guide.skip()
                if guide.step is None:
                    break
    finally:
        file.close()
    return guide


def lines(guide: Guide, rig: float | None) -> list[str]:
    """Return the state of a guide as lines: the steps, what to do, and the forces of board and rig.

    Parameters
    ----------
    guide : Guide
        The guide.
    rig : float or None
        Newest force of the rig [N]; None: unknown.
    """
    result = []
    for number, step in enumerate(guide.steps):
        skipped = " (left out)" if step in guide.skipped else ""
        mark = "done" if number < guide.index else ">>> " if number == guide.index else "    "
        result.append(f"{mark} {number + 1} {step.title}{skipped}  {step.text}".rstrip())
    if guide.step is not None:
        optional = f"; without it {guide.step.optional}" if guide.step.optional else ""
        result.append(f"{guide.step.instruction} (Enter goes on, q ends{optional})")
    force = f"board {guide.force:.3f} N (nominal)"
    if rig is not None:
        force += f", rig {rig:.3f} N, residual {guide.force - rig:+.3f} N"
    return [*result, force]


@contextlib.contextmanager
def _display() -> Iterator[Callable[[Guide, float | None], None]]:
    """Show the steps live on a terminal, otherwise each step once."""
    shown: list[int] = []
    live: Any = None
    if sys.stdout.isatty():
        from rich.live import Live  # noqa: PLC0415  # only a terminal needs it
        from rich.text import Text  # noqa: PLC0415

        live = Live(auto_refresh=False)

    def show(guide: Guide, rig: float | None) -> None:
        if live is not None:
            live.update(Text("\n".join(lines(guide, rig))), refresh=True)
        elif guide.step is not None and guide.index not in shown:
            shown.append(guide.index)
            print(f"step {guide.index + 1} of {len(guide.steps)}: {guide.step.instruction}", flush=True)

    with live if live is not None else contextlib.nullcontext():
        yield show


def _key() -> str:
    """Return a line that was typed, '' if there is none; without a terminal there never is one."""
    if sys.stdin.isatty() and select.select([sys.stdin], [], [], 0)[0]:
        return sys.stdin.readline()
    return ""
