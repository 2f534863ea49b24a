# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Rules of frames and scans: forms, order, headers, padding, checksum."""

from __future__ import annotations

from itertools import pairwise

from posfet_driver.bus.frame import CLASSIC, EXTENDED, FD, RATE_SWITCH, REMOTE
from posfet_driver.conformance.checks import Phase, check
from posfet_driver.conformance.description import checksum
from posfet_driver.conformance.records import BrokenRuleError, NotCheckedError, Run
from posfet_driver.conformance.seen_scans import COUNTERS, SEQUENCES, SeenScan
from posfet_driver.conformance.session import Session


@check("F1", Phase.REVIEW)
def identifiers(session: Session) -> str:
    """Check that there is no extended and no remote frame."""
    for frame in session.frames:
        if frame.kind & (EXTENDED | REMOTE):
            form = "remote" if frame.kind & REMOTE else "extended"
            raise BrokenRuleError(f"{form} frame with identifier 0x{frame.identifier:X}")
    return f"{len(session.frames)} frames with 11-bit identifiers"


@check("offsets", Phase.REVIEW)
def reserved_offsets(session: Session) -> str:
    """Check that there is no frame at a reserved identifier."""
    for frame in session.frames:
        offset = frame.identifier - session.board.base
        if not frame.message and not frame.kind & (EXTENDED | REMOTE):
            raise BrokenRuleError(f"frame at the reserved offset {offset}")
    return "no frame at a reserved offset"


@check("F2", Phase.REVIEW)
def reserved_bits(session: Session) -> str:
    """Check that reserved bits are 0."""
    for frame in session.frames:
        if frame.message and int.from_bytes(frame.data, "little") & frame.message.reserved:
            raise BrokenRuleError(f"reserved bits set in {frame.name} {frame.data.hex(' ')}")
    return "reserved bits are 0"


@check("F2")
def reserved_bits_of_commands(session: Session) -> str:
    """Check that a board ignores reserved bits."""
    session.settle()
    reserved = session.numbers.randrange(1, 0x1_0000)
    try:
        answer = session.ask("IDENTIFY", reserved=reserved)
    except NotCheckedError as error:
        session.ignored_commands.add(len(session.commands) - 1)
        raise BrokenRuleError(f"IDENTIFY with reserved bits 0x{reserved:04X} was not answered") from error
    if answer.result:
        raise BrokenRuleError(
            f"IDENTIFY with reserved bits 0x{reserved:04X} was answered {session.result_name(answer)}"
        )
    return f"a command with reserved bits 0x{reserved:04X} is executed"


@check("F3", Phase.REVIEW)
def order_of_blocks(session: Session) -> str:
    """Check that blocks ascend, scans do not mix, sequences ascend."""
    count = 0
    for run in session.runs:
        scans = session.run_scans(run)
        for scan in scans:
            if scan.blocks != sorted(scan.blocks):
                raise BrokenRuleError(f"{_name(scan)}: blocks in the order {scan.blocks}")
            if scan.blocks != list(range(session.board.blocks)):
                raise BrokenRuleError(f"{_name(scan)}: blocks {scan.blocks} of {session.board.blocks}")
        for before, scan in pairwise(scans):
            falls = (
                min(scan.sequence, before.sequence) >= 0 and (scan.sequence - before.sequence) % SEQUENCES >= 1 << 31
            )
            if falls or scan.first < before.frames[-1].index:
                raise BrokenRuleError(f"{_name(scan)} before the end of {_name(before)}")
        count += len(scans)
    return f"{count} scans, blocks and sequences ascending"


def _name(scan: SeenScan) -> str:
    return f"scan {scan.sequence}" if scan.sequence >= 0 else "scan"


@check("F4", Phase.REVIEW)
def forms(session: Session) -> str:
    """Check that fD blocks are FD frames of 64 bytes, all others classic ones of 8; scans have one format."""
    wrong = "ScanBlock0" if session.board.fd else "ScanBlockFd"
    for frame in session.frames:
        if frame.message is None:
            continue
        kinds = {FD, FD | RATE_SWITCH} if frame.message.fd else {CLASSIC}
        if frame.kind not in kinds or len(frame.data) != frame.message.length:
            form = "FD" if frame.kind & FD else "classic"
            raise BrokenRuleError(f"{frame.name} as a {form} frame of {len(frame.data)} bytes")
        if frame.name == wrong:
            raise BrokenRuleError(f"{frame.name} frames, although Identity states the other format")
    switched = any(frame.kind & RATE_SWITCH for frame in session.frames)
    return f"FD blocks {'with' if switched else 'without'} rate switch" if session.board.fd else "classic frames only"


