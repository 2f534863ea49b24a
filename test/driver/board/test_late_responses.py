# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Responses that come late, not at all, or state what cannot be; and commands of other hosts."""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import can
import pytest

from posfet_driver.board.board_client import Board
from posfet_driver.board.command_queue import CommandError
from posfet_driver.board.faults import FaultKind, Health
from posfet_driver.bus.frame import CLASSIC, Frame
from posfet_driver.protocol.messages import (
    COMMAND_OFFSET,
    IDENTITY_OFFSET,
    LONGEST_PERIOD,
    RESPONSE_OFFSET,
    Command,
    Request,
    Response,
    Result,
)
from posfet_model.sensor.description import load_sensor
from posfet_sim.emulation.firmware import BoardFirmware
from support.clocks import SteppedClock
from support.fake_board import FakeBoard, assert_marked, with_fd, with_layout
from support.long_cases import crossed, long_cases
from support.stepped import SteppedBus

SENSOR = load_sensor()
BASE = SENSOR.can.base_id
MILLISECOND = 1_000_000
FRAMES = {"fd": True, "classic": False}
BOTH = pytest.mark.parametrize("fd", long_cases(FRAMES, ["fd"]))
"""Commands and responses are the same in both; the tests that vary more than the frames have classic ones."""


class SlowLink:
    """A board behind a link that delays all that the board sends, and may change its responses."""

    def __init__(self, fd: bool, now: int = 0) -> None:
        sensor = with_fd(SENSOR, fd)
        self.board = BoardFirmware(sensor, FakeBoard(sensor), now)
        self.delay = 0
        self.change: dict[int, int | None] = {}
        """Value of the response by command; None: the response is lost."""
        self.results: dict[int, Result] = {}
        """Result of the response by command."""
        self.hands_back = False
        """Whether the driver receives its own commands."""
        self.commands: list[Request] = []
        self._queue: deque[tuple[int, Frame]] = deque()

    def sends(self, frame: Frame, now: int) -> None:
        """Have the board send another frame."""
        self._queue.append((now + self.delay, frame))

    def next_due(self) -> int:
        due = self.board.next_due()
        return min(due, self._queue[0][0]) if self._queue else due

    def due(self, now: int, until: int | None = None) -> list[Frame]:
        self._queue.extend((now + self.delay, frame) for frame in self.board.due(now))
        arrived = []
        while self._queue and self._queue[0][0] <= now:
            arrived.append(self._queue.popleft()[1])
        return arrived

    def receive(self, frame: Frame, now: int) -> list[Frame]:
        request = Request.unpack(frame[2])
        assert request is not None
        self.commands.append(request)
        if self.hands_back:
            self._queue.append((now + self.delay, frame))
        for sent in self.board.receive(frame, now):
            response = Response.unpack(sent[2]) if sent[0] == BASE + RESPONSE_OFFSET else None
            if response and response.command in self.results:
                response = replace(response, result=self.results[response.command])
            if response and response.command in self.change:
                value = self.change[response.command]
                if value is None:
                    continue
                sent = (*sent[:2], replace(response, value=value).pack())  # noqa: PLW2901
            self._queue.append((now + self.delay, sent))
        return []


class Bench:
    """A driver on a slow link, in stepped time."""

    def __init__(self, fd: bool = True) -> None:
        self.clock = SteppedClock()
        self.link = SlowLink(fd)
        self.unplugged = False
        self.board = Board(with_fd(SENSOR, fd), self._open_bus, self.clock)
        self.board.open()

    def _open_bus(self) -> SteppedBus:
        if self.unplugged:
            raise can.CanInitializationError("no adapter")
        self.bus = SteppedBus(self.clock, self.link)
        return self.bus

    def run(self, seconds: float) -> int:
        """Advance the time; return the number of scans, each of which has the right number and stamp."""
        end, scans = self.clock.now + round(seconds * 1e9), 0
        while self.clock.now < end:
            scan = self.board.read(0.01)
            if scan is not None:
                scans += 1
                assert_marked(scan)
                late = scan.stamp - self.clock.wall() + self.clock.now - 1000 * scan.device_time
                assert abs(late - self.link.delay) < MILLISECOND
        return scans


