# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Calibration of a board with frames of its own: its scans from a bus, and from a recording of the bus."""

from __future__ import annotations

import uuid
from pathlib import Path

import can
import numpy as np
import pytest

from posfet_driver.bus.message_conversion import message_of
from posfet_model.config import ConfigError
from posfet_sim.calibration.bench_recording import read_scans
from posfet_sim.commands.guided import scans_of
from support.clocks import PacedClock
from support.fake_board import board_on_bus
from support.own_boards import BoardA, BoardB, Transmitter, codes_of, counts_of_codes, millivolts_of, sensor_a, sensor_b

A, B = BoardA(), BoardB()
PERIOD = 5_000_000
"""Scan period [ns]."""
SLOWER = {"  scan_rate_Hz: 1000.0": "  scan_rate_Hz: 200.0"}
SCANS = 20


def test_the_guide_listens_to_such_a_board(tmp_path: Path) -> None:
    clock, channel = PacedClock(), uuid.uuid4().hex
    sensor = sensor_a(tmp_path, **SLOWER)
    transmitter = Transmitter(lambda index: A.scan(index, codes_of(index)), clock.monotonic(), PERIOD)
    with (
        can.Bus(interface="virtual", channel=channel) as bus,
        board_on_bus(bus, transmitter, clock),
        scans_of(sensor, "virtual", channel, clock) as scans,
    ):
        found = [scan.snapshot() for scan in (next(scans) for _ in range(SCANS)) if scan is not None]
    assert found
    for scan in found:
        np.testing.assert_array_equal(scan.counts, counts_of_codes(codes_of(scan.sequence)))
    assert transmitter.received == []


def test_its_recording_is_read_by_its_mapping(tmp_path: Path) -> None:
    sensor, log = sensor_a(tmp_path, **SLOWER), tmp_path / "bus.log"
    with can.Logger(str(log)) as write:
        for index in range(SCANS):
            for frame in [A.status(30.0 + 0.5 * index, 25.0), *A.scan(index, codes_of(index))]:
                write(message_of(frame, 1.7e9 + index * PERIOD * 1e-9))
    found = read_scans(log, sensor)
    assert found.counts.tolist() == [counts_of_codes(codes_of(index)).tolist() for index in range(SCANS)]
    np.testing.assert_allclose(found.temperature, [27.5 + 0.25 * index for index in range(SCANS)])


def test_a_board_without_a_temperature_is_refused_with_its_reason(tmp_path: Path) -> None:
    sensor, log = sensor_b(tmp_path, **SLOWER), tmp_path / "bus.asc"
    with can.Logger(str(log)) as write:
        for index in range(SCANS):
            for frame in B.scan(5 * index, millivolts_of(index)):
                write(message_of(frame, 1.7e9 + index * PERIOD * 1e-9))
    with pytest.raises(ConfigError, match=r"no temperature in it: no signal of temperatures \(protocol in the sensor"):
        read_scans(log, sensor)
