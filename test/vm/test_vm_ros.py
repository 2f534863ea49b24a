# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The driver node on a real kernel: its scans and diagnostics while the interface goes down and up."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

rclpy = pytest.importorskip("rclpy")
pytest.importorskip("posfet_msgs", reason="needs the built workspace")

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter

from posfet_driver.clock import SystemClock
from posfet_driver.ros.driver_node import DriverNode
from posfet_model.sensor import description
from posfet_msgs.msg import TactileRaw
from support.fake_board import PATIENCE
from support.kernel_can import virtual_wire
from support.vm_bench import VmBench

pytestmark = [pytest.mark.vm, pytest.mark.ros]
RATE = 50.0


class Watcher(Node):
    """Collects what the driver publishes."""

    def __init__(self, context: rclpy.Context) -> None:
        super().__init__("watcher", context=context)
        self.sequences: list[int] = []
        self.messages: list[str] = []
        self.create_subscription(TactileRaw, "/tactile/raw", lambda scan: self.sequences.append(scan.sequence), 100)
        self.create_subscription(DiagnosticArray, "/diagnostics", self._take, 10)

    def _take(self, message: DiagnosticArray) -> None:
        self.messages += [status.message for status in message.status]


@pytest.fixture
def executor() -> Iterator[SingleThreadedExecutor]:
    context = rclpy.Context()
    rclpy.init(context=context)
    executor = SingleThreadedExecutor(context=context)
    yield executor
    executor.shutdown()
    rclpy.shutdown(context=context)


def spin_until(executor: SingleThreadedExecutor, condition: Callable[[], bool]) -> None:
    clock = SystemClock()
    end = clock.monotonic() + PATIENCE * 1e9
    while not condition():
        executor.spin_once(timeout_sec=0.1)
        assert clock.monotonic() < end


def test_the_node_reports_an_interface_that_goes_down_and_publishes_again(
    executor: SingleThreadedExecutor, tmp_path: Path
) -> None:
    shipped = next(Path(description.__file__).parent.glob("**/posfet_5x5.yaml")).read_text(encoding="utf-8")
    file = tmp_path / "slow.yaml"
    file.write_text(shipped.replace("scan_rate_Hz: 1000", f"scan_rate_Hz: {RATE:.0f}"), encoding="utf-8")
    watcher = Watcher(executor.context)
    executor.add_node(watcher)
    with virtual_wire(fd=True) as wire:
        bench = VmBench(wire, RATE)
        bench.server.open()
        parameters = {"sensor_file": str(file), "can_interface": "socketcan", "can_channel": wire.driver.name}
        overrides = [Parameter(name, value=value) for name, value in parameters.items()]
        driver = DriverNode(
            SystemClock(), context=executor.context, namespace="/tactile", parameter_overrides=overrides
        )
        executor.add_node(driver)
        driver.trigger_configure()
        driver.trigger_activate()
        spin_until(executor, lambda: len(watcher.sequences) >= 20)
        assert watcher.sequences == sorted(set(watcher.sequences))
        wire.down()
        spin_until(executor, lambda: any("sudo ip link set vcan0 up" in message for message in watcher.messages))
        wire.up()
        count = len(watcher.sequences)
        spin_until(executor, lambda: len(watcher.sequences) >= count + 20)
        driver.trigger_deactivate()
        driver.trigger_cleanup()
        driver.destroy_node()
        bench.server.close()
    watcher.destroy_node()
