# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Boards on a bus, drivers and models that restart in the middle of touches: no contact where nothing touches."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from posfet_driver.board.board_client import Board
from posfet_model.contacts.tracker import ContactState
from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.sensor.description import load_sensor
from posfet_sim.device.error_model import load_error_model
from posfet_sim.device.simulated_board import SimulatedBoard
from posfet_sim.emulation.bus_board import BusBoard
from posfet_sim.scene import SceneLoads, load_scene
from support.clocks import EPOCH, SteppedClock
from support.fake_board import with_fd
from support.long_cases import crossed, long_cases
from support.stepped import SteppedBus
from support.touch_scene import TOUCH

SETTLING = 0.05
"""Time after the end of a touch in which its contact may still be reported [s]."""
RESTARTS = (("board",), ("board", "model"), ("board", "driver"), ("board", "same boot"), ("model",), ("driver",))


class Stack:
    """Board, driver and model in stepped time; each of them can be replaced by a new one, without memory."""

    def __init__(self, fd: bool, imperfections: str) -> None:
        self.sensor = with_fd(load_sensor(), fd)
        self.errors = load_error_model(imperfections)
        self.clock = SteppedClock(10**9, EPOCH)
        self.boot = 0
        self.bus = SteppedBus(self.clock, self.switched_on("idle"))
        self.driver = self.new_driver()
        self.model = Reconstructor(self.sensor)
        self.untouched = 0.0  # time since the last true touch [s]
        self.seen = 0  # scans with a true touch that was reported
        self.phantoms: list[str] = []
        self.doing = ""

    def switched_on(self, scene: str) -> BusBoard:
        """Return a board with a new film."""
        loads = SceneLoads(load_scene(scene, self.sensor), self.sensor)
        self.board = SimulatedBoard(self.sensor, loads, 1, self.errors)
        return BusBoard(self.board, 1, self.clock.now, boot=self.boot)

    def new_driver(self) -> Board:
        driver = Board(self.sensor, lambda: self.bus, self.clock)
        driver.open()
        return driver

    def run(self, seconds: float) -> None:
        """Process the scans of a time [s], and compare the contacts with the ground truth."""
        end = self.clock.now + round(seconds * 1e9)
        while self.clock.now < end:
            before = self.clock.now
            scan = self.driver.read(0.05)
            touched = self.board.in_contact
            self.untouched = 0.0 if touched else self.untouched + (self.clock.now - before) * 1e-9
            if scan is None:
                continue
            result = self.model.process(scan)
            self.model.run_maintenance()
            if not (result.accepted and result.valid):
                continue
            contacts = [contact for contact in result.contacts if contact.state is not ContactState.RELEASED]
            self.seen += bool(touched and contacts)
            if contacts and self.untouched > SETTLING:
                self.phantoms.append(f"{self.doing}: {contacts[0].region.force:.3f} N after {self.untouched:.2f} s")

    def restart(self, parts: tuple[str, ...], pause: float = 0.0, scene: str = "idle") -> None:
        """Replace some parts by new ones after a pause [s]."""
        self.doing = " and ".join(parts)
        if "driver" in parts:
            self.driver.close()
        self.clock.now += round(pause * 1e9)
        if "board" in parts:
            self.boot += "same boot" not in parts
            self.bus.firmware = self.switched_on(scene)
        if "driver" in parts:
            self.driver = self.new_driver()
        if "model" in parts:
            self.model = Reconstructor(self.sensor)


@pytest.mark.parametrize(
    ("loops", "fd", "imperfections"),
    long_cases(
        crossed([10, 200], {"FD": True, "classic": False}, ["default", "none"]), ["10-FD-none", "10-classic-default"]
    ),
)
def test_no_phantom_contact_follows_a_restart_behind_a_bus(
    tmp_path: Path, loops: int, fd: bool, imperfections: str
) -> None:
    touch = tmp_path / "touch.yaml"
    touch.write_text(TOUCH, encoding="utf-8")
    stack, noise = Stack(fd, imperfections), random.Random(loops)
    stack.run(1.0)
    for loop in range(loops):
        stack.restart(("board",), scene=str(touch))
        stack.run(noise.uniform(0.5, 1.0))
        stack.restart(RESTARTS[loop % len(RESTARTS)], noise.choice((0.0, 0.03, 0.3)))
        stack.run(0.5)
    assert stack.seen > 50 * loops, "touches were reported"
    assert stack.phantoms == []