@pytest.mark.parametrize(("delay", "fd"), long_cases(crossed([0.25, 1.0, 2.0], FRAMES), ["0.25-classic", "2.0-fd"]))
def test_a_board_behind_a_link_of_any_delay_is_received(delay: float, fd: bool) -> None:
    bench = Bench(fd)
    bench.link.delay = round(delay * 1e9)
    bench.run(4 * delay + 1.0)
    assert bench.run(5.0) == 5000
    assert bench.board.report().health == Health.OK
    assert bench.board.restarted == 0


def test_a_rate_whose_confirmation_comes_too_late_is_in_force_all_the_same() -> None:
    bench = Bench()
    bench.run(1.0)
    bench.link.delay = 700 * MILLISECOND
    pending = bench.board.submit(Command.SET_RATE, 5000, 0.5)
    while not pending.done():
        bench.board.read(0.01)
    with pytest.raises(CommandError, match=r"SET_RATE: no response within 0.5 s"):
        pending.result()
    for _ in range(200):
        bench.board.read(0.01)
    assert bench.board.decoder.scan_period == 5000
    assert bench.board.report().values["scan period [ms]"] == "5"


@BOTH
def test_a_stop_whose_confirmation_comes_too_late_is_not_undone(fd: bool) -> None:
    bench = Bench(fd)
    bench.link.delay = 700 * MILLISECOND
    bench.run(8.0)
    pending = bench.board.submit(Command.STOP, timeout=0.5)
    while not pending.done():
        bench.board.read(0.01)
    with pytest.raises(CommandError, match=r"STOP: no response within 0.5 s"):
        pending.result()
    bench.run(5.0)
    assert bench.board.report().state == "stopped on request"
    assert not bench.link.board.running
    assert bench.run(5.0) == 0
    assert bench.board.decoder.frames_lost == 0


def test_a_command_that_was_given_up_is_never_sent() -> None:
    bench = Bench()
    bench.run(1.0)
    bench.link.change = dict.fromkeys((Command.SELF_TEST,))
    first = bench.board.submit(Command.SELF_TEST, timeout=0.5)
    second = bench.board.submit(Command.STOP, timeout=0.5)
    bench.run(3.0)
    for pending in (first, second):
        with pytest.raises(CommandError):
            pending.result()
    assert Command.STOP not in [request.command for request in bench.link.commands]
    assert bench.link.board.running


@pytest.mark.parametrize(
    ("value", "fd"),
    long_cases(
        crossed([0, 1, 999, 10_000_000, 0xFFFF_FFFF], FRAMES),
        ["0-classic", "999-fd", "10000000-classic", "4294967295-fd"],
    ),
)
def test_another_rate_in_a_response_than_was_set_is_refused_in_one_line(value: int, fd: bool) -> None:
    bench = Bench(fd)
    bench.link.change = {Command.SET_RATE: value}
    bench.run(3.0)
    report = bench.board.report()
    assert FaultKind.RATE_REFUSED in report.conditions
    assert report.state.startswith("the board answers a scan period of 1000 us with: ok")
    bench.link.change = {}
    bench.run(3.0)
    assert bench.run(1.0) == 1000


@pytest.mark.parametrize(
    ("value", "fd"), long_cases(crossed([1, 999, 10_000_000], FRAMES), ["1-classic", "10000000-fd"])
)
def test_a_rate_that_only_a_response_states_is_never_set(value: int, fd: bool) -> None:
    """Else a board that could not keep it would refuse each start from then on."""
    bench = Bench(fd)
    bench.run(1.0)
    bench.link.change = {Command.SET_RATE: value}
    with pytest.raises(CommandError, match=rf"SET_RATE: refused by the board: ok \(value {value}\)"):
        bench.board.request(Command.SET_RATE, 1000)
    bench.link.change = {}
    bench.link.commands.clear()
    bench.link.board.running = False
    bench.run(2.0)
    assert {request.argument for request in bench.link.commands if request.command == Command.SET_RATE} == {1000}
    assert bench.run(1.0) == 1000


@pytest.mark.parametrize(
    ("value", "fd"),
    long_cases(crossed([0, 10_000_001, 0xFFFF_FFFF], FRAMES), ["0-classic", "10000001-fd", "4294967295-classic"]),
)
def test_a_rate_that_the_protocol_does_not_have_is_not_confirmed_by_a_board_that_repeats_it(
    value: int, fd: bool
) -> None:
    """Else each start from then on would set it."""
    bench = Bench(fd)
    bench.run(1.0)
    bench.link.change = {Command.SET_RATE: value}
    bench.link.results = {Command.SET_RATE: Result.OK}
    with pytest.raises(CommandError, match=r"SET_RATE: refused by the board: ok"):
        bench.board.request(Command.SET_RATE, value)
    bench.link.change, bench.link.results = {}, {}
    bench.link.commands.clear()
    bench.link.board.running = False
    bench.run(2.0)
    assert {request.argument for request in bench.link.commands if request.command == Command.SET_RATE} == {1000}
    assert bench.run(1.0) == 1000


