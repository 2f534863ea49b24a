# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The driver node with boards that have frames of their own, over a virtual bus."""

from __future__ import annotations

import time
import uuid
from collections.abc import Callable, Iterator
from pathlib import Path

import can
import numpy as np
import pytest

from support.clocks import PacedClock

rclpy = pytest.importorskip("rclpy")
pytest.importorskip("posfet_msgs", reason="needs the built workspace")

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter

from posfet_driver.bus.frame import Frame
from posfet_driver.ros.driver_node import DriverNode
from posfet_model.sensor.description import Sensor
from posfet_msgs.msg import TactileRaw
from posfet_msgs.srv import BoardCommand
from support.fake_board import PATIENCE, board_on_bus
from support.own_boards import (
    BoardA,
    BoardB,
    Transmitter,
    codes_of,
    counts_of_codes,
    counts_of_millivolts,
    millivolts_of,
    sensor_a,
    sensor_b,
)

pytestmark = pytest.mark.ros
A, B = BoardA(), BoardB()
PERIOD = 5_000_000
"""Scan period of the boards [ns]: slow, so that the data thread is never behind on a loaded machine."""
RATE = {"  scan_rate_Hz: 1000.0": "  scan_rate_Hz: 200.0"}


class Bench:
    """A context with a watcher."""

    def __init__(self) -> None:
        self.clock = PacedClock(main=False)
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.watcher = rclpy.create_node("watcher", context=self.context)
        self.executor.add_node(self.watcher)
        self.raw: list[TactileRaw] = []
        self.diagnostics: list[DiagnosticStatus] = []
        self.watcher.create_subscription(TactileRaw, "/tactile/raw", self.raw.append, 1000)
        self.watcher.create_subscription(
            DiagnosticArray, "/diagnostics", lambda message: self.diagnostics.extend(message.status), 10
        )

    def drive(self, sensor_file: Path, channel: str) -> None:
        values = {"can_interface": "virtual", "can_channel": channel, "sensor_file": str(sensor_file)}
        overrides = [Parameter(name, value=value) for name, value in values.items()]
        node = DriverNode(self.clock, context=self.context, namespace="/tactile", parameter_overrides=overrides)
        self.executor.add_node(node)
        node.start()

    def wait(self, condition: Callable[[], bool]) -> None:
        end = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < end, self.diagnostics[-1:]
            self.executor.spin_once(timeout_sec=0.02)

    def close(self) -> None:
        for node in self.executor.get_nodes():
            node.destroy_node()
        self.executor.shutdown()
        self.context.try_shutdown()


@pytest.fixture
def bench() -> Iterator[Bench]:
    bench = Bench()
    yield bench
    bench.close()


def frames_b(index: int) -> list[Frame]:
    return B.scan(5 * index, millivolts_of(index))


@pytest.mark.parametrize(
    ("name", "make_sensor", "frames", "counts", "status"),
    [
        ("a", sensor_a, lambda i: A.scan(i, codes_of(i)), lambda i: counts_of_codes(codes_of(i)), 32),
        ("b", sensor_b, frames_b, lambda i: counts_of_millivolts(millivolts_of(i)), 64),
    ],
    ids=["A", "B"],
)
def test_scans_arrive_on_raw(
    bench: Bench,
    tmp_path: Path,
    name: str,
    make_sensor: Callable[..., Sensor],
    frames: Callable[[int], list[Frame]],
    counts: Callable[[int], np.ndarray],
    status: int,
) -> None:
    make_sensor(tmp_path, **RATE)
    channel = uuid.uuid4().hex
    known = {tuple(counts(index).tolist()): index for index in range(1024)}
    with can.Bus(interface="virtual", channel=channel) as bus:
        transmitter = Transmitter(frames, bench.clock.monotonic(), PERIOD)
        with board_on_bus(bus, transmitter, bench.clock):
            bench.drive(tmp_path / f"{name}.yaml", channel)
            bench.wait(lambda: len(bench.raw) >= 40)
            indices = [known[tuple(message.counts)] for message in bench.raw[:40]]
            assert indices == list(range(indices[0], indices[0] + 40))
            sequences = [message.sequence for message in bench.raw[:40]]
            assert sequences == list(range(sequences[0], sequences[0] + 40))
            assert {message.status for message in bench.raw[:40]} == {status}
            bench.wait(lambda: bool(bench.diagnostics) and "receiving scans" in bench.diagnostics[-1].message)
            client = bench.watcher.create_client(BoardCommand, "/tactile/command")
            bench.wait(client.service_is_ready)
            future = client.call_async(BoardCommand.Request(command=2))
            bench.wait(future.done)
            assert not future.result().success
            assert future.result().message.startswith("STOP: the driver only listens to a board with frames of its own")
    assert transmitter.received == []
