# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A scene that is loaded while the board cannot be opened again: the answer and the state of the node are true."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

rclpy = pytest.importorskip("rclpy")
pytest.importorskip("posfet_msgs", reason="needs the built workspace")

from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter

from posfet_driver.board.scan_source import SourceError
from posfet_model.sensor.scan import Scan
from posfet_msgs.srv import LoadScene
from posfet_sim.ros.sim_board_node import SimBoardNode
from support.clocks import PacedClock

pytestmark = pytest.mark.ros
PATIENCE = 120.0


class Board:
    """A node whose source can be made to fail when it is opened."""

    def __init__(self) -> None:
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.failures: list[Exception] = []
        overrides = [Parameter("scene", value="idle"), Parameter("imperfections", value="none")]
        self.node = SimBoardNode(clock=PacedClock(main=False), context=self.context, parameter_overrides=overrides)
        self.scans: list[int] = []
        self.node.sink = self._receive
        self.open, self.node.source.open = self.node.source.open, self._open
        self.executor.add_node(self.node)
        self.client = self.node.create_client(LoadScene, "scene/load")

    def _receive(self, scan: Scan) -> None:
        self.scans.append(scan.sequence)

    def _open(self) -> None:
        if self.failures:
            raise self.failures.pop(0)
        self.open()

    def load(self, scene: str) -> LoadScene.Response:
        self.spin_until(self.client.service_is_ready)
        future = self.client.call_async(LoadScene.Request(scene=scene))
        self.executor.spin_until_future_complete(future, PATIENCE)
        return future.result()

    @property
    def state(self) -> str:
        return self.node._state_machine.current_state[1]

    def runs(self, scene: str) -> bool:
        """Return whether scans of a scene arrive."""
        self.scans.clear()
        self.spin_until(lambda: len(self.scans) > 3)
        return self.node.source.board.loads.name == scene

    def spin_until(self, done: Callable[[], Any]) -> None:
        end = time.monotonic() + PATIENCE
        while not done():
            assert time.monotonic() < end, "time-out"
            self.executor.spin_once(timeout_sec=0.01)


@pytest.fixture
def board() -> Iterator[Board]:
    made = Board()
    made.node.start()
    yield made
    made.node.destroy_node()
    made.executor.shutdown()
    made.context.try_shutdown()


@pytest.mark.parametrize("failure", [SourceError("unplugged"), ValueError("unplugged")])
def test_the_earlier_scene_starts_again_if_the_board_opens_with_it(board: Board, failure: Exception) -> None:
    board.failures = [failure]
    answer = board.load("tap")
    assert (answer.success, answer.message) == (
        False,
        "scene 'tap' does not start: unplugged; scene 'idle' from its start",
    )
    assert board.state == "active"
    assert board.runs("idle")
    assert board.load("tap").success
    assert board.runs("tap")


def test_a_board_that_cannot_be_opened_is_closed_until_a_scene_can_be_started(board: Board) -> None:
    board.failures = [SourceError("unplugged"), OSError("gone")]
    answer = board.load("tap")
    assert (answer.success, answer.message) == (
        False,
        "scene 'tap' does not start: unplugged; the board is closed",
    )
    assert board.state == "unconfigured"
    assert not board.node.reading
    board.failures = [SourceError("still"), SourceError("still")]
    answer = board.load("tap")
    assert not answer.success  # nothing has been opened
    assert answer.message == "scene 'tap' does not start: still; the board is closed"
    answer = board.load("tap")
    assert (answer.success, answer.message) == (True, "scene 'tap' from its start")
    assert board.state == "active"
    assert board.runs("tap")


def test_an_inactive_board_that_was_closed_is_inactive_again(board: Board) -> None:
    board.node.trigger_deactivate()
    board.failures = [SourceError("unplugged"), SourceError("unplugged")]
    assert not board.load("tap").success
    assert board.state == "unconfigured"
    assert board.load("tap").success
    assert board.state == "inactive"


def test_a_closed_board_can_be_configured_by_its_transition(board: Board) -> None:
    board.failures = [SourceError("unplugged"), SourceError("unplugged")]
    assert not board.load("tap").success
    board.node.trigger_configure()
    board.node.trigger_activate()
    assert board.runs("idle")
    board.node.trigger_deactivate()
    board.node.trigger_cleanup()
    assert board.load("tap").success
    assert board.state == "unconfigured"  # on purpose


def test_a_failing_report_does_not_end_the_node(board: Board, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []

    def fail() -> None:
        calls.append(1)
        raise ValueError("no report")

    monkeypatch.setattr(board.node.source, "report", fail)
    board.node._report()
    board.node._report()
    assert len(calls) == 2
    assert board.runs("idle")


def test_an_unforeseen_failure_is_answered(board: Board, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise MemoryError("too much")

    monkeypatch.setattr("posfet_sim.ros.sim_board_node.load_scene", fail)
    answer = board.load("tap")
    assert (answer.success, answer.message) == (
        False,
        "internal error, see the log of the node: MemoryError: too much",
    )
    assert board.runs("idle")


@pytest.mark.parametrize(
    "name", ["x" * 300, "x" * 300 + ".yaml", "~nobody_of_this_name/scene.yaml", "/dev/zero", "a/\n.yaml"]
)
def test_a_scene_that_is_no_file_is_answered_in_one_line(board: Board, name: str) -> None:
    answer = board.load(name)
    assert not answer.success
    assert len(answer.message.splitlines()) == 1
    assert not answer.message.startswith("internal error")
    assert board.runs("idle")
