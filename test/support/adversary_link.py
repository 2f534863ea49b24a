# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A board and a link that are written from docs/protocol.md alone: the reference firmware in virtual time, behind a
link that loses, delays, changes and invents frames. Shares no code with the driver, the simulated board or their tests.
"""

from __future__ import annotations

import os
import random
import struct
import subprocess
from binascii import crc_hqx
from collections import deque
from pathlib import Path
from typing import Final, NamedTuple

import can

from posfet_driver.bus.frame import CLASSIC, ERROR, EXTENDED, FD, RATE_SWITCH, REMOTE, Frame
from support.clocks import SteppedClock

BASE: Final = 0x100
KEPT: Final = 20_000
"""Scans of the log that are kept: more than any fault but a host stop can delay."""
SENT_LATER: Final = 2_000_000_000
"""Time for which a board keeps no scan that it could not send [ns]."""
FALSE_PERIODS: Final = (1, 499, 20_000, 2_000_000, 10_000_000)
"""Scan periods that a board states and does not keep [us]."""
LOG_PIPE: Final = 1 << 20
STEP: Final = 50_000
"""Longest time that the board runs at once [us]: its log then fits the pipe."""
_KINDS: Final = {"t": CLASSIC, "r": REMOTE, "T": EXTENDED, "d": FD, "b": FD | RATE_SWITCH}
_LENGTHS: Final = (0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64)


class Sampled(NamedTuple):
    """A scan that the board has sampled."""

    power_on: int
    """How often the board has been switched on before."""
    time: int
    """Time of acquisition, on the host's clock [ns]."""
    counts: str
    late: bool
    """Whether the board's processor stood still at the tick."""


class LoggedBoard:
    """The firmware's process, whose log of scans is read along."""

    def __init__(self, program: Path, folder: Path, scale: float, *options: str) -> None:
        self.power_on = 0
        self.now = 0
        """Time since the start of the process [us]."""
        self.sampled: dict[int, list[Sampled]] = {}
        """Scans by sequence, those of the newest power-on last."""
        self.is_heard = True
        """Whether anything that the board does now can still arrive."""
        self._scale = scale
        self._order: deque[int] = deque()
        self._began = 0
        self._rest = ""
        log = folder / "log"
        os.mkfifo(log)
        self._log = os.open(log, os.O_RDONLY | os.O_NONBLOCK)
        command = [str(program), "--virtual", "--stamps", "--log", str(log), "--base-id", str(BASE), *options]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def close(self) -> int:
        """End the process and return its exit code."""
        self._process.communicate()
        os.close(self._log)
        return self._process.returncode

    def host_time(self, microseconds: int) -> int:
        """Return the host's time [ns] at a time of the process [us]: the two clocks drift."""
        return round(microseconds * 1000 * self._scale)

    def run_until(self, host: int) -> list[tuple[int, Frame]]:
        """Let the board run up to a time of the host [ns]; return what it sends with the time [ns] of each frame."""
        self.now = max(self.now, int(host / 1000 / self._scale))
        return self.command(f"T {self.now}")

    def stall_until(self, host: int) -> list[tuple[int, Frame]]:
        """Let the time pass while the board's processor stands still."""
        self.now = max(self.now, int(host / 1000 / self._scale))
        return self.command(f"J {self.now}")

    def power_cycle(self, boot: int) -> list[tuple[int, Frame]]:
        """Switch the board off and on."""
        self.power_on += 1
        self._began = self.now
        return self.command(f"R {boot}")

    def send(self, frame: Frame) -> list[tuple[int, Frame]]:
        """Give the board a classic frame; when it has no room the frame is lost."""
        identifier, _, data = frame
        return self.command(f"F t{identifier:03X}{len(data)}{data.hex().upper()}")

    def command(self, line: str) -> list[tuple[int, Frame]]:
        """Send a line of docs/firmware.md."""
        talk, listen = self._process.stdin, self._process.stdout
        assert talk is not None
        assert listen is not None
        talk.write(line + "\n")
        talk.flush()
        sent, time = [], self.host_time(self.now)
        while True:
            reply = listen.readline()
            first = reply[0]
            if first in ".?":
                break
            if not self.is_heard:
                continue
            if first == "@":
                time = self.host_time(int(reply[1:]))
                continue
            length = _LENGTHS[int(reply[4], 16)]
            sent.append((time, (int(reply[1:4], 16), _KINDS[first], bytes.fromhex(reply[5 : 5 + 2 * length]))))
        self._read_log(late=line[0] == "J")
        return sent

    def _read_log(self, late: bool) -> None:
        try:
            text = self._rest + os.read(self._log, LOG_PIPE).decode()
        except BlockingIOError:
            return
        *lines, self._rest = text.split("\n")
        if not self.is_heard:
            return
        for line in lines:
            _, sequence, time, counts = line.split(" ", 3)
            number = int(sequence)
            scan = Sampled(self.power_on, self.host_time(self._began + int(time)), counts, late)
            self.sampled.setdefault(number, []).append(scan)
            self._order.append(number)
        while len(self._order) > KEPT:
            oldest = self._order.popleft()
            left = self.sampled[oldest]
            del left[0]
            if not left:
                del self.sampled[oldest]


