# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Follow the README as a newcomer would, in an empty folder, and print how long each step took.

    python3 tools/newcomer.py

The repository is cloned into a temporary folder, with an empty home and no cache of pip or uv. The commands are those
of the documents: one that is no longer there ends the run. Needs what the README asks for, and nothing of this
repository.
"""

from __future__ import annotations

import argparse
import os
import platform
import queue
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
README = "README.md"
FIRST_CONTACT = "docs/first-contact.md"
GRASP = "docs/grasp.md"
KEPT = re.compile(r"(PIP_(?!CACHE|NO_CACHE)|SSL_|REQUESTS_|LANG$|TERM$|(NO|HTTPS?)_PROXY$)\w*", re.IGNORECASE)
"""Variables that reach the newcomer: how this machine reaches the network."""
LINK = re.compile(r"http://127\.0\.0\.1:\d+/\?token=\S+")
CONTACT = re.compile(r"#\d+: ")
PICTURE = b"data: "
TIMEOUT = 3600.0
"""Longest time for one step [s]."""


class Step(NamedTuple):
    """What was reached."""

    name: str
    goal: str
    seconds: float
    """Time since the clone began, or since the command of a second start [s]."""


class Newcomer:
    """Somebody with an empty home and a fresh clone.

    Parameters
    ----------
    folder : Path
        An empty folder.
    """

    def __init__(self, folder: Path) -> None:
        self.clone = folder / "posfet"
        home = folder / "home"
        home.mkdir()
        kept = {name: value for name, value in os.environ.items() if KEPT.match(name)}
        self.environment = {**kept, "HOME": str(home), "PATH": "/usr/local/bin:/usr/bin:/bin", "PIP_NO_CACHE_DIR": "1"}

    def documented(self, command: str, document: str = README) -> str:
        """Return a command; end the run unless the document has it."""
        if command not in (self.clone / document).read_text(encoding="utf-8"):
            raise SystemExit(f"{document} has no '{command}': it has changed, and so must this script")
        return command

    def run(self, *commands: str) -> None:
        """Run commands in a terminal of their own until they end; end the run if one fails."""
        line = " && ".join(commands)
        print(f"$ {line}", flush=True)
        subprocess.run(["bash", "-c", line], cwd=self.clone, env=self.environment, check=True, timeout=TIMEOUT)

    @contextmanager
    def running(self, *commands: str) -> Iterator[Callable[[re.Pattern[str]], str]]:
        """Run commands in a terminal of their own during the block, then press Ctrl-C.

        Yields
        ------
        callable
            Waits for a line of the output in which a pattern is found, and returns what was found.
        """
        line = " && ".join(commands)
        print(f"$ {line}", flush=True)
        process = subprocess.Popen(
            ["bash", "-c", line],
            cwd=self.clone,
            env={**self.environment, "PYTHONUNBUFFERED": "1"},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        lines: queue.SimpleQueue[str] = queue.SimpleQueue()

        def read() -> None:
            for each in process.stdout or ():
                lines.put(each)
            lines.put("")

        threading.Thread(target=read, daemon=True).start()

        def wait(pattern: re.Pattern[str]) -> str:
            while True:
                text = lines.get(timeout=TIMEOUT)
                if not text:
                    raise SystemExit(f"'{line}' has ended")
                if text.startswith(("posfet: ", "      ")):
                    print(text, end="", flush=True)
                if found := pattern.search(text):
                    return found[0]

        try:
            yield wait
        finally:
            os.killpg(process.pid, signal.SIGINT)
            process.wait(60)


def first_picture(link: str) -> None:
    """Return once the stream of the page has sent a picture."""
    address, _, query = link.partition("?")
    for path in ("", "stream"):
        with urllib.request.urlopen(f"{address}{path}?{query}", timeout=60) as answer:
            while path and PICTURE not in answer.readline():
                pass


def processor_seconds(group: int) -> float:
    """Return the processor time that the processes of a session have used, with those that have ended [s]."""
    ticks = 0
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rpartition(") ")[2].split()
        except OSError:
            continue
        if int(fields[3]) == group:
            ticks += sum(map(int, fields[11:15]))
    return ticks / os.sysconf("SC_CLK_TCK")


def follow(newcomer: Newcomer, source: str) -> Iterator[Step]:
    """Do what the documents say; yield what was reached."""
    begin = time.monotonic()

    def reached(name: str, goal: str = "") -> Step:
        return Step(name, goal, time.monotonic() - begin)

    subprocess.run(["git", "clone", "--quiet", source, str(newcomer.clone)], check=True)
    yield reached("clone")
    bringup = newcomer.documented("make bringup WEB=1")
    shell = newcomer.documented("source tools/environment.sh", FIRST_CONTACT)
    with newcomer.running(bringup) as wait:
        first_picture(wait(LINK))
        yield reached("moving picture in a browser: first frame of its stream")
        with newcomer.running(shell, newcomer.documented("python3 examples/listener.py", FIRST_CONTACT)) as heard:
            heard(CONTACT)
        yield reached("a working subscriber: a contact in its output", "5 min")
        newcomer.run(shell, newcomer.documented("posfet record first.mcap --for 5", FIRST_CONTACT))
        calibrate = newcomer.documented("posfet calibrate cal.yaml --seed 0", FIRST_CONTACT)
        replay = "posfet replay first.mcap --out calibrated.mcap calibration_file:=cal.yaml"
        newcomer.run(shell, calibrate, newcomer.documented(replay, FIRST_CONTACT))
        yield reached("a recording, replayed with a calibration", "10 min")
    grasp = newcomer.documented("python -m examples.grasp_mujoco run")
    newcomer.run(newcomer.documented("make build", GRASP), shell, grasp)
    yield reached("the grasp demo has ended, the object is held", "15 min")


def second_start(newcomer: Newcomer) -> Iterator[Step]:
    """Start again; yield the time to the first picture, and the processor time up to then."""
    begin = time.monotonic()
    with newcomer.running(f"echo $$ && exec {newcomer.documented('make bringup WEB=1')}") as wait:
        session = int(wait(re.compile(r"^\d+$")))
        first_picture(wait(LINK))
        yield Step("second start, to the first frame", "2 s", time.monotonic() - begin)
        yield Step("the same in processor time", "2 s", processor_seconds(session))


def machine() -> str:
    """Return one sentence on this machine."""
    model = "unknown processor"
    for line in Path("/proc/cpuinfo").read_text(encoding="ascii", errors="replace").splitlines():
        if line.startswith("model name"):
            model = line.partition(":")[2].strip()
    load = ", ".join(f"{each:.1f}" for each in os.getloadavg())
    return f"{os.cpu_count()} processors ({model}), Python {platform.python_version()}, load {load} before"


def main(words: Sequence[str] | None = None) -> int:
    """Print what was reached and after what time, as a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--source", default=str(ROOT), help="what is cloned (default: this repository)")
    parser.add_argument("--starts", type=int, default=3, help="further starts that are timed (default: 3)")
    options = parser.parse_args(words)
    described = machine()
    steps = []
    with tempfile.TemporaryDirectory(prefix="newcomer") as folder:
        newcomer = Newcomer(Path(folder))
        for step in follow(newcomer, options.source):
            steps.append(step)
            print(f"--- {step.seconds:.0f} s: {step.name}", flush=True)
        for _ in range(options.starts):
            steps += second_start(newcomer)
    print(f"\n{described}\n\n| reached | after | goal |\n|---|---|---|")
    for step in steps:
        print(f"| {step.name} | {step.seconds:.{0 if step.seconds > 60 else 1}f} s | {step.goal} |")
    return 0


if __name__ == "__main__":
    sys.exit(main())
