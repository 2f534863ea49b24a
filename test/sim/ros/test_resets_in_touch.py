# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Scenes loaded, nodes deactivated and boards restarted in the middle of touches: no contact where nothing touches."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

rclpy = pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("posfet_msgs", reason="needs the built posfet_msgs")

from rclpy.context import Context
from rclpy.parameter import Parameter

from posfet_model.contacts.tracker import ContactState
from posfet_model.ros.model_node import ModelNode
from posfet_msgs.srv import LoadScene
from posfet_sim.ros.sim_board_node import SimBoardNode
from support.clocks import EPOCH, SteppedClock
from support.long_cases import crossed, long_cases
from support.touch_scene import TOUCH

pytestmark = pytest.mark.ros

SETTLING = 0.05
"""Time after the end of a touch in which its contact may still be reported [s]."""
ACTIONS = ("scene", "source", "model", "both", "reopen", "cleanup")


class Stack:
    """Simulated board and model in one process, whose scans the test reads in simulated time, without a thread."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, imperfections: str, can_fd: str) -> None:
        monkeypatch.setattr(SimBoardNode, "_run", lambda *_: None)
        self.context = Context()
        rclpy.init(context=self.context)
        self.clock = SteppedClock(10**9, EPOCH)
        frames = Parameter("can_fd", value=can_fd)  # classic ones have counts of 12 bits
        values = {"scene": "idle", "imperfections": imperfections}
        overrides = [frames, *(Parameter(name, value=value) for name, value in values.items())]
        self.board = SimBoardNode(clock=self.clock, context=self.context, parameter_overrides=overrides)
        self.model = ModelNode(context=self.context, parameter_overrides=[frames, Parameter("direct", value=True)])
        self.board.sink = self.model.process
        self.untouched = 0.0  # time since the last true touch [s]
        self.seen = 0  # scans with a true touch that was reported
        self.phantoms: list[str] = []
        self.doing = ""
        for node in (self.model, self.board):
            node.start()

    def close(self) -> None:
        for node in (self.board, self.model):
            node.destroy_node()
        self.context.try_shutdown()

    def run(self, seconds: float) -> None:
        """Read and deliver the scans of a time [s], and compare the contacts with the ground truth."""
        end = self.clock.now + round(seconds * 1e9)
        while self.clock.now < end:
            scan = self.board.source.read(0.1)
            if scan is None:
                continue
            if self.board._active:
                self.board.deliver(scan, 0)
            touched = self.board.source.board.in_contact
            self.untouched = 0.0 if touched else self.untouched + 1.0 / self.board.sensor.can.scan_rate
            result = self.model._result
            if result is None or not result.valid or result.sequence != scan.sequence:
                continue
            contacts = [contact for contact in result.contacts if contact.state is not ContactState.RELEASED]
            self.seen += bool(touched and contacts)
            if contacts and self.untouched > SETTLING:
                self.phantoms.append(f"{self.doing}: {contacts[0].region.force:.3f} N after {self.untouched:.2f} s")

    def load(self, scene: str) -> None:
        assert self.board._load_scene(LoadScene.Request(scene=scene), LoadScene.Response()).success

    def act(self, action: str, pause: float) -> None:
        """Interrupt the stack in one way for a time [s]."""
        self.doing = action
        nodes = {"source": [self.board], "model": [self.model], "both": [self.board, self.model]}.get(action, [])
        for node in nodes:
            node.trigger_deactivate()
        if nodes:
            self.run(pause)
        if action == "reopen":
            self.clock.now += round(pause * 1e9)
            self.board.restart()
        if action == "cleanup":
            self.model.trigger_deactivate()
            self.model.trigger_cleanup()
            self.run(pause)
            self.model.trigger_configure()
            nodes = [self.model]
        for node in nodes:
            node.trigger_activate()
        if action == "scene":
            self.clock.now += round(pause * 1e9)


@pytest.mark.parametrize(
    ("loops", "imperfections", "can_fd"),
    long_cases(
        crossed([10, 200], ["default", "none"], {"FD": "true", "classic": "false"}),
        ["10-default-FD", "10-none-classic"],
    ),
)
def test_no_phantom_contact_follows_an_interruption(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, loops: int, imperfections: str, can_fd: str
) -> None:
    touch = tmp_path / "touch.yaml"
    touch.write_text(TOUCH, encoding="utf-8")
    stack, noise = Stack(monkeypatch, imperfections, can_fd), random.Random(loops)
    try:
        stack.run(1.0)
        for loop in range(loops):
            stack.load(str(touch))
            stack.run(noise.uniform(0.15, 0.8))
            stack.act(ACTIONS[loop % len(ACTIONS)], noise.choice((0.0, 0.03, 0.3)))
            stack.load("idle")
            stack.run(0.3)
    finally:
        stack.close()
    assert stack.seen > 50 * loops, "touches were reported"
    assert stack.phantoms == []
