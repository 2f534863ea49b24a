# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Two hosts on this machine: a stack on one of them is found, counted and commanded from the other.

docs/several-machines.md has the three ways in which they find each other.
"""

from __future__ import annotations

import json
import shutil
from contextlib import ExitStack

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("posfet_msgs", reason="needs the built workspace")

from rclpy.serialization import serialize_message

from posfet_model.sensor.scan import Scan
from posfet_msgs.msg import TactileRaw
from support.bringup_process import needs_installation
from support.expectations import TIMEOUT
from support.network_namespaces import (
    DISCOVERY_SERVER,
    INTERFACE,
    MULTICAST,
    SERVER,
    WAYS,
    discovery,
    hosts,
    why_not,
)

pytestmark = [pytest.mark.ros, pytest.mark.process, pytest.mark.slow, needs_installation]


@pytest.fixture(scope="module", autouse=True)
def namespaces_are_permitted() -> None:
    if reason := why_not():
        pytest.skip(reason)


def size_of_a_scan() -> int:
    """Return the serialized size of a scan of the default board on `raw`."""
    scan = Scan.empty(1, 25)
    message = TactileRaw(rows=5, cols=5, counts=scan.counts, temperatures=[0.0] * scan.temperatures.size)
    message.header.frame_id = "tactile_array"
    return len(serialize_message(message))


@pytest.mark.parametrize("way", WAYS)
def test_a_stack_is_used_from_another_host(way: str) -> None:
    if way == DISCOVERY_SERVER and shutil.which(SERVER) is None:
        pytest.skip(f"needs {SERVER} of Fast DDS")
    with ExitStack() as stack:
        robot, desk = made = stack.enter_context(hosts(2, multicast=way == MULTICAST))
        there, here = stack.enter_context(discovery(way, made))
        stack.enter_context(robot.running(["posfet", "bringup", "scene:=hold"], **there))
        count = ["posfet", "bandwidth", "--topics", "raw", "contacts", "--for", "1", "--wait", f"{TIMEOUT:g}"]
        counted = desk.run([*count, "--interface", INTERFACE, "--json"], 3 * TIMEOUT, **here)
        assert counted.returncode == 0, counted.stderr
        traffic = json.loads(counted.stdout)
        raw = traffic["topics"]["/tactile/raw"]
        assert raw["bytes"] == raw["messages"] * size_of_a_scan() > 0
        assert traffic["topics"]["/tactile/contacts"]["messages"] > 0
        assert traffic["received"] > traffic["sent"] > 0, "scans come from the other host"
        seen = desk.run(["posfet", "diagnostics", "--wait", f"{TIMEOUT:g}"], 2 * TIMEOUT, **here)
        assert "tactile/model_node: reconstruction" in seen.stdout, seen.stderr


def test_sensors_of_several_hosts_are_counted_together() -> None:
    with ExitStack() as stack:
        left, right, desk = made = stack.enter_context(hosts(3))
        there, here = stack.enter_context(discovery(MULTICAST, made))
        for host, name in ((left, "left"), (right, "right")):
            stack.enter_context(host.running(["posfet", "bringup", f"namespace:={name}/palm"], **there))
        words = ["posfet", "bandwidth", "--namespace", "left/palm", "right/palm", "--topics", "contacts"]
        words += ["--best-effort", "--for", "1", "--wait", f"{TIMEOUT:g}", "--json"]
        counted = desk.run(words, 3 * TIMEOUT, **here)
        assert counted.returncode == 0, counted.stderr
        assert set(json.loads(counted.stdout)["topics"]) == {"/left/palm/contacts", "/right/palm/contacts"}
