"""Lists the adapters and the boards detected on them: `posfet can list`. Sends nothing."""

from __future__ import annotations

import argparse
import glob
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import can
from rich.console import Console
from rich.table import Table

from posfet_driver.bus.frame import CLASSIC, Frame
from posfet_driver.bus.frame_bus import FrameBus
from posfet_driver.bus.open_bus import one_line, open_bus
from posfet_driver.bus.socketcan_bus import NETWORK_DEVICES
from posfet_driver.clock import Clock
from posfet_driver.protocol.messages import STATUS_OFFSET, Page, Status, version
from posfet_driver.tools.bus_options import EMULATOR, bus_of
from posfet_model.config import ConfigError

SERIAL_PORTS: Final = ("/dev/ttyACM*", "/dev/ttyUSB*")
CAN_DEVICE: Final = "280"
"""Type of a CAN device in sysfs (ARPHRD_CAN)."""
PAGES_NEEDED: Final = 3
"""Consecutive status pages in the right order that identify a board."""


@dataclass
class DetectedBoard:
    """A board detected by its status frames."""

    base: int
    """Base identifier."""
    layout: int | None = None
    """Layout id; None: unknown."""
    firmware: int | None = None
    """Firmware version; None: unknown."""
    supply: float = 0.0
    """Supply voltage [V]."""
    in_order: int = 0
    """Consecutive pages in the right order."""
    page: int | None = None
    """Page of the newest frame."""

    def process(self, status: Status) -> None:
        """Process a frame that may be a status: the pages of a board come in turn, other data do not."""
        follows = self.page is None or status.page == (self.page + 1) % len(Page)
        self.in_order = self.in_order + 1 if follows else 0
        self.page = status.page
        self.supply = status.supply
        if status.page == Page.LAYOUT:
            self.layout = status.value
        elif status.page == Page.FIRMWARE:
            self.firmware = status.value


def adapters() -> list[tuple[str, str]]:
    """Return interface and channel of every adapter of this machine."""
    devices = sorted(NETWORK_DEVICES.glob("*/type")) if NETWORK_DEVICES.is_dir() else []
    network = [path.parent.name for path in devices if path.read_text(encoding="ascii").strip() == CAN_DEVICE]
    ports = sorted(port for pattern in SERIAL_PORTS for port in glob.glob(pattern))
    return [("socketcan", name) for name in network] + [("slcan", port) for port in ports]


def boards(frames: Iterable[Frame]) -> list[DetectedBoard]:
    """Return the boards whose status is among `frames`, sorted by base identifier."""
    detected: dict[int, DetectedBoard] = {}
    for identifier, kind, data in frames:
        status = Status.unpack(data) if kind == CLASSIC else None
        if status is not None and status.page in Page.__members__.values():
            base = identifier - STATUS_OFFSET
            detected.setdefault(base, DetectedBoard(base)).process(status)
        elif status is not None:
            detected.pop(identifier - STATUS_OFFSET, None)
    return [detected[base] for base in sorted(detected) if base >= 0 and detected[base].in_order >= PAGES_NEEDED]


def listen(bus: FrameBus, seconds: float, clock: Clock) -> list[Frame]:
    """Return the frames that arrive within `seconds` [s].

    Parameters
    ----------
    bus : FrameBus
        Open bus.
    seconds : float
        Listening time [s].
    clock : Clock
        Clock of the host.
    """
    end = clock.monotonic() + round(seconds * 1e9)
    frames: list[Frame] = []
    while (left := end - clock.monotonic()) > 0:
        frames += bus.read_frames(left / 1e9)
    return frames


def run_list(options: argparse.Namespace) -> int:
    """Run `posfet can list`; return the exit code. Raises the error of an adapter that the options name."""
    named = bool(options.interface)
    listed = [(options.interface, options.channel)] if named else adapters()
    table = Table("interface", "channel", "state", "base id", "layout", "firmware", "supply [V]", title="adapters")
    for interface, channel in listed:
        options.interface, options.channel = interface, channel
        shown = channel or ("a simulated board" if interface == EMULATOR else "")
        try:
            rows = _rows(options)
        except (can.CanError, ConfigError, OSError) as error:
            if named:
                raise
            rows = [[one_line(error), "", "", "", ""]]
        for row in rows:
            table.add_row(interface, shown, *row)
    console = Console(highlight=False, markup=False)
    if table.row_count:
        console.print(table)
    else:
        console.print("no adapter found: no CAN network device, no /dev/ttyACM*, no /dev/ttyUSB*")
    return 0


def _rows(options: argparse.Namespace) -> list[list[str]]:
    """Return the table rows of an adapter, one per board."""
    with bus_of(options) as (_, settings):
        bus = open_bus(settings)
        try:
            frames = listen(bus, options.seconds, options.clock)
        finally:
            bus.shutdown()
    found = boards(frames)
    if not found:
        return [[f"{len(frames)} frames, no board", "", "", "", ""]]
    return [
        [
            f"{len(frames)} frames",
            f"0x{board.base:X}",
            "?" if board.layout is None else str(board.layout),
            "?" if board.firmware is None else version(board.firmware),
            f"{board.supply:.2f}",
        ]
        for board in found
    ]
