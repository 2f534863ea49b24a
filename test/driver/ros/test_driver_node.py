# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The driver node in process: over the emulated adapter and a virtual bus, its lifecycle, and invalid input."""

from __future__ import annotations

import random
import threading
import time
import uuid
from collections.abc import Iterator
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path
from typing import Any

import can
import numpy as np
import pytest

from support.clocks import PacedClock

rclpy = pytest.importorskip("rclpy")
pytest.importorskip("posfet_msgs", reason="needs the built workspace")

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.node import Node
from rclpy.parameter import Parameter

from posfet_driver.bus.message_conversion import frame_of, message_of
from posfet_driver.clock import Clock
from posfet_driver.protocol.messages import Command, Identification, Response, Result
from posfet_driver.ros import command_service, driver_node
from posfet_driver.ros.driver_node import DriverNode
from posfet_model.config import ConfigError
from posfet_model.sensor import description
from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.scan import Scan, ScanStatus
from posfet_msgs.msg import TactileRaw
from posfet_msgs.srv import BoardCommand
from posfet_sim.emulation.firmware import BoardFirmware
from posfet_sim.emulation.slcan_adapter import EmulatedAdapter

pytestmark = pytest.mark.ros
PATIENCE = 120.0
"""After this time [s] a test has failed."""
BACKLOG = 200
"""Scans published and not received from which on time stands still: fewer than the middleware keeps."""
SENSOR = load_sensor()
SUCCESS = TransitionCallbackReturn.SUCCESS


TRANSITIONS = {
    "unconfigured": {"configure": "inactive"},
    "inactive": {"activate": "active", "cleanup": "unconfigured"},
    "active": {"deactivate": "inactive"},
}
"""What may be done in each state, and where it leads."""


class CountingBoard:
    """Makes scans whose counts encode the sequence in 12 bits, which classic frames preserve."""

    def scan(self, index: int, out: Scan) -> None:
        code = index % 4096
        out.counts[:] = code << 4 | code >> 8
        out.device_time = index * 1000
        out.temperatures[:] = 31.25
        out.status = 0


class Watcher(Node):
    """Collects what the driver publishes."""

    def __init__(self, context: rclpy.Context) -> None:
        super().__init__("watcher", context=context)
        self.raw: list[TactileRaw] = []
        self.diagnostics: list[DiagnosticStatus] = []
        self.create_subscription(DiagnosticArray, "/diagnostics", self._take, 10)
        self.command = self.create_client(BoardCommand, "/tactile/command")

    def listen(self) -> None:
        self.create_subscription(TactileRaw, "/tactile/raw", self.raw.append, 2000)

    def _take(self, message: DiagnosticArray) -> None:
        self.diagnostics += message.status


class Bench:
    """An executor with a watcher and the nodes of the test; waits for conditions."""

    def __init__(self) -> None:
        self.clock = PacedClock(main=False)  # of the node threads; the time stops while the main thread is busy
        self.drivers: list[DriverNode] = []
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.watcher = Watcher(self.context)
        self.executor.add_node(self.watcher)

    def driver(self, namespace: str = "/tactile", **parameters: Any) -> DriverNode:
        settings = {"can_interface": "slcan"} | parameters
        overrides = [Parameter(name, value=value) for name, value in settings.items()]
        node = DriverNode(self.clock, context=self.context, namespace=namespace, parameter_overrides=overrides)
        self.executor.add_node(node)
        self.drivers.append(node)
        return node

    def wait(self, condition: Any) -> None:
        """Spin until the condition holds."""
        end = time.monotonic() + PATIENCE
        with self.clock.taking_part():
            while not condition():
                assert time.monotonic() < end, self.watcher.diagnostics[-1:]
                self.executor.spin_once(timeout_sec=0.02)
                if not self._behind():
                    self.clock.monotonic()

    def call(self, command: int, argument: int = 0) -> BoardCommand.Response:
        """Call the command service of the driver and return its response."""
        client = self.watcher.command
        self.wait(client.service_is_ready)
        future = client.call_async(BoardCommand.Request(command=command, argument=argument))
        self.wait(future.done)
        return future.result()

    def _behind(self) -> bool:
        """Return whether scans are queued that the watcher should receive first."""
        if not self.watcher.raw or not self.drivers:
            return False
        return self.drivers[-1].source.decoder.sequence - self.watcher.raw[-1].sequence > BACKLOG

    def state(self) -> str:
        return self.watcher.diagnostics[-1].message if self.watcher.diagnostics else ""

    def close(self) -> None:
        for node in self.executor.get_nodes():
            node.destroy_node()
        self.executor.shutdown()
        self.context.try_shutdown()


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    monkeypatch.setattr(command_service, "RESPONSE_TIMEOUT", PATIENCE)
    bench = Bench()
    yield bench
    bench.close()


