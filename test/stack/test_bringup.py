# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The `bringup` executable as users start it: real processes, their topics and their exits."""

from __future__ import annotations

import fcntl
import os
import pty
import re
import signal
import subprocess
import termios
import time
from collections.abc import Sequence
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2")
pytest.importorskip("posfet_msgs", reason="needs the built workspace")

from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.srv import GetParameters

from posfet.graph import emulated_adapter
from posfet_msgs.msg import TactileContacts
from support.bringup_process import bringup, finish, needs_installation, running
from support.expectations import TIMEOUT, Listener, expect_info, expect_stack
from support.long_cases import long_cases

pytestmark = [pytest.mark.ros, pytest.mark.process, needs_installation]

TOUCHED = 1000
"""Number of valid scans with a contact after which the summary includes it several times."""
VARIANTS = {
    "composed, simulated board": ["source:=sim"],
    "composed, emulated adapter, CAN FD": ["source:=emulator"],
    "composed, virtual bus": ["source:=emulator", "bus_interface:=virtual", "bus_channel:=bringup"],
    "separate, simulated board": ["source:=sim", "composed:=false"],
    "separate, emulated adapter": ["source:=emulator", "composed:=false"],
}


@pytest.mark.parametrize(
    "arguments", long_cases(VARIANTS, ["composed, simulated board", "composed, emulated adapter, CAN FD"])
)
def test_the_stack_reports_the_contacts_of_the_scene(arguments: Sequence[str]) -> None:
    with running("imperfections:=none", *arguments) as process, Listener() as listener:
        expect_stack(listener)
        output = finish(process)
    # A board in the same process has no link that loses frames; a late machine leaves out scans.
    lost = "0" if arguments == ["source:=sim"] else r"\d+"
    assert re.search(rf"posfet: .* {lost} frames lost, \d+ scans missing", output), output


def run_until_touched(*arguments: str) -> str:
    """Run `posfet bringup` until a touch has been reported and included in the summary; return its output."""
    with running(*arguments) as process, Listener() as listener:
        contacts: list[TactileContacts] = listener.collect(TactileContacts, "contacts")
        listener.wait(lambda: sum(found.data_valid and bool(found.contacts) for found in contacts) > TOUCHED, "a touch")
        return finish(process)


def test_classic_can_frames_give_contacts() -> None:
    output = run_until_touched("source:=emulator", "can_fd:=false")
    assert re.search(r"posfet: .*, [1-9]\d* contacts?, centre-of-pressure error", output), output


@pytest.mark.parametrize("source", long_cases(["sim", "emulator"], ["emulator"]))
def test_a_non_ideal_board_is_read(source: str) -> None:
    output = run_until_touched(f"source:={source}")
    summary = re.search(r"posfet: .*, \d+ frames lost, .* contacts?, .* error ([\d.]+) mm \(median\)", output)
    assert summary, output
    assert 0.0 < float(summary[1]) < 0.1


def test_two_sensors_run_side_by_side() -> None:
    with running("namespace:=hand/thumb"), running("namespace:=hand/palm", "scene:=idle"):
        for namespace in ("hand/thumb", "hand/palm"):
            with Listener(namespace) as listener:
                expect_info(listener)


@pytest.mark.parametrize("composed", long_cases(["true", "false"], ["false"]))
def test_a_limited_run_ends_with_a_summary(composed: str) -> None:
    result = bringup("--for", "10", f"composed:={composed}")
    assert result.returncode == 0, result.stderr
    lines = result.stdout.splitlines()
    assert "scans/s" in lines[0]
    assert re.fullmatch(r"posfet: .* scans/s, \d+ frames lost, \d+ scans missing, .*", lines[-1])


def test_live_display_in_a_terminal() -> None:
    """A live display replaces the lines, no log line is written into it, and a key ends it."""
    master, slave = pty.openpty()
    environment = {**os.environ, "TERM": "xterm-256color", "COLUMNS": "120", "LINES": "40"}
    process = subprocess.Popen(
        ["posfet", "bringup"],
        stdin=slave,
        stdout=slave,
        stderr=slave,
        env=environment,
        start_new_session=True,
        preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),  # noqa: PLW1509  # one system call
    )
    os.close(slave)
    expected = {"force on each taxel [mN]", "contacts", "held", "frames lost", "INFO: simulating scene", "q quit"}
    shown = b""
    picture = 0
    try:
        while chunk := os.read(master, 65536):
            shown += chunk
            if expected and all(word in shown.decode(errors="replace") for word in expected):
                os.write(master, b"q")
                expected.clear()
                picture = len(shown)
    except OSError:  # Linux reports the end of a pseudo-terminal by this error
        pass
    assert process.wait(timeout=TIMEOUT) == 0
    os.close(master)
    assert not expected, shown.decode(errors="replace")[-4000:]
    begin = shown.index(b"force on each taxel")
    assert b"[INFO]" not in shown[begin:picture]
    assert b"[INFO]" in shown[picture:]  # afterwards, all of them
    assert b"posfet: " in shown[picture:]


