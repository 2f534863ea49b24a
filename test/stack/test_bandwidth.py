# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""`posfet bandwidth`: messages and bytes of each topic, counters of interfaces, and errors of one line."""

from __future__ import annotations

import json
import time
from pathlib import Path

import pytest

rclpy = pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("posfet_msgs", reason="needs the built workspace")

from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message

from posfet.bandwidth import Count, Counter, Traffic, interface_bytes, main, table
from posfet_model.config import ConfigError
from posfet_msgs.msg import TactileRaw
from support.bringup_process import needs_installation, running
from support.expectations import TIMEOUT

pytestmark = pytest.mark.ros

COUNTERS = """\
Inter-|   Receive                                      |  Transmit
 face |bytes packets errs drop fifo frame compressed multicast|bytes packets errs drop fifo colls carrier compressed
    lo: 1000 10 0 0 0 0 0 0 1000 10 0 0 0 0 0 0
  eth0: 12345 67 0 0 0 0 0 0 89 1 0 0 0 0 0 0
"""


@pytest.mark.parametrize("best_effort", [False, True])
def test_messages_and_their_serialized_sizes_are_counted(best_effort: bool) -> None:
    context = Context()
    rclpy.init(context=context)
    executor = SingleThreadedExecutor(context=context)
    talker = rclpy.create_node("talker", context=context)
    publisher = talker.create_publisher(TactileRaw, "/hand/thumb/raw", QoSProfile(depth=10))
    counter = Counter(["hand/thumb"], ["raw", "absent"], best_effort, context=context)
    for node in (talker, counter):
        executor.add_node(node)

    def spin_until(condition) -> None:
        end = time.monotonic() + TIMEOUT
        while not condition():
            assert time.monotonic() < end
            executor.spin_once(0.01)

    try:
        spin_until(lambda: publisher.get_subscription_count() == 1 and bool(counter.counts))
        message = TactileRaw(counts=[1] * 25)
        publisher.publish(message)
        count = counter.counts["/hand/thumb/raw"]
        spin_until(lambda: count.messages == 1)
        assert count.bytes == len(serialize_message(message))
        assert counter.missing == ["/hand/thumb/absent"]
        [subscriber] = talker.get_subscriptions_info_by_topic("/hand/thumb/raw")
        assert (subscriber.qos_profile.reliability is ReliabilityPolicy.BEST_EFFORT) == best_effort
        counter.restart()
        assert counter.counts == {"/hand/thumb/raw": Count()}
    finally:
        executor.shutdown()
        for node in (talker, counter):
            node.destroy_node()
        context.try_shutdown()


def test_the_counters_of_an_interface_are_read(tmp_path: Path) -> None:
    path = tmp_path / "dev"
    path.write_text(COUNTERS, encoding="ascii")
    assert interface_bytes("eth0", path) == (12345, 89)
    with pytest.raises(ConfigError, match=r"no interface 'eth1', there are eth0, lo"):
        interface_bytes("eth1", path)
    with pytest.raises(ConfigError, match="cannot be read"):
        interface_bytes("eth0", tmp_path / "none")


def test_the_table_has_rates_sizes_and_the_sum() -> None:
    counted = {
        "/tactile/raw": Count(2000, 200_000),
        "/tactile/contacts": Count(1000, 300_000),
        "/tactile/info": Count(),
    }
    lines = table(Traffic(2.0, counted, 600_000, 4000), "eth0")
    assert [line.split() for line in lines[:5]] == [
        ["topic", "1/s", "B", "each", "kB/s"],
        ["/tactile/contacts", "500.0", "300", "150.0"],
        ["/tactile/info", "0.0", "-", "0.0"],
        ["/tactile/raw", "1000.0", "100", "100.0"],
        ["sum", "1500.0", "250.0"],
    ]
    assert lines[5] == "eth0: received 300.0 kB/s, sent 2.0 kB/s, everything on it"


@pytest.mark.process
@needs_installation
def test_the_command_counts_a_running_stack(capfd: pytest.CaptureFixture[str]) -> None:
    with running("source:=sim"):
        words = ["--topics", "raw", "--for", "3", "--wait", f"{TIMEOUT:g}", "--interface", "lo", "--json"]
        assert main(words) == 0
    traffic = json.loads(capfd.readouterr().out)
    assert traffic["topics"]["/tactile/raw"]["messages"] > 0
    assert traffic["seconds"] >= 3.0


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--namespace", "nobody", "--wait", "0.2"], "no message on /nobody/... within 0.2 s"),
        (["--interface", "nowhere0"], "no interface 'nowhere0'"),
    ],
)
def test_what_cannot_be_counted_is_one_line(words: list[str], said: str, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(words) == 1
    [line] = capfd.readouterr().err.splitlines()
    assert line.startswith(said)
