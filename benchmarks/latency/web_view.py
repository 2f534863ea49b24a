# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Cost of the browser view: processor time above the bring-up, and how far the page is behind the sensor."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from http.client import HTTPConnection

import numpy as np

from benchmarks.outcome import Outcome, Table
from benchmarks.timing import processor_seconds

TIMEOUT = 30.0
WINDOW = 3.0
"""Length of a window [s]; those with and without a page take turns, so that other load counts for both."""
SETTLE = 3.0
"""Time from the first frame to the first window [s]."""


@contextmanager
def running(folder: str, *words: str) -> Iterator[tuple[int, int, str]]:
    """Run a command of posfet with a browser view; yield process id, port and token."""
    code = "import sys; from posfet.cli import main; sys.exit(main(sys.argv[1:]))"
    environment = os.environ | {"XDG_RUNTIME_DIR": folder, "PYTHONUNBUFFERED": "1"}
    command = [sys.executable, "-c", code, *words]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)
    try:
        assert process.stdout
        found = re.search(r"127\.0\.0\.1:(\d+)/\?token=(\S+)", process.stdout.readline())
        if not found:
            raise RuntimeError(f"{' '.join(words)}: no link")
        yield process.pid, int(found[1]), found[2]
    finally:
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=TIMEOUT)


def frames(port: int, token: str) -> Iterator[tuple[float, int]]:
    """Yield how far the sensor's newest frame is behind [s], and the bytes of the event, for each event of a stream."""
    connection = HTTPConnection("127.0.0.1", port, timeout=TIMEOUT)
    connection.request("GET", f"/stream?token={token}")
    response = connection.getresponse()
    kind = b""
    try:
        while line := response.readline():
            if line.startswith(b"event: "):
                kind = line
            elif line.startswith(b"data: ") and b"frame" in kind:
                arrived = time.time()
                (frame,) = json.loads(line[6:])
                if frame:
                    yield arrived - frame["stamp"] * 1e-3, len(line)
    finally:
        connection.close()


def share(pid: int, stream: Iterator[tuple[float, int]] | None) -> tuple[float, list[tuple[float, int]]]:
    """Return the share of a core [%] in a window, and the frames that were read meanwhile."""
    begin, used = time.monotonic(), processor_seconds(pid)
    read: list[tuple[float, int]] = []
    while (left := begin + WINDOW - time.monotonic()) > 0:
        if stream is None:
            time.sleep(left)
        else:
            read.append(next(stream))
    return 100 * (processor_seconds(pid) - used) / (time.monotonic() - begin), read


def cost(pid: int, port: int, token: str, pairs: int) -> tuple[float, float, list[tuple[float, int]]]:
    """Return the median share of a core [%] without a page, and with one, and all frames."""
    first = frames(port, token)
    next(first)
    first.close()
    time.sleep(SETTLE)
    without, with_page, read = [], [], []
    for _ in range(pairs):
        without.append(share(pid, None)[0])
        stream = frames(port, token)
        next(stream)
        percent, found = share(pid, stream)
        stream.close()
        with_page.append(percent)
        read += found
    return statistics.median(without), statistics.median(with_page), read


def measure(full: bool) -> Outcome:
    """Measure bring-up with a page, and `posfet view --web` beside it."""
    pairs = 8 if full else 3
    stack = ("bringup", "--web", "scene:=hold", "log_level:=warn")
    with tempfile.TemporaryDirectory() as folder, running(folder, *stack) as (pid, port, token):
        without, with_page, read = cost(pid, port, token, pairs)
        with running(folder, "view", "--web-port", str(_free_port())) as (viewer, viewer_port, viewer_token):
            viewer_without, viewer_with, viewer_read = cost(viewer, viewer_port, viewer_token, 1)
    rows = []
    for name, low, high, found in (
        ("make bringup WEB=1", without, with_page, read),
        ("posfet view --web, a process of its own", viewer_without, viewer_with, viewer_read),
    ):
        behind = np.array([each for each, _ in found]) * 1e3
        rate = len(found) / (WINDOW * (pairs if found is read else 1))
        quantiles = np.quantile(behind, [0.5, 0.99])
        size = statistics.median(size for _, size in found)
        rows.append((name, low, high, high - low, rate, float(quantiles[0]), float(quantiles[1]), size))
    values = {"web_cpu_pct": with_page - without, "web_behind_p99_ms": rows[0][6]}
    columns = (
        "command",
        "without a page, % of a core",
        "with one",
        "difference",
        "frames/s",
        "behind p50 ms",
        "p99 ms",
        "bytes",
    )
    note = "5 x 5 at 1 kHz, one page. Behind: from the acquisition of a scan to its frame in the client."
    return Outcome(values, [Table("Browser view", columns, rows, note)])


def _free_port() -> int:
    """Return a port that nobody uses: the second process must not wait for that of the first."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        return int(listener.getsockname()[1])
