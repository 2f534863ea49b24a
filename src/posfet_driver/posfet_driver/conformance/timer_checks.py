# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Rules of the scan timer: sequence, period, device time, missing scans."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

from posfet_driver.conformance.checks import Phase, check
from posfet_driver.conformance.records import JITTER, MICROSECOND, SECOND, BrokenRuleError, NotCheckedError, Run
from posfet_driver.conformance.seen_scans import SEQUENCES, SeenScan
from posfet_driver.conformance.session import Session

LEAST_DELAY: Final = 0.002
"""Difference of the shortest delays of two groups of frames [s]; assumed."""
ROUNDING: Final = 1
"""A device time is a whole number of microseconds [us]."""
OVERRUN: Final = 8
"""Flag of a scan overrun."""


def wrap(session: Session) -> int:
    """Return the number after which the device time begins again [us].

    Parameters
    ----------
    session : Session
        The board.
    """
    return 1 << (32 if session.board.fd else 28)


def elapsed(session: Session, begin: SeenScan, end: SeenScan) -> int:
    """Return the device time from one scan to another [us].

    Parameters
    ----------
    session : Session
        The board.
    begin, end : SeenScan
        Scans with a time.
    """
    assert begin.time is not None
    assert end.time is not None
    return (end.time - begin.time) % wrap(session)


def ticks(begin: SeenScan, end: SeenScan) -> int:
    """Return the number of ticks from one scan to another.

    Parameters
    ----------
    begin, end : SeenScan
        Scans with a sequence.
    """
    return (end.sequence - begin.sequence) % SEQUENCES


def timed(scans: list[SeenScan]) -> list[SeenScan]:
    """Return the scans with a time.

    Parameters
    ----------
    scans : list of SeenScan
        Scans.
    """
    return [scan for scan in scans if scan.time is not None and scan.sequence >= 0]


def tick_length(session: Session, scans: list[SeenScan]) -> float:
    """Return the time from one tick to the next by the board's clock [us].

    Parameters
    ----------
    session : Session
        The board.
    scans : list of SeenScan
        Scans at one period.

    Raises
    ------
    NotCheckedError
        When fewer than two of them have a time.
    """
    stated = timed(scans)
    if len(stated) < 2 or not ticks(stated[0], stated[-1]):
        raise NotCheckedError("too few scans with a time")
    return elapsed(session, stated[0], stated[-1]) / ticks(stated[0], stated[-1])


def irregularity(session: Session, scans: list[SeenScan]) -> str:
    """Return what is irregular about scans that have to follow each other tick by tick; '' when nothing is.

    Parameters
    ----------
    session : Session
        The board.
    scans : list of SeenScan
        Scans at one period.
    """
    for before, scan in pairwise(scans):
        if scan.sequence >= 0 and ticks(before, scan) != 1:
            return f"scan {scan.sequence} follows scan {before.sequence}"
    stated = timed(scans)
    if len(stated) > 2:
        length = tick_length(session, stated)
        for before, scan in pairwise(stated):
            if abs(elapsed(session, before, scan) / ticks(before, scan) - length) > length / 2:
                return f"the time from scan {before.sequence} to {scan.sequence} is {elapsed(session, before, scan)} us"
    return ""


def scans_needed(session: Session, count: int) -> int:
    """Return the number of scans to listen to so that `count` of them have a time.

    Parameters
    ----------
    session : Session
        The board.
    count : int
        Number of times.
    """
    every = session.description.states["timing"]["header_scans"]
    return count if session.board.fd else every * (count - 1) + 2


@check("T1")
def timer_runs_while_stopped(session: Session) -> str:
    """Check that the sequence goes on while the board is stopped."""
    session.settle()
    with session.scanning("T1") as first:
        session.listen_to_scans(scans_needed(session, 3))
    session.listen(0.2 + 0.2 * session.numbers.random())
    with session.scanning("T1") as second:
        session.listen_to_scans(scans_needed(session, 2))
    before, after = session.run_scans(first), session.run_scans(second)
    if not timed(before) or not timed(after):
        raise NotCheckedError("no scans with a time")
    begin, end = timed(before)[-1], timed(after)[0]
    counted, by_device = ticks(begin, end), elapsed(session, begin, end) / tick_length(session, before)
    by_host = (end.arrival - begin.arrival) / (session.period * MICROSECOND)
    if abs(counted - by_device) > 0.5:
        raise BrokenRuleError(f"{counted} ticks while stopped, {by_device:.1f} by the device time")
    if abs(counted - by_host) * session.period * 1e-6 > 5 * JITTER + 0.01 * by_host * session.period * 1e-6:
        raise BrokenRuleError(f"{counted} ticks while stopped, {by_host:.1f} by the host's clock")
    return f"{counted} ticks from the last scan before to the first after a stop"


