# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Driver and model in one process, whose scans are processed without Python, while everything around them changes."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

rclpy = pytest.importorskip("rclpy")
pytest.importorskip("posfet_msgs", reason="needs the built workspace")

from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.node import Node
from rclpy.parameter import Parameter

from posfet_driver.protocol.messages import Command
from posfet_driver.ros.driver_node import DriverNode
from posfet_model.ros.model_node import ModelNode
from posfet_model.ros.rcl_functions import rcl_functions
from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.scan import Scan
from posfet_msgs.msg import TactileContacts, TactileImage, TactileRaw
from posfet_sim.emulation.firmware import BoardFirmware
from posfet_sim.emulation.slcan_adapter import EmulatedAdapter

pytestmark = pytest.mark.ros

SENSOR = load_sensor()
PATIENCE = 120.0
"""After this time [s] a test has failed."""
SUCCESS = TransitionCallbackReturn.SUCCESS
ENOUGH = 200
"""Scans that are waited for: ten blocks."""


class StillBoard:
    """A board that nothing touches."""

    def scan(self, index: int, out: Scan) -> None:
        out.counts[:] = 30_000 + index * 7919 % 3
        out.device_time = index * 1000
        out.temperatures[:] = 25.0
        out.status = 0


class Watcher(Node):
    """Collects what is published."""

    def __init__(self, context: rclpy.Context) -> None:
        super().__init__("watcher", context=context)
        self.contacts: list[int] = []
        self.images: list[int] = []
        self.raw: list[int] = []
        self.create_subscription(TactileContacts, "contacts", lambda message: self._take(self.contacts, message), 1000)

    def listen(self, kind: type, topic: str, into: list[int]) -> object:
        return self.create_subscription(kind, topic, lambda message: self._take(into, message), 1000)

    @staticmethod
    def _take(into: list[int], message: TactileContacts | TactileImage | TactileRaw) -> None:
        into.append(message.sequence)


class Bench:
    """The nodes, composed as in one process, and what was processed in Python."""

    def __init__(self, folder: Path) -> None:
        self.link = folder / "tty"
        self.adapter = self.plug_in()
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.watcher = Watcher(self.context)
        bus = {"can_interface": "slcan", "can_channel": str(self.link)}
        self.model = ModelNode(context=self.context, parameter_overrides=[Parameter("direct", value=True)])
        self.driver = DriverNode(
            context=self.context, parameter_overrides=[Parameter(name, value=value) for name, value in bus.items()]
        )
        self.in_python: list[int] = []
        self.driver.sink, self.driver.stream = self._process, self.model.stream
        self.executor = SingleThreadedExecutor(context=self.context)
        for node in (self.watcher, self.model, self.driver):
            self.executor.add_node(node)
        self.model.start()
        self.model.add_maps()
        self.driver.start()

    def _process(self, scan: Scan) -> None:
        self.in_python.append(scan.sequence)
        self.model.process(scan)

    def plug_in(self) -> EmulatedAdapter:
        """Connect an adapter with a board that has just been powered."""
        adapter = EmulatedAdapter(self.link, BoardFirmware(SENSOR, StillBoard(), time.monotonic_ns()))
        adapter.open()
        return adapter

    def wait(self, condition: Callable[[], bool]) -> None:
        """Spin until the condition holds."""
        end = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < end, self.driver.source.report()
            self.executor.spin_once(timeout_sec=0.02)

    @property
    def accepted(self) -> int:
        """Scans that the model has accepted."""
        latest = self.model.latest()
        return latest.scans if latest else 0

    def flows(self) -> None:
        """Wait until nearly all of many scans in a row were processed without Python, and their contacts have come.

        What Python had read before is processed by Python; so is the first scan of a model.
        """
        window: list[int] = []

        def flowed() -> bool:
            if not window or len(self.in_python) - window[0] > ENOUGH // 10:
                window[:] = len(self.in_python), self.accepted, len(self.watcher.contacts)
            _, accepted, received = window
            return self.accepted >= accepted + ENOUGH and len(self.watcher.contacts) >= received + ENOUGH

        self.wait(flowed)

    def close(self) -> None:
        self.executor.shutdown()
        for node in (self.driver, self.model, self.watcher):
            node.destroy_node()
        if self.context.ok():
            rclpy.shutdown(context=self.context)
        self.adapter.close()


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    bench = Bench(tmp_path)
    try:
        yield bench
    finally:
        bench.close()


def test_rclpy_leads_to_the_functions_of_rcl() -> None:
    functions = rcl_functions()
    assert functions is not None and all(functions)


