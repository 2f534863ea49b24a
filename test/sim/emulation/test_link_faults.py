# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The fault policy of a link: outcomes and resets for scans and frames, and their counters."""

from collections import Counter
from dataclasses import replace

from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.scan import Scan
from posfet_sim.device.error_model import ErrorModel
from posfet_sim.device.simulated_board import SimulatedBoard
from posfet_sim.emulation.faulty_scans import FaultyScans
from posfet_sim.emulation.link_faults import LOST_IN_RESETS, RESETS, LinkFaults, TransmissionOutcome
from posfet_sim.scene import SceneLoads, load_scene

SENSOR = load_sensor()
FAULTY = replace(
    ErrorModel.none(),
    drop_probability=0.2,
    truncation_probability=0.1,
    duplication_probability=0.1,
    resets_per_hour=3600.0,
)


def test_outcomes_are_counted_and_depend_only_on_seed_and_sequence() -> None:
    faults, backwards = LinkFaults(FAULTY, 3), LinkFaults(FAULTY, 3)
    outcomes = [faults.outcome(number) for number in range(3000)]
    assert [backwards.outcome(number) for number in reversed(range(3000))] == outcomes[::-1]
    assert [LinkFaults(FAULTY, 4).outcome(number) for number in range(3000)] != outcomes
    counted = Counter(outcomes)
    assert set(counted) == set(TransmissionOutcome)
    for outcome in TransmissionOutcome:
        assert faults.counters.get(outcome.counter, counted[outcome]) == counted[outcome]
    assert "delivered" not in faults.counters


def test_several_resets_between_two_calls_count_as_one() -> None:
    often, once = LinkFaults(FAULTY, 5), LinkFaults(FAULTY, 5)
    resets = sum(often.reset_due(0.01 * step) for step in range(2001))
    assert resets == often.counters[RESETS] > 5
    assert once.reset_due(20.0)
    assert not once.reset_due(20.0)
    assert once.counters[RESETS] == 1
    assert (once.running_since, once.next_reset) == (often.running_since, often.next_reset)


def test_scans_follow_the_fault_policy() -> None:
    board = SimulatedBoard(SENSOR, SceneLoads(load_scene("idle", SENSOR), SENSOR), 3, FAULTY)
    scans, policy = FaultyScans(board, 3), LinkFaults(FAULTY, 3)
    scan = Scan.empty(SENSOR.layout.id, SENSOR.layout.taxels)
    times = {
        TransmissionOutcome.DELIVERED: 1,
        TransmissionOutcome.DROPPED: 0,
        TransmissionOutcome.TRUNCATED: 0,
        TransmissionOutcome.DUPLICATED: 2,
    }
    for index in range(3000):
        policy.reset_due(board.clock.time(index))
        silent = board.clock.time(index) < policy.running_since
        policy.counters[LOST_IN_RESETS] += silent
        assert scans.scan(index, scan) == (0 if silent else times[policy.outcome(index)])
    assert scans.counters == policy.counters


def test_counters_continue_those_of_a_previous_run() -> None:
    first = LinkFaults(FAULTY, 3)
    for number in range(100):
        first.outcome(number)
    before = dict(first.counters)
    second = LinkFaults(FAULTY, 3, first.counters)
    for number in range(100):
        second.outcome(number)
    assert second.counters == {name: 2 * count for name, count in before.items()}