@check("T1", Phase.REVIEW)
def first_tick(session: Session) -> str:
    """Check that the first tick after power-on has the sequence 0."""
    scans = timed(_power_on_scans(session))
    if not scans or scans[0].time is None:
        raise NotCheckedError("no scan with a time after power-on")
    ahead = scans[0].sequence * tick_length(session, scans) - scans[0].time
    if not -100_000 <= ahead <= session.board.period:
        raise BrokenRuleError(f"scan {scans[0].sequence} at {scans[0].time} us after power-on")
    return f"scan {scans[0].sequence} at {scans[0].time} us after power-on"


@check("T2")
def period_stays(session: Session) -> str:
    """Check that sTOP and START do not change the period."""
    session.settle()
    lengths = []
    with session.scanning("T2"):
        session.must("SET_RATE", session.numbers.choice((2, 3)) * session.board.period)
        session.listen_to_scans(2)
        begin = len(session.frames)
        session.listen_to_scans(scans_needed(session, 3))
        lengths.append(tick_length(session, session.scans(begin)))
    with session.scanning("T2") as run:
        session.listen_to_scans(scans_needed(session, 3))
    lengths.append(tick_length(session, session.run_scans(run)))
    if abs(lengths[1] / lengths[0] - 1) > 0.01:
        raise BrokenRuleError(f"ticks every {lengths[0]:.0f} us before STOP and START, {lengths[1]:.0f} us after")
    return f"ticks every {lengths[0]:.0f} us before and after STOP and START"