def test_scans_are_processed_without_python(bench: Bench) -> None:
    bench.flows()
    latest = bench.model.latest()
    assert latest is not None and latest.sequence > bench.in_python[-1]
    report = bench.driver.source.report()
    assert report.state == "receiving scans" and report.scans >= latest.scans


def test_nothing_is_published_after_deactivation(bench: Bench) -> None:
    bench.flows()
    assert bench.driver.trigger_deactivate() == SUCCESS
    latest = bench.model.latest()
    assert latest is not None
    scans = bench.driver.source.report().scans
    bench.wait(lambda: bench.driver.source.report().scans > scans + ENOUGH)  # the source is read on
    after = bench.model.latest()
    assert after is not None and after.sequence == latest.sequence and max(bench.watcher.contacts) <= latest.sequence
    assert bench.driver.trigger_activate() == SUCCESS
    bench.flows()


def test_a_model_that_is_inactive_processes_no_scan(bench: Bench) -> None:
    bench.flows()
    assert bench.model.trigger_deactivate() == SUCCESS
    latest, processed = bench.model.latest(), len(bench.in_python)
    bench.wait(lambda: len(bench.in_python) > processed + ENOUGH)
    after = bench.model.latest()
    assert latest is not None and after is not None and after.sequence == latest.sequence
    assert bench.model.trigger_activate() == SUCCESS
    bench.flows()


def test_cleanup_ends_the_thread_and_configure_starts_it_anew(bench: Bench) -> None:
    bench.flows()
    thread = bench.driver._thread
    assert bench.driver.trigger_deactivate() == bench.driver.trigger_cleanup() == SUCCESS
    assert thread is not None and not thread.is_alive() and not bench.driver.reading
    assert bench.driver.trigger_configure() == bench.driver.trigger_activate() == SUCCESS
    bench.flows()


def test_a_restart_of_the_source_goes_on(bench: Bench) -> None:
    for _ in range(3):
        bench.flows()
        bench.driver.restart()
    bench.flows()


def test_an_adapter_that_is_unplugged_and_plugged_in_again(bench: Bench) -> None:
    bench.flows()
    bench.adapter.close()
    bench.wait(lambda: "unavailable" in bench.driver.source.report().state)
    bench.adapter = bench.plug_in()
    bench.flows()
    assert bench.driver.source.report().counters["bus losses"] == 1


def test_another_calibration_is_used_from_the_next_scan_on(bench: Bench) -> None:
    bench.flows()
    bench.in_python.clear()
    fresh = bench.model._use_calibration(None)
    bench.flows()
    assert bench.model._reconstructor is fresh and bench.in_python


def test_tare_and_settings_while_scans_are_processed(bench: Bench) -> None:
    bench.flows()
    bench.wait(lambda: bool((latest := bench.model.latest()) and latest.valid))
    for _ in range(20):
        tare = bench.model._tare(force=False)
        assert tare is not None and tare.done
    [result] = bench.model.set_parameters([Parameter("hum_removal", value=False)])
    assert result.successful, result.reason
    bench.flows()


def test_a_command_is_answered_while_scans_are_processed(bench: Bench) -> None:
    bench.flows()
    pending = bench.driver._submit(Command.IDENTIFY, 0, PATIENCE)
    bench.wait(pending.done)
    assert pending.result().command == Command.IDENTIFY
    bench.flows()


@pytest.mark.parametrize("topic", ["image", "raw"])
def test_another_topic_is_served_by_python_while_it_is_subscribed_to(bench: Bench, topic: str) -> None:
    bench.flows()
    kind, received = {"image": (TactileImage, bench.watcher.images), "raw": (TactileRaw, bench.watcher.raw)}[topic]
    subscription = bench.watcher.listen(kind, topic, received)
    bench.wait(lambda: len(received) >= ENOUGH)
    assert set(received[10:]) <= set(bench.in_python)
    bench.watcher.destroy_subscription(subscription)
    publishers = [*bench.model.publishers, *bench.driver.publishers]
    [publisher] = [each for each in publishers if each.topic_name == f"/{topic}"]
    bench.wait(lambda: not publisher.get_subscription_count())
    bench.flows()


def test_a_context_that_is_shut_down_ends_the_thread(bench: Bench) -> None:
    bench.flows()
    thread = bench.driver._thread
    assert thread is not None
    rclpy.shutdown(context=bench.context)
    thread.join(PATIENCE)
    assert not thread.is_alive() and not bench.driver.failure
