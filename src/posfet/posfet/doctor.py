# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""`posfet doctor`: check this machine, and say what to do about what is wrong."""

from __future__ import annotations

import argparse
import glob
import grp
import importlib.util
import os
import platform
import re
import shutil
import socket
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Final

import posfet_model
from posfet_driver.bus import can_interface
from posfet_driver.tools.list_boards import SERIAL_PORTS
from posfet_model.calibration.calibration_folder import write_problem
from posfet_model.parameters import CALIBRATION_FOLDER
from posfet_model.sensor.description import load_sensor

OK: Final = "ok"
NOTE: Final = "note"
BAD: Final = "BAD"
"""Results of a check; only BAD changes the exit code."""
PYTHON: Final = (3, 10), (3, 13)
"""Oldest and newest tested versions of Python."""
PACKAGES: Final = {
    "numpy": "", "PyYAML": "", "rich": "", "python-can": "the driver and posfet can",
    "mcap": "recordings", "h5py": "posfet export FILE.h5", "pyarrow": "posfet export FILE.parquet",
    "joblib": "posfet score --jobs",
}  # fmt: skip
"""Packages of Python by their names for pip: what needs them; '' for everything."""
OPTIONAL: Final = ("h5py", "pyarrow", "joblib")
ROS_PACKAGES: Final = ("rclpy", "posfet_msgs")
LARGEST_DOMAIN: Final = 101
"""Largest ROS_DOMAIN_ID whose ports are below those that Linux gives to other programs."""
RANGES: Final = ("SUBNET", "LOCALHOST", "OFF", "SYSTEM_DEFAULT")
MIN_FREE: Final = 1e9
"""Free space below which recordings are mentioned [byte]."""
SHARED_MEMORY: Final = Path("/dev/shm")
"""Where Fast DDS keeps shared memory, each with a file that its process keeps locked."""
LOCKS: Final = Path("/proc/locks")
EXCHANGE_TIMEOUT: Final = 10.0
"""Time in which a message must arrive through the middleware [s]."""


@dataclass(frozen=True)
class Finding:
    """Result of a check."""

    level: str
    """OK, NOTE or BAD."""
    text: str
    """What was found."""
    remedy: str = ""
    """What to do, in one line; '' if there is nothing to do."""

    def line(self) -> str:
        """Return the finding in one line."""
        return f"{self.level:5}{self.text}" + (f": {self.remedy}" if self.remedy else "")


def versions() -> Iterator[Finding]:
    """Check Python and its packages.

    Yields
    ------
    Finding
        A finding.
    """
    yield Finding(OK, f"posfet {posfet_model.__version__}, {platform.system()} {platform.machine()}")
    version = sys.version_info[:2]
    tested = PYTHON[0] <= version <= PYTHON[1]
    between = " to ".join(".".join(map(str, each)) for each in PYTHON)
    yield Finding(
        OK if tested else NOTE, f"Python {platform.python_version()}", "" if tested else f"tested with {between}"
    )
    for package, purpose in PACKAGES.items():
        try:
            yield Finding(OK, f"{package} {metadata.version(package)}")
        except metadata.PackageNotFoundError:
            wanted = f", which {purpose} need{'s' * purpose.startswith('posfet')}" if purpose else ""
            level = NOTE if package in OPTIONAL else BAD
            yield Finding(level, f"no package {package}{wanted}", f"pip install {package}")


def ros_environment(environment: Mapping[str, str]) -> Iterator[Finding]:
    """Check ROS 2 and its environment variables.

    Parameters
    ----------
    environment : mapping of str to str
        Environment of the process.

    Yields
    ------
    Finding
        A finding.
    """
    missing = [name for name in ROS_PACKAGES if importlib.util.find_spec(name) is None]
    for name in missing:
        level = NOTE if "rclpy" in missing else BAD  # the model and the simulated board run without ROS
        yield Finding(
            level, f"no package {name}", "source tools/environment.sh, or install/setup.bash of your workspace"
        )
    if not missing:
        distribution = environment.get("ROS_DISTRO") or "Jazzy of .venv"
        yield Finding(OK, f"ROS 2 ({distribution}), {environment.get('RMW_IMPLEMENTATION') or 'default middleware'}")
    domain = environment.get("ROS_DOMAIN_ID") or "0"
    if not (domain.isdecimal() and int(domain) <= LARGEST_DOMAIN):
        yield Finding(BAD, f"ROS_DOMAIN_ID={domain}", f"set a whole number in [0, {LARGEST_DOMAIN}]")
    found = environment.get("ROS_AUTOMATIC_DISCOVERY_RANGE") or "SUBNET"
    if found not in RANGES:
        yield Finding(BAD, f"ROS_AUTOMATIC_DISCOVERY_RANGE={found}", f"set one of {', '.join(RANGES)}")
    elif found == "LOCALHOST":
        yield Finding(NOTE, "ROS traffic stays on this machine", "ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET opens it")
    if environment.get("ROS_LOCALHOST_ONLY"):
        yield Finding(NOTE, "ROS_LOCALHOST_ONLY is set and overrides the range", "unset ROS_LOCALHOST_ONLY")


def serial_adapters(patterns: Sequence[str] = SERIAL_PORTS) -> Iterator[Finding]:
    """Check that serial adapters may be opened.

    Parameters
    ----------
    patterns : sequence of str, optional
        Patterns of their paths.

    Yields
    ------
    Finding
        A finding.
    """
    ports = sorted(port for pattern in patterns for port in glob.glob(pattern))
    if not ports:
        yield Finding(NOTE, f"no serial adapter ({', '.join(patterns)})", "source:=emulator needs none")
    for port in ports:
        if os.access(port, os.R_OK | os.W_OK):
            yield Finding(OK, f"serial adapter {port}")
        else:
            yield Finding(BAD, f"serial adapter {port} may not be opened", _permission(port))