def test_a_command_that_was_cancelled_while_it_waited_is_not_sent_and_the_reader_goes_on() -> None:
    bench = Bench()
    bench.run(1.0)
    bench.link.commands.clear()
    first, second, third = map(bench.board.submit, (Command.SELF_TEST, Command.STOP, Command.SELF_TEST))
    assert second.cancel()
    assert bench.run(1.0) == 1000
    assert (first.result().result, third.result().result) == (Result.OK, Result.OK)
    assert [request.command for request in bench.link.commands] == [Command.SELF_TEST, Command.SELF_TEST]


def test_a_command_that_was_sent_cannot_be_cancelled() -> None:
    bench = Bench()
    bench.run(1.0)
    bench.link.delay = 100 * MILLISECOND
    pending = bench.board.submit(Command.SELF_TEST)
    bench.board.read(0.01)
    assert not pending.cancel()
    while not pending.done():
        bench.board.read(0.01)
    assert pending.result().result == Result.OK


@pytest.mark.parametrize("closes", [True, False])
def test_cancelled_commands_that_expire_or_find_the_board_closed_raise_nothing(closes: bool) -> None:
    bench = Bench()
    bench.run(1.0)
    bench.link.board.running = False
    bench.link.delay = 60_000 * MILLISECOND
    bench.run(0.5)
    pending = [bench.board.submit(Command.SELF_TEST) for _ in range(3)]
    assert pending[1].cancel()
    if closes:
        bench.board.close()
    else:
        bench.run(2.0)
    for one in (pending[0], pending[2]):
        with pytest.raises(CommandError):
            one.result(timeout=0)


def test_a_rate_that_a_user_has_set_is_given_up_when_the_next_board_refuses_it() -> None:
    bench = Bench()
    bench.run(1.0)
    bench.board.request(Command.SET_RATE, 2000)
    slower = with_layout(SENSOR, 5, 5, scan_rate=1e6 / 3000)
    bench.link.board = BoardFirmware(slower, FakeBoard(slower), bench.clock.now)
    for _ in range(100):
        bench.board.read(0.01)
    report = bench.board.report()
    assert report.state == "the board answers a scan period of 1000 us with: bad argument"
    bench.link.board = BoardFirmware(SENSOR, FakeBoard(SENSOR), bench.clock.now)
    for _ in range(100):
        bench.board.read(0.01)
    assert bench.board.report().state == "receiving scans"


@pytest.mark.parametrize(
    ("value", "fd"),
    long_cases(crossed([0, 1 << 20, 0xFFFF_FFFF], FRAMES), ["0-classic", "1048576-fd", "4294967295-classic"]),
)
def test_the_sequence_in_a_response_is_not_believed(value: int, fd: bool) -> None:
    bench = Bench(fd)
    bench.link.change = {Command.START: value, Command.STOP: value}
    assert bench.run(2.0) > 1900
    assert bench.board.decoder.frames_lost == 0


@BOTH
def test_stamps_are_right_at_once_after_stop_and_start(fd: bool) -> None:
    bench = Bench(fd)
    bench.run(1.0)
    for pause in (0.1, 3.0):
        bench.board.request(Command.STOP)
        assert bench.run(pause) == 0
        bench.board.request(Command.START)
        assert bench.run(0.5) >= 495  # `run` checks stamps
    assert bench.board.decoder.frames_lost == 0
    assert bench.board.decoder.resets == 0


@BOTH
def test_a_rate_that_another_host_sets_is_followed(fd: bool) -> None:
    bench = Bench(fd)
    bench.run(1.0)
    frame = BASE + COMMAND_OFFSET, CLASSIC, Request(Command.SET_RATE, 99, 2_000_000).pack()
    bench.link.receive(frame, bench.clock.now)
    for _ in range(4000):
        bench.board.read(0.01)
    assert bench.board.decoder.scan_period == 2_000_000
    assert bench.board.restarted == 0  # a scan in two seconds is no silence
    assert bench.board.report().values["scan period [ms]"] == "2000"


