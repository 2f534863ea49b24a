# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Errors of a node's own parts: counted and reported, restarted once, and then the end of the process with its code."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import pytest

rclpy = pytest.importorskip("rclpy")
pytest.importorskip("posfet_msgs", reason="needs the built workspace")

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.node import Node

from posfet_driver.board.faults import Health
from posfet_driver.board.scan_source import SourceError, SourceReport
from posfet_driver.ros import scan_source_node
from posfet_driver.ros.scan_source_node import ScanSourceNode
from posfet_model.ros import run_node
from posfet_model.ros.exit_codes import PROCESS_FAILED, exit_code
from posfet_model.ros.run_node import ros, spin
from posfet_model.ros.supervision import SupervisedNode
from posfet_model.sensor.description import Sensor
from posfet_model.sensor.scan import Scan
from posfet_msgs.msg import TactileContacts
from posfet_msgs.srv import BoardCommand

pytestmark = pytest.mark.ros
PATIENCE = 120.0


class Device:
    """A device without a data thread that raises the errors that a test puts into it, one per use."""

    def __init__(self) -> None:
        self.opened = 0
        self.errors: dict[str, list[Exception]] = {"open": [], "read": [], "report": []}
        self.failure = ""

    def use(self, name: str) -> None:
        if self.errors[name]:
            raise self.errors[name].pop(0)

    def open(self) -> None:
        self.use("open")
        self.opened += 1
        self.failure = ""

    def close(self) -> None: ...

    def report(self) -> SourceReport:
        self.use("report")
        return SourceReport(Health.OK, "fine", 0, 0, failure=self.failure)


class Source(Device):
    """A source of scans of such a device."""

    simulated = True

    def __init__(self) -> None:
        super().__init__()
        self.scan = Scan.empty(1, 25)

    def read(self, timeout: float) -> Scan | None:
        self.use("read")
        time.sleep(1e-3)
        return self.scan


class SourceNode(ScanSourceNode):
    """A node around such a device."""

    def __init__(self, device: Device) -> None:
        self.device = device
        super().__init__("source_node", namespace="/supervised")
        self.scans = 0
        self.sink = self._count

    def make_source(self, sensor: Sensor, parameters: Mapping[str, Any]) -> Any:
        return self.device

    def _count(self, _: Scan) -> None:
        self.scans += 1


class Bench:
    """A node around a device with errors, and its diagnostics, run as in a process of its own."""

    def __init__(self) -> None:
        self.diagnostics: list[DiagnosticStatus] = []
        self.listener: Node | None = None

    def run(self, make_node: Callable[[], Node], until: Callable[[], bool]) -> int:
        """Run a node until a condition holds, and return the exit code of the process."""
        end = time.monotonic() + PATIENCE

        def over() -> bool:
            assert time.monotonic() < end, self.diagnostics[-1:]
            return until()

        def run() -> int:
            with ros([]) as stack:
                node = make_node()
                stack.callback(node.destroy_node)
                self.listener = rclpy.create_node("listener")
                stack.callback(self.listener.destroy_node)
                self.listener.create_subscription(DiagnosticArray, "/diagnostics", self._take, 10)
                spin([node, self.listener], over)
            return 0

        return exit_code(run)

    def _take(self, message: DiagnosticArray) -> None:
        self.diagnostics += message.status

    def latest(self) -> dict[str, str]:
        """Return the values of the newest diagnostics."""
        return {pair.key: pair.value for pair in self.diagnostics[-1].values} if self.diagnostics else {}


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    monkeypatch.setattr(scan_source_node, "REPORT_PERIOD", 0.02)
    yield Bench()


def started(device: Device) -> tuple[list[SourceNode], Callable[[], SourceNode]]:
    """Return a function that makes and starts the node, and the list that it is put into."""
    nodes: list[SourceNode] = []

    def make() -> SourceNode:
        nodes.append(SourceNode(device))
        nodes[0].start()
        return nodes[0]

    return nodes, make


def test_a_data_thread_that_ends_on_an_error_is_restarted_and_reported(bench: Bench) -> None:
    source = Source()
    nodes, make = started(source)
    source.errors["read"].append(ValueError("odd\nscan"))
    over = lambda: "latest internal error" in bench.latest() and nodes[0].scans > 10  # noqa: E731
    assert bench.run(make, over) == 0
    assert source.opened == 2
    assert bench.diagnostics[-1].level == DiagnosticStatus.ERROR
    assert bench.diagnostics[-1].message == "fine; internal errors"
    values = bench.latest()
    assert (values["internal errors"], values["errors of data thread"]) == ("1", "1")
    assert values["latest internal error"].startswith("data thread: ValueError: odd scan (test_supervision.py:")


def test_an_error_of_the_sink_is_one_of_the_data_thread(bench: Bench) -> None:
    nodes, make = started(Source())

    def fail(_: Scan) -> None:
        nodes[0].sink = nodes[0]._count
        raise KeyError("model")

    def with_sink() -> SourceNode:
        node = make()
        node.sink = fail
        return node

    assert bench.run(with_sink, lambda: nodes[0].scans > 10 and bool(bench.latest())) == 0
    assert nodes[0].internal_errors.counts == {"data thread": 1}


