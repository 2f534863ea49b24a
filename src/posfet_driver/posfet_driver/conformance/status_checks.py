# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Rules of status, identity and boot number, and of what follows power-on."""

from __future__ import annotations

from itertools import pairwise

from posfet_driver.conformance.checks import Phase, check
from posfet_driver.conformance.records import (
    JITTER,
    LATE_SHARE,
    MICROSECOND,
    SECOND,
    BrokenRuleError,
    NotCheckedError,
    PowerOn,
    Window,
)
from posfet_driver.conformance.seen_scans import SeenFrame
from posfet_driver.conformance.session import Session
from posfet_driver.conformance.timer_checks import timed


@check("I1")
def listen_while_stopped(session: Session) -> str:
    """Listen to a stopped board; the reviews judge what was seen."""
    session.settle()
    with session.window(False):
        session.listen(3.3)
    return "listened for 3.3 s"


@check("I1", Phase.REVIEW)
def status_period(session: Session) -> str:
    """Check that status is sent every 100 ms in both states."""
    period = session.description.states["timing"]["status_period_ms"] * 1e-3
    for window in session.windows:
        _periodic(session, "Status", period, window)
    return f"every {1e3 * period:g} ms, stopped and scanning"


@check("I2", Phase.REVIEW)
def identity_period(session: Session) -> str:
    """Check that identity is sent once per second."""
    period = session.description.states["timing"]["identity_period_ms"] * 1e-3
    for window in session.windows:
        _periodic(session, "Identity", period, window)
    return f"every {period:g} s"


def _periodic(session: Session, name: str, period: float, window: Window) -> None:
    """Check the number of frames, and that they come at equal times: a busy host may read some of them late."""
    state = "scanning" if window.scanning else "stopped"
    times = [frame.time / SECOND for frame in session.named(name, window.first, window.last)]
    duration = (window.end - window.begin) / SECOND
    if abs(len(times) - duration / period) > 2:
        raise BrokenRuleError(f"{len(times)} {name} frames in {duration:.2f} s while {state}")
    delays = [time - times[0] - number * period for number, time in enumerate(times)]
    late = sum(delay - min(delays) > max(JITTER, period / 4) for delay in delays)
    if late > LATE_SHARE * len(times):
        gaps = [1e3 * (end - begin) for begin, end in pairwise(times)]
        mean = sum(gaps) / len(gaps)
        raise BrokenRuleError(
            f"{name} after {min(gaps):.0f} to {max(gaps):.0f} ms, {mean:.1f} on average, while {state}"
        )


@check("I2", Phase.REVIEW)
def identity_after_commands(session: Session) -> str:
    """Check that identity follows an OK response to IDENTIFY or SET_RATE directly."""
    codes = {session.description.codes[name]: name for name in ("IDENTIFY", "SET_RATE")}
    count = 0
    for answer in session.answers:
        if answer.code in codes and not answer.result:
            following = (f for f in session.frames[answer.frame.index + 1 :] if f.data != answer.frame.data)
            if (after := next(following, None)) is None or after.name != "Identity":
                raise BrokenRuleError(f"no Identity directly after the response to {codes[answer.code]}")
            count += 1
    return f"directly after {count} responses"


@check("identity", Phase.REVIEW)
def identity_content(session: Session) -> str:
    """Check that identity states layout, version, format and the period in force."""
    expected = {
        "LayoutId": session.board.layout,
        "ProtocolVersion": session.description.states["version"],
        "Format": int(session.board.fd),
    }
    identities = session.named("Identity")
    for frame in identities:
        for name, value in expected.items():
            if frame.values[name] != value:
                raise BrokenRuleError(f"{name} {frame.values[name]}, expected {value}")
        firmware = [(i.values["FirmwareMajor"], i.values["FirmwareMinor"]) for i in (identities[0], frame)]
        if firmware[0] != firmware[1]:
            raise BrokenRuleError(f"firmware {firmware[0]}, later {firmware[1]}")
    for answer in session.answers:
        if answer.code == session.description.codes["SET_RATE"] and not answer.result:
            for stated in session.named("Identity", answer.frame.index, answer.frame.index + 2):
                if stated.values["ScanPeriod"] != answer.argument:
                    raise BrokenRuleError(f"ScanPeriod {stated.values['ScanPeriod']} after SET_RATE {answer.argument}")
    values = identities[-1].values
    return f"layout {values['LayoutId']}, firmware {values['FirmwareMajor']}.{values['FirmwareMinor']}"


