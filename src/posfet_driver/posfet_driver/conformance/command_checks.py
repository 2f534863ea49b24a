# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Rules of commands and responses."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from posfet_driver.bus.frame import CLASSIC, EXTENDED, FD, REMOTE, Frame
from posfet_driver.conformance.checks import Phase, check
from posfet_driver.conformance.records import JITTER, LATE_SHARE, SECOND, BrokenRuleError, NotCheckedError
from posfet_driver.conformance.seen_scans import SEQUENCES
from posfet_driver.conformance.session import Session
from posfet_driver.conformance.timer_checks import ROUNDING, irregularity, scans_needed, tick_length, ticks

AT_ONCE: Final = 8
"""Commands sent without waiting for responses in between."""
NO_ARGUMENT: Final = ("START", "STOP", "IDENTIFY", "SELF_TEST")


@check("C1")
def other_frames(session: Session) -> str:
    """Check that short, remote, FD and extended frames with the identifier of commands are ignored."""
    session.settle()
    first = len(session.frames)
    sent = {}
    for form, frame in _other_frames(session):
        sent[frame[2][1] if len(frame[2]) > 1 and not frame[1] & REMOTE else -1] = form
        session.bus.write_frame(frame)
    session.listen(session.response_limit + 0.1)
    responses = session.named("Response", first)
    session.ignored.update(frame.index for frame in responses)
    if responses:
        form = sent.get(responses[0].values["ResponseTag"], "short or remote")
        raise BrokenRuleError(f"{form} frame was answered")
    if session.scans(first):
        raise BrokenRuleError("one of short, remote, FD and extended frames started the board")
    return f"ignored: {', '.join(dict.fromkeys(sent.values()))}"


def _other_frames(session: Session) -> Iterator[tuple[str, Frame]]:
    base, start = session.board.base, session.description.codes["START"]
    for length in session.numbers.sample(range(8), 8):
        yield "short", (base, CLASSIC, session.command(start, session.next_tag())[2][:length])
    yield "remote", (base, REMOTE, bytes(8))
    yield "extended", (base, EXTENDED, session.command(start, session.next_tag())[2])
    if session.board.fd_bus:
        yield "FD", (base, FD, session.command(start, session.next_tag())[2])


@check("C2")
def many_at_once(session: Session) -> str:
    """Send commands without waiting for responses; the review judges them."""
    session.settle()
    codes = session.description.codes
    free = [(codes[name], 0) for name in ("IDENTIFY", "SELF_TEST", "STOP")] + [(codes["SET_RATE"], session.period)]
    unknown = next(code for code in range(255, 0, -1) if code not in codes.values())
    for _ in range(2):
        session.ask_at_once(session.numbers.choices([*free, (unknown, 0)], k=AT_ONCE))
    with session.scanning("C2"):
        session.ask_at_once(session.numbers.choices([(codes["IDENTIFY"], 0), (unknown, 0)], k=AT_ONCE))
    return f"{AT_ONCE} at once"


@check("C2", Phase.REVIEW)
def responses(session: Session) -> str:
    """Check that each command has one response, in time and in order, with its code and tag."""
    commands = [c for index, c in enumerate(session.commands) if index not in session.ignored_commands]
    received = [frame for frame in session.named("Response") if frame.index not in session.ignored]
    delays: dict[str, list[float]] = {}
    for number, command in enumerate(commands):
        name = f"{session.command_name(command.code)} with tag {command.tag}"
        if number >= len(received):
            raise BrokenRuleError(f"no response to {name}")
        values = received[number].values
        if (values["ResponseCommand"], values["ResponseTag"]) != (command.code, command.tag):
            answered = session.command_name(values["ResponseCommand"])
            raise BrokenRuleError(f"response to {name}: {answered} with tag {values['ResponseTag']}")
        kind = session.command_name(command.code) if command.code in session.description.codes.values() else "others"
        delays.setdefault(kind, []).append((received[number].time - command.time) / SECOND)
    if len(received) > len(commands):
        raise BrokenRuleError(f"{len(received)} responses to {len(commands)} commands")
    late = 0
    for kind, times in delays.items():
        late_here = sum(time > session.response_limit for time in times)
        if late_here > LATE_SHARE * len(times):
            raise BrokenRuleError(f"responses to {kind} after up to {1e3 * max(times):.0f} ms")
        late += late_here
    if late:
        return f"{len(commands)} commands, each answered once; {late} responses read late, perhaps by a busy host"
    slowest = max(time for times in delays.values() for time in times)
    return f"{len(commands)} commands, each answered once, after {1e3 * slowest:.1f} ms at most"