@pytest.fixture
def link(tmp_path: Path) -> Path:
    return tmp_path / "can0"


def make_adapter(link: Path, clock: Clock, fd: bool = True) -> EmulatedAdapter:
    sensor = replace(SENSOR, can=replace(SENSOR.can, fd=fd))
    adapter = EmulatedAdapter(link, BoardFirmware(sensor, CountingBoard(), clock.monotonic()), clock)
    adapter.open()
    return adapter


@pytest.fixture
def adapter(link: Path, bench: Bench) -> Iterator[EmulatedAdapter]:
    adapter = make_adapter(link, bench.clock)
    yield adapter
    adapter.close()


def assert_counting(messages: list[TactileRaw]) -> None:
    """Check that the counts of each message encode its sequence."""
    for message in messages:
        code = message.sequence % 4096
        np.testing.assert_array_equal(np.asarray(message.counts), np.full(25, code << 4 | code >> 8))


@pytest.mark.parametrize("fd", [True, False], ids=["fd", "classic"])
def test_raw_over_the_emulated_adapter(bench: Bench, link: Path, fd: bool) -> None:
    adapter = make_adapter(link, bench.clock, fd)
    try:
        bench.watcher.listen()
        node = bench.driver(can_channel=str(link), can_fd=str(fd).lower(), frame_id="thumb")
        node.start()
        bench.wait(lambda: len(bench.watcher.raw) >= 300)
        messages = bench.watcher.raw
        assert_counting(messages)
        first, last = messages[0], messages[-1]
        assert last.sequence - first.sequence == len(messages) - 1
        assert (last.rows, last.cols, last.layout_id, last.header.frame_id) == (5, 5, SENSOR.layout.id, "thumb")
        assert last.device_time == last.sequence * 1000
        assert last.status == ScanStatus.OK
        assert list(last.temperatures) == [31.25, 31.25]
        assert last.frames_lost == 0
        stamps = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in (first, last)]
        assert abs(stamps[1] - bench.clock.wall()) < 1_000_000_000
        if fd:
            assert stamps[1] - stamps[0] == pytest.approx((last.sequence - first.sequence) * 1e6, abs=20e6)
        bench.wait(lambda: bench.state() == "receiving scans")
        assert bench.watcher.diagnostics[-1].level == DiagnosticStatus.OK
    finally:
        adapter.close()


def test_raw_over_a_virtual_bus(bench: Bench) -> None:
    channel = uuid.uuid4().hex
    clock = bench.clock
    firmware = BoardFirmware(SENSOR, CountingBoard(), clock.monotonic())
    with can.Bus(interface="virtual", channel=channel) as bus:

        def board_turn() -> bool:
            now = clock.monotonic()
            frames = firmware.due(now)
            while (message := bus.recv(0)) is not None:
                frames += firmware.receive(frame_of(message), now)
            for frame in frames:
                bus.send(message_of(frame))
            return len(bench.watcher.raw) >= 50

        bench.watcher.listen()
        bench.driver(can_interface="virtual", can_channel=channel).start()
        bench.wait(board_turn)
    assert_counting(bench.watcher.raw)


def test_two_boards_on_one_bus_use_one_driver_each(bench: Bench, tmp_path: Path) -> None:
    """As documented: one sensor file each, with different base_id, and one namespace each."""
    channel, clock = uuid.uuid4().hex, bench.clock
    shipped = (Path(description.__file__).parent / "sensors" / "posfet_5x5.yaml").read_text(encoding="utf-8")
    nodes, firmwares, received = [], [], {}
    with can.Bus(interface="virtual", channel=channel) as bus:
        for name, base in (("thumb", 0x100), ("palm", 0x110)):
            file = tmp_path / f"{name}.yaml"
            file.write_text(shipped.replace("base_id: 0x100", f"base_id: 0x{base:X}"), encoding="utf-8")
            own = load_sensor(str(file))
            firmwares.append(BoardFirmware(own, CountingBoard(), clock.monotonic()))
            node = bench.driver(
                f"/hand/{name}", can_interface="virtual", can_channel=channel, sensor_file=str(file), autostart=False
            )
            received[name] = scans = []
            node.sink = lambda scan, scans=scans: scans.append((scan.sequence, int(scan.counts[0])))
            assert (node.trigger_configure(), node.trigger_activate()) == (SUCCESS, SUCCESS)
            nodes.append(node)

        def boards_turn() -> bool:
            now = clock.monotonic()
            frames = [frame for firmware in firmwares for frame in firmware.due(now)]
            while (message := bus.recv(0)) is not None:
                for firmware in firmwares:
                    frames += firmware.receive(frame_of(message), now)
            for frame in frames:
                bus.send(message_of(frame))
            return all(len(scans) >= 50 for scans in received.values())

        bench.wait(boards_turn)
        for node, scans in zip(nodes, received.values(), strict=True):
            node.trigger_shutdown()
            assert [count for _, count in scans] == [(n % 4096) << 4 | (n % 4096) >> 8 for n, _ in scans]
            report = node.source.report()
            assert report.frames_lost == 0
            assert report.counters["unrelated frames"] > 0


