# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Boards that break one rule each, by the id of the rule."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from posfet_driver.bus.frame import CLASSIC, EXTENDED, FD, REMOTE, Frame
from support.protocol_board import (
    BAD_ARGUMENT,
    BUSY,
    FAILED,
    IDENTIFY,
    LONGEST,
    OK,
    SELF_TEST,
    SET_RATE,
    START,
    ProtocolBoard,
)

CLASSIC_BOARDS: list[tuple[str, type[ProtocolBoard]]] = []
FD_BOARDS: list[tuple[str, type[ProtocolBoard]]] = []
POWER_ON_BOARDS: list[tuple[str, type[ProtocolBoard]]] = []
"""Boards that show it after power-on only."""

_T = TypeVar("_T", bound=type[ProtocolBoard])


def breaks(rule: str, *lists: list[tuple[str, type[ProtocolBoard]]]) -> Callable[[_T], _T]:
    """Add a board to the lists, by default that of FD boards."""

    def add(board: _T) -> _T:
        for boards in lists or (FD_BOARDS,):
            boards.append((rule, board))
        return board

    return add


def with_bits(frame: Frame, mask: int) -> Frame:
    data = (int.from_bytes(frame[2], "little") | mask).to_bytes(len(frame[2]), "little")
    return frame[0], frame[1], data


@breaks("F1")
class SendsExtendedFrames(ProtocolBoard):
    def identity(self) -> list[Frame]:
        return [*super().identity(), (self.base + 2, EXTENDED, bytes(8))]


@breaks("F1", CLASSIC_BOARDS)
class SendsRemoteFrames(ProtocolBoard):
    def status(self) -> list[Frame]:
        return [*super().status(), (self.base + 5, REMOTE, bytes(8))]


@breaks("offsets", CLASSIC_BOARDS)
class UsesReservedIdentifiers(ProtocolBoard):
    def status(self) -> list[Frame]:
        return [*super().status(), (self.base + 6, CLASSIC, bytes(8))]


@breaks("F2")
class SetsReservedBits(ProtocolBoard):
    def status(self) -> list[Frame]:
        return [with_bits(frame, 1 << 54) for frame in super().status()]


@breaks("F2")
class RejectsReservedBits(ProtocolBoard):
    def is_command(self, identifier: int, kind: int, data: bytes) -> bool:
        return super().is_command(identifier, kind, data) and data[2:4] == bytes(2)


@breaks("F3", FD_BOARDS, CLASSIC_BOARDS)
class SendsBlocksBackwards(ProtocolBoard):
    def fd_scan(self, sequence: int, time: int) -> list[Frame]:
        return super().fd_scan(sequence, time)[::-1]

    def classic_scan(self, sequence: int, time: int) -> list[Frame]:
        frames = super().classic_scan(sequence, time)
        return [*frames[:-2], frames[-1], frames[-2]]


@breaks("F3")
class OmitsBlocks(ProtocolBoard):
    def fd_scan(self, sequence: int, time: int) -> list[Frame]:
        return super().fd_scan(sequence, time)[: 1 if sequence % 8 == 5 else None]


@breaks("F4", FD_BOARDS, CLASSIC_BOARDS)
class SendsStatusAsFd(ProtocolBoard):
    def status(self) -> list[Frame]:
        return [(identifier, FD, data) for identifier, _, data in super().status()]


@breaks("F4", CLASSIC_BOARDS)
class SendsBothFormats(ProtocolBoard):
    def classic_scan(self, sequence: int, time: int) -> list[Frame]:
        return super().fd_scan(sequence, time) + super().classic_scan(sequence, time)


@breaks("T1", FD_BOARDS, CLASSIC_BOARDS)
class CountsOnlyScansThatAreSent(ProtocolBoard):
    def count_tick(self) -> None:
        if self.scanning:
            super().count_tick()


@breaks("T1")
class CountsFromZeroAtStart(ProtocolBoard):
    def start(self, argument: int, time: int) -> tuple[int, int]:
        if not self.scanning:
            self.sequence = 0
        return super().start(argument, time)


@breaks("T1", POWER_ON_BOARDS)
class KeepsItsSequenceAtPowerOn(ProtocolBoard):
    def switch_on(self, now: int) -> None:
        super().switch_on(now)
        self.sequence = 1000


@breaks("T2", FD_BOARDS, CLASSIC_BOARDS)
class ForgetsThePeriodAtStop(ProtocolBoard):
    def stop(self, argument: int, time: int) -> tuple[int, int]:
        answer = super().stop(argument, time)
        self.change_period(self.shortest, time)
        return answer


@breaks("T2", POWER_ON_BOARDS)
class IsSlowAfterPowerOn(ProtocolBoard):
    def switch_on(self, now: int) -> None:
        super().switch_on(now)
        self.period = 2 * self.shortest