BAD_INPUT = {
    "unknown argument": (["sourse:=sim"], "sourse: unknown argument, did you mean source? posfet bringup -s lists all"),
    "not an argument": (["sim"], "sim: must be an argument name:=value"),
    "not a choice": (["source:=usb"], "source: must be one of sim, can, emulator, replay, got 'usb'"),
    "not a bitrate": (["can_bitrate:=fast"], "can_bitrate: must be a whole number"),
    "no such sensor": (["sensor_file:=posfet_9x9"], "posfet_9x9: no such sensor"),
    "no such sensor file": (["sensor_file:=/nowhere/s.yaml"], "/nowhere/s.yaml: no such sensor file"),
    "no such scene": (["scene:=nowhere"], "nowhere: no such scene"),
    "no such imperfections": (["imperfections:=nowhere"], "nowhere: cannot be read"),
    "a bus for nobody": (["bus_interface:=virtual"], "bus_interface: needs source:=emulator"),
    "no such parameter file": (["params_file:=/nowhere/p.yaml"], "params_file: no such file: /nowhere/p.yaml"),
    "no such interface": (["source:=can", "can_interface:=carrier_pigeon"], "carrier_pigeon"),
    "bad namespace": (["namespace:=9 lives"], "namespace: must be names of a-z"),
}


NOT_BEFORE = ("no such interface", "no such parameter file")
"""Bad input that is found by what differs between one process and several."""


@pytest.mark.parametrize(
    ("arguments", "expected", "composed"),
    long_cases(
        {f"{name}-{composed}": (*case, composed) for composed in ("true", "false") for name, case in BAD_INPUT.items()},
        [*(f"{name}-true" for name in BAD_INPUT), *(f"{name}-false" for name in NOT_BEFORE)],
    ),
)
def test_invalid_input_ends_with_one_line(arguments: list[str], expected: str, composed: str) -> None:
    result = bringup("--for", "20", f"composed:={composed}", *arguments)
    assert result.returncode == 1, result.stdout
    assert expected in result.stderr
    assert len(result.stderr.splitlines()) == 1, result.stderr


def test_invalid_parameters_end_with_one_line(tmp_path: os.PathLike[str]) -> None:
    path = os.path.join(tmp_path, "parameters.yaml")
    for text, expected in (
        ("frame_id: hand", "frame_id: use the argument frame_id:=<name>: all nodes have the same frame"),
        ("display_rate: fast", "display_rate: must be a number with a decimal point in [0.1, 10000] Hz, got 'fast'"),
        ("frame: hand", "frame: unknown parameter, did you mean "),
        ("use_sim_time: 3", "use_sim_time"),
    ):
        with open(path, "w", encoding="utf-8") as file:
            file.write(f"/**:\n  ros__parameters:\n    {text}\n")
        result = bringup("--for", "20", f"params_file:={path}")
        assert result.returncode == 1
        assert expected in result.stderr
        assert "Traceback" not in result.stderr


def test_an_interface_that_cannot_be_opened_is_reported_with_the_reason() -> None:
    result = bringup("--for", "2", "source:=can", "can_interface:=socketcan", "can_channel:=can_nowhere")
    assert result.returncode == 1
    assert "can_nowhere" in result.stderr
    assert "Traceback" not in result.stderr


