# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A board that keeps every rule of the protocol, in small methods so that a test can break one rule at a time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from posfet_driver.bus.frame import CLASSIC, FD, RATE_SWITCH, Frame
from posfet_driver.conformance.description import checksum, load_description

DESCRIPTION = load_description()
MESSAGES = DESCRIPTION.messages
OK, UNKNOWN_COMMAND, BAD_ARGUMENT, BUSY, FAILED = range(5)
START, STOP, SET_RATE, IDENTIFY, SELF_TEST = range(1, 6)
LONGEST = 10_000_000


@dataclass(frozen=True)
class Choices:
    """What the protocol leaves to the board."""

    first_status: int = 20_000
    first_identity: int = 20_000
    """Times of the first frames [us]."""
    identity_restarts: bool = False
    """Whether the second to the next identity counts from one that was sent after a command."""
    response_time: int = 0
    """Time after which a command that was executed at once is answered [us]."""
    busy_while_scanning: bool = False
    """Whether SELF_TEST is refused while scanning."""
    period_step: int = 1
    """Periods are multiples of this [us], or of the shortest one."""
    rate_switch: bool = True
    header_at_any_scan: bool = False
    """Whether more headers are sent than needed."""


class ProtocolBoard:
    """A board on a bus in virtual time: `due` and `receive` return the frames that it sends.

    Times are its own, in microseconds since power-on; `now` is the time of the host in ns.
    """

    boot = 5

    def __init__(
        self, base: int, taxels: int, layout: int, fd: bool, shortest: int, now: int, free: Choices | None = None
    ) -> None:
        self.base, self.taxels, self.layout, self.fd, self.shortest = base, taxels, layout, fd, shortest
        self.free = free or Choices()
        self.switch_on(now)

    def switch_on(self, now: int) -> None:
        self.on = now
        self.boot = (self.boot + 1) % 16
        self.scanning = False
        self.sequence = 0
        self.tick = 0
        """Time of the next tick."""
        self.period = self.shortest
        self.header_due = True
        self.status_due, self.identity_due = self.first_status(), self.first_identity()
        self.heartbeat = 0
        self.waiting: list[tuple[int, list[Frame]]] = []
        """Responses with the host's time at which they are sent."""

    def first_status(self) -> int:
        return self.free.first_status

    def first_identity(self) -> int:
        return self.free.first_identity

    # Time

    def time(self, now: int) -> int:
        return (now - self.on) // 1000

    def next_event(self) -> int:
        return min(self.tick, self.status_due, self.identity_due)

    def next_due(self) -> int:
        return min([self.on + 1000 * self.next_event(), *(time for time, _ in self.waiting[:1])])

    def due(self, now: int, until: int | None = None) -> list[Frame]:
        frames: list[Frame] = []
        while self.next_due() <= now:
            next_time = self.next_event()
            if self.waiting and self.waiting[0][0] < self.on + 1000 * next_time:
                frames += self.waiting.pop(0)[1]
            elif self.tick == next_time:
                frames += self.on_tick()
            elif self.status_due == next_time:
                frames += self.status()
                self.status_due += self.status_period()
            else:
                frames += self.identity()
                self.identity_due += self.identity_period()
        return [sent for frame in frames for sent in self.send(frame)]

    def send(self, frame: Frame) -> list[Frame]:
        return [frame]

    # Scans

    def on_tick(self) -> list[Frame]:
        frames = self.scan(self.sequence, self.tick) if self.sends_scan() else []
        self.header_due |= self.scanning and not frames
        self.count_tick()
        self.tick += self.period
        return frames

    def sends_scan(self) -> bool:
        return self.scanning

    def count_tick(self) -> None:
        self.sequence = (self.sequence + 1) % (1 << 32)

    def device_time(self, tick: int) -> int:
        return tick

    def flags(self) -> int:
        return 0

    def count(self, sequence: int, taxel: int) -> int:
        return (sequence * 7 + taxel * 129) % 4096 << 4

    def unused(self) -> int:
        return 0

    def counts(self, sequence: int, per_block: int) -> list[list[int]]:
        blocks = -(-self.taxels // per_block)
        counts = [self.count(sequence, taxel) for taxel in range(self.taxels)]
        counts += [self.unused()] * (blocks * per_block - self.taxels)
        return [counts[per_block * k : per_block * (k + 1)] for k in range(blocks)]

    def scan(self, sequence: int, tick: int) -> list[Frame]:
        time = self.device_time(tick)
        return self.fd_scan(sequence, time) if self.fd else self.classic_scan(sequence, time)

    def fd_scan(self, sequence: int, time: int) -> list[Frame]:
        return [
            self.fd_block(
                Sequence=sequence,
                DeviceTime=time % (1 << 32),
                BlockIndex=k,
                BlockStatus=self.flags(),
                BlockBoot=self.boot,
                **{f"Count{i}": count for i, count in enumerate(counts)},
            )
            for k, counts in enumerate(self.counts(sequence, 26))
        ]

    def fd_block(self, **values: int) -> Frame:
        message = MESSAGES["ScanBlockFd"]
        identifier, _, data = message.frame(self.base, **values, Checksum=self.checksum(message.encode(**values)))
        return identifier, FD | RATE_SWITCH * self.free.rate_switch, data

    def checksum(self, data: bytes) -> int:
        return checksum(data)

    def needs_header(self, sequence: int) -> bool:
        return self.header_due or sequence % 16 == 0 or (self.free.header_at_any_scan and sequence % 5 == 0)

    def classic_scan(self, sequence: int, time: int) -> list[Frame]:
        frames = []
        if self.needs_header(sequence):
            frames.append(self.header(sequence, time))
        self.header_due = False
        for k, counts in enumerate(self.counts(sequence, 5)):
            codes = {f"Code{i}": count >> 4 for i, count in enumerate(counts)}
            identifier, kind, data = MESSAGES["ScanBlock0"].frame(self.base, ScanCounter0=sequence % 16, **codes)
            frames.append((identifier + k, kind, data))
        return frames

    def header(self, sequence: int, time: int) -> Frame:
        values = {"HeaderSequence": sequence, "HeaderTime": time % (1 << 28), "HeaderBoot": self.boot}
        return MESSAGES["ScanHeader"].frame(self.base, **values)

    # Status and identity

    def status_period(self) -> int:
        return 100_000

    def identity_period(self) -> int:
        return 1_000_000

    def status(self) -> list[Frame]:
        values = {"Temperature1": 6400, "Temperature2": -0x8000, "Supply": 5000, "Scanning": int(self.scanning)}
        frame = MESSAGES["Status"].frame(self.base, **values, Boot=self.boot, Heartbeat=self.heartbeat)
        self.heartbeat = (self.heartbeat + 1) % 16
        return [frame]

    def identity_values(self) -> dict[str, int]:
        return {"LayoutId": self.layout, "ProtocolVersion": 2, "Format": int(self.fd), "FirmwareMajor": 3}

    def identity(self) -> list[Frame]:
        frame = MESSAGES["Identity"].frame(self.base, **self.identity_values(), FirmwareMinor=9, ScanPeriod=self.period)
        return [frame]

    # Commands

    def is_command(self, identifier: int, kind: int, data: bytes) -> bool:
        return identifier == self.base and kind == CLASSIC and len(data) == 8

    def receive(self, frame: Frame, now: int) -> list[Frame]:
        if now < self.on or not self.is_command(*frame):
            return []
        values = MESSAGES["Command"].decode(frame[2].ljust(8, b"\0")[:8])
        code, tag, argument = values["CommandCode"], values["CommandTag"], values["CommandArgument"]
        result, value = self.execute(code, argument, self.time(now))
        frames = self.respond(code, tag, result, value)
        if result == OK and code in {IDENTIFY, SET_RATE}:
            frames += self.identity_after(code)
            if self.free.identity_restarts:
                self.identity_due = self.time(now) + self.identity_period()
        if delay := self.response_time(code):
            self.waiting.append((now + 1000 * delay, frames))
            self.waiting.sort(key=lambda waiting: waiting[0])
            return []
        return [sent for frame in frames for sent in self.send(frame)]

    def response_time(self, code: int) -> int:
        return self.free.response_time

    def respond(self, code: int, tag: int, result: int, value: int) -> list[Frame]:
        values = {"ResponseCommand": code, "ResponseTag": tag, "ResponseResult": result, "ResponseValue": value}
        return [MESSAGES["Response"].frame(self.base, **values, ResponseBoot=self.boot)]

    def identity_after(self, code: int) -> list[Frame]:
        return self.identity()

    def execute(self, code: int, argument: int, time: int) -> tuple[int, int]:
        if code not in self.commands():
            return UNKNOWN_COMMAND, 0
        if argument and code != SET_RATE:
            return self.unwanted_argument(code, argument)
        return self.commands()[code](argument, time)

    def unwanted_argument(self, code: int, argument: int) -> tuple[int, int]:
        return BAD_ARGUMENT, 0

    def commands(self) -> dict[int, Callable[[int, int], tuple[int, int]]]:
        return {
            START: self.start,
            STOP: self.stop,
            SET_RATE: self.set_rate,
            IDENTIFY: self.identify,
            SELF_TEST: self.self_test,
        }

    def start(self, argument: int, time: int) -> tuple[int, int]:
        self.header_due |= not self.scanning
        self.scanning = True
        return OK, self.sequence

    def stop(self, argument: int, time: int) -> tuple[int, int]:
        self.scanning = False
        return OK, self.sequence

    def accepts(self, period: int) -> bool:
        exact = period % self.free.period_step == 0 or period % self.shortest == 0
        return self.shortest <= period <= LONGEST and exact

    def set_rate(self, argument: int, time: int) -> tuple[int, int]:
        if not self.accepts(argument):
            return BAD_ARGUMENT, 0
        self.change_period(argument, time)
        return OK, argument

    def change_period(self, period: int, time: int) -> None:
        self.header_due |= period != self.period
        self.tick = max(self.tick - self.period + period, time)
        self.period = period

    def identify(self, argument: int, time: int) -> tuple[int, int]:
        return OK, int.from_bytes(self.identity()[0][2][:4], "little")

    def self_test(self, argument: int, time: int) -> tuple[int, int]:
        if self.scanning and self.free.busy_while_scanning:
            return BUSY, 0
        return (FAILED if self.flags() else OK), self.flags()