class Link:
    """The bus, its adapter and the socket's buffer, with the faults that are `active`. It is the opened bus as well."""

    unreadable = 0
    arrival_stamp = 0
    must_be_asked = False
    port, read_by_port = None, False

    def __init__(self, clock: SteppedClock, board: LoggedBoard, fd: bool, noise: random.Random) -> None:
        self.active: dict[str, int] = {}
        """Faults by name, each with a random number that the fault may use."""
        self.lookahead = 5_000_000
        """Time by which the board runs ahead of the host, and by which commands are late [ns]."""
        self.cadence = 1_000_000
        """Frames arrive at multiples of it [ns]."""
        self.room = 4000
        """Frames that the socket keeps while nobody reads."""
        self.plugged = 0
        self.overflowed = 0
        self.stated: deque[dict[int, list[int]]] = deque(maxlen=4)
        """FD: of each of the newest lies about the sequence, the true numbers of the scans by the number stated."""
        self.clock = clock
        self.board = board
        self._fd = fd
        self._noise = noise
        self._queue: deque[tuple[int, Frame]] = deque()
        self._late: list[tuple[int, Frame]] = []
        self._stalled: list[tuple[int, Frame]] = []
        self._commands: list[Frame] = []
        self._frozen: dict[str, bytes] = {}
        self._swap: tuple[int, Frame] | None = None
        self._newest = 0

    def open(self) -> Link:
        """Open the bus: an unplugged adapter cannot be opened."""
        if "unplugged" in self.active:
            raise can.CanInitializationError("no such adapter")
        self._queue.clear()
        return self

    def presence(self) -> object:
        """Change when the adapter is plugged in or out."""
        return self.plugged, "unplugged" in self.active

    def shutdown(self) -> None:
        """Close the bus."""

    def ask_state(self) -> None:
        """Request the adapter's state: it reports none."""
        self._demand()

    def begin(self, name: str) -> None:
        """Let a fault begin."""
        self._frozen.clear()
        self.active[name] = self._noise.getrandbits(31)
        if name in {"lie: sequence", "lie: frozen sequence"}:
            self.stated.append({})

    def end(self) -> None:
        """Let all faults end; what an adapter held back arrives now."""
        if "unplugged" in self.active:
            self.plugged += 1
        if "bus blocked" in self.active:
            self._take(self.board.command("B 0"))
        self.active.clear()
        stalled, self._stalled = self._stalled, []
        for time, frame in stalled:
            self._arrive(max(self.clock.now, time), frame)  # the board runs ahead of the host
        commands, self._commands = self._commands, []
        for frame in commands:
            self._take(self.board.send(frame))

    def run(self, host: int) -> None:
        """Let the board run up to a time of the host [ns]."""
        while (target := min(host, self.board.host_time(self.board.now + STEP))) < host:
            self._take(self.board.run_until(target))
        self._take(self.board.run_until(host))

    def stand_still(self, duration: int) -> None:
        """Let the host stand still [ns]: the socket keeps the oldest frames and drops the rest."""
        end = self.clock.now + duration
        while self.clock.now < end:
            self.clock.now = min(self.clock.now + STEP * 1000, end)
            full = max(len(self._queue), len(self._stalled)) >= self.room
            cut = not self.active.keys().isdisjoint({"cable out", "unplugged"}) and self.clock.now < end - SENT_LATER
            self.run(self.clock.now)
            self.board.is_heard = not full and not cut
        self.board.is_heard = True
        if len(self._queue) >= self.room:
            self._queue.append((self.clock.now, (0x004, ERROR, bytes([0, 1]).ljust(8, b"\0"))))

    def power_cycle(self, boot: int) -> None:
        """Switch the board off and on."""
        self._frozen.clear()
        self._take(self.board.power_cycle(boot))

    def stall_board(self, host: int) -> None:
        """Let the board's processor stand still up to a time of the host [ns]."""
        self._take(self.board.stall_until(host))

    def read_frames(self, timeout: float) -> list[Frame]:
        """Return what has arrived, or wait for it."""
        clock, end = self.clock, self.clock.now + round(timeout * 1e9)
        while True:
            self._demand()
            if self.board.host_time(self.board.now) <= clock.now:
                self.run(min(end, clock.now + self.lookahead) if end > clock.now else clock.now)
                self._release()
            frames, queue = [], self._queue
            while queue and queue[0][0] <= clock.now:
                frames.append(queue.popleft()[1])
            if frames or clock.now >= end:
                return frames
            next_arrival = queue[0][0] if queue else end
            clock.now = max(clock.now, min(end, next_arrival, self.board.host_time(self.board.now) + 1000))

    def write_frame(self, frame: Frame) -> None:
        """Send a command to the board."""
        self._demand()
        if {"cable out", "deaf board"} & self.active.keys():
            return
        if "commands lost" in self.active and self._noise.random() < 0.5:
            return
        if "adapter stalls" in self.active:
            self._commands.append(frame)
            return
        self._take(self.board.send(frame))

    def foreign(self, command: int, argument: int = 0) -> None:
        """Let another host send a command, which this one sees."""
        frame = BASE, CLASSIC, struct.pack("<BBHI", command, self._noise.randrange(256), 0, argument)
        self._arrive(self.board.host_time(self.board.now), frame)
        self._take(self.board.send(frame))

    def _demand(self) -> None:
        if "unplugged" in self.active:
            raise can.CanOperationError("the adapter is gone")

    def _take(self, sent: list[tuple[int, Frame]]) -> None:
        active = self.active
        for time, frame in sent:
            if not active:
                self._arrive(time, frame)
            elif active.keys().isdisjoint({"cable out", "unplugged"}):
                self._disturb(time, self._lie(frame))
        if "foreign traffic" in active and sent:
            for _ in range(len(sent) // 2):
                self._arrive(sent[-1][0], self._foreign_frame())
        if "error frames" in active and sent and self._noise.random() < 0.3:
            self._arrive(sent[-1][0], (self._noise.choice((0x008, 0x020, 0x080)), ERROR, bytes(8)))
        if "overflow reported" in active and sent and self._noise.random() < 0.3:
            self._arrive(sent[-1][0], (0x004, ERROR, bytes([0, 1]).ljust(8, b"\0")))

    def _foreign_frame(self) -> Frame:
        noise = self._noise
        if noise.random() < 0.2:
            return BASE + noise.randrange(8), EXTENDED, noise.randbytes(8)
        return noise.choice((0x80, 0x0FF, 0x200, 0x7FF)), noise.choice((CLASSIC, FD)), noise.randbytes(8)

    def _arrive(self, time: int, frame: Frame) -> None:
        """Put a frame into the socket's buffer; frames arrive in the order of this call."""
        time += 150_000 if frame[1] & FD else 130_000
        self._newest = max(self._newest, -(-time // self.cadence) * self.cadence)
        if len(self._queue) < self.room:
            self._queue.append((self._newest, frame))
        else:
            self.overflowed += 1

    def _release(self) -> None:
        """Let late frames arrive, and what waited to be overtaken."""
        if self._swap and not self.active:
            swap, self._swap = self._swap, None
            self._arrive(*swap)
        if self._late:
            due = [late for late in self._late if late[0] <= self.clock.now]
            self._late = [late for late in self._late if late[0] > self.clock.now]
            for time, frame in due:
                self._arrive(time, frame)

    def _disturb(self, time: int, frame: Frame) -> None:  # noqa: PLR0912  # one branch for each fault
        active, noise = self.active, self._noise
        identifier, kind, data = frame
        if "adapter stalls" in active:
            held, self._swap = [(time, frame), *([self._swap] if self._swap else [])], None  # it was overtaken now
            self._stalled += held[: max(self.room - len(self._stalled), 0)]
            return
        if identifier == BASE + 1:
            if "answers lost" in active:
                return
            if "answers late" in active:
                self._late.append((time + noise.randrange(100_000_000, 1_500_000_000), frame))
                return
        if "frames lost" in active and noise.random() < 0.1:
            return
        if "bursts lost" in active and (time // 7_000_000 + active["bursts lost"]) % 11 < 5:
            return
        if "frames truncated" in active and noise.random() < 0.1:
            frame = identifier, kind, data[: 48 if kind & FD else noise.randrange(8)]
        if "frames corrupted" in active and kind & FD and noise.random() < 0.1:
            changed = bytearray(data)
            for _ in range(noise.randrange(1, 4)):
                changed[noise.randrange(64)] ^= 1 << noise.randrange(8)
            frame = identifier, kind, bytes(changed)
        if "frames delayed" in active:
            time += active["frames delayed"] % 30_000_000
        if "jitter" in active and noise.random() < 0.3:
            time += noise.randrange(8_000_000)
        if "frames reordered" in active and self._swap is None and noise.random() < 0.1:
            self._swap = time, frame
            return
        self._arrive(time, frame)
        if self._swap:
            swap, self._swap = self._swap, None
            self._arrive(*swap)
        if "frames doubled" in active and noise.random() < 0.1:
            self._arrive(time, frame)

    def _lie(self, frame: Frame) -> Frame:
        """Return what a board with broken firmware sends instead."""
        active, (identifier, kind, data) = self.active, frame
        offset = identifier - BASE
        if offset == 1:
            command, tag, result, boot, value = struct.unpack("<BBBBI", data)
            if "lie: rate" in active and command == 3:
                value = (0, 0xFFFFFFFF)[active["lie: rate"] % 2]
            if "lie: answers" in active and command in {1, 2}:
                value = (value + 1_048_576) & 0xFFFFFFFF
            if "lie: identity" in active and command == 4:
                value ^= (1, 1 << 16, 1 << 20)[active["lie: identity"] % 3]
            return identifier, kind, struct.pack("<BBBBI", command, tag, result, boot, value)
        if offset == 2 and "lie: not scanning" in active:
            return identifier, kind, data[:6] + bytes([data[6] & ~0x10]) + data[7:]
        if offset == 5:
            word = int.from_bytes(data, "little")
            if "lie: identity" in active:
                word ^= (1, 1 << 16, 1 << 20)[active["lie: identity"] % 3]
            if "lie: period" in active:
                word = word & 0xFF_FFFF_FFFF | self._noise.choice(FALSE_PERIODS) << 40
            return identifier, kind, word.to_bytes(8, "little")
        if offset == 3 and kind & FD:
            return identifier, kind, self._lie_fd(data)
        if offset == 4 or offset >= 8:
            return identifier, kind, self._lie_classic(offset, data)
        return frame

    @property
    def jump(self) -> int:
        """Number by which the sequence jumps."""
        number = self.active.get("lie: sequence", 0)
        return number and (number % 300, number % 1_000_000, 1 << 20 + number % 12, 1 << 31)[number & 3] + 1

    def _lie_fd(self, data: bytes) -> bytes:
        true, time = struct.unpack_from("<II", data)
        sequence = true
        if "lie: frozen sequence" in self.active:
            (sequence,) = struct.unpack_from("<I", self._frozen.setdefault("sequence", data))
        if "lie: frozen time" in self.active:
            (time,) = struct.unpack_from("<I", self._frozen.setdefault("time", data), 4)
        sequence = (sequence + self.jump) & 0xFFFFFFFF
        time += self.active.get("lie: time", 0)
        if sequence != true:
            self.stated[-1].setdefault(sequence, []).append(true)
        head = struct.pack("<II", sequence, time & 0xFFFFFFFF) + data[8:10]
        return head + crc_hqx(head + data[12:], 0xFFFF).to_bytes(2, "little") + data[12:]

    def _lie_classic(self, offset: int, data: bytes) -> bytes:
        if offset == 4:
            sequence, word = struct.unpack("<II", data)
            time, boot = word & 0x0FFFFFFF, word >> 28
            if "lie: frozen sequence" in self.active:
                (sequence,) = struct.unpack_from("<I", self._frozen.setdefault("header", data))
            if "lie: frozen time" in self.active:
                time = struct.unpack_from("<I", self._frozen.setdefault("time", data), 4)[0] & 0x0FFFFFFF
            time += self.active.get("lie: time", 0)
            return struct.pack("<II", (sequence + self.jump) & 0xFFFFFFFF, time & 0x0FFFFFFF | boot << 28)
        counter = data[0] & 0xF
        if "lie: frozen sequence" in self.active:
            counter = self._frozen.setdefault("block", data)[0] & 0xF
        return bytes([data[0] & 0xF0 | (counter + self.jump) & 0xF]) + data[1:]
