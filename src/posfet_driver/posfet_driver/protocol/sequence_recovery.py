"""The numbers of classic scans, whose counter is the same again after 16 of them: certain, or not handed on."""

from __future__ import annotations

from typing import Final

from posfet_driver.bus.frame import CLASSIC, Frame
from posfet_driver.protocol.clock_sync import DRIFT
from posfet_driver.protocol.messages import (
    CLASSIC_BLOCK_OFFSET,
    RESPONSE_OFFSET,
    STATUS_OFFSET,
    Command,
    Page,
    Response,
    Result,
    Status,
)
from posfet_driver.protocol.scan_assembler import CLASSIC_LATE, CLASSIC_WRAP, NUMBER_WRAP, SCAN_PAGE, Assembler, nearest
from posfet_driver.protocol.scan_codec import CLASSIC_COUNTER, CLASSIC_LENGTH

CERTAIN: Final = float(CLASSIC_WRAP - CLASSIC_LATE - 1)
"""Scans that may be missing while the counter still tells which."""
MISLED: Final = 2 * CERTAIN + 1
"""Scans that have to be counted right until a counter that stood still is believed: it cannot by chance."""
ASK_EARLY: Final = CERTAIN / 2
"""Scans that may be missing from which the board is asked, while frames still pass: clocks differ."""
ASK_PERIOD: Final = 1_000_000_000
"""Least time between two such questions [ns]."""
ANSWER_TIME: Final = 200_000_000
"""Time within which a board answers [ns]; then it is asked again."""
HOLD_TIME: Final = 500_000_000
"""Longest time for which frames are held [ns]; a status comes in less. Time in which nothing comes does not count."""
PAUSE: Final = 50_000_000
"""Time without any frame [ns] that counts at most: after it the answer may be behind all that waited meanwhile."""
HOLD_FRAMES: Final = 8192
"""Most frames that are held."""