@check("T2")
def period_after_power_on(session: Session) -> str:
    """Check that the period after power-on is the shortest one."""
    scans = _power_on_scans(session)
    session.settle()
    length = round(tick_length(session, scans))
    for shorter in (length - 1, length // 2):
        if not session.ask("SET_RATE", shorter).result:
            raise BrokenRuleError(f"{length} us after power-on, although SET_RATE {shorter} is accepted")
    return f"{length} us after power-on, shorter ones are refused"


def _power_on_scans(session: Session) -> list[SeenScan]:
    if session.power_on is None or session.power_on.run is None:
        raise NotCheckedError("after power-on: with --power-cycle")
    return session.run_scans(session.power_on.run)


@dataclass(frozen=True)
class _Change:
    """What was seen when the period changed between two ticks."""

    gap: int
    """Device time from the last tick at the old period to the first at the new one [us]."""
    sent: float
    answered: float
    """Host's time from that last tick to the command and to its response [us]."""


@check("T3")
def longer_period(session: Session) -> str:
    """Check that the first tick at a longer period follows the latest one by that period."""
    old = -(-100_000 // session.board.period) * session.board.period
    new = session.numbers.choice((2, 3)) * old
    gap = _change(session, old, new).gap
    seen = f"from {old} to {new} us: the first tick after {gap} us"
    if abs(gap / new - 1) > 0.1:
        raise BrokenRuleError(seen)
    return seen


@check("T3")
def shorter_period(session: Session) -> str:
    """Check that the first tick at a shorter period comes at once when its time has passed."""
    old = max(3, -(-400_000 // session.board.period)) * session.board.period
    new = session.board.period
    change = _change(session, old, new)
    seen = f"from {old} to {new} us, {change.answered:.0f} us after a tick: the next one {change.gap} us after it"
    tolerance = 1e6 * JITTER + 0.01 * old
    if not max(change.sent, new) - tolerance <= change.gap <= max(change.answered, new) + new + tolerance:
        raise BrokenRuleError(seen)
    return seen


def _change(session: Session, old: int, new: int) -> _Change:
    """Change the period in the middle between two ticks."""
    session.settle()
    with session.scanning("T3") as run:
        first = session.must("SET_RATE", old)
        end = session.clock.monotonic() + 5 * old * MICROSECOND
        while sum(scan.first > first.frame.index for scan in session.scans(run.start.before)) < 2:
            session.read(old * 1e-6)
            if session.clock.monotonic() > end:
                raise NotCheckedError(f"no scans at a period of {old} us")
        session.listen((0.3 + 0.3 * session.numbers.random()) * old * 1e-6)
        answer = session.must("SET_RATE", new)
        session.listen(2.5 * new * 1e-6 + JITTER)
    scans = session.run_scans(run)
    latest = [scan for scan in scans if scan.first < answer.before][-1]
    stated = [scan for scan in timed(scans) if first.before <= scan.first <= latest.first]
    if not stated or not _ticked(stated[-1], latest, old):
        raise NotCheckedError("the scans before the change of the period state no time")
    known = stated[-1]
    for scan in scans[scans.index(latest) + 1 :]:
        answered = scan.first > answer.frame.index
        if scan.time is not None:
            gap = elapsed(session, known, scan) - (ticks(known, scan) - 1) * old
            if answered or abs(gap / old - 1) > 0.01:
                tick = latest.arrival
                return _Change(gap, (answer.sent - tick) / MICROSECOND, (answer.frame.time - tick) / MICROSECOND)
            known = scan
        elif answered:
            break
        latest = scan  # the command had not yet taken effect
    raise NotCheckedError("the scans after the change of the period state no time")


def _ticked(begin: SeenScan, end: SeenScan, period: int) -> bool:
    """Return whether all ticks from one scan to another came after this period [us], by the host's clock."""
    error = (end.arrival - begin.arrival) / MICROSECOND - ticks(begin, end) * period
    return abs(error) < 2e6 * JITTER


@check("T4")
def device_time(session: Session) -> str:
    """Check that the device time runs at the speed of the host's clock."""
    session.settle()
    with session.scanning() as run, session.window(True):
        session.listen(max(2.0, scans_needed(session, 8) * session.period * 1e-6))
    scans = timed(session.run_scans(run))
    if len(scans) < 6:
        raise NotCheckedError("too few scans with a time")
    third = len(scans) // 3
    delays = [
        scan.arrival / MICROSECOND - scans[0].arrival / MICROSECOND - elapsed(session, scans[0], scan) for scan in scans
    ]
    duration = elapsed(session, scans[0], scans[-1])
    drift = min(delays[-third:]) - min(delays[:third])
    limit = 1e6 * LEAST_DELAY + 2 * session.description.states["timing"]["tolerance_ppm"] * 1e-6 * duration
    if abs(drift) > limit:
        raise BrokenRuleError(f"device time and host's clock differ by {drift:.0f} us after {duration} us")
    return f"{drift:+.0f} us against the host's clock in {duration * 1e-6:.1f} s"


@check("T4", Phase.REVIEW)
def equal_ticks(session: Session) -> str:
    """Check that the device time advances by the period from tick to tick."""
    largest = 0
    for run in _steady_runs(session):
        for before, scan in _pairs(timed(session.run_scans(run))):
            error = abs(elapsed(session, before, scan) - ticks(before, scan) * session.board.period)
            if error > ROUNDING and not _uncounted(session, before, scan):
                raise BrokenRuleError(
                    f"{elapsed(session, before, scan)} us from scan {before.sequence} to {scan.sequence} "
                    f"at a period of {session.board.period} us"
                )
            largest = max(largest, 0 if error > ROUNDING else error)
    return f"ticks every {session.board.period} us, within {largest} us"


@check("T5", Phase.REVIEW)
def missing_scans(session: Session) -> str:
    """Check that missing scans keep their numbers and are flagged."""
    missing, unknown = 0, 0
    for run in _steady_runs(session):
        scans = session.run_scans(run)
        for before, scan in pairwise(timed(scans)):
            if _uncounted(session, before, scan):
                raise BrokenRuleError(
                    f"{elapsed(session, before, scan)} us from scan {before.sequence} to {scan.sequence}: "
                    "a missing scan was not counted"
                )
        for before, scan in pairwise(scans):
            if scan.sequence < 0 or (count := ticks(before, scan) - 1) == 0:
                continue
            flagged = _flagged(session, before, scan)
            if flagged is False:
                raise BrokenRuleError(f"no scan between {before.sequence} and {scan.sequence}, and no ScanOverrun")
            missing += count * bool(flagged)
            unknown += count * (flagged is None)
    if not missing:
        raise NotCheckedError("no Status at missing scans" if unknown else "no scan was missing")
    return f"{missing} scans missing, flagged"


def _flagged(session: Session, before: SeenScan, scan: SeenScan) -> bool | None:
    """Return whether missing scans are flagged; None: not known, since classic scans carry no flags.

    The status is sure to state it from the first missing tick to the next scan.
    """
    statuses = session.named("Status", before.first, scan.frames[-1].index + 1)
    if scan.status & OVERRUN or any(status.values["ScanOverrun"] for status in statuses):
        return True
    missed = before.arrival + session.board.period * MICROSECOND + round(JITTER * SECOND)
    told = any(status.time > missed and status.index < scan.first for status in statuses)
    return False if session.board.fd or told else None


def _steady_runs(session: Session) -> list[Run]:
    return [run for run in session.runs if session.owned_by_none(run)]


def _pairs(scans: list[SeenScan]) -> list[tuple[SeenScan, SeenScan]]:
    return list(pairwise(scans))


def _uncounted(session: Session, before: SeenScan, scan: SeenScan) -> bool:
    """Return whether at least one whole period passed that the sequence does not show."""
    more = elapsed(session, before, scan) - ticks(before, scan) * session.board.period
    return round(more / session.board.period) >= 1 and abs(more % session.board.period) <= ROUNDING
