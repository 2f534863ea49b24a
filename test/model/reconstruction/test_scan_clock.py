# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Which scans are accepted, the interval before each, and the counters."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np
import pytest

from posfet_model.reconstruction.diagnostics import Level, Period, is_silent, judge
from posfet_model.reconstruction.scan_clock import ScanClock, ScanCounts
from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.scan import Scan, ScanStatus

SENSOR = load_sensor()
START = 1_700_000_000_000_000_000


def scan(index: int, **changes: Any) -> Scan:
    """Return scan `index` of a board at 1 kHz."""
    made = Scan.empty(SENSOR.layout.id, SENSOR.layout.taxels)
    made.sequence, made.device_time, made.stamp = index, 1000 * index, START + 1_000_000 * index
    for name, value in changes.items():
        setattr(made, name, value)
    return made


def accept(clock: ScanClock, made: Scan) -> bool:
    fits = clock.fits(made)
    if fits and not clock.is_new(made):
        return False
    accepted = fits and clock.is_sound(made)
    (clock.admit if accepted else clock.refuse)(made)
    return accepted


def clock_after(scans: int) -> ScanClock:
    clock = ScanClock(SENSOR)
    assert all(accept(clock, scan(index)) for index in range(scans))
    return clock


def counted(clock: ScanClock) -> dict[str, int]:
    return {name: value for name, value in asdict(clock.counts).items() if value and name != "accepted"}


def test_a_regular_stream_has_regular_intervals() -> None:
    clock = clock_after(50)
    assert clock.step == pytest.approx(1e-3, abs=1e-12)
    assert (clock.interrupted, clock.suspect, clock.counts.accepted) == (False, False, 50)
    assert counted(clock) == {}
    assert clock.rate == pytest.approx(1000, abs=1e-6)


@pytest.mark.parametrize(
    ("changes", "cause", "missed"),
    [
        ({"layout_id": 2}, "layout_mismatch", 1),
        ({"counts": np.zeros(3, np.uint16)}, "layout_mismatch", 0),
        ({"counts": np.zeros((5, 5), np.uint16)}, "layout_mismatch", 0),
        ({"status": ScanStatus.ADC_FAULT}, "adc_fault", 0),
        ({"sequence": 9}, "repeated", 1),
        ({"sequence": 5, "stamp": START}, "late", 1),
        ({"sequence": 9, "status": ScanStatus.ADC_FAULT}, "repeated", 1),
        ({"sequence": 5, "stamp": START, "status": ScanStatus.ADC_FAULT}, "late", 1),
    ],
)
def test_a_rejected_scan_is_counted_by_its_cause_and_bridged(changes: dict[str, Any], cause: str, missed: int) -> None:
    """Scan 10 is missing where what arrives in its place is another one."""
    clock = clock_after(10)
    assert not accept(clock, scan(10, **changes))
    assert counted(clock) == {cause: 1}
    assert accept(clock, scan(11))
    assert clock.step == pytest.approx(2e-3, abs=1e-12)
    assert counted(clock) == {cause: 1} | ({"missed": missed} if missed else {})


def test_scans_are_missing_beside_those_that_are_refused_each_of_them_once() -> None:
    clock, faulty = clock_after(10), {"status": ScanStatus.ADC_FAULT}
    for index in (10, 11, 11, 14):
        assert not accept(clock, scan(index, **faulty))
    assert accept(clock, scan(16))
    assert counted(clock) == {"adc_fault": 4, "missed": 3}, "12, 13 and 15 are missing"
    assert accept(clock, scan(18))
    assert counted(clock) == {"adc_fault": 4, "missed": 4}
    # A sequence that a fault has damaged leaves none that was missed before.
    assert not accept(clock, scan(2**40, **faulty))
    assert accept(clock, scan(19))
    assert counted(clock) == {"adc_fault": 5, "missed": 4}


def test_missing_scans_are_counted_and_included_in_the_interval() -> None:
    clock = clock_after(10)
    assert accept(clock, scan(209))
    assert clock.step == pytest.approx(0.2, abs=1e-9)
    assert not clock.interrupted
    assert counted(clock) == {"missed": 199}


def test_a_gap_longer_than_two_time_constants_is_an_interruption() -> None:
    clock = clock_after(10)
    assert accept(clock, scan(1009))
    assert clock.interrupted
    assert counted(clock) == {"missed": 999, "gaps": 1}
    assert accept(clock, scan(1010))
    assert not clock.interrupted


@pytest.mark.parametrize("period", [0.03, 0.1])
def test_a_board_that_was_set_to_a_much_lower_rate_is_followed(period: float) -> None:
    clock = clock_after(10)
    for number in range(1, 20):
        time = round(1e6 * period * number)
        assert accept(clock, scan(9 + number, device_time=9000 + time, stamp=START + 9_000_000 + 1000 * time))
        assert clock.suspect == (number == 1)
    assert clock.step == pytest.approx(period, rel=1e-6)
    assert clock.rate == pytest.approx(1.0 / period, rel=1e-6)
    assert counted(clock) == {"time_jumps": 1}


