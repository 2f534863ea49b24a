# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The firmware's image for a Cortex-M3 on QEMU, with driver and model on its serial line as on a real board."""

from __future__ import annotations

import math
import re
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from importlib import resources
from itertools import pairwise
from pathlib import Path

import pytest

from posfet_driver.board.board_client import Board
from posfet_driver.board.command_queue import CommandError
from posfet_driver.board.faults import Health
from posfet_driver.protocol.messages import Command
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_model.sensor.scan import Scan, ScanStatus
from support.bringup_process import needs_installation, running
from support.fake_board import PATIENCE, read_scans, read_until, slcan_opener, with_fd, with_layout
from support.reference_board import make

COMPILER = "arm-none-eabi-gcc"
EMULATOR = "qemu-system-arm"
pytestmark = [
    pytest.mark.vm,
    pytest.mark.skipif(
        not (shutil.which(COMPILER) and shutil.which(EMULATOR)), reason=f"needs {COMPILER} and {EMULATOR}"
    ),
]
RATE = 100.0
"""Scan rate [Hz]; the emulated processor has to share its core with others."""
PERIOD = round(1e6 / RATE)
FORCE = 3.0
"""Total force of a press [N]: 0.5 N on the middle, 3/4 and 1/2 of it on the neighbours beside and across."""
FORMATS = ["fd", "classic"]


class Machine:
    """The emulated processor."""

    def __init__(self, process: subprocess.Popen[str], port: str) -> None:
        self.port = port
        self._process = process

    def reset(self) -> None:
        """Reset the processor, whose memory keeps its contents."""
        assert self._process.stdin is not None
        self._process.stdin.write("system_reset\n")
        self._process.stdin.flush()


@contextmanager
def running_machine(image: Path) -> Iterator[Machine]:
    command = [EMULATOR, "-M", "mps2-an385", "-kernel", str(image), "-display", "none", "-serial", "pty"]
    command += ["-monitor", "stdio"]
    pipe = subprocess.PIPE
    process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=subprocess.STDOUT, text=True)
    output = ""
    try:
        assert process.stdout is not None
        while not (found := re.search(r"redirected to (\S+)", output)):
            line = process.stdout.readline()  # it ends, or says where its serial line is
            assert line, output
            output += line
        yield Machine(process, found[1])
    finally:
        process.terminate()
        process.communicate(timeout=PATIENCE)


@pytest.fixture(params=FORMATS)
def form(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def machine(built: Path, form: str) -> Iterator[Machine]:
    make(built, "cortex-m")
    with running_machine(built / f"posfet_{form}.elf") as machine:
        yield machine


@pytest.fixture
def sensor(form: str) -> Sensor:
    return with_fd(with_layout(load_sensor(), 5, 5, scan_rate=RATE), form == "fd")


@pytest.fixture
def board(machine: Machine, sensor: Sensor) -> Iterator[Board]:
    board = Board(sensor, slcan_opener(machine.port, sensor.can.fd))
    board.open()
    yield board
    board.close()


def read(board: Board, count: int) -> list[Scan]:
    return [replace(scan, counts=scan.counts.copy()) for scan in read_scans(board, count)]


def test_scans_follow_the_scan_timer(board: Board, form: str) -> None:
    losses = board.decoder.statistics
    scans = read(board, 1)
    lost = losses.lost_scans
    scans += read(board, 200)
    assert board.report().health in (Health.OK, Health.WARN)
    missing = 0  # by other work on the machine
    for before, after in pairwise(scans):
        gap = after.sequence - before.sequence - 1
        assert gap >= 0
        missing += gap
        assert gap == 0 or form == "classic" or after.status & ScanStatus.SCAN_OVERRUN
    read_until(board, lambda: losses.lost_scans - lost >= missing)  # classic ones are counted with the next header
    assert (losses.incomplete_scans, losses.checksum, losses.malformed, losses.implausible) == (0, 0, 0, 0)
    # Time follows the ticks. Where the emulator had to wait for a processor, single scans are sampled late.
    delays = sorted(scan.device_time - PERIOD * scan.sequence for scan in scans)
    assert delays[150] - delays[50] < PERIOD
    assert scans[-1].temperatures.tolist() == [25.0, 25.0]


def test_commands_are_answered_as_on_any_board(board: Board, form: str) -> None:
    read(board, 1)
    assert board.request(Command.IDENTIFY, timeout=PATIENCE).value == 0x0102_0001 | (form == "fd") << 20
    with pytest.raises(CommandError, match=r"SELF_TEST.*busy"):
        board.request(Command.SELF_TEST, timeout=PATIENCE)
    stopped = board.request(Command.STOP, timeout=PATIENCE).value
    assert board.request(Command.SELF_TEST, timeout=PATIENCE).value == 0
    with pytest.raises(CommandError, match=r"SET_RATE.*bad argument"):
        board.request(Command.SET_RATE, 999, timeout=PATIENCE)
    assert board.request(Command.SET_RATE, 2 * PERIOD, timeout=PATIENCE).value == 2 * PERIOD
    assert board.request(Command.START, timeout=PATIENCE).value >= stopped
    assert read(board, 20)[-1].sequence >= stopped + 20


def test_a_reset_is_seen_as_another_boot(machine: Machine, board: Board) -> None:
    for _ in range(2):
        assert not any(scan.status & ScanStatus.BOARD_RESET for scan in read(board, 20)[1:])
        machine.reset()
        scan = read(board, 1)[0]
        while not scan.status & ScanStatus.BOARD_RESET:
            scan = read(board, 1)[0]


@needs_installation
def test_a_press_reaches_the_contacts(machine: Machine, form: str, tmp_path: Path) -> None:
    pytest.importorskip("rclpy")
    from posfet_msgs.msg import TactileContacts  # noqa: PLC0415  # only where there is ROS
    from support.expectations import Listener  # noqa: PLC0415

    shipped = (resources.files("posfet_model.sensor") / "sensors" / "posfet_5x5.yaml").read_text()
    sensor_file = tmp_path / "slow.yaml"
    sensor_file.write_text(re.sub(r"scan_rate_Hz: \S+", f"scan_rate_Hz: {RATE}", shipped))
    arguments = [
        "source:=can",
        "can_interface:=slcan",
        f"can_channel:={machine.port}",
        f"sensor_file:={sensor_file}",
        f"can_fd:={str(form == 'fd').lower()}",
    ]
    with running(*arguments), Listener() as listener:
        messages: list[TactileContacts] = listener.collect(TactileContacts, "contacts")

        def held() -> bool:
            """Whether a press has been found with its force and place."""
            contacts = [each.contacts[0] for each in messages if each.data_valid and len(each.contacts) == 1]
            return any(
                math.isclose(-contact.force.z, FORCE, rel_tol=0.05)
                and math.hypot(contact.centre_of_pressure.x, contact.centre_of_pressure.y) < 0.1e-3
                for contact in contacts
            )

        listener.wait(held, f"a contact of {FORCE} N in the middle")
