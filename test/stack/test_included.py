# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The launch file in a robot's launch: namespaces, remaps, parameters, faults of ours, and its end by any signal."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from urllib.request import urlopen

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("launch", reason="needs launch; test_bringup.py passes the same ROS arguments to the executable")
pytest.importorskip("launch_ros", reason="needs launch_ros")

from launch import LaunchContext
from launch.actions import ExecuteProcess, LogInfo, Shutdown, TimerAction
from launch.launch_description_sources import load_python_launch_file_as_module
from rcl_interfaces.srv import GetParameters

from posfet_model.ros.exit_codes import PROCESS_FAILED
from posfet_msgs.msg import TactileContacts
from support.bringup_process import needs_installation
from support.expectations import TIMEOUT, Listener
from support.paths import LAUNCH

pytestmark = [pytest.mark.ros, pytest.mark.process, needs_installation]

LAUNCH_FILE = str(LAUNCH / "bringup.launch.py")
ROBOT = """
import sys
from launch import LaunchDescription, LaunchService
from launch.actions import ExecuteProcess, GroupAction, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch_ros.actions import PushRosNamespace, SetParameter, SetRemap

file, *words = sys.argv[1:]
included = IncludeLaunchDescription(
    PythonLaunchDescriptionSource(file), launch_arguments=[word.split(":=") for word in words]
)
group = GroupAction([
    PushRosNamespace("robot"), SetRemap("contacts", "touch"), SetParameter("use_sim_time", True),
    SetParameter("robot_name", "r2"), included,
])
others = ExecuteProcess(cmd=["cat"])  # ends with the launch, whose pipe it reads
service = LaunchService(noninteractive=True)
service.include_launch_description(LaunchDescription([others, group]))
sys.exit(service.run())
"""


@contextmanager
def robot(*words: str) -> Iterator[subprocess.Popen[str]]:
    """Run a robot's launch file that includes ours."""
    command = [sys.executable, "-c", ROBOT, LAUNCH_FILE, *words]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def children(process: int) -> dict[int, str]:
    """Return the running children of a process with their command lines."""
    found = {}
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            state, parent = (folder / "stat").read_text(encoding="utf-8").rpartition(")")[2].split()[:2]
            line = (folder / "cmdline").read_text(encoding="utf-8", errors="replace").replace("\0", " ")
        except OSError:  # it has just ended
            continue
        if int(parent) == process and state != "Z":
            found[int(folder.name)] = line
    return found


def wait_until_ended(processes: dict[int, str]) -> None:
    """Wait until none of the processes runs; fail after TIMEOUT."""
    end = time.monotonic() + TIMEOUT
    while alive := [line for pid, line in processes.items() if Path(f"/proc/{pid}/exe").exists()]:
        assert time.monotonic() < end, alive
        time.sleep(0.01)


def ours(process: int) -> dict[int, str]:
    return {pid: line for pid, line in children(process).items() if "posfet" in line}


@pytest.mark.parametrize(("composed", "number"), [("true", signal.SIGTERM), ("false", signal.SIGTERM)])
def test_an_included_stack_is_moved_remapped_and_ends_with_the_launch(composed: str, number: signal.Signals) -> None:
    # Texts that a parameter file without quotes would turn into a number.
    texts = {"serial": "0815", "frame_id": "1e5"}
    words = [f"composed:={composed}", *(f"{name}:={text}" for name, text in texts.items())]
    with robot(*words) as process, Listener("robot/tactile") as listener:
        contacts = listener.collect(TactileContacts, "touch")
        listener.wait(lambda: any(message.contacts for message in contacts), "a contact")
        assert contacts[-1].header.frame_id == texts["frame_id"]
        for name in ("model_node", "sim_board_node"):
            request = GetParameters.Request(names=["use_sim_time", "serial"])
            simulated, serial = listener.call(GetParameters, f"{name}/get_parameters", request).values
            assert simulated.bool_value
            assert serial.string_value == texts["serial"]
        nodes = ours(process.pid)
        assert len(nodes) == (1 if composed == "true" else 2)
        process.send_signal(number)
        wait_until_ended(nodes)


