"""Access to a board under test: everything sent to it and everything received from it is kept."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Final

from posfet_driver.bus.frame import CLASSIC, ERROR, EXTENDED, REMOTE, Frame
from posfet_driver.bus.frame_bus import FrameBus
from posfet_driver.clock import Clock
from posfet_driver.conformance.description import Description, load_description
from posfet_driver.conformance.seen_scans import SeenFrame, SeenScan, classic_scans, fd_scans

JITTER: Final = 0.02
"""Longest time by which host and adapter delay one frame more than another [s]; assumed."""
LATE_SHARE: Final = 0.2
"""Share of frames that a busy host may read later than that [1]; assumed."""
LONGEST_WAIT: Final = 1.0
"""Time after which a command counts as not answered [s]."""
SILENCE: Final = 0.5
"""Time without a frame after which a board is off [s]."""
PATIENCE: Final = 120.0
"""Time within which a person switches the board off and on [s]."""
MICROSECOND: Final = 1000
SECOND: Final = 1_000_000_000


class NotCheckedError(Exception):
    """A rule cannot be judged; the message is the reason, one line."""


class BrokenRuleError(Exception):
    """The board breaks the rule; the message is what was seen, one line."""


class NoBoardError(Exception):
    """No board was found; the message is one line."""


@dataclass(frozen=True)
class Board:
    """What the tester knows of the board."""

    base: int
    """Base identifier."""
    taxels: int
    layout: int
    """Layout id."""
    fd: bool
    """Whether its scans are FD blocks."""
    period: int
    """Scan period for the tests [us]."""
    fd_bus: bool
    """Whether the bus carries FD frames."""

    @property
    def blocks(self) -> int:
        """Number of blocks of a scan."""
        return -(-self.taxels // (26 if self.fd else 5))

    @property
    def highest_offset(self) -> int:
        """Highest identifier less the base identifier; those above may be another board's."""
        return 5 if self.fd else 7 + self.blocks


@dataclass(frozen=True)
class Answer:
    """A command and its response."""

    code: int
    argument: int
    result: int
    value: int
    sent: int
    """Host's clock at sending [ns]."""
    before: int
    """Number of frames received before it was sent."""
    frame: SeenFrame
    """The response."""


@dataclass(frozen=True)
class SentCommand:
    """A command as it was sent."""

    code: int
    tag: int
    argument: int
    time: int
    """Host's clock [ns]."""
    before: int
    """Number of frames received before."""


@dataclass
class Run:
    """Frames from START to STOP."""

    start: Answer
    owner: str
    """Rule that is tried out in this run; '': none, the board is only listened to."""
    stop: Answer | None = None
    end: int = 0
    """Number of frames received when no more of the run can follow."""


@dataclass(frozen=True)
class Window:
    """A time without commands."""

    scanning: bool
    begin: int
    """Host's clock [ns]."""
    end: int
    first: int
    """Number of frames received before."""
    last: int


@dataclass
class PowerOn:
    """What was seen after the board had been switched on."""

    boot_before: int
    first: int
    """Number of frames received before."""
    run: Run | None = None


