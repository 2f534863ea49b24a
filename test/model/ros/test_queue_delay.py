# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Scans that come faster than they are processed: late ones are dropped, and services are answered."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import pytest

rclpy = pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("posfet_msgs", reason="needs the built posfet_msgs")

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import GetParameters
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from posfet_model.ros.model_node import RAW_DEPTH, ModelNode
from posfet_model.ros.queue_delay import LONGEST, SHORT, QueueDelay
from posfet_model.ros.run_node import NodeExecutor
from posfet_model.sensor.scan import Scan
from posfet_msgs.msg import TactileRaw

OVERLOAD = 5
"""Scans that come while one is processed."""
SCANS = 3000
"""Scans that have come when the service is asked."""
DEADLINE = 120.0


class FakeNode:
    """Keeps the callback of a timer that never runs by itself."""

    def __init__(self) -> None:
        self.beat: Callable[[], None] = lambda: None

    def create_timer(self, timer_period_sec: float, callback: Callable[[], None], *, autostart: bool) -> Any:
        assert timer_period_sec < SHORT
        assert not autostart
        self.beat = callback
        return self

    def reset(self) -> None:
        """Start, as a timer."""

    def cancel(self) -> None:
        """Stop, as a timer."""


def test_messages_are_dropped_while_the_queue_is_too_long() -> None:
    node, now = FakeNode(), [5.0]
    queue = QueueDelay(node, lambda: now[0])
    now[0] = 100.0
    queue.start()
    expected = [(LONGEST, False), (LONGEST + 1e-3, True), (SHORT + 1e-3, True), (SHORT, False), (LONGEST, False)]
    for delay, dropped in expected:
        now[0] += 10.0
        node.beat()
        now[0] += delay
        assert queue.too_late() is dropped
    assert queue.dropped == 2


class Overloaded:
    """A model node that processes a scan while five come, and a node that publishes them."""

    def __init__(self) -> None:
        self.context = Context()
        rclpy.init(context=self.context)
        self.published = 0
        self.end = threading.Event()
        self._came = threading.Condition()
        overloaded = self

        class SlowNode(ModelNode):
            """The model node."""

            def process(self, scan: Scan) -> None:
                overloaded.wait_for(overloaded.published + OVERLOAD)

        self.model = SlowNode(context=self.context, namespace="/slow")
        self.other = Node("other", context=self.context, namespace="/slow")
        self._publisher = self.other.create_publisher(TactileRaw, "raw", RAW_DEPTH)
        self._slow, self.fast = NodeExecutor(context=self.context), SingleThreadedExecutor(context=self.context)
        self._slow.add_node(self.model)
        self.fast.add_node(self.other)
        self._threads = [threading.Thread(target=each) for each in (self._spin, self._publish)]

    def start(self) -> None:
        """Begin to publish."""
        self.model.start()
        for thread in self._threads:
            thread.start()

    def wait_for(self, published: int) -> None:
        """Wait until so many scans have come, or the end."""
        with self._came:
            assert self._came.wait_for(lambda: self.end.is_set() or self.published >= published, DEADLINE)

    def close(self) -> None:
        """End the threads and nodes."""
        self.end.set()
        with self._came:
            self._came.notify_all()
        for thread in self._threads:
            if thread.is_alive():
                thread.join(DEADLINE)
        for executor in (self._slow, self.fast):
            executor.shutdown()
        for node in (self.model, self.other):
            node.destroy_node()
        rclpy.shutdown(context=self.context)

    def _spin(self) -> None:
        while not self.end.is_set():
            self._slow.spin_once(0.1)

    def _publish(self) -> None:
        message = TactileRaw(layout_id=1, rows=5, cols=5, counts=[0] * 25, temperatures=[25.0, 25.0])
        while not self.end.is_set():
            self._publisher.publish(message)
            with self._came:
                self.published += 1
                self._came.notify_all()
            time.sleep(1e-3)


@pytest.mark.ros
def test_a_service_is_answered_while_scans_come_faster_than_they_are_processed() -> None:
    if NodeExecutor is SingleThreadedExecutor:
        pytest.skip("this executor has no queue")
    bench, messages = Overloaded(), []
    try:
        bench.other.create_subscription(
            DiagnosticArray, "/diagnostics", lambda array: messages.append(array.status[0].message), 9
        )
        client = bench.other.create_client(GetParameters, "model_node/get_parameters")
        bench.start()
        assert client.wait_for_service(DEADLINE)
        bench.wait_for(SCANS)
        answer = client.call_async(GetParameters.Request(names=["simulated"]))
        bench.fast.spin_until_future_complete(answer, DEADLINE)
        assert answer.done()
        # Without dropping, each of the scans that wait takes as long as five others to come: four times as many.
        assert bench.published < 3 * SCANS
        deadline = time.monotonic() + DEADLINE
        while not any("lower the scan rate" in message for message in messages) and time.monotonic() < deadline:
            bench.fast.spin_once(0.1)
        assert any("scans dropped" in message for message in messages)
        assert bench.model._queue.dropped > 0
    finally:
        bench.close()
