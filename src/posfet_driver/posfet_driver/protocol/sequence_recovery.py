"""Sequence numbers of scans: extension of the counter in the frames, and recovery where classic counters are ambiguous.

The two classes here are the only owners of the sequence.
"""

from __future__ import annotations

from typing import Final

from posfet_driver.bus.frame import CLASSIC, Frame
from posfet_driver.protocol.clock_sync import MAX_DRIFT
from posfet_driver.protocol.messages import CLASSIC_BLOCK_OFFSET, Command, Message, Page, Result, Status
from posfet_driver.protocol.scan_assembler import Assembler, BlockOutcome
from posfet_driver.protocol.scan_codec import CLASSIC_COUNTER, CLASSIC_LENGTH

CLASSIC_WRAP: Final = CLASSIC_COUNTER + 1
"""Number of values of a classic scan counter."""
CLASSIC_LATE: Final = 3
"""A classic counter that is up to this far behind belongs to a late frame; further behind, scans were lost."""
STATUS_WRAP: Final = 0x1_0000
"""Modulus of the sequence in a status frame."""
RESPONSE_WRAP: Final = 0x1_0000_0000
"""Modulus of the sequence in the response to START."""

MAX_MISSING: Final = float(CLASSIC_WRAP - CLASSIC_LATE - 1)
"""Scans that may be missing while a classic counter is unambiguous."""
TRUST_AFTER: Final = 2 * MAX_MISSING + 1
"""Scans that a counter that was frozen must count correctly before it is trusted: it cannot do so by chance."""
EARLY_REQUEST: Final = MAX_MISSING / 2
"""Number of possibly missing scans from which on START is sent while frames still arrive: clocks differ."""
REQUEST_INTERVAL: Final = 1_000_000_000
"""Shortest time between two such requests [ns]."""
RESPONSE_TIME: Final = 200_000_000
"""Time within which a board responds [ns]; then the request is repeated."""
HOLD_TIME: Final = 500_000_000
"""Longest time for which frames are held [ns]; a status arrives sooner. Pauses without frames hardly count."""
PAUSE: Final = 50_000_000
"""Time that a pause without frames counts at most [ns]: the response may be behind all that waited meanwhile."""
HOLD_FRAMES: Final = 8192
"""Largest number of frames that are held."""

_COMPLETE, _CONFLICT = BlockOutcome.COMPLETE, BlockOutcome.CONFLICT