class Numbering:
    """Holds the frames of one board while the counter may hide that 16 scans, or 32, or more, were lost.

    START is answered by the number of the next scan, even when the board is running. So no scan is newer than that
    number, plus one for each scan period since the question was sent. As long as this bound is less than 16 above the
    newest counter heard, the counter is certain, whatever was lost or late.

    When it is not, because the cable was out or a host or an adapter was held up, frames are held. They go on when the
    rest has come, so that a pause in which nothing was lost loses nothing. Else the board is asked (`question_due`).
    Its answer comes in its place among the scans, as a status with the number of the newest scan does: when the scans
    counted up to there are as many as it tells, those held are certain, else they are dropped, and counted as lost.

    While a counter stands still (`Assembler.misled`) nothing is handed on, until it has been seen to count.

    A receiver that only listens (no question was ever noted) has no such bound: it takes the frames that came soonest
    for undelayed ones, and after a silence guesses until a status comes.
    """

    def __init__(self, base: int, assembler: Assembler) -> None:
        self.questions = 0
        """How often a running board was asked."""
        self._assembler = assembler
        self._response = base + RESPONSE_OFFSET
        self._status = base + STATUS_OFFSET
        self._first = base + CLASSIC_BLOCK_OFFSET
        self._last = self._first + assembler.codec.blocks - 1
        self._bound = 0.0  # no scan of the board has a higher number
        self._known = False  # there is such a bound
        self._arrival = 0
        self._period = 1.0
        self._held: list[Frame] = []
        self._number = 0  # of the newest scan, held ones included
        self._before = b""  # the newest first block of a scan
        self._doubted = False  # the counter was wrong, and has not been seen to count since
        self._right_from = 0  # number from which a counter that stood still was right
        self._flowing = False  # a scan began in the batch before
        self._waited = 0  # for how long the first frame has been held, pauses left out
        self._tag: int | None = None  # of a question that is not answered
        self._sent: int | None = None  # when the newest question was sent; None: nobody asks

    @property
    def holding(self) -> bool:
        """Whether frames are held."""
        return bool(self._held)

    def question_due(self) -> bool:
        """Return whether the board has to be told START, whose answer makes numbers certain."""
        if self._sent is None:
            return False
        since = self._arrival - self._sent
        if self._tag is not None and since < ANSWER_TIME:
            return False
        if self._assembler.misled:
            return self._known and self._bound - self._right_from > MISLED
        missing = self._bound - self._assembler.sequence
        return self.holding or (self._flowing and self._known and missing > ASK_EARLY and since > ASK_PERIOD)

    def asked(self, tag: int, now: int) -> None:
        """Take note that START is being sent at `now` [ns]."""
        self.questions += self._known or self.holding
        self._tag, self._sent = tag, now

    def forget(self) -> None:
        """Give up the bound: scans may come at another rate."""
        self._known = False

    def anchor(self, newest: int) -> None:
        """Take the number of the newest scan, when nothing better is known."""
        if not self._known:
            self._bound, self._known = newest + 1.0, True

    def take(self, frames: list[Frame], arrival: int, period: float, listening: bool) -> list[Frame]:
        """Take a batch read at `arrival` [ns] at a scan period [ns]; return what is to be fed, maybe less or more.

        Without `listening` nothing is held: scans are of no use until a START is answered.
        """
        passed = arrival - self._arrival
        self._bound += passed / period * (1.0 + DRIFT)
        self._arrival, self._period = arrival, period
        self._waited += min(passed, PAUSE) if frames else 0
        if not listening:
            self._known = False
        elif self._sent is None:
            self._listen_only()
        if not self._held and not self._assembler.misled:
            self._flowing = self._number != self._assembler.sequence
            self._number = self._right_from = self._assembler.sequence
            if self._tag is None and (not listening or self._is_certain()):
                return frames
            self._before = self._before if self._doubted else b""
        settled = self._judge(frames, listening)
        if self._is_certain() or not (listening or self._known):
            settled += self._release(True)
        elif self._held and (self._waited > HOLD_TIME or len(self._held) > HOLD_FRAMES):
            self._release(False)
            if self._sent is None:
                self._assembler.align(int(self._bound), NUMBER_WRAP)
        return settled

    def _is_certain(self) -> bool:
        trusted = self._known and not self._doubted and not self._assembler.misled
        return trusted and 0.0 <= self._bound - self._number < CERTAIN

    def _listen_only(self) -> None:
        """Take the bound from the scans themselves."""
        newest = float(self._assembler.sequence)
        self._bound = max(self._bound, newest + 1) if self._known else newest + 1
        self._known = True

    def _judge(self, frames: list[Frame], listening: bool) -> list[Frame]:
        """Hold blocks; return the rest, and with each number that the board tells the blocks that it makes certain."""
        settled: list[Frame] = []
        for frame in frames:
            identifier, kind, data = frame
            if self._first <= identifier <= self._last and kind == CLASSIC and len(data) == CLASSIC_LENGTH:
                ahead = (data[0] - self._number) & CLASSIC_COUNTER
                self._number += ahead if ahead <= CERTAIN else 0  # else it is late
                if identifier == self._first:
                    self._compare(data)
                if self._assembler.misled:
                    continue
                if not self._held:
                    self._waited = 0
                self._held.append(frame)
                continue
            newest = self._told(frame) if kind == CLASSIC else None
            if newest is not None:
                right = -CLASSIC_LATE <= newest - self._number <= CERTAIN
                close = abs(newest - self._number) <= CLASSIC_LATE
                settled += self._release(right and listening)
                self._doubted = self._doubted or (listening and not close)
                if self._assembler.misled:
                    self._watch(newest, close)
                self._number = self._number if right else newest
            settled.append(frame)
        return settled

    def _compare(self, block: bytes) -> None:
        """See whether the counter stands still, by the first blocks of two scans."""
        before, self._before = self._before, block
        if not before or block == before:
            return
        if (block[0] ^ before[0]) & CLASSIC_COUNTER:
            self._doubted = False
        else:
            self._assembler.losses.stuck += 1
            self._assembler.misled = True
            self._release(False)

    def _watch(self, newest: int, right: bool) -> None:
        """See whether a counter that stood still counts again, by a number that the board tells."""
        ahead = newest - self._assembler.sequence
        if ahead >= -CLASSIC_WRAP:  # else the board was reset
            self._assembler.jump(ahead)
        if not right:
            self._right_from = self._number = newest
        elif newest - self._right_from >= MISLED:
            self._assembler.misled = False

    def _release(self, certain: bool) -> list[Frame]:
        held, self._held = self._held, []
        return held if certain else []

    def _told(self, frame: Frame) -> int | None:
        """Return the number of the newest scan, when the board tells it by this frame."""
        identifier, _, data = frame
        if identifier == self._status:
            status = Status.unpack(data)
            if status is None or status.page != Page.SCAN:
                return None
            newest = nearest(self._number, status.value, SCAN_PAGE)
            if self._tag is not None and self._arrival - (self._sent or 0) > ANSWER_TIME:
                self._bound, self._known = newest + 1.0, True  # a deaf board's status stands in for its answer
            return newest
        response = Response.unpack(data) if identifier == self._response else None
        if response is None or response.command != Command.START or response.result != Result.OK:
            return None
        newest = nearest(self._number, response.value - 1, NUMBER_WRAP)
        if response.tag == self._tag:
            self._bound = newest + 1 + (self._arrival - (self._sent or 0)) / self._period
            self._tag, self._known = None, True
        return newest
