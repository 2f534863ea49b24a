# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The command `posfet` itself, the variables of make, and `posfet doctor`."""

from __future__ import annotations

import fcntl
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from importlib import metadata
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

import posfet_model
from posfet import doctor
from posfet.cli import COMMANDS, main
from posfet.doctor import BAD, NOTE, OK, Finding
from posfet_driver.bus import can_interface
from support.paths import ROOT


def test_the_version_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"posfet {posfet_model.__version__}\n"


@pytest.mark.parametrize(
    ("word", "meant"), [("bringpu", "did you mean bringup? "), ("recrod", "did you mean record? "), ("xyz", "")]
)
def test_an_unknown_command_is_answered_with_the_most_similar(
    word: str, meant: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([word]) == 2
    error = capsys.readouterr().err
    assert error == f"posfet: unknown command '{word}', {meant}known are {', '.join(COMMANDS)}\n"


def test_a_missing_package_is_one_line(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.delitem(sys.modules, "posfet.displays", raising=False)
    monkeypatch.setitem(COMMANDS, "displays", ("posfet_no_such_package", ""))
    assert main(["displays"]) == 1
    error = capsys.readouterr().err
    assert error.startswith("posfet displays: needs the package posfet_no_such_package: source tools/environment.sh")
    assert error.count("\n") == 1
    monkeypatch.setitem(COMMANDS, "displays", ("posfet.no_such_module", ""))
    with pytest.raises(ModuleNotFoundError):
        main(["displays"])


@pytest.mark.skipif(shutil.which("make") is None, reason="needs make")
@pytest.mark.parametrize(
    ("word", "reason"),
    [
        ("SCEEN=hold", "unknown variable SCEEN (did you mean SCENE?); known are ARGS FOR "),
        ("scene=hold", "unknown variable scene (did you mean SCENE?); known are ARGS FOR "),
        ("COLOUR=1", "unknown variable COLOUR; known are ARGS FOR "),
    ],
)
def test_an_unknown_variable_of_make_is_refused(word: str, reason: str) -> None:
    run = subprocess.run(["make", "-n", "bringup", word], cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == 2
    assert reason in run.stderr
    assert run.stderr.count("\n") == 1


@pytest.mark.skipif(shutil.which("make") is None, reason="needs make")
def test_every_variable_that_a_target_uses_is_known() -> None:
    words = ["ARGS=x", "FOR=1", "FULL=1", "ONLY=x", "SCANS=1", "SCENE=x", "SOURCE=sim", "STEPS=1", "WEB=1"]
    run = subprocess.run(["make", "-n", "clean", *words], cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.stderr == ""
    assert run.returncode == 0
    text = (ROOT / "Makefile").read_text(encoding="utf-8")
    used = set(re.findall(r"\$\((?:if |or )?([A-Z]+)[,)]", text)) - {
        "IN",
        "MAKE",
        "SHELL",
        "PACKAGES",
        "SOURCES",
        "BUILT",
    }
    assert used - {"READY", "VARIABLES"} == {word.partition("=")[0] for word in words}


def found(find: Callable[[], Iterator[Finding]]) -> list[Finding]:
    return list(find())


def test_the_versions_are_listed_and_what_is_missing_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    def version(name: str) -> str:
        if name in {"python-can", "h5py"}:
            raise metadata.PackageNotFoundError
        return "1.2"

    monkeypatch.setattr(doctor.metadata, "version", version)
    findings = found(doctor.versions)
    assert findings[0].text.startswith(f"posfet {posfet_model.__version__}, ")
    lines = [each.line() for each in findings]
    assert "ok   numpy 1.2" in lines
    assert "BAD  no package python-can, which the driver and posfet can need: pip install python-can" in lines
    assert "note no package h5py, which posfet export FILE.h5 needs: pip install h5py" in lines


@pytest.mark.parametrize(
    ("environment", "level", "text"),
    [
        ({"ROS_DOMAIN_ID": "102"}, BAD, "ROS_DOMAIN_ID=102"),
        ({"ROS_DOMAIN_ID": "x"}, BAD, "ROS_DOMAIN_ID=x"),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCAL"}, BAD, "ROS_AUTOMATIC_DISCOVERY_RANGE=LOCAL"),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}, NOTE, "ROS traffic stays on this machine"),
        ({"ROS_LOCALHOST_ONLY": "1"}, NOTE, "ROS_LOCALHOST_ONLY is set and overrides the range"),
    ],
)
def test_the_environment_of_ros_is_checked(environment: dict[str, str], level: str, text: str) -> None:
    (finding,) = [each for each in doctor.ros_environment(environment) if each.text == text]
    assert finding.level == level
    assert finding.remedy
    assert BAD not in {each.level for each in doctor.ros_environment({"ROS_DOMAIN_ID": "7"})}


def test_a_serial_adapter_without_permission_names_the_group(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    port = tmp_path / "ttyACM0"
    port.touch()
    (fine,) = doctor.serial_adapters([str(tmp_path / "ttyACM*")])
    assert (fine.level, fine.text) == (OK, f"serial adapter {port}")
    monkeypatch.setattr(os, "access", lambda *_: False)
    monkeypatch.setattr(doctor.grp, "getgrgid", lambda _: type("Group", (), {"gr_name": "dialout"}))
    (refused,) = doctor.serial_adapters([str(tmp_path / "ttyACM*")])
    assert refused == Finding(
        BAD, f"serial adapter {port} may not be opened", "sudo usermod -aG dialout $USER, then log in again"
    )
    (none,) = doctor.serial_adapters([str(tmp_path / "ttyUSB*")])
    assert none.level == NOTE


@pytest.mark.parametrize(
    ("flags", "mtu", "carrier", "level", "text"),
    [
        ("0x41", "72", "1", OK, "SocketCAN can7 is up"),
        ("0x40", "72", "1", BAD, "the interface is down: sudo ip link set can7 up"),
        ("0x41", "16", "1", BAD, "carries classic CAN only (mtu 16): sudo ip link set can7 down; sudo ip link"),
        ("0x41", "72", "0", BAD, "SocketCAN can7 is bus-off: check wiring"),
    ],
)
def test_a_can_interface_that_cannot_be_used_is_said_with_its_remedy(
    flags: str, mtu: str, carrier: str, level: str, text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "can7"
    folder.mkdir()
    entries = {"type": "280", "flags": flags, "mtu": mtu, "carrier": carrier}
    for name, content in entries.items():
        (folder / name).write_text(content, encoding="ascii")
    monkeypatch.setattr(can_interface, "NETWORK_DEVICES", tmp_path)
    (finding,) = doctor.can_interfaces()
    assert finding.level == level
    assert text in finding.line()


@pytest.mark.skipif(not doctor.LOCKS.is_file(), reason="needs /proc/locks")
@pytest.mark.skipif(not os.access(doctor.SHARED_MEMORY, os.W_OK), reason="needs /dev/shm")
def test_what_killed_processes_left_in_shared_memory_is_counted() -> None:
    with TemporaryDirectory(dir=doctor.SHARED_MEMORY) as name, ExitStack() as held:
        folder = Path(name)
        for path in ("fastrtps_1", "fastrtps_1_el", "fastrtps_port7411", "fastrtps_port7411_sl", "other_el"):
            (folder / path).touch()
        for path in folder.glob("fastrtps_*_[es]l"):
            fcntl.flock(held.enter_context(path.open()), fcntl.LOCK_SH)
        assert found(lambda: doctor.shared_memory(folder)) == [Finding(OK, f"no files of ended processes in {folder}")]
        held.close()
        (finding,) = doctor.shared_memory(folder)
        assert finding.line() == f"note 2 files of ended processes in {folder}: `fastdds shm clean` removes them"
        assert found(lambda: doctor.shared_memory(folder, folder / "none")) == []


def test_the_exit_code_says_whether_something_is_wrong(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    findings = [Finding(OK, "fine"), Finding(NOTE, "hint", "do")]
    monkeypatch.setattr(doctor, "checks", lambda: [("subject", lambda: iter(findings))])
    assert doctor.main([]) == 0
    assert capsys.readouterr().out == "subject\n  ok   fine\n  note hint: do\nno problem found\n"
    findings.append(Finding(BAD, "broken", "mend"))
    assert doctor.main([]) == 1
    assert capsys.readouterr().out.endswith("  BAD  broken: mend\n1 problem\n")


def test_a_calibration_folder_that_cannot_be_written_is_bad(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    assert BAD not in {finding.level for finding in found(doctor.folders)}
    (tmp_path / ".ros").touch()
    bad, _ = found(doctor.folders)
    why = f"{tmp_path}/.ros/posfet: the calibration folder cannot be written: {tmp_path}/.ros is not a folder"
    assert bad == Finding(BAD, why, "set calibration_folder:=<folder of yours>")
