# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The reference firmware of `firmware/` for tests: built once per run, in virtual time or behind a pseudo-terminal."""

from __future__ import annotations

import fcntl
import os
import select
import shutil
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from posfet_driver.bus.frame import Frame
from posfet_driver.bus.slcan_codec import encode_line, parse_line
from support.fake_board import PATIENCE

FIRMWARE = Path(__file__).resolve().parents[2] / "firmware"
COMPILER = shutil.which(os.environ.get("CC", "cc")) if shutil.which("make") else None


def make(folder: Path, *targets: str) -> None:
    """Build targets of the firmware's Makefile in a folder, which processes may share."""
    folder.mkdir(exist_ok=True)
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        command = ["make", "-s", "-C", str(FIRMWARE), f"OUT={folder}", *targets]
        subprocess.run(command, check=True, capture_output=True, text=True, env=_environment())


def _environment() -> dict[str, str]:
    """Return the environment without what a surrounding make hands down."""
    handed_down = {"MAKEFLAGS", "MAKELEVEL", "MFLAGS", "OUT"}
    return {name: value for name, value in os.environ.items() if name not in handed_down}


class VirtualBoard:
    """The board in virtual time: every method lets it act and returns the frames that it has sent."""

    def __init__(self, program: Path, *options: str) -> None:
        self._process = subprocess.Popen(
            [str(program), "--virtual", *options], stdin=subprocess.PIPE, stdout=subprocess.PIPE
        )

    def kill(self) -> None:
        """End the process after a failed test."""
        self._process.kill()
        self._process.communicate()

    def close(self) -> None:
        """End the process; fail if a sanitizer has found anything."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.close()
        code = self._process.wait(PATIENCE)
        self._process.stdout.close()
        assert code == 0

    def line(self, text: str) -> list[Frame]:
        """Send a line of docs/firmware.md."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(text.encode() + b"\n")
        self._process.stdin.flush()
        frames = []
        while (reply := self._process.stdout.readline().rstrip(b"\n")) not in (b".", b"?", b""):
            frame = parse_line(reply)
            assert frame is not None, reply
            frames.append(frame)
        assert reply == b".", f"{text}: {reply!r}"
        return frames

    def run_until(self, microseconds: int) -> list[Frame]:
        """Let the time pass to a moment."""
        return self.line(f"T {microseconds}")

    def send(self, frame: Frame) -> list[Frame]:
        """Give the board a frame."""
        return self.line("F " + encode_line(frame).decode().rstrip())


@contextmanager
def virtual_board(program: Path, *options: str) -> Iterator[VirtualBoard]:
    """Run a board in virtual time."""
    board = VirtualBoard(program, *options)
    try:
        yield board
    except BaseException:
        board.kill()
        raise
    board.close()


class TerminalBoard:
    """The board in real time behind a pseudo-terminal."""

    def __init__(self, process: subprocess.Popen[str], port: str) -> None:
        self.port = port
        self._process = process

    def power_cycle(self) -> None:
        """Switch the board off and on; its next boot has the next number."""
        self._process.send_signal(signal.SIGHUP)


@contextmanager
def terminal_board(program: Path, *options: str) -> Iterator[TerminalBoard]:
    """Run a board behind a pseudo-terminal; it must end cleanly."""
    process = subprocess.Popen([str(program), *options], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        assert select.select([process.stdout], [], [], PATIENCE)[0], "the board does not start"
        yield TerminalBoard(process, process.stdout.readline().strip())
    finally:
        process.terminate()
        _, errors = process.communicate(timeout=PATIENCE)
    assert (process.returncode, errors) == (0, "")
