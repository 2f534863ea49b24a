# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A new subscriber gets data at once, also after others were killed; nothing is left of them in shared memory."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from subprocess import PIPE, Popen

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("posfet_msgs", reason="needs the built workspace")

from support.bringup_process import needs_installation
from support.late_subscribers import (
    BUSY,
    PROFILES,
    TARGET,
    TOGETHER,
    Wait,
    clean_shared_memory,
    running,
    summary,
    waits,
)
from support.shared_memory import names, remove_abandoned

KILLS = 200
PROFILES_OF_THE_MIDDLEWARE = '<?xml version="1.0" encoding="UTF-8"?><dds><profiles/></dds>'
"""Settings that change nothing: the stack has those that Fast DDS begins with."""

pytestmark = [pytest.mark.ros, pytest.mark.process]


@needs_installation
def test_subscribers_get_data_after_others_were_killed() -> None:
    """How long they wait depends on the machine; `python -m support.late_subscribers` measures it."""
    with clean_shared_memory():
        with running(["posfet", "bringup", "imperfections:=none"]) as bringup:
            measured = waits(6, bringup.pid)
            assert bringup.poll() is None
        assert all(math.isfinite(wait.seconds) for wait in measured), summary(measured)


@contextmanager
def stack_on_a_busy_machine() -> Iterator[Popen[str]]:
    """Run a stack beside two processes that only compute."""
    with ExitStack() as stack:
        stack.enter_context(clean_shared_memory())
        bringup = stack.enter_context(running(["posfet", "bringup"]))
        waits(1, bringup.pid)  # until the stack is up
        for _ in range(2):
            stack.enter_context(running([sys.executable, "-c", BUSY], "kill"))
        yield bringup
        assert bringup.poll() is None


@needs_installation
@pytest.mark.slow
def test_no_subscriber_waits_for_more_than_half_a_second_after_200_were_killed() -> None:
    """Of the wait, the time for a processor does not count: that is the load of the machine."""
    with stack_on_a_busy_machine() as bringup:
        measured = waits(KILLS, bringup.pid)
    assert max(wait.with_a_processor for wait in measured) <= TARGET, summary(measured)


@needs_installation
@pytest.mark.slow
def test_with_the_settings_of_the_middleware_some_wait_for_longer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They wait for an announcement or a heartbeat, not for a processor: the measure above tells these apart."""
    profiles = tmp_path / "profiles.xml"
    profiles.write_text(PROFILES_OF_THE_MIDDLEWARE, encoding="utf-8")
    monkeypatch.setenv(PROFILES, str(profiles))
    measured: list[Wait] = []
    with stack_on_a_busy_machine() as bringup:
        while len(measured) < KILLS and not any(wait.with_a_processor > TARGET for wait in measured):
            measured += waits(TOGETHER, bringup.pid, len(measured))
    assert any(wait.with_a_processor > TARGET for wait in measured), summary(measured)


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
