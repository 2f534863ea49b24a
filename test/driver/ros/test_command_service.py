# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The service `command` in every executor: nobody waits for a command but its caller."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from typing import Any

import pytest

rclpy = pytest.importorskip("rclpy")
pytest.importorskip("posfet_msgs", reason="needs the built workspace")

from rclpy.executors import SingleThreadedExecutor

from posfet_driver.board.command_queue import CommandError
from posfet_driver.protocol.messages import Command, Response, Result
from posfet_driver.ros import command_service
from posfet_driver.ros.command_service import WAITING_LIMIT, CommandService
from posfet_model.ros.run_node import NodeExecutor
from posfet_model.ros.supervision import SupervisedNode
from posfet_msgs.srv import BoardCommand

pytestmark = pytest.mark.ros
PATIENCE = 120.0


class Bench:
    """A node with the service and a client; the futures of the commands are done when a test says so."""

    def __init__(self, make_executor: Callable[..., Any]) -> None:
        rclpy.init()
        self.node = SupervisedNode("commanded")
        self.submitted: list[Future[Response]] = []
        self.error: CommandError | None = None
        self.service = CommandService(self.node, self._submit)
        self.client = self.node.create_client(BoardCommand, "command")
        self._executor = make_executor()
        self._executor.add_node(self.node)
        self.wait(self.client.service_is_ready)

    def _submit(self, command: Command, argument: int, timeout: float) -> Future[Response]:
        if self.error:
            raise self.error
        self.submitted.append(Future())
        return self.submitted[-1]

    def call(self, command: int = Command.IDENTIFY) -> Any:
        return self.client.call_async(BoardCommand.Request(command=command))

    def wait(self, condition: Callable[[], bool]) -> None:
        end = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < end
            self._executor.spin_once(0.02)

    def close(self) -> None:
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown()


@pytest.fixture(params=[NodeExecutor, SingleThreadedExecutor], ids=["node executor", "single-threaded"])
def bench(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    monkeypatch.setattr(command_service, "RESPONSE_TIMEOUT", PATIENCE)
    bench = Bench(request.param)
    yield bench
    bench.close()


def response(value: int) -> Response:
    return Response(Command.IDENTIFY, tag=1, result=Result.OK, value=value)


def test_timers_and_other_calls_go_on_while_commands_wait(bench: Bench) -> None:
    ticks: list[int] = []
    bench.node.create_timer(0.001, lambda: ticks.append(1))
    first, second = bench.call(), bench.call()
    bench.wait(lambda: len(bench.submitted) == 2)
    unknown = bench.call(77)
    bench.wait(unknown.done)
    assert "command must be one of 1 START, 2 STOP" in unknown.result().message
    bench.wait(lambda: len(ticks) > 3)
    assert not (first.done() or second.done())
    for number in (1, 0):  # not in the order of the calls
        threading.Thread(target=bench.submitted[number].set_result, args=(response(number),)).start()
        bench.wait((first, second)[number].done)
    assert [(call.result().success, call.result().value) for call in (first, second)] == [(True, 0), (True, 1)]
    assert bench.node.internal_errors.total == 0


def test_errors_of_commands_are_answered(bench: Bench) -> None:
    calls = [bench.call() for _ in range(2)]
    bench.wait(lambda: len(bench.submitted) == 2)
    bench.submitted[0].set_exception(CommandError("IDENTIFY: refused by the board: bad argument"))
    bench.submitted[1].set_exception(KeyError("lost"))
    bench.wait(lambda: all(call.done() for call in calls))
    refused, lost = (call.result().message for call in calls)
    assert refused == "IDENTIFY: refused by the board: bad argument"
    assert lost == "internal error, see the log of the node: KeyError: 'lost'"
    assert bench.node.internal_errors.counts == {"service command": 1}
    bench.error = CommandError("the driver is not configured")
    refused = bench.call()
    bench.wait(refused.done)
    assert (refused.result().success, refused.result().message) == (False, "the driver is not configured")


def test_a_command_that_nobody_processes_is_answered_in_time_and_counts_until_it_is_done(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(command_service, "RESPONSE_TIMEOUT", 0.01)
    calls = [bench.call() for _ in range(WAITING_LIMIT)]
    bench.wait(lambda: all(call.done() for call in calls))
    assert {call.result().message for call in calls} == {"no response: the data thread is busy"}
    refused = bench.call()
    bench.wait(refused.done)
    assert refused.result().message == f"IDENTIFY: {WAITING_LIMIT} commands are waiting already"
    for pending in bench.submitted:
        pending.set_result(response(1))
    monkeypatch.setattr(command_service, "RESPONSE_TIMEOUT", PATIENCE)
    accepted = bench.call()
    bench.wait(lambda: len(bench.submitted) == WAITING_LIMIT + 1)
    bench.submitted[-1].set_result(response(5))
    bench.wait(accepted.done)
    assert accepted.result().value == 5
