# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Short versions of the long-running tests."""

from __future__ import annotations

from pathlib import Path

import pytest

from posfet_driver.bus.frame import ERROR
from posfet_model.sensor.description import load_sensor
from posfet_sim.emulation.firmware import BoardFirmware
from support.fake_board import FakeBoard
from support.fault_injector import FaultInjector, InjectedFault
from support.long_cases import crossed, long_cases
from support.long_runs import COUNTED, NEW_SEQUENCE, fuzz, fuzz_board, scans_under_faults
from support.soak import FAULTS, RENAMED, TARGET_RECOVERY, UNPLUGGED, WRONG_BITRATE, Soak, main

FRAMES = {"fd": True, "classic": False}
BOTH = pytest.mark.parametrize("fd", FRAMES.values(), ids=FRAMES.keys())


@pytest.mark.parametrize(("seed", "fd"), long_cases(crossed([1, 2], FRAMES), ["1-classic", "2-fd"]))
def test_every_sent_scan_is_published_or_counted_as_lost(seed: int, fd: bool) -> None:
    account = scans_under_faults(8000, fd, seed)
    assert account["published"] > 2000
    assert account["incomplete"] > 0 or fd
    assert account["lost"] > 0
    assert account["sent"] == account["published"] + account["incomplete"] + account["lost"]


@BOTH
def test_every_scan_is_accounted_for_with_resets_and_frozen_counters(fd: bool) -> None:
    account = scans_under_faults(8000, fd, 3, COUNTED + NEW_SEQUENCE)
    assert account["published"] > 2000
    assert account["resets"] > 0


@BOTH
def test_arbitrary_frames_cause_no_failure(fd: bool) -> None:
    frames, growth = fuzz(200_000, fd, 4)
    assert frames >= 200_000
    assert growth < 1 << 20


@BOTH
@pytest.mark.parametrize("seed", [0, 6])
def test_a_board_whose_frames_are_changed_ends_nothing_and_is_received_once_it_tells_the_truth(
    fd: bool, seed: int
) -> None:
    found = fuzz_board(3.0, fd, seed)
    assert found["scans"] > 0
    assert found["recovery"] < 2.0


@pytest.mark.parametrize("fault", [fault for fault in FAULTS if isinstance(fault, InjectedFault)])
def test_no_fault_of_the_soak_test_needs_frames_that_its_adapter_cannot_carry(fault: InjectedFault) -> None:
    sensor = load_sensor()
    injector = FaultInjector(lambda now: BoardFirmware(sensor, FakeBoard(sensor), now), sensor.can.base_id, 0)
    injector.fault = fault
    frames = [frame for tick in range(20) for frame in injector.due(tick * 100_000_000)]
    assert not any(kind & ERROR for _, kind, _ in frames)


@BOTH
def test_data_flows_within_half_a_second_after_a_fault_of_the_adapter_however_busy_the_machine_is(
    fd: bool, tmp_path: Path
) -> None:
    """The time stands still while board, adapter or driver wait for a processor.

    The back-off alone would open the bus again 0.6 s after the fault.
    """
    with Soak(tmp_path, fd, seed=1, paced=True) as soak:
        for fault in (UNPLUGGED, RENAMED, WRONG_BITRATE):
            soak.one_fault(fault, length=0.9)
    assert not soak.verdict.failures()
    assert len(soak.verdict.recoveries) == 3
    assert max(soak.verdict.recoveries) <= TARGET_RECOVERY


@pytest.mark.slow
def test_a_short_soak_test_passes(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--for", "6", "--every", "0.6", "--seed", "1"]) == 0, capsys.readouterr().out