@dataclass
class Session:
    """A board under test."""

    bus: FrameBus
    """The open bus."""
    clock: Clock
    """Clock of the host."""
    board: Board
    numbers: random.Random
    """Source of all that is free: tags, periods, arguments, order."""
    description: Description = field(default_factory=load_description)
    frames: list[SeenFrame] = field(default_factory=list)
    """All frames of the board."""
    commands: list[SentCommand] = field(default_factory=list)
    answers: list[Answer] = field(default_factory=list)
    runs: list[Run] = field(default_factory=list)
    windows: list[Window] = field(default_factory=list)
    ignored: set[int] = field(default_factory=set)
    """Indices of responses to frames that are no commands; judged where these were sent."""
    ignored_commands: set[int] = field(default_factory=set)
    """Indices of commands whose missing response is judged where they were sent."""
    new_periods: list[Answer] = field(default_factory=list)
    """Responses to SET_RATE that changed the period."""
    power_on: PowerOn | None = None

    def __post_init__(self) -> None:
        """Begin with any tag."""
        self._tag = self.numbers.randrange(256)
        self.period = 0

    def read(self, seconds: float) -> None:
        """Keep the frames that are waiting; when there is none, wait up to `seconds` [s] for the first.

        Parameters
        ----------
        seconds : float
            Longest time to wait [s].
        """
        received = self.bus.read_frames(seconds)
        now = self.clock.monotonic()
        for identifier, kind, data in received:
            offset = identifier - self.board.base
            if not kind & ERROR and 1 <= offset <= self.board.highest_offset:
                self.frames.append(self._seen(now, identifier, kind, data))

    @property
    def response_limit(self) -> float:
        """Longest time from a command to its response as this host sees it [s]."""
        return float(self.description.states["timing"]["response_ms"]) * 1e-3 + JITTER

    def listen(self, seconds: float) -> None:
        """Keep the frames of `seconds` [s].

        Parameters
        ----------
        seconds : float
            Duration [s].
        """
        end = self.clock.monotonic() + round(seconds * SECOND)
        while (left := end - self.clock.monotonic()) > 0:
            self.read(left / SECOND)

    def listen_to_scans(self, count: int) -> None:
        """Keep the frames of `count` scan periods.

        Parameters
        ----------
        count : int
            Number of scans.
        """
        self.listen(count * self.period * 1e-6)

    def ask(self, name: str, argument: int = 0, reserved: int = 0) -> Answer:
        """Send a command and return its response.

        Parameters
        ----------
        name : str
            Name of the command.
        argument : int, default 0
            Its argument.
        reserved : int, default 0
            Value of the reserved bits.

        Raises
        ------
        NotCheckedError
            When the board does not respond.
        """
        sent = self._send(self.description.codes[name], argument, reserved)
        return self._wait([sent])[0]

    def ask_at_once(self, commands: Sequence[tuple[int, int]]) -> list[Answer]:
        """Send commands without waiting for responses in between, and return the responses to them.

        Parameters
        ----------
        commands : sequence of tuple of int and int
            Codes and arguments.

        Raises
        ------
        NotCheckedError
            When the board does not respond to one of them.
        """
        return self._wait([self._send(code, argument) for code, argument in commands])

    def must(self, name: str, argument: int = 0) -> Answer:
        """Send a command that is needed to go on, and return its response.

        Parameters
        ----------
        name : str
            Name of the command.
        argument : int, default 0
            Its argument.

        Raises
        ------
        NotCheckedError
            When it is refused or not answered.
        """
        answer = self.ask(name, argument)
        if answer.result:
            raise NotCheckedError(f"{name} {argument} was refused with {self.result_name(answer)}")
        return answer

    def settle(self) -> None:
        """Bring the board to the state in which every test begins: stopped, with the period for the tests."""
        self.ask("STOP")
        self.must("SET_RATE", self.board.period)

    @contextmanager
    def scanning(self, owner: str = "") -> Iterator[Run]:
        """Let the board scan within a block.

        Parameters
        ----------
        owner : str, optional
            Rule that is tried out in this run.

        Yields
        ------
        Run
            The run.
        """
        run = Run(self.must("START"), owner)
        self.runs.append(run)
        try:
            yield run
        finally:
            self.listen(JITTER)  # frames that were on their way
            run.end = len(self.frames)
        run.stop = self.must("STOP")
        self.listen_to_scans(3)
        self.listen(JITTER)
        run.end = len(self.frames)

    @contextmanager
    def window(self, scanning: bool) -> Iterator[None]:
        """Note the duration of a block, in which no command is sent.

        Parameters
        ----------
        scanning : bool
            Whether the board scans.

        Yields
        ------
        None
            Nothing.
        """
        self.listen(JITTER)  # to what follows the latest response
        begin, first = self.clock.monotonic(), len(self.frames)
        yield
        self.windows.append(Window(scanning, begin, self.clock.monotonic(), first, len(self.frames)))

    def scans(self, first: int = 0, last: int | None = None) -> list[SeenScan]:
        """Return the scans of some of the frames.

        Parameters
        ----------
        first : int, default 0
            Index of the first frame.
        last : int, optional
            Index after the last one.
        """
        return (fd_scans if self.board.fd else classic_scans)(self.frames[first:last])

    def run_scans(self, run: Run) -> list[SeenScan]:
        """Return the scans of a run.

        Parameters
        ----------
        run : Run
            The run.
        """
        return self.scans(run.start.before, run.end)

    @staticmethod
    def owned_by_none(run: Run) -> bool:
        """Return whether nothing was tried out in a run.

        Parameters
        ----------
        run : Run
            The run.
        """
        return not run.owner and run.stop is not None

    def named(self, name: str, first: int = 0, last: int | None = None) -> list[SeenFrame]:
        """Return the frames of one message.

        Parameters
        ----------
        name : str
            Name of the message.
        first : int, default 0
            Index of the first frame.
        last : int, optional
            Index after the last one.
        """
        return [frame for frame in self.frames[first:last] if frame.name == name]

    def result_name(self, answer: Answer) -> str:
        """Return the name of a result.

        Parameters
        ----------
        answer : Answer
            Command and response.
        """
        names = {number: name for name, number in self.description.results.items()}
        return names.get(answer.result, f"result {answer.result}")

    def command_name(self, code: int) -> str:
        """Return the name of a command, or its code when it is unknown.

        Parameters
        ----------
        code : int
            Code of the command.
        """
        names = {number: name for name, number in self.description.codes.items()}
        return names.get(code, f"code {code}")

    def next_tag(self) -> int:
        """Return a tag that was not used among the last 255."""
        self._tag = (self._tag + 1) % 256
        return self._tag

    def command(self, code: int, tag: int, argument: int = 0, reserved: int = 0) -> Frame:
        """Return the frame of a command.

        Parameters
        ----------
        code, tag, argument : int
            Its signals.
        reserved : int, default 0
            Value of the reserved bits.
        """
        message = self.description.messages["Command"]
        data = message.encode(CommandCode=code, CommandTag=tag, CommandArgument=argument)
        return self.board.base, CLASSIC, data[:2] + reserved.to_bytes(2, "little") + data[4:]

    def find(self) -> None:
        """Find the board and stop it; its own identity says which frames it sends.

        Raises
        ------
        NoBoardError
            When no status or no identity arrives.
        """
        self._expect("Status")
        begin = len(self.frames)
        try:
            self.ask("STOP")
            self.must("IDENTIFY")
            self._expect("Identity", begin)
            identity = self.named("Identity", begin)[-1].values
            self.board = replace(self.board, fd=bool(identity["Format"]))
            self.period = identity["ScanPeriod"]
            if self.ask("SET_RATE", self.board.period).result:
                self.board = replace(self.board, period=self.period)
        except NotCheckedError as error:
            raise NoBoardError(f"the board cannot be tested: {error}") from error

    def switch_off_and_on(self, request: Callable[[], None]) -> None:
        """Have the board switched off and on, listen to it, then to its first scans.

        Parameters
        ----------
        request : callable
            Asks for it, or does it.

        Raises
        ------
        NoBoardError
            When it was not switched off and on.
        """
        self._expect("Status")
        boot = self.named("Status")[-1].values["Boot"]
        request()
        first = self._first_after_power_on(boot)
        self.power_on = PowerOn(boot, first)
        self.listen(1.3)
        identity = self.named("Identity", first)
        self.period = identity[-1].values["ScanPeriod"] if identity else self.board.period
        with self.scanning("power-on") as self.power_on.run:
            self.listen_to_scans(8)

    def _first_after_power_on(self, boot: int) -> int:
        """Return the index of the first frame after a reset: after a silence, or with another boot than before it."""
        begin = heard = self.clock.monotonic()
        while self.clock.monotonic() < begin + PATIENCE * SECOND:
            count = len(self.frames)
            self.read(SILENCE / 5)
            received = self.frames[count:]
            if received and received[0].time > heard + SILENCE * SECOND:
                return count
            heard = received[-1].time if received else heard
            if any(frame.name == "Status" and frame.values["Boot"] != boot for frame in received):
                return max(frame.index for frame in self.frames if frame.boot == boot) + 1
        raise NoBoardError(f"the board was not switched off and on within {PATIENCE:g} s")

    def _expect(self, name: str, first: int = 0) -> None:
        end = self.clock.monotonic() + round(LONGEST_WAIT * SECOND)
        while not self.named(name, first):
            if self.clock.monotonic() >= end:
                raise NoBoardError(
                    f"no {name} frame within {LONGEST_WAIT:g} s at base identifier 0x{self.board.base:X}"
                )
            self.read(max((end - self.clock.monotonic()) / SECOND, 0.0))

    def _send(self, code: int, argument: int, reserved: int = 0) -> SentCommand:
        sent = SentCommand(code, self.next_tag(), argument, self.clock.monotonic(), len(self.frames))
        self.commands.append(sent)
        self.bus.write_frame(self.command(code, sent.tag, argument, reserved))
        return sent

    def _wait(self, sent: list[SentCommand]) -> list[Answer]:
        """Return the responses to commands; after the time for it those with another tag, too, which rule C2 judges."""
        limit = self.response_limit
        begin = self.clock.monotonic()
        while (waited := (self.clock.monotonic() - begin) / SECOND) < LONGEST_WAIT:
            late = waited >= limit
            responses = self.named("Response", sent[0].before)
            found = [_response_to(command, responses, late) for command in sent]
            if None not in found:
                answers = [self._answer(*pair) for pair in zip(sent, found, strict=True)]
                for answer in answers:
                    self._note(answer)
                return answers
            self.read((LONGEST_WAIT if late else limit) - waited)
        missing = next(command for command, response in zip(sent, found, strict=True) if response is None)
        raise NotCheckedError(f"no response to {self.command_name(missing.code)} within {LONGEST_WAIT:g} s")

    def _note(self, answer: Answer) -> None:
        self.answers.append(answer)
        if answer.code == self.description.codes["SET_RATE"] and not answer.result and answer.argument != self.period:
            self.period = answer.argument
            self.new_periods.append(answer)

    @staticmethod
    def _answer(sent: SentCommand, response: SeenFrame | None) -> Answer:
        assert response is not None
        values = response.values
        return Answer(
            sent.code,
            sent.argument,
            values["ResponseResult"],
            values["ResponseValue"],
            sent.time,
            sent.before,
            response,
        )

    def _seen(self, now: int, identifier: int, kind: int, data: bytes) -> SeenFrame:
        """Return a frame with its signals, also when kind or length are wrong: rule F4 judges those."""
        messages, offset = self.description.messages, identifier - self.board.base
        message = next((message for message in messages.values() if message.offset == offset), None)
        first = messages["ScanBlock0"]
        if offset >= first.offset:
            message = first
        if kind & (EXTENDED | REMOTE) or message is None:
            return SeenFrame(len(self.frames), now, identifier, kind, data, None, {})
        values = message.decode(data.ljust(message.length, b"\0")[: message.length])
        block = values["BlockIndex"] if message.name == "ScanBlockFd" else offset - first.offset
        return SeenFrame(len(self.frames), now, identifier, kind, data, message, values, block)


def _response_to(command: SentCommand, responses: list[SeenFrame], any_tag: bool) -> SeenFrame | None:
    for tags in ({command.tag}, set(range(256)) if any_tag else set[int]()):
        for frame in responses:
            if frame.values["ResponseCommand"] == command.code and frame.values["ResponseTag"] in tags:
                return frame
    return None
