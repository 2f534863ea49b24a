# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Environment of a run: machine, versions, commit."""

from __future__ import annotations

import os
import platform
import subprocess
import time
from importlib import metadata
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("numpy", "python-can", "scipy", "cantools", "ros-jazzy-rclpy")


def facts() -> dict[str, str | float]:
    """Return flat facts by name."""
    return {
        "date": time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime()),
        "commit": _commit(),
        "processor": _processor(),
        "processors": float(os.cpu_count() or 0),
        "load_before": os.getloadavg()[0],
        "kernel": platform.release(),
        "python": platform.python_version(),
        "ngspice": _ngspice(),
        **{name: _version(name) for name in PACKAGES},
    }


def text() -> str:
    """Return one sentence on processor, Python, NumPy and commit."""
    versions = f"Python {platform.python_version()}, NumPy {_version('numpy')}"
    return f"Machine: {os.cpu_count()} processors, {_processor()}; {versions}; commit {_commit()}."


def _commit() -> str:
    def git(*words: str) -> str:
        try:
            run = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=False)
        except FileNotFoundError:
            return ""
        return run.stdout.strip()

    changed = git("status", "--porcelain", "--untracked-files=no", "--", "src", "benchmarks/*.py")
    return (git("rev-parse", "--short", "HEAD") or "unknown") + (" with changes" if changed else "")


def _processor() -> str:
    for line in Path("/proc/cpuinfo").read_text(encoding="ascii", errors="replace").splitlines():
        if line.startswith("model name"):
            return line.split(":", 1)[1].strip()
    return platform.machine()


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "none"


def _ngspice() -> str:
    try:
        log = subprocess.run(["ngspice", "--version"], capture_output=True, text=True, check=False, timeout=10).stdout
    except FileNotFoundError:
        return "none"
    words = next((line.split() for line in log.splitlines() if "ngspice-" in line), ["** ngspice-unknown"])
    return next((word.removeprefix("ngspice-") for word in words if word.startswith("ngspice-")), "unknown")