def test_lifecycle(bench: Bench, adapter: EmulatedAdapter, link: Path) -> None:
    """Unconfigured at first; inactive it reads but does not publish; active it publishes; it can be cycled."""
    bench.watcher.listen()
    node = bench.driver(can_channel=str(link), autostart=False)
    received: list[int] = []
    node.sink = lambda scan: received.append(scan.sequence)
    node.start()
    assert node.source.report().state == "closed"
    for _ in range(2):
        assert node.trigger_configure() == SUCCESS
        seen = node.source.report().scans
        bench.wait(lambda seen=seen: node.source.report().scans >= seen + 50)
        assert received == bench.watcher.raw == []
        assert node.trigger_activate() == SUCCESS
        bench.wait(lambda: len(received) > 50 and bench.watcher.raw)
        assert_counting(bench.watcher.raw)
        assert node.trigger_deactivate() == SUCCESS
        assert node.trigger_cleanup() == SUCCESS
        assert node.source.report().state == "closed"
        assert received == list(range(received[0], received[0] + len(received)))
        seen = -1
        while seen != len(bench.watcher.raw):  # messages in transit
            seen = len(bench.watcher.raw)
            bench.executor.spin_once(timeout_sec=0.2)
        received.clear()
        bench.watcher.raw.clear()
    assert node.source.report().frames_lost == 0
    assert node.trigger_shutdown() == SUCCESS


def test_diagnostics_say_that_an_inactive_driver_discards_its_scans(
    bench: Bench, adapter: EmulatedAdapter, link: Path
) -> None:
    bench.watcher.listen()
    node = bench.driver(can_channel=str(link))
    node.start()
    bench.wait(lambda: bench.state() == "receiving scans")
    assert node.trigger_deactivate() == SUCCESS
    bench.wait(lambda: bench.state() == "receiving scans; inactive: scans are discarded")
    assert bench.watcher.diagnostics[-1].level == DiagnosticStatus.OK
    assert node.trigger_activate() == SUCCESS
    bench.wait(lambda: bench.state() == "receiving scans")


def test_lifecycle_transitions_in_any_order_while_the_adapter_comes_and_goes(bench: Bench, link: Path) -> None:
    node = bench.driver(can_channel=str(link), autostart=False)
    received: list[int] = []
    node.sink = lambda scan: received.append(scan.sequence)
    threads = threading.active_count()
    noise, state, adapter = random.Random(5), "unconfigured", None
    for _ in range(20):
        if adapter:
            adapter.close()
        adapter = make_adapter(link, bench.clock) if noise.random() < 0.6 else None
        name = noise.choice(sorted(TRANSITIONS[state]))
        assert getattr(node, f"trigger_{name}")() == SUCCESS
        state = TRANSITIONS[state][name]
        if state == "active" and adapter:
            received.clear()
            bench.wait(lambda: len(received) > 10)
        if state == "unconfigured":
            assert threading.active_count() == threads + bool(adapter)
            assert node.source.report().state == "closed"
    assert node.trigger_shutdown() == SUCCESS
    assert not node.reading
    if adapter:
        adapter.close()


def test_the_sink_gets_scans_without_subscribers(bench: Bench, adapter: EmulatedAdapter, link: Path) -> None:
    node = bench.driver(can_channel=str(link))
    received: list[int] = []
    node.sink = lambda scan: received.append(scan.sequence)
    node.start()
    bench.wait(lambda: len(received) > 100)
    assert node.count_subscribers("raw") == 0


def test_a_board_starts_and_obeys_commands_without_subscribers(
    bench: Bench, adapter: EmulatedAdapter, link: Path
) -> None:
    node = bench.driver(can_channel=str(link))
    node.start()
    bench.wait(lambda: bench.state() == "receiving scans")
    response = bench.call(BoardCommand.Request.IDENTIFY)
    assert (response.success, response.value & 0xFFFF) == (True, SENSOR.layout.id)


