# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The echo in C++: `python -m benchmarks.latency.processes.compiled_echo LIBRARY LINK SENSOR OUT`.

Starts the board as `echo.py` does, then calls the library that `compiled` has built of `compiled_echo.cpp`.
"""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Final

SOURCE: Final = Path(__file__).with_suffix(".cpp")
FOLDER: Final = Path(__file__).resolve().parents[3] / "build" / "benchmarks"
LIBRARIES: Final = ("rcl", "rcutils", "rmw", "rosidl_runtime_c")
TYPES: Final = "lib/libposfet_msgs__rosidl_typesupport_c.so"
COMPILE_TIMEOUT: Final = 120.0
PROBES: Final = (0x0102030405060708, 0x1112131415161718)
"""Sequences whose bytes find their place in a message."""


class CannotCompile(RuntimeError):
    """The library cannot be built here; the message says what is missing."""


def prefixes(environment: Mapping[str, str]) -> list[Path]:
    """Return the folders in which ROS packages are installed."""
    return [Path(name) for name in environment.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if name]


def found(places: list[Path], what: str) -> Path:
    """Return the first of the folders that has a file; raise CannotCompile naming it."""
    for place in places:
        if (place / what).exists():
            return place
    raise CannotCompile(f"{what} is in none of the folders of AMENT_PREFIX_PATH")


def command(environment: Mapping[str, str], out: Path) -> list[str]:
    """Return the words that build the library; raise CannotCompile if a compiler, headers or libraries are missing."""
    compiler = shutil.which("g++", path=environment.get("PATH", ""))
    if compiler is None:
        raise CannotCompile("g++ is not on PATH. Install with: sudo apt-get install g++")
    places = prefixes(environment)
    headers = found(places, "include/rcl/rcl/rcl.h") / "include"
    libraries = found(places, "lib/librcl.so") / "lib"
    words = [compiler, "-std=c++17", "-O2", "-shared", "-fPIC", str(SOURCE), "-o", str(out), f"-L{libraries}", "-ldl"]
    words += [f"-I{folder}" for folder in sorted(headers.iterdir()) if folder.is_dir()]
    return words + [f"-l{name}" for name in LIBRARIES]


def compiled(environment: Mapping[str, str] = os.environ) -> Path:
    """Return the library, built if its source is newer; raise CannotCompile with the reason if it cannot be built."""
    library = FOLDER / f"{SOURCE.stem}.so"
    if library.exists() and library.stat().st_mtime > SOURCE.stat().st_mtime:
        return library
    FOLDER.mkdir(parents=True, exist_ok=True)
    words = command(environment, library)
    run = subprocess.run(words, capture_output=True, text=True, check=False, timeout=COMPILE_TIMEOUT)
    if run.returncode:
        reason = next((line for line in run.stderr.splitlines() if "error" in line), "no error message")
        raise CannotCompile(f"{SOURCE.name} does not compile here: {reason.strip()}")
    return library


def position(one: bytes, other: bytes) -> int:
    """Return where the sequence is in a message, from two that were filled with the sequences PROBES."""
    places = [message.find(probe.to_bytes(8, "little")) for message, probe in zip((one, other), PROBES, strict=True)]
    if places[0] < 0 or places[0] != places[1]:
        raise ValueError(f"the sequence is at {places[0]} of one message and at {places[1]} of another")
    return places[0]


def main() -> None:
    """Start the board, then echo until interrupted."""
    from benchmarks.latency.processes.echo import empty_message, started_bus  # noqa: PLC0415  # need rclpy
    from posfet_model.ros import middleware  # noqa: PLC0415
    from posfet_model.sensor.description import load_sensor  # noqa: PLC0415

    library, link, sensor_file, out = sys.argv[1:]
    sensor = load_sensor(sensor_file)
    message = empty_message(sensor)
    one, other = (bytes(message(sequence)) for sequence in PROBES)
    types = found(prefixes(os.environ), TYPES) / TYPES
    board, bus = started_bus(link, sensor)
    echo = ctypes.CDLL(library).compiled_echo
    with middleware.applied():
        given = bus.fileno(), one, ctypes.c_size_t(len(one)), ctypes.c_size_t(position(one, other))
        code = echo(*given, bytes(types), out.encode())
    board.close()
    sys.exit(code)


if __name__ == "__main__":
    main()