@breaks("T3", FD_BOARDS, CLASSIC_BOARDS)
class ChangesThePeriodOneTickLater(ProtocolBoard):
    def change_period(self, period: int, time: int) -> None:
        self.header_due |= period != self.period
        self.period = period


@breaks("T3")
class CountsANewPeriodFromTheCommand(ProtocolBoard):
    def change_period(self, period: int, time: int) -> None:
        if period != self.period:
            self.header_due = True
            self.period, self.tick = period, time + period


@breaks("T4", FD_BOARDS, CLASSIC_BOARDS)
class HasAFastClock(ProtocolBoard):
    def device_time(self, tick: int) -> int:
        return round(tick * 1.01)


@breaks("T4")
class HasAnUnsteadyClock(ProtocolBoard):
    def device_time(self, tick: int) -> int:
        return tick + tick // self.shortest % 2 * 2


@breaks("T5")
class LeavesScansOut(ProtocolBoard):
    sent = 0
    left_out = 50

    def start(self, argument: int, time: int) -> tuple[int, int]:
        self.sent = 0
        return super().start(argument, time)

    def scan(self, sequence: int, tick: int) -> list[Frame]:
        self.sent += 1
        return [] if self.sent == self.left_out else super().scan(sequence, tick)


@breaks("S1", FD_BOARDS, CLASSIC_BOARDS)
class SendsOneScanMoreAfterStop(ProtocolBoard):
    more = 0

    def stop(self, argument: int, time: int) -> tuple[int, int]:
        self.more = int(self.scanning)
        return super().stop(argument, time)

    def sends_scan(self) -> bool:
        sends = self.scanning or self.more > 0
        self.more = 0
        return sends


@breaks("S1", FD_BOARDS, CLASSIC_BOARDS)
class StartsOneScanLate(ProtocolBoard):
    late = 0

    def start(self, argument: int, time: int) -> tuple[int, int]:
        self.late = int(not self.scanning)
        return super().start(argument, time)

    def sends_scan(self) -> bool:
        sends = self.scanning and not self.late
        self.late = 0
        return sends


@breaks("S2", CLASSIC_BOARDS)
class SendsNoHeaderAfterStart(ProtocolBoard):
    def start(self, argument: int, time: int) -> tuple[int, int]:
        answer = super().start(argument, time)
        self.header_due = False
        return answer


@breaks("S2", CLASSIC_BOARDS)
class SendsNoHeaderAfterMissingScans(LeavesScansOut):
    left_out = 90

    def on_tick(self) -> list[Frame]:
        due = self.header_due
        frames = super().on_tick()
        self.header_due = self.header_due and (due or bool(frames))
        return frames


@breaks("S2", CLASSIC_BOARDS)
class SendsNoHeaderAtANewPeriod(ProtocolBoard):
    def change_period(self, period: int, time: int) -> None:
        due = self.header_due
        super().change_period(period, time)
        self.header_due = due


@breaks("S2", CLASSIC_BOARDS)
class SendsTheHeaderAfterBlock0(ProtocolBoard):
    def classic_scan(self, sequence: int, time: int) -> list[Frame]:
        head, first, *rest = super().classic_scan(sequence, time)
        return [first, head, *rest] if head[0] == self.base + 4 else [head, first, *rest]


@breaks("S2", CLASSIC_BOARDS)
class SendsEvery32ndHeader(ProtocolBoard):
    def needs_header(self, sequence: int) -> bool:
        return self.header_due or sequence % 32 == 0


@breaks("S3", FD_BOARDS, CLASSIC_BOARDS)
class FillsUnusedCounts(ProtocolBoard):
    def unused(self) -> int:
        return 0xFFFF


@breaks("S4")
class ReadsTheClockForEachBlock(ProtocolBoard):
    def fd_block(self, **values: int) -> Frame:
        return super().fd_block(**values | {"DeviceTime": values["DeviceTime"] + 40 * values["BlockIndex"]})


@breaks("S4")
class FlagsTheFirstBlockOnly(ProtocolBoard):
    def fd_block(self, **values: int) -> Frame:
        return super().fd_block(**values | {"BlockStatus": int(values["BlockIndex"] == 0)})


@breaks("checksum")
class CoversTheChecksumField(ProtocolBoard):
    def checksum(self, data: bytes) -> int:
        return super().checksum(data[:10] + data[8:])


@breaks("I1")
class SendsStatusTooSeldom(ProtocolBoard):
    def status_period(self) -> int:
        return 110_000


@breaks("I1", FD_BOARDS, CLASSIC_BOARDS)
class SendsStatusOnlyWhileScanning(ProtocolBoard):
    def status(self) -> list[Frame]:
        return super().status() if self.scanning or self.status_due < 500_000 else []