@pytest.mark.parametrize("composed", ["true", "false"])
def test_ctrl_c_during_startup_ends_without_a_traceback(composed: str) -> None:
    command = ["posfet", "bringup", f"composed:={composed}"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    loaded = Path(f"/proc/{process.pid}/maps")
    while process.poll() is None and "_rclpy" not in loaded.read_text(encoding="utf-8", errors="replace"):
        pass  # ends with the process, or once it starts to load ROS
    assert finish(process) is not None


def children(process: int) -> set[int]:
    """Return the running child processes of a process."""
    found = set()
    for status in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, parent = status.read_text(encoding="utf-8", errors="replace").rpartition(")")[2].split()[:2]
        except OSError:  # it has just ended
            continue
        if int(parent) == process and state != "Z":
            found.add(int(status.parent.name))
    return found


def test_nodes_end_when_bringup_is_killed() -> None:
    with running("source:=emulator", "composed:=false") as process, Listener() as listener:
        expect_info(listener)
        nodes = children(process.pid)
        assert len(nodes) == 3
        process.kill()
        end = time.monotonic() + TIMEOUT
        while any(Path(f"/proc/{node}").exists() for node in nodes):
            assert time.monotonic() < end, nodes
            time.sleep(0.01)


def test_a_second_emulator_in_a_namespace_is_rejected_in_one_line() -> None:
    link = emulated_adapter("twice")
    link.unlink(missing_ok=True)
    with running("source:=emulator", "namespace:=twice") as first:
        end = time.monotonic() + TIMEOUT
        while not link.is_symlink():
            assert time.monotonic() < end
            time.sleep(0.01)
        for composed in ("true", "false"):
            second = bringup("--for", "20", "source:=emulator", "namespace:=twice", f"composed:={composed}")
            assert second.returncode == 1
            assert "an emulated adapter is running here already" in second.stderr
            assert len(second.stderr.splitlines()) == 1, second.stderr
        assert re.search(r"posfet: .* frames lost", finish(first))


@pytest.mark.parametrize("composed", ["true", "false"])
def test_ros_arguments_move_rename_and_set_the_nodes(composed: str, tmp_path: Path) -> None:
    path = tmp_path / "parameters.yaml"
    path.write_text("/robot/hand/brain:\n  ros__parameters:\n    simulated: false\n", encoding="utf-8")
    rules = [
        "-r",
        "__ns:=/robot",
        "-r",
        "contacts:=touch",
        "-r",
        "model_node:__node:=brain",
        "-p",
        "use_sim_time:=true",
    ]
    words = ["namespace:=hand", f"composed:={composed}", f"params_file:={path}", "--ros-args", *rules]
    with running(*words, "-p", "not_ours:=1") as process, Listener("robot/hand") as listener:
        contacts = listener.collect(TactileContacts, "touch")
        expect_info(listener)  # says that it is simulated: arguments override the section of a node
        listener.wait(lambda: bool(contacts), "touch")
        wanted = {"/robot/hand/brain", "/robot/hand/sim_board_node"}
        listener.wait(lambda: wanted <= listener.node_names(), "the nodes")
        for node in wanted:
            request = GetParameters.Request(names=["use_sim_time"])
            assert listener.call(GetParameters, f"{node}/get_parameters", request).values[0].bool_value
        diagnostics = listener.collect(DiagnosticArray, "/diagnostics")
        listener.wait(lambda: bool(diagnostics), "diagnostics while no /clock runs")
        stamp = contacts[-1].header.stamp.sec
        assert abs(time.time() - stamp) < TIMEOUT  # the time of acquisition
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=TIMEOUT)
    assert process.returncode == 0, errors
    assert "ignored, this node has no such parameter: not_ours" in errors


@pytest.mark.parametrize("composed", ["true", "false"])
@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["--log-levl", "debug"], "unknown ROS arguments: ['--log-levl', 'debug']"),
        (["-r", "__node:=a/b"], "__node: must be a name without slashes"),
        (["-p", "seed:=7"], "-p seed: use the argument seed:=<value>, from which the nodes get it"),
    ],
)
def test_bad_ros_arguments_end_with_one_line(words: list[str], reason: str, composed: str) -> None:
    result = bringup(f"composed:={composed}", "--ros-args", *words)
    assert result.returncode == 1
    assert reason in result.stderr.splitlines()[-1]
    assert "Traceback" not in result.stderr


def test_show_args_describes_every_argument() -> None:
    result = bringup("--show-args")
    assert result.returncode == 0
    for name in (
        "source",
        "can_interface",
        "can_channel",
        "can_bitrate",
        "can_fd",
        "namespace",
        "sensor_file",
        "params_file",
        "scene",
        "composed",
        "log_level",
    ):
        assert re.search(rf"^  {name}$", result.stdout, re.MULTILINE), name
