# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A new subscriber gets data at once, also after others were killed; nothing is left of them in shared memory."""

from __future__ import annotations

import math
import statistics
import sys
from contextlib import ExitStack
from pathlib import Path
from subprocess import PIPE, Popen

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("posfet_msgs", reason="needs the built workspace")

from support.bringup_process import needs_installation
from support.late_subscribers import TARGET, clean_shared_memory, running, summary, waits
from support.shared_memory import names, remove_abandoned

FEW = 20
"""First subscriptions: before much can have been left behind."""
TIMES_LONGER = 5.0
"""Longest wait, in times of the median of the first ones, when that is long: a lease of what was killed is 20 s."""

pytestmark = [pytest.mark.ros, pytest.mark.process]


@needs_installation
def test_subscribers_get_data_after_others_were_killed() -> None:
    """How long they wait depends on the machine; `python -m support.late_subscribers` measures it."""
    with clean_shared_memory():
        with running(["posfet", "bringup", "imperfections:=none"]) as bringup:
            measured = waits(6, bringup.pid)
            assert bringup.poll() is None
        assert all(math.isfinite(wait.seconds) for wait in measured), summary(measured)


@needs_installation
@pytest.mark.slow
def test_the_first_message_arrives_as_soon_after_200_subscriptions_as_after_the_first_ones() -> None:
    """What killed subscribers leave behind delays no other; within half a second, but on a machine that is busy."""
    with ExitStack() as stack:
        stack.enter_context(clean_shared_memory())
        bringup = stack.enter_context(running(["posfet", "bringup"]))
        waits(1, bringup.pid)  # until the stack is up
        for _ in range(2):
            stack.enter_context(running([sys.executable, "-c", "while True: pass"], "kill"))
        measured = waits(200, bringup.pid)
        assert bringup.poll() is None
    usual = statistics.median(wait.seconds for wait in measured[:FEW])
    assert all(wait.seconds <= max(TARGET, TIMES_LONGER * usual) for wait in measured), summary(measured)


LOCK = """
import fcntl, sys
file = open(sys.argv[1], "w")
fcntl.flock(file, fcntl.LOCK_EX)
print("locked", flush=True)
sys.stdin.read()
"""


def test_only_named_files_of_dead_processes_are_removed(tmp_path: Path) -> None:
    for name in ("fastrtps_dead", "fastrtps_alive", "fastrtps_other", "fastrtps_written"):
        (tmp_path / name).touch()
        if name != "fastrtps_written":
            (tmp_path / f"{name}_el").touch()
    (tmp_path / "sem.fastrtps_dead_mutex").touch()
    (tmp_path / "fastrtps_link_el").symlink_to(tmp_path / "fastrtps_other_el")
    everything = names(tmp_path)
    command = [sys.executable, "-c", LOCK, str(tmp_path / "fastrtps_alive_el")]
    with Popen(command, stdin=PIPE, stdout=PIPE, text=True) as process:
        assert process.stdout is not None
        process.stdout.readline()
        removed = remove_abandoned(everything - {"fastrtps_other", "fastrtps_other_el"}, tmp_path)
        process.communicate()
    assert removed == {"fastrtps_dead", "fastrtps_dead_el", "sem.fastrtps_dead_mutex"}
    assert names(tmp_path) == everything - removed