def test_a_killed_stack_is_started_again_with_all_that_the_launch_gave_it() -> None:
    with robot("respawn:=always") as process, Listener("robot/tactile") as listener:
        contacts = listener.collect(TactileContacts, "touch")
        listener.wait(lambda: bool(contacts), "contacts")
        first = ours(process.pid)
        subprocess.run(["kill", "-KILL", *map(str, first)], check=True)
        wait_until_ended(first)
        # Its command is that of the first, once it no longer is a copy of launch.
        listener.wait(lambda: list(ours(process.pid).values()) == list(first.values()), "the same process again")
        contacts.clear()
        listener.wait(lambda: bool(contacts), "contacts of the process that was started again")


def test_an_included_stack_is_shown_in_a_browser(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))  # port and token of no other test
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "log"))
    with robot("web:=true") as process:
        found = None
        while found is None:
            line = process.stdout.readline() or pytest.fail("the launch has ended")
            found = re.search(r"in a browser on this machine: (http://127\.0\.0\.1:\d+/\S*)", line)
        with urlopen(found[1], timeout=TIMEOUT) as answer:
            assert b"<title>" in answer.read()
    token = re.split(r"[=#?]", found[1])[-1]
    logs = [path for path in (tmp_path / "log").rglob("*") if path.is_file()]
    assert logs
    assert not [path for path in logs if token in path.read_text(encoding="utf-8", errors="replace")]


@pytest.mark.parametrize("composed", ["true", "false"])
@pytest.mark.parametrize("word", ["scene:=nowhere", "namespace:=9"])
def test_a_stack_that_is_not_required_fails_alone(composed: str, word: str) -> None:
    with robot("required:=false", f"composed:={composed}", word) as process:
        shown = ""
        while "the rest goes on (required:=false)" not in shown:
            shown += process.stdout.readline() or pytest.fail(shown)
        assert process.poll() is None
        end = time.monotonic() + TIMEOUT
        while not any(line.startswith("cat") for line in children(process.pid).values()):
            assert time.monotonic() < end
            time.sleep(0.01)
        assert process.poll() is None


def actions(code: int, *, required: bool = True, respawn: str = "on_internal_error", stopping: bool = False) -> Any:
    """Return what the launch file does when a process ends with an exit code."""
    file = load_python_launch_file_as_module(LAUNCH_FILE)
    context = LaunchContext()
    context._set_is_shutdown(stopping)
    event = SimpleNamespace(process_name="bringup-1", returncode=code, cmd=["true"], cwd=None, env={})
    return file.on_exit(required, respawn)(event, context)


@pytest.mark.parametrize(
    ("code", "options", "kinds"),
    [
        (PROCESS_FAILED, {}, [ExecuteProcess]),
        (PROCESS_FAILED, {"required": False}, [ExecuteProcess]),
        (PROCESS_FAILED, {"required": False, "respawn": "never"}, [LogInfo]),
        (0, {}, [Shutdown]),
        (-9, {}, [Shutdown]),
        (0, {"required": False}, [LogInfo]),
        (1, {"required": False}, [LogInfo]),
        (1, {"respawn": "always"}, [TimerAction]),
        (PROCESS_FAILED, {"respawn": "always"}, [ExecuteProcess]),
        (0, {"stopping": True}, []),
        (1, {"stopping": True, "respawn": "always"}, []),
    ],
)
def test_what_follows_the_end_of_a_process(code: int, options: dict[str, Any], kinds: list[type]) -> None:
    assert [type(action) for action in actions(code, **options)] == kinds


@pytest.mark.parametrize(("code", "respawn"), [(1, "on_internal_error"), (PROCESS_FAILED, "never")])
def test_a_required_process_that_failed_for_good_fails_the_launch(code: int, respawn: str) -> None:
    with pytest.raises(RuntimeError, match=f"bringup-1 failed with exit code {code}"):
        actions(code, respawn=respawn)
