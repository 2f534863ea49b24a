# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Commands to a board under test, and its answers: every one is kept."""

from __future__ import annotations

import random
from collections.abc import Sequence

from posfet_driver.bus.frame import CLASSIC, Frame
from posfet_driver.bus.frame_bus import FrameBus
from posfet_driver.clock import Clock
from posfet_driver.conformance.listener import Listener
from posfet_driver.conformance.records import JITTER, LONGEST_WAIT, SECOND, Answer, Board, NotCheckedError, SentCommand
from posfet_driver.conformance.seen_scans import SeenFrame


class Commander(Listener):
    """Sends commands to a board and waits for the responses.

    Parameters
    ----------
    bus : FrameBus
        The open bus.
    clock : Clock
        Clock of the host.
    board : Board
        What is known about the board.
    numbers : random.Random
        Source of all that is free: tags, periods, arguments, order.
    """

    def __init__(self, bus: FrameBus, clock: Clock, board: Board, numbers: random.Random) -> None:
        super().__init__(bus, clock, board)
        self.numbers = numbers
        self.commands: list[SentCommand] = []
        self.answers: list[Answer] = []
        self.ignored: set[int] = set()
        """Indices of responses to frames that are no commands; judged where these were sent."""
        self.ignored_commands: set[int] = set()
        """Indices of commands whose missing response is judged where they were sent."""
        self.new_periods: list[Answer] = []
        """Responses to SET_RATE that changed the period."""
        self.period = 0
        """Scan period [us]; 0: unknown."""
        self._tag = numbers.randrange(256)

    @property
    def response_limit(self) -> float:
        """Longest time from a command to its response as this host sees it [s]."""
        return float(self.description.states["timing"]["response_ms"]) * 1e-3 + JITTER

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


def _response_to(command: SentCommand, responses: list[SeenFrame], any_tag: bool) -> SeenFrame | None:
    for tags in ({command.tag}, set(range(256)) if any_tag else set[int]()):
        for frame in responses:
            if frame.values["ResponseCommand"] == command.code and frame.values["ResponseTag"] in tags:
                return frame
    return None