@check("C3")
def unknown_commands(session: Session) -> str:
    """Check that each unknown code is answered with UNKNOWN_COMMAND."""
    session.settle()
    codes = [code for code in range(256) if code not in session.description.codes.values()]
    session.numbers.shuffle(codes)
    first = len(session.frames)
    for begin in range(0, len(codes), AT_ONCE):
        commands = [(code, session.numbers.choice((0, 1, 1000))) for code in codes[begin : begin + AT_ONCE]]
        for answer in session.ask_at_once(commands):
            if session.result_name(answer) != "UNKNOWN_COMMAND":
                raise BrokenRuleError(f"code {answer.code} was answered {session.result_name(answer)}")
    session.listen(0.1 + JITTER)
    if session.scans(first):
        raise BrokenRuleError("an unknown command started the board")
    return f"{len(codes)} unknown codes"


@check("C3")
def refused_commands(session: Session) -> str:
    """Check that a refused command has no effect, stopped or scanning."""
    session.settle()
    before = _stated_period(session)
    count = _refuse_all(session)
    first = len(session.frames)
    session.listen(0.1 + JITTER)
    if session.scans(first):
        raise BrokenRuleError("a refused command started the board")
    after = _stated_period(session)
    if after != before:
        raise BrokenRuleError(f"a refused command changed the period from {before} to {after} us")
    session.settle()
    with session.scanning("C3") as run:
        session.listen_to_scans(scans_needed(session, 2))
        count += _refuse_all(session)
        session.listen_to_scans(scans_needed(session, 2))
    wrong = irregularity(session, session.run_scans(run))
    if wrong:
        raise BrokenRuleError(f"refused commands while scanning: {wrong}")
    return f"{count} refused commands without effect"


def _refuse_all(session: Session) -> int:
    """Send commands that a board has to refuse, and return their number."""
    longest = session.description.states["timing"]["longest_period_us"]
    commands = [("SET_RATE", 0), ("SET_RATE", longest + 1), *((name, 1000) for name in NO_ARGUMENT)]
    for name, argument in session.numbers.sample(commands, len(commands)):
        if not session.ask(name, argument).result:
            raise NotCheckedError(f"{name} {argument} was not refused")
    return len(commands)


def _stated_period(session: Session) -> int:
    first = len(session.frames)
    session.must("IDENTIFY")
    session.listen(JITTER)
    identities = session.named("Identity", first)
    if not identities:
        raise NotCheckedError("no Identity after IDENTIFY")
    return identities[0].values["ScanPeriod"]


@check("C4", Phase.REVIEW)
def values_of_refusals(session: Session) -> str:
    """Check that the value of a refusal is 0."""
    refused = [answer for answer in session.answers if answer.result]
    for answer in refused:
        stated = session.command_name(answer.code), session.result_name(answer)
        if answer.value and stated != ("SELF_TEST", "FAILED"):
            raise BrokenRuleError(f"{stated[0]} was answered {stated[1]} with value {answer.value}")
    return f"0 in {len(refused)} refusals"


@check("C5")
def unwanted_arguments(session: Session) -> str:
    """Check that an argument of a command that has none is refused, stopped or scanning."""
    numbers = session.numbers
    for name in numbers.sample(NO_ARGUMENT, len(NO_ARGUMENT)):
        for argument in (1, numbers.randrange(2, 1 << 24), numbers.randrange(1, 1 << 8) << 24):
            session.settle()
            _refuse_argument(session, name, argument)
    session.settle()
    with session.scanning("C5"):
        for name in numbers.sample(NO_ARGUMENT, len(NO_ARGUMENT)):
            _refuse_argument(session, name, 1 << numbers.randrange(32))
    return "arguments of START, STOP, IDENTIFY, SELF_TEST are refused"


def _refuse_argument(session: Session, name: str, argument: int) -> None:
    answer = session.ask(name, argument)
    if session.result_name(answer) != "BAD_ARGUMENT":
        raise BrokenRuleError(f"{name} with argument {argument} was answered {session.result_name(answer)}")


@check("C6")
def wrong_periods(session: Session) -> str:
    """Check that periods that no board keeps are refused."""
    session.settle()
    longest = session.description.states["timing"]["longest_period_us"]
    for period in (0, 1, longest + 1, session.numbers.randrange(longest + 1, 1 << 32), (1 << 32) - 1):
        answer = session.ask("SET_RATE", period)
        if session.result_name(answer) != "BAD_ARGUMENT":
            raise BrokenRuleError(f"SET_RATE {period} was answered {session.result_name(answer)}")
    return f"0, 1 and more than {longest} us are refused"


