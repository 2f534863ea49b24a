# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

from __future__ import annotations

import os
import pty
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from posfet.terminal import log_capture
from posfet.terminal.log_capture import LogCapture


@contextmanager
def terminal() -> Iterator[int]:
    """Make standard error a terminal, whose other end is returned."""
    ours, theirs = pty.openpty()
    before = os.dup(2)
    os.dup2(theirs, 2)
    try:
        yield ours
    finally:
        os.dup2(before, 2)
        for number in (before, theirs, ours):
            os.close(number)


def test_lines_are_kept_out_of_the_picture_and_written_afterwards() -> None:
    with terminal() as other_end:
        with LogCapture() as log:
            os.write(2, b"\x1b[33m[WARN] [1700000000.123] [tactile.driver_node]: no traffic\x1b[0m\n")
            log.update()
            first = log.newest
            log.update()
            same = log.newest
            os.write(2, b"another line\n")
            log.update()
        written = os.read(other_end, 4096).decode().splitlines()
        os.write(2, b"directly\n")
        directly = os.read(other_end, 4096)
    assert (first, same, log.newest) == ("WARN: no traffic", "WARN: no traffic", "another line")
    assert written[1] == "another line"
    assert directly == b"directly\r\n"


def test_a_flood_is_limited(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(log_capture, "MOST", 100)
    with terminal() as other_end:
        with LogCapture() as log:
            for number in range(50):
                os.write(2, f"line {number}\n".encode())
                log.update()
        os.write(2, b"end")
        written = os.read(other_end, 4096)
    assert log.newest == "line 49"
    assert len(written) < 200
    assert b"\0" not in written


def test_what_is_no_terminal_is_left_alone(capfd: pytest.CaptureFixture[str]) -> None:
    with LogCapture() as log:
        print("to a file", file=sys.stderr, flush=True)
        log.update()
        assert log.newest == ""
    assert capfd.readouterr().err == "to a file\n"