@BOTH
def test_a_board_that_a_user_has_stopped_is_left_alone_though_the_adapter_was_unplugged(fd: bool) -> None:
    bench = Bench(fd)
    bench.run(1.0)
    bench.board.request(Command.STOP)
    bench.bus.broken = True
    assert bench.run(3.0) == 0
    assert bench.board.bus.opened == 2
    assert bench.board.report().state == "stopped on request"
    assert not bench.link.board.running
    bench.board.request(Command.START)
    assert bench.run(1.0) >= 999
    bench.bus.broken = True
    bench.run(1.0)
    assert bench.run(1.0) == 1000


@BOTH
@pytest.mark.parametrize("unplugged", [True, False])
def test_a_board_that_a_user_has_stopped_is_started_when_it_was_closed_and_opened_again(
    unplugged: bool, fd: bool
) -> None:
    """Also where the adapter is absent at that time."""
    bench = Bench(fd)
    bench.run(1.0)
    bench.board.request(Command.STOP)
    bench.board.close()
    bench.unplugged = unplugged
    bench.board.open()
    bench.run(1.0)
    bench.unplugged = False
    bench.run(1.0)
    assert bench.run(1.0) == 1000


@BOTH
@pytest.mark.parametrize("lost", [0, 1, 2])
def test_a_board_is_told_to_stop_until_it_answers_before_the_bus_is_closed(lost: int, fd: bool) -> None:
    """At most twice: else what is closed would hang on a board that is gone."""
    bench = Bench(fd)
    bench.run(1.0)
    bench.link.commands.clear()
    receive, closed = bench.link.receive, bench.clock.now

    def lossy(frame: Frame, now: int) -> list[Frame]:
        bench.link.change = {Command.STOP: None} if len(bench.link.commands) < lost else {}
        return receive(frame, now)

    bench.link.receive = lossy  # type: ignore[method-assign]
    bench.link.delay = 10 * MILLISECOND
    bench.board.close()
    assert [request.command for request in bench.link.commands] == [Command.STOP] * min(lost + 1, 2)
    assert bench.clock.now - closed == pytest.approx((200 * lost + 10 * (lost < 2)) * MILLISECOND, abs=2 * MILLISECOND)
    assert bench.board.decoder.frames_lost == 0


def stated(bench: Bench, period: int) -> Frame:
    """Return the identity of the board with another scan period [us]."""
    identity = bench.board.decoder.identity
    assert identity is not None
    return BASE + IDENTITY_OFFSET, CLASSIC, replace(identity, period=period).pack()


@BOTH
def test_silence_is_noticed_though_the_board_has_stated_a_period_that_its_scans_do_not_keep(fd: bool) -> None:
    """Else it would be noticed after ten such periods."""
    bench = Bench(fd)
    bench.run(2.0)
    bench.link.sends(stated(bench, LONGEST_PERIOD), bench.clock.now)
    for _ in range(300):
        bench.board.read(0.01)
    bench.link.delay = 1_000_000 * MILLISECOND
    silent = bench.clock.now
    while FaultKind.NO_SCANS not in bench.board.report().conditions:
        bench.board.read(0.01)
        assert bench.clock.now < silent + 1000 * MILLISECOND


@pytest.mark.parametrize(
    ("delay", "fd"), long_cases(crossed([1, 100, 1000], FRAMES), ["1-classic", "100-fd", "1000-classic"])
)
def test_a_late_response_to_the_stop_before_closing_does_not_stop_a_board_opened_again(delay: int, fd: bool) -> None:
    """As when a data thread is restarted: the response arrives when the next socket is open already."""
    bench = Bench(fd)
    bench.link.delay = delay * MILLISECOND
    bench.run(4 * delay / 1000 + 1)
    bench.board.close()
    bench.board.open()
    bench.run(4 * delay / 1000 + 1)
    assert bench.run(1.0) == 1000


@BOTH
def test_a_command_is_repeated_as_soon_whatever_period_the_board_states_meanwhile(fd: bool) -> None:
    bench = Bench(fd)
    bench.run(2.0)
    frame = stated(bench, LONGEST_PERIOD)
    bench.link.change = dict.fromkeys((Command.IDENTIFY,))
    bench.board.close()
    bench.link.commands.clear()
    bench.board.open()
    bench.link.sends(frame, bench.clock.now)
    for _ in range(100):
        bench.board.read(0.01)
    assert len(bench.link.commands) >= 4  # IDENTIFY, every 0.2 s


