# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Set-up from nothing: `make build` in a fresh clone, with .venv and all packages."""

from __future__ import annotations

import os
import re
import resource
import shutil
import subprocess
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from benchmarks.outcome import Outcome, Table

ROOT: Final = Path(__file__).resolve().parents[2]
ENVIRONMENT: Final = "posfet: set up in "
"""Begin of the line that says how long the set-up of .venv took [s]."""
NO_CACHE: Final = {"PIP_NO_CACHE_DIR": "1", "UV_NO_CACHE": "1"}
"""Environment variables with which every package is downloaded."""


def unavailable(environment: Mapping[str, str]) -> str:
    """Return why nothing can be measured here, '' if it can."""
    if environment.get("ROS_DISTRO"):
        return "with a sourced ROS 2 no .venv is set up; in a shell without it: make bench ONLY=setup"
    if shutil.which("git", path=environment.get("PATH", "")) is None:
        return "git is not on PATH. Install with: sudo apt-get install git"
    if not (ROOT / ".git").exists():
        return f"{ROOT} is no clone of the repository"
    return ""


def clean(environment: Mapping[str, str]) -> dict[str, str]:
    """Return the environment without what belongs to this .venv, in which `make` would build otherwise."""
    own = {"VIRTUAL_ENV", "PYTHONPATH", "PYTHONHOME", "AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH", "COLCON_PREFIX_PATH",
           "LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE", "MAKEFLAGS", "MFLAGS", "MAKELEVEL"}  # fmt: skip
    left = {name: value for name, value in environment.items() if name not in own}
    places = [place for place in left.get("PATH", "").split(os.pathsep) if not place.startswith(f"{ROOT}{os.sep}")]
    return left | {"PATH": os.pathsep.join(places)}


def failure(output: str) -> str:
    """Return the last line of an output, in which `make` says why it failed."""
    lines = [line.strip() for line in output.splitlines() if line.strip()]
    return lines[-1] if lines else "no output"


def measure(full: bool) -> Outcome:
    """Set up once."""
    del full
    reason = unavailable(os.environ)
    if reason:
        return Outcome(skipped=reason)
    with tempfile.TemporaryDirectory(prefix="posfet-setup-") as folder:
        clone = Path(folder) / "posfet"
        subprocess.run(["git", "clone", "--quiet", "--no-hardlinks", str(ROOT), str(clone)], check=True)
        before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
        made = subprocess.run(
            ["make", "build"], cwd=clone, env=clean(os.environ) | NO_CACHE, capture_output=True, text=True, check=False
        )
        seconds, after = time.monotonic() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
        return outcome(made.returncode, made.stdout + made.stderr, seconds, sum(after[:2]) - sum(before[:2]))


def outcome(code: int, output: str, seconds: float, processor: float) -> Outcome:
    """Return the result of `make build` from its exit code, output, duration [s] and processor time [s].

    Skipped without the packages of .venv, which a network has; raises RuntimeError if they do not build.
    """
    found = re.search(f"^{re.escape(ENVIRONMENT)}([0-9]+) s$", output, re.MULTILINE)
    if found is None:
        return Outcome(skipped=f"the packages of .venv cannot be had here: {failure(output)}")
    if code:
        raise RuntimeError(f"make build failed in a fresh clone: {failure(output)}")
    environment = float(found[1])
    rows = [(".venv with its packages", environment), ("build", seconds - environment), ("both", seconds)]
    note = (
        f"From a clone to a built workspace, once; {processor:.0f} s of processor time. Everything is downloaded: the "
        "network counts, and no cache of pip or uv."
    )
    return Outcome({"setup_s": seconds, "setup_cpu_s": processor}, [Table("Set-up", ("part", "s"), rows, note)])