@check("C6")
def kept_periods(session: Session) -> str:
    """Check that accepted periods are kept exactly; a board that keeps a period also keeps multiples of it."""
    session.settle()
    period, numbers = session.board.period, session.numbers
    longest = session.description.states["timing"]["longest_period_us"]
    kept = []
    session.settle()
    with session.scanning("C6") as run:
        session.listen_to_scans(scans_needed(session, 3))
    unit = tick_length(session, session.run_scans(run)) / period
    candidates = [2 * period, *(period + numbers.randrange(1, 2 * period) for _ in range(3))]
    for candidate in [*candidates, longest // period * period]:
        answer = session.ask("SET_RATE", candidate)
        if answer.result:
            if candidate % period == 0 or session.result_name(answer) != "BAD_ARGUMENT":
                raise BrokenRuleError(f"SET_RATE {candidate} was answered {session.result_name(answer)}")
            continue
        if answer.value != candidate:
            raise BrokenRuleError(f"SET_RATE {candidate} was answered with the value {answer.value}")
        if candidate <= 4 * period:
            with session.scanning("C6") as run:
                session.listen_to_scans(scans_needed(session, 5))
            length = tick_length(session, session.run_scans(run)) / unit
            if abs(length - candidate) > ROUNDING * (1 + candidate / period):
                raise BrokenRuleError(f"SET_RATE {candidate} was accepted, ticks come every {length:.1f} us")
        kept.append(candidate)
    return f"accepted and kept: {', '.join(map(str, kept))} us"


@check("C7")
def repeated_commands(session: Session) -> str:
    """Check that sTART while scanning and STOP while stopped are accepted and change nothing."""
    session.settle()
    with session.scanning("C7") as run:
        session.listen_to_scans(scans_needed(session, 2))
        again = session.ask("START")
        session.listen_to_scans(scans_needed(session, 2))
        if again.result:
            raise BrokenRuleError(f"START while scanning was answered {session.result_name(again)}")
    scans = session.run_scans(run)
    wrong = irregularity(session, scans)
    if wrong:
        raise BrokenRuleError(f"START while scanning: {wrong}")
    before = [scan for scan in scans if scan.first < again.before]
    after = [scan for scan in scans if scan.first > again.frame.index]
    if before and after and not 1 <= (again.value - before[-1].sequence) % SEQUENCES <= ticks(before[-1], after[0]) + 1:
        raise BrokenRuleError(
            f"START between scans {before[-1].sequence} and {after[0].sequence} stated {again.value} as the next"
        )
    first = len(session.frames)
    answer = session.ask("STOP")
    if answer.result:
        raise BrokenRuleError(f"STOP while stopped was answered {session.result_name(answer)}")
    session.listen(0.1)
    if session.scans(first):
        raise BrokenRuleError("STOP while stopped started the board")
    return "accepted without effect"


@check("C8")
def self_test(session: Session) -> str:
    """Check that sELF_TEST does not disturb scans; its result agrees with the flags."""
    session.settle()
    answers = [session.ask("SELF_TEST")]
    if session.result_name(answers[0]) == "BUSY":
        raise BrokenRuleError("BUSY while stopped")
    with session.scanning("C8") as run:
        for _ in range(3):
            session.listen_to_scans(scans_needed(session, 2))
            answers.append(session.ask("SELF_TEST"))
        session.listen_to_scans(scans_needed(session, 2))
    for answer in answers:
        result = session.result_name(answer)
        if result not in {"OK", "BUSY", "FAILED"}:
            raise BrokenRuleError(f"answered {result}")
        if ((result == "FAILED") != (answer.value != 0) and result != "BUSY") or answer.value > 15:
            raise BrokenRuleError(f"answered {result} with the flags {answer.value}")
    wrong = irregularity(session, session.run_scans(run))
    if wrong:
        raise BrokenRuleError(f"scans disturbed: {wrong}")
    return f"stopped: {session.result_name(answers[0])}, scanning: {session.result_name(answers[1])}"


@check("commands")
def answers_of_identify(session: Session) -> str:
    """Check that the value of IDENTIFY is the first half of Identity."""
    session.settle()
    first = len(session.frames)
    answer = session.must("IDENTIFY")
    session.listen(JITTER)
    for frame in session.named("Identity", first):
        stated = int.from_bytes(frame.data[:4], "little")
        if stated != answer.value:
            raise BrokenRuleError(f"IDENTIFY was answered 0x{answer.value:08X}, Identity states 0x{stated:08X}")
    return f"IDENTIFY: 0x{answer.value:08X}, as in Identity"
