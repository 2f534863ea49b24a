"""Sequence of classic scans, whose counter wraps after 16: a scan is published only when its sequence is certain."""

from __future__ import annotations

import random
from collections import deque

import pytest

from posfet_driver.bus.frame import CLASSIC, Frame
from posfet_driver.protocol.decoder import Decoder, ResponseReceived, ScanReady
from posfet_driver.protocol.messages import COMMAND_OFFSET, Command, Page, Request, Status
from posfet_model.sensor.description import load_sensor
from posfet_sim.emulation.firmware import BoardFirmware
from support.fake_board import FakeBoard, assert_marked, with_fd

SENSOR = load_sensor()
BASE = SENSOR.can.base_id
PERIOD = round(1e9 / SENSOR.can.scan_rate)
STEP = PERIOD // 4
BLOCKS = range(BASE + 8, BASE + 13)


class Line:
    """A board, a link that can be cut, an adapter that can be delayed, and a host with requests, in stepped time."""

    def __init__(self, speed: float = 1.0, transit_time: int = 0) -> None:
        self.firmware = BoardFirmware(with_fd(SENSOR, False), FakeBoard(SENSOR), 0)
        self.decoder = Decoder(with_fd(SENSOR, False))
        self.now = 0
        self.cut = False
        self.held_up = False
        self.unresponsive = False
        self.published: list[int] = []
        self.questions = 0
        self._speed = speed  # of the board clock
        self._way = transit_time  # [ns] in each direction
        self._queue: deque[tuple[int, Frame]] = deque()
        self._commands: deque[tuple[int, Frame]] = deque()
        self._ask()
        while not self.published:
            self.step()

    def step(self, periods: float = 0.25) -> None:
        """Advance the time; read and check the scans."""
        self.now += round(periods * PERIOD)
        board_time = round(self.now * self._speed)
        while self._commands and self._commands[0][0] <= self.now:
            self._send(self.firmware.receive(self._commands.popleft()[1], board_time))
        self._send(self.firmware.due(board_time))
        if self.held_up:
            return
        frames = []
        while self._queue and self._queue[0][0] <= self.now:
            frames.append(self._queue.popleft()[1])
        for decoded in self.decoder.decode(frames, self.now, 0):
            if isinstance(decoded, ScanReady):
                assert_marked(decoded.scan)
                self.published.append(decoded.scan.sequence)
            elif isinstance(decoded, ResponseReceived):
                assert not self.decoder.resync(decoded.response.value, count_gap=True)
        if self.decoder.resync_needed():
            self._ask()

    def run(self, periods: int) -> None:
        for _ in range(4 * periods):
            self.step()

    def account(self) -> int:
        """Number of scans that are published or counted as lost."""
        losses = self.decoder.statistics
        return self.published[0] + len(self.published) + losses.incomplete_scans + losses.lost_scans

    def _ask(self) -> None:
        self.questions += 1
        self.decoder.note_start_sent(self.questions & 0xFF, self.now)
        if not (self.cut or self.unresponsive):
            request = Request(Command.START, self.questions & 0xFF).pack()
            self._commands.append((self.now + self._way, (BASE + COMMAND_OFFSET, CLASSIC, request)))

    def _send(self, frames: list[Frame]) -> None:
        if not self.cut:
            self._queue += [(self.now + self._way, frame) for frame in frames]

    def lose(self, scans: int) -> None:
        """Let the adapter drop what the board sends for a while."""
        self.cut = True
        self.run(scans)
        self.cut = False