@breaks("I1", POWER_ON_BOARDS)
class SendsTheFirstStatusLate(ProtocolBoard):
    def first_status(self) -> int:
        return 300_000


@breaks("I2")
class SendsIdentityTooSeldom(ProtocolBoard):
    def identity_period(self) -> int:
        return 1_500_000


@breaks("I2")
class SendsNoIdentityAfterSetRate(ProtocolBoard):
    def identity_after(self, code: int) -> list[Frame]:
        return self.identity() if code == IDENTIFY else []


@breaks("I2")
class SendsStatusBeforeIdentity(ProtocolBoard):
    def identity_after(self, code: int) -> list[Frame]:
        return self.status() + self.identity()


@breaks("I2", POWER_ON_BOARDS)
class SendsTheFirstIdentityLate(ProtocolBoard):
    def first_identity(self) -> int:
        return 1_200_000


@breaks("I3")
class HasNoHeartbeat(ProtocolBoard):
    def status(self) -> list[Frame]:
        self.heartbeat = 3
        return super().status()


@breaks("I4")
class RespondsWithAnotherBoot(ProtocolBoard):
    def respond(self, code: int, tag: int, result: int, value: int) -> list[Frame]:
        return [with_bits(frame, 1 << 24) for frame in super().respond(code, tag, result, value)]


@breaks("I4", POWER_ON_BOARDS)
class HasOneBootForEver(ProtocolBoard):
    def switch_on(self, now: int) -> None:
        super().switch_on(now)
        self.boot = 6


@breaks("I6")
class ForgetsThatItResetTheCharge(ProtocolBoard):
    def status(self) -> list[Frame]:
        return [with_bits(frame, 1 << 53) if self.heartbeat < 5 else frame for frame in super().status()]


@breaks("identity")
class StatesAnotherLayout(ProtocolBoard):
    def identity_values(self) -> dict[str, int]:
        return super().identity_values() | {"LayoutId": self.layout + 1}


@breaks("identity")
class StatesVersion1(ProtocolBoard):
    def identity_values(self) -> dict[str, int]:
        return super().identity_values() | {"ProtocolVersion": 1}


@breaks("states")
class DoesNotStateThatItScans(ProtocolBoard):
    def status(self) -> list[Frame]:
        identifier, kind, data = super().status()[0]
        return [(identifier, kind, data[:6] + bytes([data[6] & ~0x10]) + data[7:])]


@breaks("states", POWER_ON_BOARDS)
class ScansAfterPowerOn(ProtocolBoard):
    def switch_on(self, now: int) -> None:
        super().switch_on(now)
        self.scanning = True


@breaks("commands")
class AnswersIdentifyWithTheLayoutOnly(ProtocolBoard):
    def identify(self, argument: int, time: int) -> tuple[int, int]:
        return OK, self.layout


class _AcceptsOthers(ProtocolBoard):
    def accepts_frame(self, identifier: int, kind: int, data: bytes) -> bool:
        raise NotImplementedError

    def is_command(self, identifier: int, kind: int, data: bytes) -> bool:
        return super().is_command(identifier, kind, data) or self.accepts_frame(identifier, kind, data)


@breaks("C1", FD_BOARDS, CLASSIC_BOARDS)
class AcceptsShortCommands(_AcceptsOthers):
    def accepts_frame(self, identifier: int, kind: int, data: bytes) -> bool:
        return identifier == self.base and kind == CLASSIC and len(data) >= 2


@breaks("C1")
class AnswersRemoteFrames(_AcceptsOthers):
    def accepts_frame(self, identifier: int, kind: int, data: bytes) -> bool:
        return identifier == self.base and kind == REMOTE


@breaks("C1")
class AcceptsExtendedCommands(_AcceptsOthers):
    def accepts_frame(self, identifier: int, kind: int, data: bytes) -> bool:
        return identifier == self.base and kind == EXTENDED


@breaks("C1")
class AcceptsFdCommands(_AcceptsOthers):
    def accepts_frame(self, identifier: int, kind: int, data: bytes) -> bool:
        return identifier == self.base and kind & FD != 0


@breaks("C1")
class ObeysShortCommandsSilently(AcceptsShortCommands):
    def receive(self, frame: Frame, now: int) -> list[Frame]:
        frames = super().receive(frame, now)
        return frames if len(frame[2]) == 8 else []


@breaks("C2", FD_BOARDS, CLASSIC_BOARDS)
class AnswersTwice(ProtocolBoard):
    def respond(self, code: int, tag: int, result: int, value: int) -> list[Frame]:
        return 2 * super().respond(code, tag, result, value)