def test_diagnostics_report_an_adapter_that_appears_disconnects_and_returns(bench: Bench, link: Path) -> None:
    bench.watcher.listen()
    bench.driver(can_channel=str(link)).start()
    bench.wait(lambda: "No such file or directory" in bench.state())
    assert bench.watcher.diagnostics[-1].level == DiagnosticStatus.ERROR
    assert bench.watcher.diagnostics[-1].hardware_id == "posfet_5x5 (tactile)"
    for _ in range(2):
        adapter = make_adapter(link, bench.clock)
        try:
            bench.watcher.raw.clear()
            bench.wait(lambda: len(bench.watcher.raw) > 50 and bench.state() == "receiving scans")
            assert_counting(bench.watcher.raw)
        finally:
            adapter.close()
        bench.wait(lambda: bench.watcher.diagnostics[-1].level == DiagnosticStatus.ERROR)


def test_commands_reach_the_board_while_it_scans(bench: Bench, adapter: EmulatedAdapter, link: Path) -> None:
    bench.watcher.listen()
    bench.driver(can_channel=str(link)).start()
    bench.wait(lambda: len(bench.watcher.raw) > 10)
    call = bench.call
    response = call(BoardCommand.Request.IDENTIFY)
    value = Identification(SENSOR.layout.id, protocol=2, fd=True, firmware_major=1).pack()
    assert (response.success, response.message, response.value) == (True, "", value)
    rejected = call(BoardCommand.Request.SET_RATE, 10)
    assert not rejected.success
    assert rejected.message == "SET_RATE: refused by the board: bad argument"
    unknown = call(77)
    assert not unknown.success
    assert "command must be one of 1 START, 2 STOP" in unknown.message
    assert call(BoardCommand.Request.STOP).success
    bench.wait(lambda: bench.state() == "stopped on request")
    assert call(BoardCommand.Request.START).success
    bench.wait(lambda: bench.state() == "receiving scans")
    assert_counting(bench.watcher.raw)
    assert bench.watcher.raw[-1].frames_lost == 0
    adapter.close()
    bench.wait(lambda: bench.watcher.diagnostics[-1].level == DiagnosticStatus.ERROR)
    assert call(BoardCommand.Request.IDENTIFY).message.startswith("IDENTIFY: CAN bus unavailable, retrying")


def test_a_command_is_answered_before_anyone_subscribes(
    bench: Bench, adapter: EmulatedAdapter, link: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(driver_node, "SUBSCRIBER_TIMEOUT", 1 << 62)
    monkeypatch.setattr(command_service, "RESPONSE_TIMEOUT", PATIENCE / 4)
    bench.driver(can_channel=str(link)).start()
    assert bench.call(BoardCommand.Request.IDENTIFY).success


def test_diagnostics_and_other_calls_go_on_while_a_command_waits(
    bench: Bench, adapter: EmulatedAdapter, link: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    node = bench.driver(can_channel=str(link))
    node.start()
    bench.wait(bench.watcher.command.service_is_ready)
    pending: Future[Response] = Future()
    monkeypatch.setattr(node._board, "submit", lambda *_: pending)
    waiting = bench.watcher.command.call_async(BoardCommand.Request(command=BoardCommand.Request.IDENTIFY))
    assert not bench.call(77).success
    seen = len(bench.watcher.diagnostics)
    bench.wait(lambda: len(bench.watcher.diagnostics) > seen)
    assert not waiting.done()
    pending.set_result(Response(Command.IDENTIFY, 1, Result.OK, 9))
    bench.wait(waiting.done)
    assert waiting.result().value == 9


def test_an_unconfigured_driver_rejects_commands(bench: Bench, link: Path) -> None:
    bench.driver(can_channel=str(link), autostart=False)
    response = bench.call(BoardCommand.Request.IDENTIFY)
    assert (response.success, response.message) == (False, "the driver is not configured")


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"can_interface": "slcam"}, "CAN interface must be one of .*, got 'slcam'"),
        ({"can_options": ["nonsense=1"]}, "interface 'slcan' has no option 'nonsense', known are .*listen_only"),
        ({"can_fd": "perhaps"}, "can_fd: must be one of auto, true, false, got 'perhaps'"),
        ({"can_bitrate": -1}, r"can_bitrate: must be a whole number in \[0, 1000000\] bit/s, got -1"),
        ({"sensor_file": "nosuch"}, "nosuch: no such sensor"),
    ],
)
def test_invalid_input_is_rejected_with_a_one_line_error(
    bench: Bench, parameters: dict[str, Any], message: str
) -> None:
    with pytest.raises(ConfigError, match=message) as caught:
        bench.driver(**parameters)
    assert "\n" not in str(caught.value)


def test_a_bitrate_unsupported_by_the_interface_aborts_the_start(bench: Bench) -> None:
    node = bench.driver(can_bitrate=123, can_channel="port")
    with pytest.raises(ConfigError, match="/tactile/driver_node: slcan:port: bitrate must be one of 10000"):
        node.start()