@pytest.mark.parametrize("transit_time", [0, PERIOD, 5 * PERIOD, 20 * PERIOD])
@pytest.mark.parametrize("scans", [1, 8, 13, 15, 16, 17, 32, 100])
def test_the_sequence_is_right_after_a_pause_of_any_length(scans: int, transit_time: int) -> None:
    line = Line(transit_time=transit_time)
    line.run(50)
    for _ in range(5):
        line.lose(scans)
        line.run(60 + 8 * transit_time // PERIOD)
    line.run(400)
    assert len(set(line.published)) == len(line.published)
    assert line.account() == line.published[-1] + 1
    again = 200 if transit_time > PERIOD * 6 else 0  # a request is pending all the time: one is lost and sent again
    few = 5 * (scans + 2 + 4 * transit_time // PERIOD + again)
    assert line.decoder.statistics.lost_scans <= few


@pytest.mark.parametrize("transit_time", [0, PERIOD, 20 * PERIOD])
@pytest.mark.parametrize("pause", [5, 12, 16, 17, 40, 250])
def test_late_scans_are_not_lost(pause: int, transit_time: int) -> None:
    line = Line(transit_time=transit_time)
    line.run(50)
    for _ in range(5):
        line.held_up = True
        line.run(pause)
        line.held_up = False
        line.run(100)
    line.run(2 * transit_time // PERIOD)
    assert line.published == list(range(line.published[0], line.published[-1] + 1))
    assert line.published[-1] >= line.now // PERIOD - 4 - 3 * transit_time // PERIOD


def test_scans_lost_among_late_ones_do_not_shift_the_sequence() -> None:
    """16 scans are lost among frames that are late themselves, so that arrival times do not reveal it."""
    line = Line()
    line.run(100)
    line.held_up = True
    line.run(30)
    line.lose(16)
    line.run(30)
    line.held_up = False
    line.run(400)
    assert line.account() == line.published[-1] + 1
    assert line.decoder.statistics.lost_scans >= 16


@pytest.mark.parametrize("speed", [1 - 5e-3, 1 - 50e-6, 1.0, 1 + 50e-6, 1 + 5e-3])
def test_a_board_clock_with_a_rate_error_loses_no_scans(speed: float) -> None:
    line = Line(speed)
    line.run(6_000)
    assert line.published == list(range(line.published[0], line.published[-1] + 1))
    assert line.published[-1] > line.now * speed / PERIOD - 20
    assert line.questions <= (30 if abs(speed - 1) > 1e-3 else 1)
    assert line.decoder.resync_requests == line.questions - 1  # the first one starts the board


def test_a_board_ignoring_commands_is_numbered_by_its_status() -> None:
    line = Line()
    line.run(100)
    line.unresponsive = True
    line.lose(16)
    line.run(700)
    assert line.account() == line.published[-1] + 1
    assert line.published[-1] >= line.now // PERIOD - 2
    assert line.decoder.statistics.lost_scans < 16 + 310  # at most until the next status


def test_a_listen_only_decoder_takes_the_sequence_from_the_status() -> None:
    line = Line()
    line.run(25)
    frames = [line.firmware.due(index * PERIOD) for index in range(line.published[-1] + 1, 3000)]
    decoder = Decoder(with_fd(SENSOR, False))
    decoder.receiving = True
    numbers = []
    for index, batch in enumerate(frames):
        if not 1500 <= index < 1548:
            for decoded in decoder.decode(batch, index * PERIOD, 0):
                if isinstance(decoded, ScanReady):
                    numbers.append(decoder.scan.sequence)
                    if decoder.scan.sequence > 1000:
                        assert_marked(decoder.scan)
    assert numbers[-1] == 2999
    assert len(numbers) > 2900 - 350


def test_frames_that_stay_ambiguous_are_discarded_and_use_bounded_memory() -> None:
    line = Line()
    line.run(25)
    blocks = [frame for frame in line.firmware.due(line.now + 20 * PERIOD) if frame[0] in BLOCKS]
    held = 0
    for turn in range(1000):  # the board clock is frozen: the same scans are sent endlessly, without status
        line.decoder.decode(blocks, line.now + turn * 20 * PERIOD, 0)
        held = max(held, line.decoder.held_frames)
    assert 0 < held < 9000


@pytest.mark.parametrize("seed", range(4))
def test_sequences_are_right_and_add_up_under_arbitrary_loss_and_delay(seed: int) -> None:
    noise = random.Random(seed)
    line = Line(1 + noise.uniform(-50e-6, 50e-6), noise.choice([0, PERIOD // 2, 3 * PERIOD]))
    for _ in range(150):
        event = noise.random()
        length = min(int(noise.expovariate(1 / 20)), 200)
        if event < 0.3:
            line.lose(length)
        elif event < 0.6:
            line.held_up = True
            line.run(length)
            if noise.random() < 0.5:
                line.lose(noise.choice([1, 13, 15, 16, 17, 32]))
                line.run(noise.randrange(10))
            line.held_up = False
        line.run(noise.randrange(30))
    line.run(700)
    assert line.published == sorted(set(line.published))
    assert line.account() == line.published[-1] + 1


def test_a_status_queued_before_the_preceding_scan_has_no_effect() -> None:
    line = Line()
    line.run(100)
    newest = line.published[-1]
    status = Status((20.0, 20.0), 5.0, 0, Page.SCAN, newest - 1).pack()
    list(line.decoder.decode([(BASE + 2, CLASSIC, status)], line.now, 0))
    line.run(10)
    assert line.published == list(range(line.published[0], line.published[-1] + 1))
