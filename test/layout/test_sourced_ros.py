# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The check of what is installed beside a sourced ROS 2, in an environment where it can be built."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterable
from pathlib import Path
from shutil import which

import pytest

from support.paths import ROOT

pytest.importorskip("rclpy", reason="needs ROS 2")
pytestmark = pytest.mark.skipif(which("colcon") is None or which("g++") is None, reason="needs colcon and g++")


def set_up(**variables: str) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"ROS_DISTRO": "jazzy"} | variables
    return subprocess.run(
        ["bash", ROOT / "tools/setup.sh"], env=environment, capture_output=True, text=True, check=False
    )


def without(tools: Iterable[str], folder: Path) -> str:
    """Return a search path with everything that setup.sh runs but some tools."""
    for name in {"bash", "dirname", "python3", "colcon", "cmake", "g++"} - set(tools):
        (folder / name).symlink_to(str(which(name)))
    return str(folder)


def test_an_environment_that_has_everything_is_used() -> None:
    done = set_up()
    assert (done.returncode, done.stdout) == (0, "posfet: using the sourced ROS 2 jazzy\n"), done.stderr


def test_missing_tools_are_named_with_their_packages(tmp_path: Path) -> None:
    done = set_up(PATH=without(["colcon", "cmake"], tmp_path))
    assert done.returncode == 1
    assert (
        "missing: colcon cmake. Install with: sudo apt-get install python3-colcon-common-extensions cmake"
        in done.stderr
    )


def test_missing_headers_are_named_with_their_packages(tmp_path: Path) -> None:
    (tmp_path / "g++").write_text("#!/bin/sh\nexit 1\n", encoding="utf-8")
    (tmp_path / "g++").chmod(0o755)
    done = set_up(PATH=f"{tmp_path}:{os.environ['PATH']}")
    assert done.returncode == 1
    assert "Install with: sudo apt-get install pybind11-dev python3-dev" in done.stderr