def lose_one_response(bench: Bench, command: Command) -> None:
    """Read until the board has got a command, whose response is lost."""
    bench.link.commands.clear()
    bench.link.change = {command: None}
    while command not in [request.command for request in bench.link.commands]:
        bench.board.read(0.01)
    bench.link.change = {}


@BOTH
def test_another_board_is_noticed_though_scans_flow_and_one_response_is_lost(fd: bool) -> None:
    bench = Bench(fd)
    bench.run(1.0)
    bench.link.board.layout_id = 9
    lose_one_response(bench, Command.IDENTIFY)
    lost = bench.clock.now
    while FaultKind.WRONG_LAYOUT not in bench.board.report().conditions:
        bench.board.read(0.01)
        assert bench.clock.now < lost + 1000 * MILLISECOND


@BOTH
def test_a_board_that_is_asked_again_while_scans_flow_is_set_to_its_rate_though_one_response_is_lost(fd: bool) -> None:
    bench = Bench(fd)
    bench.run(1.0)
    identity = bench.board.decoder.identity
    assert identity is not None
    wrong = replace(identity, board=replace(identity.board, layout=9))
    bench.link.sends((BASE + IDENTITY_OFFSET, CLASSIC, wrong.pack()), bench.clock.now)
    lose_one_response(bench, Command.SET_RATE)
    lost = bench.clock.now
    while bench.board.report().health != Health.OK:
        bench.board.read(0.01)
        assert bench.clock.now < lost + 1000 * MILLISECOND
    assert bench.run(1.0) >= 984  # classic scans are numbered from the next header on


@BOTH
@pytest.mark.parametrize("before", ["stopped by a user", "started again", "scanning"])
def test_a_board_that_was_reset_before_it_gets_start_is_set_to_its_rate(before: str, fd: bool) -> None:
    """After power-on it has its shortest period, whatever it has confirmed before."""
    bench = Bench(fd)
    bench.run(1.0)
    bench.board.request(Command.SET_RATE, 2000)
    if before == "stopped by a user":
        bench.board.request(Command.STOP)
    bench.link.delay, receive = 5 * MILLISECOND, bench.link.receive

    def reset(frame: Frame, now: int) -> list[Frame]:
        request = Request.unpack(frame[2])
        if request and request.command == Command.START:
            bench.link.board = BoardFirmware(with_fd(SENSOR, fd), FakeBoard(with_fd(SENSOR, fd)), now, boot=1)
            bench.link.receive = receive  # type: ignore[method-assign]
            if before != "scanning":
                bench.link.due(now)  # its first status comes before the response
        return receive(frame, now)

    bench.link.receive = reset  # type: ignore[method-assign]
    if before == "started again":
        bench.link.board.running = False
    else:
        bench.board.request(Command.START)
    while bench.link.board.boot == 0 or bench.board.report().health != Health.OK:
        bench.board.read(0.01)
    end = bench.clock.now + 1000 * MILLISECOND
    while bench.clock.now < end:
        bench.board.read(0.01)
    scans = bench.board.decoder.scans
    while bench.clock.now < end + 1000 * MILLISECOND:
        bench.board.read(0.01)
    assert abs(bench.board.decoder.scans - scans - 500) <= 1
    assert bench.board.report().values["scan period [ms]"] == "2"


@pytest.mark.parametrize(("delay", "fd"), long_cases(crossed([0.3, 0.9, 1.5, 2.5], FRAMES), ["0.3-classic", "2.5-fd"]))
def test_an_adapter_that_is_slow_but_alive_is_not_reopened_for_ever(delay: float, fd: bool) -> None:
    """Reopening drops what is under way, so it comes ever less often."""
    bench = Bench(fd)
    bench.link.delay = round(delay * 1e9)
    assert bench.run(12.0) > 1000
    opened = bench.board.bus.opened
    assert opened <= 3
    bench.run(5.0)
    assert (bench.board.bus.opened, bench.board.report().health) == (opened, Health.OK)


@BOTH
def test_own_commands_that_the_bus_hands_back_are_no_other_hosts(fd: bool) -> None:
    """As udp_multicast does: the first scans wait for no header that confirms a period which nobody disputes."""
    plain, echoing = Bench(fd), Bench(fd)
    echoing.link.hands_back = True
    assert echoing.run(1.0) == plain.run(1.0) > 900
    assert echoing.board.decoder.traffic.commands == 0
    assert echoing.board.decoder.frames_lost == 0