def unwrap(reference: int, low: int, modulus: int) -> int:
    """Return the number that is congruent to `low` and closest to `reference`.

    Parameters
    ----------
    reference : int
        A number close to the result.
    low : int
        The result modulo `modulus`.
    modulus : int
        Modulus, an even number.

    Returns
    -------
    int
        The unwrapped number.

    Examples
    --------
    >>> unwrap(0x1_FFFF, 3, 0x1_0000)
    131075
    """
    return reference + (low - reference + modulus // 2) % modulus - modulus // 2


class SequenceTracker:
    """Extends the scan counter of the frames to the full sequence and assigns each block to its scan.

    Blocks of one scan share its counter and, with CAN FD, its device time. A classic counter has 4 bits: the caller
    ensures that fewer than 13 scans are missing between two classic frames, or sets the sequence (`SequenceRecovery`).

    Parameters
    ----------
    assembler : Assembler
        Collects the blocks.
    """

    def __init__(self, assembler: Assembler) -> None:
        codec = assembler.codec
        self.assembler = assembler
        self.sequence = -1
        """Sequence of the scan that was begun last, unwrapped; -1 before the first."""
        self.counter_frozen = False
        """Whether a classic counter was found frozen and has not been trusted since."""
        self._statistics = assembler.statistics
        self._codec = codec
        self._fd = codec.fd
        self._mask = codec.counter_mask
        self._half = (codec.counter_mask + 1) // 2
        self._counter = self.sequence & self._mask  # low bits of the sequence
        self._known = False  # `sequence` is that of a scan of this board
        self._announced = False  # the sequence of the next scan was announced by the board
        self._unexpected = -1  # the counter that arrived instead

    def feed(self, offset: int, kind: int, data: bytes) -> bool:
        """Process one block.

        Parameters
        ----------
        offset : int
            Identifier less the board's base identifier.
        kind : int
            Kind of the frame.
        data : bytes
            Data of the frame.

        Returns
        -------
        bool
            Whether the block completed a scan, which the assembler then holds.
        """
        header = self._codec.header(offset, kind, data)
        if header is None:
            self._statistics.malformed += 1
            return False
        wire_time, counter, block, status = header
        assembler = self.assembler
        if counter != self._counter or wire_time != assembler.wire_time:
            if self._announced and self._is_unexpected(counter):
                pass
            elif self._known and counter == (self._counter + 1) & self._mask:
                assembler.begin(wire_time)
                self._counter = counter
                self.sequence += 1
            elif not self._begin(counter, wire_time):
                return False
        outcome = assembler.add(block, status, data)
        if outcome is _COMPLETE:
            return True
        if outcome is _CONFLICT:
            self.counter_frozen = True
        return False

    def resync(self, next_scan: int, count_gap: bool = True, reset: bool = False) -> bool:
        """Set the sequence of the next scan, as the board announces it.

        Parameters
        ----------
        next_scan : int
            Low 32 bits of the sequence of the next scan.
        count_gap : bool, default True
            Whether scans between the last one and the next one count as lost.
        reset : bool, default False
            Whether the board reports a reset.

        Returns
        -------
        bool
            Whether the board was reset, by its own report or because its sequence fell: sequence and clock restarted.
        """
        ahead = unwrap(self.sequence, next_scan, RESPONSE_WRAP) - self.sequence
        reset = self._known and (reset or ahead <= -CLASSIC_LATE)
        if self._known and not reset:
            if ahead > 1:  # else scans have overtaken the response
                self.assembler.abandon()
                self.assembler.count_lost((ahead - 1) * count_gap)
                self._set(self.sequence + ahead - 1, announced=True)
            return False
        self.assembler.abandon()
        self.assembler.forget_clock()
        self.counter_frozen = False
        self._set(next_scan - 1, announced=True)
        return reset

    def align(self, newest: int, modulus: int) -> None:
        """Correct the sequence by that of the newest scan, which boards send between two scans.

        A classic counter does not show that a multiple of 16 scans was lost; this does. What the counter does show is
        left to it. A sequence below the current one corrects the count of lost scans.

        Parameters
        ----------
        newest : int
            Sequence of the newest scan, modulo `modulus`.
        modulus : int
            2^16 in a status frame, 2^32 in a response.
        """
        ahead = unwrap(self.sequence, newest, modulus) - self.sequence
        if not self._fd and not -CLASSIC_LATE <= ahead < CLASSIC_WRAP - CLASSIC_LATE:
            self.skip(ahead)

    def skip(self, scans: int) -> None:
        """Advance the sequence by scans that are lost; a negative number corrects the count of lost scans."""
        self.assembler.abandon()
        if self._known:
            self.assembler.count_lost(scans)
        self._set(self.sequence + scans, announced=False)

    def report_frozen_counter(self) -> None:
        """Note that two scans with different data share one classic counter."""
        self._statistics.frozen_counter += 1
        self.counter_frozen = True

    def trust_counter(self) -> None:
        """Note that a counter that was frozen counts again."""
        self.counter_frozen = False

    def _set(self, sequence: int, announced: bool) -> None:
        self.sequence = sequence
        self._counter = sequence & self._mask
        self._known = True
        self._announced, self._unexpected = announced and not self._fd, -1  # FD frames: the device time suffices

    def _is_unexpected(self, counter: int) -> bool:
        """Return whether a classic counter, the first after an announcement, may be frozen.

        When it differs from the announced one, scans were lost, or it is frozen: its scan is abandoned until it counts.
        """
        if self._unexpected < 0 and counter != (self.sequence + 1) & CLASSIC_COUNTER:
            self._unexpected = counter
        self._announced = counter == self._unexpected
        return self._announced

    def _begin(self, counter: int, wire_time: int) -> bool:
        """Begin the scan of a block; return False when the block is late or ambiguous."""
        ahead = (counter - self._counter) & self._mask
        if not self._known:
            self.sequence, ahead = counter - 1, 1
            self._known = True
        elif self._fd:
            if ahead == 0:  # the device time differs
                self._statistics.frozen_counter += 1
                return False
            if ahead >= self._half:
                self._statistics.late += 1
                return False
        elif ahead > self._mask - CLASSIC_LATE:
            self._statistics.late += 1
            return False
        self.assembler.begin(wire_time)
        if ahead > 1:
            self.assembler.count_lost(ahead - 1)
        self.sequence += ahead
        self._counter = counter
        return True


class SequenceRecovery:
    """Holds the frames of one board while a classic counter may hide that 16, 32 or more scans were lost.

    A board responds to START with the sequence of its next scan, even when it is running. No scan is therefore newer
    than that sequence plus one for each scan period since the request was sent. While this bound is less than 16 above
    the newest counter received, the counter is unambiguous, whatever was lost or late.

    When it is not, because the cable was unplugged or a host or an adapter was delayed, frames are held. They are
    released when the missing ones arrive, so that a pause in which nothing was lost loses nothing. Otherwise START has
    to be sent again (`resync_needed`). The response has its position among the scans, as has a status with the sequence
    of the newest scan: when as many scans were counted up to there as it states, the held ones are correct, else they
    are dropped and counted as lost.

    While a counter is frozen (`SequenceTracker.counter_frozen`) no scan is released, until it has been seen to count.

    A passive listener, which never sends START, has no such bound: it assumes that the frames that arrived first were
    undelayed, and after a pause it guesses until a status arrives.

    Parameters
    ----------
    base : int
        The board's base identifier.
    tracker : SequenceTracker
        Sequence of the scans.
    """

    def __init__(self, base: int, tracker: SequenceTracker) -> None:
        self.resync_requests = 0
        """Number of times START was sent to a running board to learn its sequence."""
        self._tracker = tracker
        self._first_block = base + CLASSIC_BLOCK_OFFSET
        self._last_block = self._first_block + tracker.assembler.codec.blocks - 1
        self._bound = 0.0  # no scan of the board has a higher sequence
        self._bound_known = False
        self._arrival = 0
        self._period = 1.0
        self._held: list[Frame] = []
        self._newest = 0  # sequence of the newest scan, held ones included
        self._previous_block = b""  # the newest first block of a scan
        self._doubted = False  # the counter was wrong, and has not been seen to count since
        self._correct_from = 0  # sequence from which on a counter that was frozen was correct
        self._flowing = False  # a scan began in the previous batch
        self._since_batch = 0  # time from the previous batch to this one [ns]
        self._held_for = 0  # time for which the oldest frame has been held, without pauses [ns]
        self._tag: int | None = None  # of a request without response
        self._sent: int | None = None  # time of the newest request; None: this host sends none

    @property
    def holding(self) -> bool:
        """Whether frames are held."""
        return bool(self._held)

    @property
    def held_frames(self) -> int:
        """Number of frames that are held."""
        return len(self._held)

    def resync_needed(self) -> bool:
        """Return whether START has to be sent to a running board, to learn the sequence of its next scan."""
        if self._sent is None:
            return False
        since = self._arrival - self._sent
        if self._tag is not None and since < RESPONSE_TIME:
            return False
        if self._tracker.counter_frozen:
            return self._bound_known and self._bound - self._correct_from > TRUST_AFTER
        missing = self._bound - self._tracker.sequence
        early = self._flowing and self._bound_known and missing > EARLY_REQUEST and since > REQUEST_INTERVAL
        return self.holding or early

    def note_start_sent(self, tag: int, now: int) -> None:
        """Note that START is being sent.

        Parameters
        ----------
        tag : int
            Tag of the command.
        now : int
            Monotonic time [ns].
        """
        self.resync_requests += self._bound_known or self.holding
        self._tag, self._sent = tag, now

    def forget_bound(self) -> None:
        """Discard the bound: the scan period may have changed."""
        self._bound_known = False

    def set_initial_sequence(self, newest: int) -> None:
        """Set the bound by the sequence of the newest scan, unless there is one already."""
        if not self._bound_known:
            self._bound, self._bound_known = newest + 1.0, True

    def begin_batch(self, arrival: int, period: float, receiving: bool) -> bool:
        """Begin a batch of frames.

        Parameters
        ----------
        arrival : int
            Monotonic time at which the batch was read [ns].
        period : float
            Scan period [ns].
        receiving : bool
            Whether scans are received; otherwise nothing is held.

        Returns
        -------
        bool
            Whether all frames of the batch can be decoded immediately; if not, they have to pass `sort_out`.
        """
        tracker = self._tracker
        self._since_batch = arrival - self._arrival
        self._bound += self._since_batch / period * (1.0 + MAX_DRIFT)
        self._arrival, self._period = arrival, period
        if not receiving:
            self._bound_known = False
        elif self._sent is None:
            self._assume_undelayed()
        if not self._held and not tracker.counter_frozen:
            self._flowing = self._newest != tracker.sequence
            self._newest = self._correct_from = tracker.sequence
            if self._tag is None and (not receiving or self._is_certain()):
                return True
            self._previous_block = self._previous_block if self._doubted else b""
        return False

    def sort_out(self, items: list[Frame | Message], receiving: bool) -> list[Frame | Message]:
        """Hold the scan blocks of a batch and release those with a certain sequence.

        Parameters
        ----------
        items : list of frames and messages
            The batch; short messages of the board are parsed.
        receiving : bool
            As in `begin_batch`.

        Returns
        -------
        list of frames and messages
            What is to be decoded now, in order; blocks of earlier batches may be among it.
        """
        self._held_for += min(self._since_batch, PAUSE) if items else 0
        released = self._hold_blocks(items, receiving)
        if self._is_certain() or not (receiving or self._bound_known):
            released += self._release()
        elif self._held and (self._held_for > HOLD_TIME or len(self._held) > HOLD_FRAMES):
            self._held = []
            if self._sent is None:
                self._tracker.align(int(self._bound), RESPONSE_WRAP)
        return released

    def _is_certain(self) -> bool:
        trusted = self._bound_known and not self._doubted and not self._tracker.counter_frozen
        return trusted and 0.0 <= self._bound - self._newest < MAX_MISSING

    def _assume_undelayed(self) -> None:
        """Set the bound by the scans themselves."""
        newest = float(self._tracker.sequence)
        self._bound = max(self._bound, newest + 1) if self._bound_known else newest + 1
        self._bound_known = True

    def _hold_blocks(self, items: list[Frame | Message], receiving: bool) -> list[Frame | Message]:
        """Hold blocks; return the rest, and with each sequence that the board states the blocks that it confirms."""
        released: list[Frame | Message] = []
        for item in items:
            if isinstance(item, tuple):
                identifier, kind, data = item
                in_range = self._first_block <= identifier <= self._last_block
                if in_range and kind == CLASSIC and len(data) == CLASSIC_LENGTH:
                    self._hold(item)
                else:
                    released.append(item)
                continue
            newest = self._stated_sequence(item)
            if newest is not None:
                correct = -CLASSIC_LATE <= newest - self._newest <= MAX_MISSING
                close = abs(newest - self._newest) <= CLASSIC_LATE
                held = self._release()
                released += held if correct and receiving else []
                self._doubted = self._doubted or (receiving and not close)
                if self._tracker.counter_frozen:
                    self._watch_frozen_counter(newest, close)
                self._newest = self._newest if correct else newest
            released.append(item)
        return released

    def _hold(self, block: Frame) -> None:
        identifier, _, data = block
        ahead = (data[0] - self._newest) & CLASSIC_COUNTER
        self._newest += ahead if ahead <= MAX_MISSING else 0  # else it is late
        if identifier == self._first_block:
            self._compare(data)
        if self._tracker.counter_frozen:
            return
        if not self._held:
            self._held_for = 0
        self._held.append(block)

    def _compare(self, block: bytes) -> None:
        """Detect a frozen counter by the first blocks of two scans."""
        previous, self._previous_block = self._previous_block, block
        if not previous or block == previous:
            return
        if (block[0] ^ previous[0]) & CLASSIC_COUNTER:
            self._doubted = False
        else:
            self._tracker.report_frozen_counter()
            self._held = []

    def _watch_frozen_counter(self, newest: int, correct: bool) -> None:
        """Check by a sequence that the board states whether a counter that was frozen counts again."""
        ahead = newest - self._tracker.sequence
        if ahead >= -CLASSIC_WRAP:  # else the board was reset
            self._tracker.skip(ahead)
        if not correct:
            self._correct_from = self._newest = newest
        elif newest - self._correct_from >= TRUST_AFTER:
            self._tracker.trust_counter()

    def _release(self) -> list[Frame]:
        held, self._held = self._held, []
        return held

    def _stated_sequence(self, message: Message) -> int | None:
        """Return the sequence of the newest scan, when the message states it."""
        if isinstance(message, Status):
            if message.page != Page.SCAN:
                return None
            newest = unwrap(self._newest, message.value, STATUS_WRAP)
            if self._tag is not None and self._arrival - (self._sent or 0) > RESPONSE_TIME:
                self._bound, self._bound_known = newest + 1.0, True  # in place of the response, which does not arrive
            return newest
        if message.command != Command.START or message.result != Result.OK:
            return None
        newest = unwrap(self._newest, message.value - 1, RESPONSE_WRAP)
        if message.tag == self._tag:
            self._bound = newest + 1 + (self._arrival - (self._sent or 0)) / self._period
            self._tag, self._bound_known = None, True
        return newest