def _permission(port: str) -> str:
    status = os.stat(port)
    try:
        group = grp.getgrgid(status.st_gid).gr_name
    except KeyError:
        group = str(status.st_gid)
    if group == "root":
        return f"sudo chmod a+rw {port}, or a udev rule"
    return f"sudo usermod -aG {group} $USER, then log in again"


def can_interfaces() -> Iterator[Finding]:
    """Check that CAN interfaces of the kernel are up.

    Yields
    ------
    Finding
        A finding.
    """
    names = can_interface.names()
    can = load_sensor().can
    if not names:
        yield Finding(NOTE, "no SocketCAN interface", "with an adapter: is its kernel driver loaded? see dmesg")
    for name in names:
        obstacle = can_interface.obstacle(name, can.fd, can.bitrate, can.data_bitrate)
        if obstacle:
            yield Finding(BAD, f"SocketCAN {name}", obstacle)
        elif can_interface.is_bus_off(name):
            yield Finding(
                BAD, f"SocketCAN {name} is bus-off", "check wiring, termination and bit rate; set restart-ms 100"
            )
        else:
            yield Finding(OK, f"SocketCAN {name} is up")


def folders() -> Iterator[Finding]:
    """Check where calibrations and recordings go.

    Yields
    ------
    Finding
        A finding.
    """
    if problem := write_problem(Path(str(CALIBRATION_FOLDER.default)).expanduser()):
        yield Finding(BAD, problem, "set calibration_folder:=<folder of yours>")
    free = shutil.disk_usage(Path.cwd()).free
    level, remedy = (OK, "") if free > MIN_FREE else (NOTE, "recordings need about 0.1 to 1 MB/s for each sensor")
    yield Finding(level, f"{free / 1e9:.1f} GB free in this folder", remedy)


def network() -> Iterator[Finding]:
    """Check that a UDP message reaches this machine's loopback interface.

    Yields
    ------
    Finding
        A finding.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        try:
            receiver.bind(("127.0.0.1", 0))
            receiver.settimeout(1.0)
            receiver.sendto(b"x", receiver.getsockname())
            receiver.recv(1)
        except OSError as error:
            yield Finding(BAD, f"loopback interface: {error}", "sudo ip link set lo up; check the firewall")
            return
    yield Finding(OK, "loopback interface")


def shared_memory(folder: Path = SHARED_MEMORY, locks: Path = LOCKS) -> Iterator[Finding]:
    """Check for what processes that were killed have left of Fast DDS in shared memory: files whose locks nobody holds.

    Parameters
    ----------
    folder : Path, optional
        Folder of the files.
    locks : Path, optional
        Locks that are held, as the kernel lists them; without it nothing is found.

    Yields
    ------
    Finding
        A finding.
    """
    if not locks.is_file():
        return
    held = set(re.findall(r"\b[0-9a-f]+:[0-9a-f]+:(\d+)\b", locks.read_text(encoding="ascii")))
    left = 0
    for path in folder.glob("fastrtps_*_[es]l"):
        with suppress(FileNotFoundError):  # its process has just ended
            left += str(path.stat().st_ino) not in held
    if left:
        files = "file" if left == 1 else "files"
        yield Finding(NOTE, f"{left} {files} of ended processes in {folder}", "`fastdds shm clean` removes them")
    else:
        yield Finding(OK, f"no files of ended processes in {folder}")


def middleware() -> Iterator[Finding]:
    """Check that a message of one participant reaches another one, and list the sensors that run.

    Yields
    ------
    Finding
        A finding.
    """
    if any(importlib.util.find_spec(name) is None for name in ROS_PACKAGES):
        return
    from posfet.middleware_check import exchange  # noqa: PLC0415  # needs ROS

    seconds, sensors = exchange(EXCHANGE_TIMEOUT)
    if seconds is None:
        yield Finding(
            BAD,
            f"no message within {EXCHANGE_TIMEOUT:g} s between two participants",
            "allow UDP multicast on this machine (firewall, VPN, container), or set "
            "ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST",
        )
        return
    yield Finding(OK, f"message between two participants after {seconds:.1f} s")
    running = f"running sensors: {', '.join(sensors)}" if sensors else "no sensor is running"
    yield Finding(OK if sensors else NOTE, running, "" if sensors else "posfet bringup starts one")


def checks() -> Iterator[tuple[str, Callable[[], Iterator[Finding]]]]:
    """Iterate over the checks.

    Yields
    ------
    tuple of str and callable
        Subject, '' where it is that of the check before, and what finds.
    """
    yield "versions", versions
    yield "adapters", serial_adapters
    yield "", can_interfaces
    yield "folders", folders
    yield "ROS 2", lambda: ros_environment(os.environ)
    yield "network", network
    yield "", shared_memory
    yield "", middleware


def main(words: Sequence[str] | None = None) -> int:
    """Print what was found, and return 0, or 1 if something is wrong.

    Parameters
    ----------
    words : sequence of str, optional
        Command line; default: that of the process.
    """
    parser = argparse.ArgumentParser(
        prog="posfet doctor",
        description="Check versions, adapters and their permissions, SocketCAN, folders, ROS 2 and its network; each "
        "line says what to do. Exit code 1 if something is BAD.",
    )
    parser.parse_args(words)
    bad = 0
    for subject, find in checks():
        if subject:
            print(subject)
        for finding in find():
            print(f"  {finding.line()}", flush=True)
            bad += finding.level == BAD
    print(f"{bad} problem{'s' * (bad != 1)}" if bad else "no problem found")
    return int(bad > 0)
