# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The stack as nodes of another program: the shipped example, and what does not fit."""

from __future__ import annotations

import re
import select
import signal
import subprocess
import sys
import time

import pytest

rclpy = pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("posfet_msgs", reason="needs the built workspace")

from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor

import posfet.bringup
from posfet_model.config import ConfigError
from posfet_msgs.msg import TactileContacts
from support.bringup_process import needs_installation
from support.expectations import TIMEOUT, Listener
from support.paths import EXAMPLES

FEW = 500
"""Messages after which contacts count as not valid: half a second, the time for which the example takes older ones."""

pytestmark = [pytest.mark.ros, pytest.mark.process, needs_installation]


def test_the_example_with_a_controller_on_the_same_executor_prints_the_force() -> None:
    """Or that it is unknown, where a machine that lost scans left none of the contacts valid."""
    command = [sys.executable, str(EXAMPLES / "one_executor.py")]
    with (
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process,
        Listener("hand/tactile") as listener,
    ):
        contacts = listener.collect(TactileContacts, "contacts")
        shown: list[str] = []
        end = time.monotonic() + TIMEOUT
        while not shown or shown[-1].endswith((" 0.00 N\n", "unknown\n")):
            contacts.clear()
            assert select.select([process.stdout], [], [], max(end - time.monotonic(), 0.0))[0], shown
            shown.append(process.stdout.readline())
            assert process.poll() is None, process.stderr.read()
            if shown[-1] == "contacts unknown\n":
                listener.wait(lambda: len(contacts) > FEW, "contacts")
                if not any(message.data_valid for message in contacts):
                    break
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=TIMEOUT)
    assert re.fullmatch(r"touched with \d\.\d\d N\n|contacts unknown\n", shown[-1])
    assert process.returncode == 0, errors
    assert "Traceback" not in errors


def test_nodes_of_two_sensors_share_an_executor_and_are_destroyed_at_the_end() -> None:
    context = Context()
    rclpy.init(context=context)
    executor = SingleThreadedExecutor(context=context)
    words = ["-r", "__ns:=/robot", "-r", "contacts:=touch"]
    with (
        posfet.bringup.nodes(context, words, namespace="thumb", scene="hold") as thumb,
        posfet.bringup.nodes(context, namespace="palm", scene="idle", composed=True) as palm,
    ):
        names = []
        for node in (*thumb, *palm):
            executor.add_node(node)
            names.append(node.get_fully_qualified_name())
        assert names == [
            "/robot/thumb/model_node",
            "/robot/thumb/sim_board_node",
            "/palm/model_node",
            "/palm/sim_board_node",
        ]
        assert thumb.nodes["model_node"].resolve_topic_name("contacts") == "/robot/thumb/touch"
        snapshots = [None]
        while None in snapshots:
            executor.spin_once(timeout_sec=0.05)
            snapshots = [thumb.snapshot(), palm.snapshot()]
        assert (thumb.failure, palm.failure) == ("", "")
        thumb.nodes["model_node"].failure = "cannot go on"
        assert thumb.failure == "cannot go on"
    executor.shutdown()
    rclpy.shutdown(context=context)


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [({"scene": "nowhere"}, "no such scene"), ({"sourse": "sim"}, "sourse: unknown argument")],
)
def test_arguments_that_do_not_fit_are_refused_in_one_line(arguments: dict[str, str], reason: str) -> None:
    with pytest.raises(ConfigError, match=reason), posfet.bringup.nodes(**arguments):
        pytest.fail("must not start")