@breaks("C2")
class ForgetsTheTag(ProtocolBoard):
    def respond(self, code: int, tag: int, result: int, value: int) -> list[Frame]:
        return super().respond(code, 0, result, value)


@breaks("C2")
class AnswersSelfTestLate(ProtocolBoard):
    def response_time(self, code: int) -> int:
        return 400_000 if code == SELF_TEST else 0


@breaks("C2")
class AnswersInAnotherOrder(ProtocolBoard):
    def response_time(self, code: int) -> int:
        return 1000 if code == IDENTIFY else 0


@breaks("C3")
class HasASecretCommand(ProtocolBoard):
    def commands(self) -> dict[int, Callable[[int, int], tuple[int, int]]]:
        return super().commands() | {200: self.self_test}


@breaks("C3")
class StartsAtAnUnknownCommand(ProtocolBoard):
    def execute(self, code: int, argument: int, time: int) -> tuple[int, int]:
        self.scanning |= code == 77
        return super().execute(code, argument, time)


@breaks("C3")
class KeepsARefusedPeriod(ProtocolBoard):
    def set_rate(self, argument: int, time: int) -> tuple[int, int]:
        if argument == LONGEST + 1:
            self.change_period(2 * self.shortest, time)
        return super().set_rate(argument, time)


@breaks("C4", FD_BOARDS, CLASSIC_BOARDS)
class AnswersRefusalsWithTheArgument(ProtocolBoard):
    def set_rate(self, argument: int, time: int) -> tuple[int, int]:
        result, _ = super().set_rate(argument, time)
        return result, argument


@breaks("C5")
class StartsWithAnArgument(ProtocolBoard):
    def unwanted_argument(self, code: int, argument: int) -> tuple[int, int]:
        return self.commands()[code](0, 0) if code == START else (BAD_ARGUMENT, 0)


@breaks("C5")
class LooksAtOneByteOfTheArgument(ProtocolBoard):
    def execute(self, code: int, argument: int, time: int) -> tuple[int, int]:
        return super().execute(code, argument if code == SET_RATE else argument & 0xFF_FFFF, time)


@breaks("C6")
class AcceptsAnyLongPeriod(ProtocolBoard):
    def accepts(self, period: int) -> bool:
        return self.shortest <= period < 1 << 24


@breaks("C6")
class RefusesPeriodsAboveOneSecond(ProtocolBoard):
    def accepts(self, period: int) -> bool:
        return self.shortest <= period <= 1_000_000 or period == LONGEST // 2


@breaks("C6")
class RoundsThePeriod(ProtocolBoard):
    """It states the period that was asked for."""

    def on_tick(self) -> list[Frame]:
        frames = super().on_tick()
        self.tick -= self.period % 1000
        return frames


@breaks("C6")
class AnswersWithAnotherPeriod(ProtocolBoard):
    def set_rate(self, argument: int, time: int) -> tuple[int, int]:
        result, value = super().set_rate(argument, time)
        return result, value + (result == OK)


@breaks("C7")
class IsBusyWhileScanning(ProtocolBoard):
    def start(self, argument: int, time: int) -> tuple[int, int]:
        return (BUSY, 0) if self.scanning else super().start(argument, time)


@breaks("C7")
class RefusesToStopTwice(ProtocolBoard):
    def stop(self, argument: int, time: int) -> tuple[int, int]:
        return super().stop(argument, time) if self.scanning else (BUSY, 0)


@breaks("C7", FD_BOARDS, CLASSIC_BOARDS)
class SkipsAScanAtASecondStart(ProtocolBoard):
    skipped = False

    def start(self, argument: int, time: int) -> tuple[int, int]:
        self.skipped = self.scanning
        return super().start(argument, time)

    def sends_scan(self) -> bool:
        skipped, self.skipped = self.skipped, False
        return self.scanning and not skipped


@breaks("C8", FD_BOARDS, CLASSIC_BOARDS)
class SkipsAScanForTheSelfTest(ProtocolBoard):
    testing = False

    def self_test(self, argument: int, time: int) -> tuple[int, int]:
        self.testing = self.scanning
        return super().self_test(argument, time)

    def sends_scan(self) -> bool:
        testing, self.testing = self.testing, False
        return self.scanning and not testing


@breaks("C8")
class IsBusyWhileStopped(ProtocolBoard):
    def self_test(self, argument: int, time: int) -> tuple[int, int]:
        return super().self_test(argument, time) if self.scanning else (BUSY, 0)


@breaks("C8")
class PassesWithFlags(ProtocolBoard):
    def self_test(self, argument: int, time: int) -> tuple[int, int]:
        return OK, 2


@breaks("C8")
class FailsWithoutFlags(ProtocolBoard):
    def self_test(self, argument: int, time: int) -> tuple[int, int]:
        return FAILED, 0