def test_a_clock_that_runs_a_hundred_times_too_fast_is_no_lower_rate() -> None:
    clock = clock_after(10)
    for number in range(1, 20):
        assert accept(clock, scan(9 + number, device_time=9000 + 100_000 * number))
        assert clock.suspect
        assert clock.step == pytest.approx(1e-3, rel=0.01)


def test_a_reset_of_a_board_with_another_layout_changes_nothing() -> None:
    clock = clock_after(10)
    assert not accept(clock, scan(3, layout_id=2, status=ScanStatus.BOARD_RESET | ScanStatus.CHARGE_RESET))
    assert accept(clock, scan(10))
    assert (clock.interrupted, clock.suspect) == (False, False)
    assert counted(clock) == {"layout_mismatch": 1}


@pytest.mark.parametrize("jump", [3_600_000_000, -9000, -5_000_000_000])
def test_a_jump_of_the_boards_clock_is_bridged_by_the_sequence(jump: int) -> None:
    clock = clock_after(10)
    assert accept(clock, scan(10, device_time=10_000 + jump))
    assert (clock.suspect, clock.interrupted) == (True, False)
    assert clock.step == pytest.approx(1e-3, rel=0.01)
    assert accept(clock, scan(11, device_time=11_000 + jump))
    assert not clock.suspect
    assert clock.step == pytest.approx(1e-3, abs=1e-12)
    assert counted(clock) == {"time_jumps": 1}


@pytest.mark.parametrize("flag", [ScanStatus.BOARD_RESET, ScanStatus.OK])
def test_a_reset_is_bridged_by_timestamps_whether_flagged_or_not(flag: ScanStatus) -> None:
    clock = clock_after(100)
    assert accept(clock, scan(0, stamp=START + 150_000_000, status=flag))
    assert (clock.suspect, clock.interrupted) == (True, False)
    assert clock.step == pytest.approx(0.051, abs=1e-9)
    assert accept(clock, scan(1, stamp=START + 151_000_000))
    assert clock.step == pytest.approx(1e-3, abs=1e-12)
    assert counted(clock) == {"resets": 1}


@pytest.mark.parametrize("stamp", [START - 1, START + 60_000_000_000])
def test_a_reset_of_unknown_duration_is_an_interruption(stamp: int) -> None:
    clock = clock_after(100)
    assert accept(clock, scan(0, stamp=stamp, status=ScanStatus.BOARD_RESET))
    assert clock.interrupted


def test_without_board_time_the_interval_comes_from_timestamps() -> None:
    clock = ScanClock(SENSOR)
    for index in range(5):
        made = scan(index, device_time=0, status=ScanStatus.TIME_ESTIMATED, stamp=START + 2_000_000 * index)
        assert accept(clock, made)
    assert clock.step == pytest.approx(2e-3, abs=1e-12)
    assert counted(clock) == {}


def test_a_sequence_that_stays_behind_is_eventually_accepted() -> None:
    clock = clock_after(100)
    accepted = [accept(clock, scan(index, stamp=START - 1)) for index in range(20)]
    assert accepted.index(True) == 10
    assert all(accepted[10:])
    assert counted(clock)["resets"] == 1


def test_a_wrapped_or_huge_sequence_is_harmless() -> None:
    clock = clock_after(10)
    assert accept(clock, scan(10, sequence=2**63))
    assert accept(clock, scan(11, sequence=2**63 + 1))
    assert clock.step == pytest.approx(1e-3, abs=1e-12)


GOOD = ScanCounts(accepted=1000)


@pytest.mark.parametrize(
    ("after", "state", "level", "word"),
    [
        (GOOD, {}, Level.OK, "valid"),
        (ScanCounts(), {"silent": True}, Level.ERROR, "no scans"),
        (ScanCounts(), {}, Level.OK, "valid"),
        (ScanCounts(accepted=9, layout_mismatch=1), {}, Level.ERROR, "sensor file"),
        (ScanCounts(layout_mismatch=1), {}, Level.ERROR, "sensor file"),
        (ScanCounts(accepted=9, adc_fault=1), {}, Level.ERROR, "ADC"),
        (ScanCounts(accepted=9, implausible=1), {}, Level.ERROR, "ADC"),
        (ScanCounts(accepted=9, resets=1), {}, Level.WARN, "restarted"),
        (ScanCounts(accepted=9, resets=1, gaps=1), {}, Level.WARN, "interrupted"),
        (ScanCounts(accepted=9, gaps=1), {}, Level.WARN, "interrupted"),
        (ScanCounts(accepted=9, time_jumps=1), {}, Level.WARN, "clock"),
        (ScanCounts(accepted=9, missed=1), {}, Level.WARN, "missing"),
        (ScanCounts(accepted=9, repeated=1), {}, Level.WARN, "duplicate"),
        (ScanCounts(accepted=9, late=1), {}, Level.WARN, "late"),
        (GOOD, {"saturated": 1}, Level.WARN, "range"),
        (GOOD, {"unsettled": 1}, Level.WARN, "offset"),
        (GOOD, {"faulty": 1}, Level.WARN, "stuck"),
        (GOOD, {"temperature_known": False}, Level.WARN, "temperature"),
        (GOOD, {"calibrated": False}, Level.OK, "uncalibrated: forces may be off by 10%"),
    ],
)
def test_the_diagnostic_level_names_the_cause(
    after: ScanCounts, state: dict[str, Any], level: Level, word: str
) -> None:
    known = {"unsettled": 0, "saturated": 0, "faulty": 0, "temperature_known": True, "calibrated": True}
    known |= {"silent": False} | state
    verdict = judge(Period.between(ScanCounts(), after, **known))
    assert verdict.level is level
    assert word in verdict.text


