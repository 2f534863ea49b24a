# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""An emulated slcan adapter on a pseudo-terminal, with a simulated board behind it."""

from __future__ import annotations

import os
import secrets
import select
import threading
import tty
from collections import deque
from pathlib import Path
from typing import Final

from posfet_driver.board.scan_source import SourceError
from posfet_driver.bus.bus_error import one_line
from posfet_driver.bus.frame import Frame
from posfet_driver.bus.slcan_codec import (
    END,
    FLAG_BUS_ERROR,
    FLAG_OVERFLOW,
    FLAG_WARNING,
    REFUSED,
    LineReader,
    encode_line,
    parse_line,
)
from posfet_driver.clock import Clock, SystemClock
from posfet_model._lib.units import NANOSECONDS
from posfet_sim.emulation.adapter_lock import lock
from posfet_sim.emulation.backlog import LONGEST_BACKLOG, first_due
from posfet_sim.emulation.bus_node import Node

READ_SIZE: Final = 4096
IDLE: Final = 0.5
"""Maximum wait for commands [s]."""


class EmulatedAdapter:
    """Serves one pseudo-terminal in a thread of its own, from `open` to `close`, at the stable path `link`.

    Commands as in LAWICEL's manual and CANable's firmware: O L C (open, listen only, close), S Y (bitrates), V N F
    (version, serial number, status), and frames t T r R d D b B. Settings without a meaning for an emulation are
    accepted. While what waits for the terminal's reader is older than LONGEST_BACKLOG, frames are lost, those of a scan
    all together; F then states an overflow, once. Not emulated: transmission time on the bus, arbitration, bus errors,
    other nodes, and the time stamps of command Z, which is refused.

    Parameters
    ----------
    link : Path or str
        Path at which the terminal appears.
    node : Node
        Node behind the adapter.
    clock : Clock, optional
        Default: the clock of this machine.
    """

    def __init__(self, link: Path | str, node: Node, clock: Clock | None = None) -> None:
        self.link = Path(link)
        self.frames_sent = 0
        """Frames written to the terminal."""
        self.frames_dropped = 0
        """Frames lost because nobody read the terminal."""
        self.flags = 0
        """Status flags of the adapter (FLAG_* of slcan_codec), the answer to F."""
        self.failure = ""
        """Error that the node or this thread has ended on, in one line; '' while it runs."""
        self.speeds: tuple[bytes, ...] = ()
        """Commands that set the bitrates of the bus, such as (S8, Y5): without all of them no frame passes."""
        self._set_speeds: set[bytes] = set()
        self._node = node
        self._clock = clock or SystemClock()
        self._reader = LineReader()
        self._output = bytearray()
        self._written = 0  # bytes written to the terminal, in all
        self._waiting: deque[tuple[int, int]] = deque()  # time [ns] and end of each part of the output, in such bytes
        self._read = True  # whether the terminal is read, so that output is accepted
        self._overflowed = False  # since the last answer to F
        self._channel_open = False
        self._listen_only = False
        self._thread: threading.Thread | None = None
        self._terminals: tuple[int, ...] = ()
        self._wake: tuple[int, ...] = ()
        self._lock: int | None = None

    def open(self) -> None:
        """Create the terminal, link it, and serve it.

        Raises
        ------
        SourceError
            The link cannot be created, or another file or a running adapter is at its path.
        """
        try:
            self._lock = lock(self.link)
        except BlockingIOError as error:
            raise SourceError(f"{self.link}: an emulated adapter is running here already") from error
        except OSError as error:
            raise SourceError(f"{self.link}: the adapter cannot be linked here: {error.strerror}") from error
        try:
            self._wake = os.pipe()
            self._terminals = master, slave = os.openpty()
            tty.setraw(slave)
            os.set_blocking(master, False)
            self._make_link(os.ttyname(slave))
        except OSError as error:
            self._release()
            raise SourceError(f"{self.link}: the adapter cannot be linked here: {error.strerror}") from error
        self.failure = ""
        self._thread = threading.Thread(target=self._run, args=(master,), name="slcan adapter", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop the thread and remove the terminal, as when the adapter is unplugged; may be called twice."""
        if not self._thread:
            return
        os.write(self._wake[1], b"x")
        self._thread.join()
        self._thread = None
        if self.link.is_symlink() and os.readlink(self.link) == os.ttyname(self._terminals[1]):
            self.link.unlink()
        self._release()

    def _make_link(self, target: str) -> None:
        if self.link.exists() and not self.link.is_symlink():
            raise FileExistsError(0, "there is something else already")
        fresh = self.link.with_name(f"{self.link.name}.{secrets.token_hex(8)}")
        fresh.symlink_to(target)
        try:
            fresh.replace(self.link)
        except OSError:
            fresh.unlink()
            raise

    def _release(self) -> None:
        for descriptor in (*self._terminals, *self._wake):
            os.close(descriptor)
        self._terminals = self._wake = ()
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None
        self._channel_open = False
        self._discard()
        self._reader.clear()

    def _run(self, master: int) -> None:
        try:
            self._serve(master)
        except Exception as error:
            self.failure = f"{type(error).__name__}: {one_line(error)}"

    def _serve(self, master: int) -> None:
        """Serve the terminal until `close`."""
        wake = self._wake[0]
        while True:
            waiting = [master] if self._output else []
            wait = (self._node.next_due() - self._clock.monotonic()) / 1e9
            # Not poll: it waits in whole milliseconds.
            readable, _, _ = select.select([master, wake], waiting, [], min(max(wait, 0.0), IDLE))
            if wake in readable:
                return
            now = self._clock.monotonic()
            self._read = not self._waiting or now - self._waiting[0][0] <= LONGEST_BACKLOG * NANOSECONDS
            for frame in first_due(self._node, now):  # a board has sent it when a command comes that it answers
                self._send(frame)
            if master in readable:
                for line in self._reader.lines(os.read(master, READ_SIZE)):
                    self._execute(line, now)
            end = self._written + len(self._output)
            if end > (self._waiting[-1][1] if self._waiting else self._written):
                self._waiting.append((now, end))
            self._flush(master)

    def _execute(self, line: bytes, now: int) -> None:
        """Execute one line received at `now` [ns] and reply to it."""
        letter = line[:1]
        if letter in {b"O", b"L"}:
            self._reply(REFUSED if self._channel_open else END)
            if not self._channel_open:
                self._channel_open, self._listen_only = True, letter == b"L"
        elif letter == b"C":
            self._channel_open = False
            self._set_speeds.clear()
            self._discard()
            self._reply(END)
        elif letter in {b"", b"S", b"s", b"Y"}:
            self._set_speeds.add(line)
            self._reply(REFUSED if self._channel_open and letter else END)
        elif line == b"F":
            flags = self.flags if self._readable else self.flags | FLAG_BUS_ERROR | FLAG_WARNING
            self._reply(b"F%02X\r" % (flags | FLAG_OVERFLOW * self._overflowed))
            self._overflowed &= not self._read  # a reply for which there is no room states nothing
        elif line in _ANSWERS:
            self._reply(_ANSWERS[line])
        else:
            self._transmit(line, now)

    @property
    def _readable(self) -> bool:
        return self._set_speeds.issuperset(self.speeds)

    def _transmit(self, line: bytes, now: int) -> None:
        frame = parse_line(line)
        if frame is None or not self._channel_open or self._listen_only:
            self._reply(REFUSED)
            return
        self._reply(b"Z\r" if line[0] < ord("a") else b"z\r")
        if self._readable:
            for answer in self._node.receive(frame, now):
                self._send(answer)

    def _reply(self, reply: bytes) -> None:
        if self._read:
            self._output += reply

    def _send(self, frame: Frame) -> None:
        if not self._channel_open or not self._readable:
            return
        if not self._read:
            self.frames_dropped += 1
            self._overflowed = True
            return
        self._output += encode_line(frame)
        self.frames_sent += 1

    def _discard(self) -> None:
        self._output.clear()
        self._waiting.clear()

    def _flush(self, master: int) -> None:
        while self._output:
            try:
                written = os.write(master, self._output)
            except BlockingIOError:
                return
            del self._output[:written]
            self._written += written
            while self._waiting and self._waiting[0][1] <= self._written:
                self._waiting.popleft()


_ANSWERS: Final = {b"V": b"V1013\r", b"N": b"NPSFT\r"}
