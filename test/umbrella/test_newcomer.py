# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""tools/newcomer.py follows commands that the documents have, and measures what it says; it is run by hand."""

from __future__ import annotations

import re
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

from support.paths import ROOT

SPEC = spec_from_file_location("newcomer", ROOT / "tools/newcomer.py")
assert SPEC
assert SPEC.loader
NEWCOMER = module_from_spec(SPEC)
SPEC.loader.exec_module(NEWCOMER)
LINK = "http://127.0.0.1:1234/?token=abc"


@pytest.fixture
def reader(tmp_path: Path) -> object:
    """A newcomer who reads the documents of this repository, and runs nothing."""

    class Reader(NEWCOMER.Newcomer):
        def __init__(self) -> None:
            super().__init__(tmp_path)
            self.clone = ROOT
            self.lines: list[str] = []

        def run(self, *commands: str) -> None:
            self.lines.append(" && ".join(commands))

        @contextmanager
        def running(self, *commands: str) -> Iterator[Callable[[re.Pattern[str]], str]]:
            self.run(*commands)
            said = f"posfet: in a browser on this machine: {LINK}\n#1: 0.27 N"
            yield lambda pattern: pattern.search(said)[0] if pattern.search(said) else "1"

    return Reader()


def test_each_command_is_in_the_documents(reader, monkeypatch: pytest.MonkeyPatch) -> None:
    cloned: list[list[str]] = []
    pictures: list[str] = []
    monkeypatch.setattr(NEWCOMER.subprocess, "run", lambda words, check: cloned.append(words))
    monkeypatch.setattr(NEWCOMER, "first_picture", pictures.append)
    steps = [*NEWCOMER.follow(reader, "somewhere"), *NEWCOMER.second_start(reader)]
    assert cloned[0][:2] == ["git", "clone"]
    assert pictures == [LINK, LINK]
    assert [step.goal for step in steps] == ["", "", "5 min", "10 min", "15 min", "2 s", "2 s"]
    assert [line.partition(" ")[0] for line in reader.lines] == ["make", "source", "source", "source", "make", "echo"]
    with pytest.raises(SystemExit, match="has no 'make coffee'"):
        reader.documented("make coffee")


def test_the_first_picture_is_an_event_of_the_stream() -> None:
    asked: list[str] = []

    class Page(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            asked.append(self.path)
            self.send_response(200)
            self.end_headers()
            self.wfile.write(b": nothing yet\n\nevent: frame\ndata: {}\n\n" if "stream" in self.path else b"page")

        def log_message(self, *_: object) -> None:
            pass

    with HTTPServer(("127.0.0.1", 0), Page) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        NEWCOMER.first_picture(f"http://127.0.0.1:{server.server_address[1]}/?token=abc")
        server.shutdown()
        thread.join()
    assert asked == ["/?token=abc", "/stream?token=abc"]


def test_the_processor_time_of_a_session_is_that_of_its_processes() -> None:
    busy = "from time import process_time\nwhile process_time() < 0.3: pass\nprint(flush=True); input()"
    with subprocess.Popen(
        [sys.executable, "-c", busy], stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
    ) as process:
        process.stdout.readline()
        spent = NEWCOMER.processor_seconds(process.pid)
        process.communicate(b"\n")
    assert 0.25 <= spent < 3.0, "0.3 s, counted in ticks of 10 ms"


def test_the_home_and_the_environment_are_empty(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", "/somewhere")
    monkeypatch.setenv("ROS_DISTRO", "jazzy")
    monkeypatch.setenv("PIP_CACHE_DIR", "/cache")
    newcomer = NEWCOMER.Newcomer(tmp_path)
    assert newcomer.environment.keys().isdisjoint({"PYTHONPATH", "ROS_DISTRO", "PIP_CACHE_DIR"})
    assert list(Path(newcomer.environment["HOME"]).iterdir()) == []