@check("I3", Phase.REVIEW)
def heartbeat(session: Session) -> str:
    """Check that heartbeat counts the status frames."""
    statuses = session.named("Status")
    for before, status in pairwise(statuses):
        if session.power_on and before.index < session.power_on.first <= status.index:
            continue
        if status.values["Heartbeat"] != (before.values["Heartbeat"] + 1) % 16:
            raise BrokenRuleError(f"{status.values['Heartbeat']} follows {before.values['Heartbeat']}")
    return f"counted in {len(statuses)} status frames"


@check("I4", Phase.REVIEW)
def boot_is_constant(session: Session) -> str:
    """Check that boot is the same in all frames."""
    first = session.power_on.first if session.power_on else 0
    boots: dict[int, SeenFrame] = {}
    for frame in session.frames[first:]:
        if frame.boot is not None:
            boots.setdefault(frame.boot, frame)
    if len(boots) > 1:
        raise BrokenRuleError(", ".join(f"{boot} in {frame.name}" for boot, frame in boots.items()))
    return f"{min(boots)} in all frames"


@check("I4", Phase.REVIEW)
def boot_changes(session: Session) -> str:
    """Check that boot is another one after the board was switched off."""
    power = _power_on(session)
    boot = session.named("Status", power.first)[0].values["Boot"]
    if boot == power.boot_before:
        raise BrokenRuleError(f"{boot} before and after power-on")
    return f"{power.boot_before} before power-on, {boot} after"


@check("I6", Phase.REVIEW)
def charge_reset_is_constant(session: Session) -> str:
    """Check that ChargeReset is the same in all status frames."""
    first = session.power_on.first if session.power_on else 0
    stated = {status.values["ChargeReset"] for status in session.named("Status", first)}
    if len(stated) > 1:
        raise BrokenRuleError("ChargeReset is 0 and 1 without a power-on in between")
    return f"ChargeReset {min(stated)} in all status frames"


@check("I1", Phase.REVIEW)
def first_status(session: Session) -> str:
    """Check that the first status follows power-on within 100 ms."""
    return _first(session, "Status", session.description.states["timing"]["status_period_ms"])


@check("I2", Phase.REVIEW)
def first_identity(session: Session) -> str:
    """Check that the first identity follows power-on within 1 s."""
    return _first(session, "Identity", session.description.states["timing"]["identity_period_ms"])


def _first(session: Session, name: str, limit: int) -> str:
    power = _power_on(session)
    if power.run is None or not (scans := timed(session.run_scans(power.run))):
        raise NotCheckedError("no scan with a time after power-on")
    switched_on = min(scan.frames[0].time - MICROSECOND * (scan.time or 0) for scan in scans)
    frames = session.named(name, power.first)
    delay = (frames[0].time - switched_on) / 1e6 if frames else 1e9
    if delay > limit + 1e3 * JITTER:
        raise BrokenRuleError(f"the first {delay:.0f} ms after power-on")
    return f"the first {delay:.0f} ms after power-on"


def _power_on(session: Session) -> PowerOn:
    if session.power_on is None:
        raise NotCheckedError("after power-on: with --power-cycle")
    return session.power_on


@check("states", Phase.REVIEW)
def scanning_flag(session: Session) -> str:
    """Check that status states whether the board scans, and scans are sent in that state only."""
    begins = {run.start.frame.index: run for run in session.runs if run.stop}
    for run in begins.values():
        assert run.stop is not None
        for status in session.named("Status", run.start.frame.index, run.stop.before):
            if not status.values["Scanning"]:
                raise BrokenRuleError("Scanning is 0 between START and STOP")
    for window in session.windows:
        if not window.scanning:
            _stopped(session, window.first, window.last)
    return "Scanning agrees with START and STOP"


@check("states", Phase.REVIEW)
def stopped_after_power_on(session: Session) -> str:
    """Check that a board is stopped after power-on."""
    power = _power_on(session)
    if power.run is None:
        raise NotCheckedError("no scan after power-on")
    _stopped(session, power.first, power.run.start.before)
    return "stopped after power-on"


def _stopped(session: Session, first: int, last: int) -> None:
    if any(status.values["Scanning"] for status in session.named("Status", first, last)):
        raise BrokenRuleError("Scanning is 1 while the board is stopped")
    if session.scans(first, last):
        raise BrokenRuleError("scans while the board is stopped")
