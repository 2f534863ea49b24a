# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Commands for a running stack: tare, scene, diagnostics; and whether the middleware carries messages."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from types import SimpleNamespace

import pytest

rclpy = pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("posfet_msgs", reason="needs the built workspace")

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

import posfet.bringup
from posfet import stack_commands
from posfet.composed_node import Graph
from posfet.middleware_check import exchange
from posfet_model.ros import middleware
from support.expectations import TIMEOUT

pytestmark = pytest.mark.ros


@pytest.fixture(scope="module")
def stack() -> Iterator[Graph]:
    """A stack whose services are served by a thread."""
    context = Context()
    with middleware.applied():
        rclpy.init(context=context)
    executor = SingleThreadedExecutor(context=context)

    def serve() -> None:
        with suppress(ExternalShutdownException):
            executor.spin()

    with posfet.bringup.nodes(context, namespace="robot/thumb", scene="idle", imperfections="none") as graph:
        for node in graph:
            executor.add_node(node)
        thread = threading.Thread(target=serve)
        thread.start()
        yield graph
        executor.shutdown()
        context.try_shutdown()
        thread.join(TIMEOUT)


@pytest.fixture(autouse=True)
def patience(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stack_commands, "DISCOVERY_TIMEOUT", TIMEOUT)


def errors(capfd: pytest.CaptureFixture[str]) -> str:
    """Return what was printed on stderr but the log of the stack, which may say that this machine is slow."""
    return "".join(line for line in capfd.readouterr().err.splitlines(keepends=True) if not line.startswith("["))


def test_a_stack_is_tared(stack: Graph, capfd: pytest.CaptureFixture[str]) -> None:
    assert stack_commands.tare(["--namespace", "/robot/thumb", "--force"]) == 0
    assert capfd.readouterr().out.count("\n") == 1


def test_another_scene_is_loaded_and_an_unknown_one_refused(stack: Graph, capfd: pytest.CaptureFixture[str]) -> None:
    assert stack_commands.scene(["hold", "--namespace", "robot/thumb"]) == 0
    assert capfd.readouterr().out == "scene 'hold' from its start\n"
    assert stack_commands.scene(["hodl", "--namespace", "robot/thumb"]) == 1
    assert errors(capfd).startswith("hodl: no such scene; did you mean hold? give the path")
    end = time.monotonic() + TIMEOUT
    while not (snapshot := stack.snapshot()) or not snapshot.contacts:
        assert time.monotonic() < end
        time.sleep(0.01)
    assert stack_commands.tare(["--namespace", "robot/thumb"]) == 1
    assert errors(capfd).startswith("refused")


def test_the_state_of_a_stack_is_shown(stack: Graph, capfd: pytest.CaptureFixture[str]) -> None:
    assert "robot/thumb/model_node" in {node.get_fully_qualified_name().strip("/") for node in stack}
    stack_commands.diagnostics(["--namespace", "robot/thumb", "--values"])
    output = capfd.readouterr().out
    assert "robot/thumb/model_node: reconstruction: " in output
    assert "robot/thumb/sim_board_node: board: simulating scene" in output
    assert "      scene: " in output


def test_a_sensor_that_is_not_there_is_one_line(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stack_commands, "DISCOVERY_TIMEOUT", 0.2)
    assert stack_commands.tare(["--namespace", "index"]) == 1
    error = errors(capfd)
    assert error.startswith("/index/tare: no such service; ")
    assert error.count("\n") == 1
    assert stack_commands.diagnostics(["--namespace", "index"]) == 1
    expected = "no diagnostics of index within 0.2 s; start the stack with posfet bringup\n"
    assert errors(capfd) == expected


@pytest.mark.parametrize(
    ("last", "services", "remedy"),
    [
        ("tare", ["/b/tare", "/a/tare", "/index/tare", "/c/other"], "running are /a, /b: choose with --namespace"),
        ("load", ["/a/scene/load", "/a/calibration/load"], "running are /a: choose with --namespace"),
        ("tare", ["/index/tare"], "is the stack running? Start it with posfet bringup; posfet doctor checks"),
    ],
)
def test_a_missing_service_is_answered_with_those_that_are_there(last: str, services: list[str], remedy: str) -> None:
    node = SimpleNamespace(
        clients=[SimpleNamespace(srv_name="/index/tare")],
        get_service_names_and_types=lambda: [(name, []) for name in services],
    )
    assert stack_commands._remedy(node, last).startswith(remedy)


def test_the_scenes_are_listed(capfd: pytest.CaptureFixture[str]) -> None:
    assert stack_commands.scene([]) == 0
    assert "press_slide_lift" in capfd.readouterr().out.splitlines()


def test_the_worst_status_is_first() -> None:
    pairs = [KeyValue(key="rate", value="7"), KeyValue(key="fault: supply low", value="check its supply")]
    statuses = [
        DiagnosticStatus(level=bytes([level]), name=name, message="m", values=pairs[:count])
        for level, name, count in ((0, "a", 1), (2, "c", 1), (1, "b", 2))
    ]
    remedy = "      fault: supply low: check its supply"
    assert stack_commands.lines(statuses, values=False) == ["ERROR c: m", "WARN  b: m", remedy, "OK    a: m"]
    assert stack_commands.lines(statuses[:1], values=True) == ["OK    a: m", "      rate: 7"]


def test_a_message_passes_between_two_participants(stack: Graph) -> None:
    assert stack.nodes
    seconds, sensors = exchange(TIMEOUT)
    assert seconds is not None
    assert sensors in ([], ["/robot/thumb"])