@pytest.mark.parametrize("again", ["read", "open"])
def test_a_second_failure_within_a_minute_ends_the_process_with_its_code(
    bench: Bench, again: str, capfd: pytest.CaptureFixture[str]
) -> None:
    source = Source()
    _, make = started(source)

    def broken() -> SourceNode:
        node = make()
        source.errors[again].append(SourceError("no such board"))
        source.errors["read"].insert(0, RuntimeError("first"))
        return node

    assert bench.run(broken, lambda: False) == PROCESS_FAILED
    errors = capfd.readouterr().err
    last = errors.splitlines()[-1]
    assert last.startswith("/supervised/source_node: data thread failed again within 60 s: SourceError: no such board")
    assert last.endswith(f"ending with exit code {PROCESS_FAILED}")
    assert not any(thread.name.endswith(" data") for thread in threading.enumerate())


def test_a_failed_source_without_a_data_thread_is_reopened_once(bench: Bench) -> None:
    device = Device()
    _, make = started(device)

    def failing() -> SourceNode:
        node = make()
        device.failure = "ZeroDivisionError: no thread"
        return node

    assert bench.run(failing, lambda: device.opened == 2 and "errors of source" in bench.latest()) == 0
    assert bench.latest()["latest internal error"] == "source: ZeroDivisionError: no thread"

    def failing_again() -> SourceNode:
        node = make()
        node._restarts.allows()
        device.failure = "ZeroDivisionError: no thread"
        return node

    _, make = started(device)
    assert bench.run(failing_again, lambda: False) == PROCESS_FAILED


def test_diagnostics_go_on_when_the_source_cannot_report(bench: Bench) -> None:
    source = Source()
    _, make = started(source)

    def silent() -> SourceNode:
        node = make()
        source.errors["report"] += [AttributeError("state")] * 3
        return node

    levels = lambda: [(status.level, status.message) for status in bench.diagnostics]  # noqa: E731
    cannot = (DiagnosticStatus.ERROR, "the source cannot report its state; internal errors")
    assert bench.run(silent, lambda: cannot in levels() and "fine; internal errors" in levels()[-1]) == 0
    assert bench.latest()["errors of report"] == "3"


def test_a_source_that_cannot_be_opened_for_an_unexpected_reason_is_an_error_in_one_line(
    bench: Bench, capfd: pytest.CaptureFixture[str]
) -> None:
    device = Device()
    device.errors["open"].append(ValueError("odd\nfile"))
    _, make = started(device)
    assert bench.run(make, lambda: True) == 1
    assert "/supervised/source_node: ValueError: odd file (test_supervision.py:" in capfd.readouterr().err


class Raising(SupervisedNode):
    """A node whose timer and service raise, and whose subscription raises for `errors` messages."""

    def __init__(self, errors: int) -> None:
        super().__init__("raising", namespace="/supervised")
        self.left = errors
        self.received = 0
        self.create_timer(0.005, self._tick)
        self.create_service(BoardCommand, "raise", self._serve)
        self.client = self.create_client(BoardCommand, "raise")
        self.create_subscription(TactileContacts, "in", self._take, 10)
        self._publisher = self.create_publisher(TactileContacts, "in", 10)
        self.answer: Any = None

    def _tick(self) -> None:
        self._publisher.publish(TactileContacts())
        if self.answer is None and self.client.service_is_ready():
            self.answer = self.client.call_async(BoardCommand.Request())
        raise OSError("tick")

    def _serve(self, request: Any, response: Any) -> Any:
        raise ValueError("bad\nrequest")

    def _take(self, _: Any) -> None:
        self.received += 1
        self.left -= 1
        if self.left >= 0:
            raise IndexError("message")


def test_callbacks_that_raise_are_counted_and_answered(bench: Bench) -> None:
    nodes: list[Raising] = []

    def make() -> Raising:
        nodes.append(Raising(errors=1))
        return nodes[0]

    done = lambda: bool(nodes[0].answer and nodes[0].answer.done()) and nodes[0].received > 3  # noqa: E731
    assert bench.run(make, done) == 0
    response, counts = nodes[0].answer.result(), nodes[0].internal_errors.counts
    assert not response.success
    assert response.message == "internal error, see the log of the node: ValueError: bad request"
    assert counts["timer tick"] > 1
    assert (counts["service raise"], counts["callback"]) == (1, 1)


def test_callbacks_that_raise_again_and_again_end_the_process(bench: Bench, capfd: pytest.CaptureFixture[str]) -> None:
    assert bench.run(lambda: Raising(errors=9), lambda: False) == PROCESS_FAILED
    assert "a callback failed: IndexError: message" in capfd.readouterr().err


def test_one_restart_is_allowed_within_a_minute(monkeypatch: pytest.MonkeyPatch) -> None:
    times = iter([0.0, 59.9, 100.0, 160.0])
    monkeypatch.setattr("posfet_model.ros.supervision.time.monotonic", lambda: next(times))
    policy = run_node.RestartPolicy()
    assert [policy.allows() for _ in range(4)] == [True, False, False, True]