@pytest.mark.parametrize(("rate", "longest"), [(1000.0, 1), (10.0, 1), (2.0, 1), (1.0, 2), (0.5, 4), (0.1, 20)])
def test_a_slow_board_is_silent_after_two_of_its_periods(rate: float, longest: int) -> None:
    """Reports come once a second: at 0.5 Hz every second one has no scan."""
    silent = [is_silent(float(without), rate) for without in range(40)]
    assert silent.index(True) == longest
    assert all(silent[longest:])


def test_arrival_times_are_averaged() -> None:
    """A classic board sends no timestamps: scans that arrive late and in bursts are still 1 ms apart."""
    clock = ScanClock(SENSOR)
    generator = np.random.default_rng(1)
    steps = []
    arrival = 0
    for index in range(20_000):
        due = START + 1_000_000 * index + int(generator.exponential(300_000))
        arrival = max(arrival, due)  # a late scan delays the next ones
        assert accept(clock, scan(index, device_time=0, stamp=arrival, status=ScanStatus.TIME_ESTIMATED))
        steps.append(clock.step)
    assert clock.counts.time_jumps == 0
    assert max(abs(step - 1e-3) for step in steps[200:]) < 5e-5
    assert sum(steps) == pytest.approx(20.0, abs=0.01)


def test_a_board_that_begins_with_a_new_film_interrupts_the_force_however_soon_it_is_back() -> None:
    clock = clock_after(10)
    remembers = scan(0, stamp=START + 20_000_000, status=ScanStatus.BOARD_RESET)
    assert accept(clock, remembers)
    assert (clock.interrupted, clock.suspect) == (False, True)
    new = scan(0, stamp=START + 40_000_000, status=ScanStatus.BOARD_RESET | ScanStatus.CHARGE_RESET)
    assert accept(clock, new)
    assert (clock.interrupted, clock.suspect) == (True, True)
    assert counted(clock) == {"resets": 2, "gaps": 1}
    assert accept(clock, scan(1, stamp=START + 41_000_000))
    assert (clock.interrupted, clock.suspect) == (False, False)


def test_a_charge_that_is_not_known_to_continue_interrupts_the_force_also_while_the_sequence_goes_on() -> None:
    clock = clock_after(10)
    assert accept(clock, scan(20, status=ScanStatus.CHARGE_RESET))
    assert clock.interrupted
    assert counted(clock) == {"missed": 10, "gaps": 1}


def test_a_restart_is_not_forgotten_when_its_first_scan_cannot_be_used() -> None:
    clock = clock_after(10)
    status = ScanStatus.BOARD_RESET | ScanStatus.CHARGE_RESET | ScanStatus.ADC_FAULT
    assert not accept(clock, scan(0, stamp=START + 20_000_000, status=status))
    assert accept(clock, scan(1, stamp=START + 21_000_000))
    assert (clock.interrupted, clock.suspect) == (True, True)
    assert counted(clock) == {"adc_fault": 1, "resets": 1, "gaps": 1}


def test_a_late_scan_of_before_a_restart_does_not_stand_for_its_first_scan() -> None:
    clock = clock_after(10)
    status = ScanStatus.BOARD_RESET | ScanStatus.CHARGE_RESET | ScanStatus.ADC_FAULT
    assert not accept(clock, scan(0, stamp=START + 20_000_000, status=status))
    assert not accept(clock, scan(5))
    assert not accept(clock, scan(11))
    assert accept(clock, scan(1, stamp=START + 21_000_000))
    assert (clock.interrupted, clock.suspect) == (True, True)
    assert counted(clock) == {"adc_fault": 1, "late": 2, "resets": 1, "gaps": 1}


def test_scans_that_stay_before_a_restart_are_eventually_accepted() -> None:
    clock = clock_after(10)
    assert not accept(clock, scan(0, stamp=START + 20_000_000, status=ScanStatus.BOARD_RESET | ScanStatus.ADC_FAULT))
    accepted = [accept(clock, scan(index, stamp=START - 1)) for index in range(1, 20)]
    assert accepted.index(True) == 10
    assert all(accepted[10:])


def test_the_first_scan_of_a_restart_that_arrives_twice_is_one_restart() -> None:
    clock = clock_after(10)
    first = scan(0, stamp=START + 20_000_000, status=ScanStatus.BOARD_RESET | ScanStatus.CHARGE_RESET)
    assert accept(clock, first)
    assert not accept(clock, first)
    assert accept(clock, scan(1, stamp=START + 21_000_000))
    assert not clock.interrupted
    assert counted(clock) == {"repeated": 1, "resets": 1, "gaps": 1}