@check("S1", Phase.REVIEW)
def first_and_last_scan(session: Session) -> str:
    """Check that the first scan is the one that START states, the last the one before that which STOP states."""
    count = 0
    for run in session.runs:
        scans = session.run_scans(run)
        if not scans or run.stop is None:
            if run.stop and session.owned_by_none(run):
                raise BrokenRuleError("no scan between START and STOP")
            continue
        first, last = run.start.value, (run.stop.value - 1) % SEQUENCES
        if not _is(scans[0], first, session):
            raise BrokenRuleError(f"first scan {_number(scans[0])} after START, which stated {first}")
        if not _is(scans[-1], last, session):
            raise BrokenRuleError(f"last scan {_number(scans[-1])}, although STOP stated {run.stop.value}")
        late = [scan for scan in scans[:-1] if scan.first > run.stop.frame.index]
        if late:
            raise BrokenRuleError(f"{len(late) + 1} scans after the response to STOP")
        count += 1
    return f"{count} times from START to STOP: first and last scan as stated"


def _is(scan: SeenScan, sequence: int, session: Session) -> bool:
    if scan.sequence >= 0 or session.board.fd:
        return scan.sequence == sequence
    return scan.frames[0].values["ScanCounter0"] == sequence % COUNTERS


def _number(scan: SeenScan) -> str:
    return str(scan.sequence) if scan.sequence >= 0 else f"with counter {scan.frames[0].values['ScanCounter0']}"


@check("S2", Phase.REVIEW)
def headers(session: Session) -> str:
    """Check that a header precedes block 0 of each 16th scan, of the first, after missing ones, and at a new period."""
    if session.board.fd:
        raise NotCheckedError("the board sends FD blocks")
    for frame in session.named("ScanHeader"):
        after = session.frames[frame.index + 1] if frame.index + 1 < len(session.frames) else None
        counter = frame.values["HeaderSequence"] % COUNTERS
        if not (after and after.name == "ScanBlock0" and (after.block, after.values["ScanCounter0"]) == (0, counter)):
            sequence = frame.values["HeaderSequence"]
            raise BrokenRuleError(f"header of scan {sequence} is not followed by block 0 of that scan")
    every = session.description.states["timing"]["header_scans"]
    for run in session.runs:
        scans = session.run_scans(run)
        for number, scan in enumerate(scans):
            if scan.header:
                continue
            if number == 0:
                raise BrokenRuleError("no header before the first scan after START")
            if scan.sequence % every == 0:
                raise BrokenRuleError(f"no header before scan {scan.sequence}, a multiple of {every}")
            if (scan.sequence - scans[number - 1].sequence) % SEQUENCES != 1:
                raise BrokenRuleError(f"no header before scan {scan.sequence}, the first one after missing scans")
        _headers_at_new_periods(session, run, scans)
    return f"{len(session.named('ScanHeader'))} headers"


def _headers_at_new_periods(session: Session, run: Run, scans: list[SeenScan]) -> None:
    """Check one run. A change takes effect between command and response; one scan begun before may follow that."""
    for change in session.new_periods:
        if run.start.frame.index < change.before <= change.frame.index < run.end:
            following = [scan for scan in scans if scan.first > change.frame.index]
            possible = [scan for scan in scans if change.before <= scan.first < change.frame.index] + following[:2]
            if len(following) >= 2 and not any(scan.header for scan in possible):
                raise BrokenRuleError(f"no header before scan {possible[0].sequence}, the first at a new period")


@check("S3", Phase.REVIEW)
def unused_counts(session: Session) -> str:
    """Check that counts of taxels that do not exist are 0."""
    per_block = 26 if session.board.fd else 5
    used = session.board.taxels - per_block * (session.board.blocks - 1)
    if used == per_block:
        raise NotCheckedError("every count of this layout belongs to a taxel")
    prefix = "Count" if session.board.fd else "Code"
    name = "ScanBlockFd" if session.board.fd else "ScanBlock0"
    last = [frame for frame in session.named(name) if frame.block == session.board.blocks - 1]
    for frame in last:
        for unused in range(used, per_block):
            if frame.values[f"{prefix}{unused}"]:
                raise BrokenRuleError(f"{prefix}{unused} of the last block is {frame.values[f'{prefix}{unused}']}")
    return f"{per_block - used} unused in {len(last)} last blocks"


@check("S4", Phase.REVIEW)
def one_head_per_scan(session: Session) -> str:
    """Check that all blocks of an FD scan have the same sequence, time and status."""
    if not session.board.fd:
        raise NotCheckedError("the board sends classic blocks")
    if session.board.blocks == 1:
        raise NotCheckedError("a scan of this layout has one block")
    scans = [scan for run in session.runs for scan in session.run_scans(run)]
    for scan in scans:
        for name in ("DeviceTime", "BlockStatus"):
            values = {frame.values[name] for frame in scan.frames}
            if len(values) > 1:
                raise BrokenRuleError(f"scan {scan.sequence}: {name} {sorted(values)}")
    return f"the same in all blocks of {len(scans)} scans"


@check("checksum", Phase.REVIEW)
def checksums(session: Session) -> str:
    """Check that the checksum of each FD block is right."""
    if not session.board.fd:
        raise NotCheckedError("the board sends classic blocks")
    blocks = session.named("ScanBlockFd")
    for frame in blocks:
        right = checksum(frame.data)
        if frame.values["Checksum"] != right:
            raise BrokenRuleError(
                f"checksum 0x{frame.values['Checksum']:04X} of scan {frame.values['Sequence']}, 0x{right:04X} is right"
            )
    return f"{len(blocks)} blocks"
