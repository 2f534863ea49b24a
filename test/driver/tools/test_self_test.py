# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The checks of `posfet can selftest` at any scan rate, in stepped time."""

from __future__ import annotations

import pytest

from posfet_driver.bus.frame import Frame
from posfet_driver.bus.frame_bus import FrameBus
from posfet_driver.bus.open_bus import BusSettings, bus_settings
from posfet_driver.tools import self_test
from posfet_driver.tools.self_test import CheckFailed, SelfTest
from posfet_model.sensor.description import load_sensor
from posfet_sim.emulation.firmware import BoardFirmware
from support.clocks import SteppedClock
from support.fake_board import FakeBoard, with_fd, with_layout
from support.stepped import SteppedBus

DURATION = 2.0
"""Time for which scans are checked [s]."""


def self_test_of(
    monkeypatch: pytest.MonkeyPatch,
    fd: bool,
    rate: float,
    actual: float = 1.0,
    clock: SteppedClock | None = None,
    bus: type[SteppedBus] = SteppedBus,
) -> SelfTest:
    """Return the self-test of a board with a scan rate [Hz], whose clock runs `actual` times as fast."""
    clock, sensor = clock or SteppedClock(), with_fd(with_layout(load_sensor(), 5, 5, scan_rate=rate), fd)

    class Firmware(BoardFirmware):
        """A board whose ticks come at another rate than was set."""

        def _set_period(self, period: int, now: int) -> tuple[int, int]:  # type: ignore[override]
            return super()._set_period(round(period / actual), now)[0], period

    class Opener:
        """The only bus there is."""

        channel = "any"

        def __init__(self, settings: BusSettings, _: object) -> None:
            self.settings = settings

        def __call__(self) -> FrameBus:
            return bus(clock, firmware)

    own = with_layout(sensor, 5, 5, scan_rate=rate * actual)
    firmware = Firmware(own, FakeBoard(own), 0)
    monkeypatch.setattr(self_test, "BusOpener", Opener)
    return SelfTest(sensor, bus_settings("virtual", "any", sensor.can), DURATION, clock)


@pytest.mark.parametrize("fd", [True, False], ids=["fd", "classic"])
@pytest.mark.parametrize("rate", [0.1, 0.3, 1.0, 2.2, 10.0, 1000.0])
def test_a_right_board_passes_at_any_scan_rate(monkeypatch: pytest.MonkeyPatch, rate: float, fd: bool) -> None:
    test = self_test_of(monkeypatch, fd, rate)
    for _, check in test.checks():
        check()


@pytest.mark.parametrize("rate", [0.3, 10.0, 1000.0])
def test_a_board_that_scans_at_another_rate_fails(monkeypatch: pytest.MonkeyPatch, rate: float) -> None:
    test = self_test_of(monkeypatch, True, rate, actual=1.1)
    with pytest.raises(CheckFailed, match=f"{rate:g} scans/s are expected"):
        for _, check in test.checks():
            check()


@pytest.mark.parametrize(("silence", "passes"), [(0.2, True), (0.7, False)])
@pytest.mark.parametrize("rate", [10.0, 1000.0])
def test_scans_that_end_before_the_check_does_fail(
    monkeypatch: pytest.MonkeyPatch, rate: float, silence: float, passes: bool
) -> None:
    ends: list[int] = []

    class Bus(SteppedBus):
        """A bus on which no scan arrives from a time on, while commands are answered."""

        def read_frames(self, timeout: float) -> list[Frame]:
            self.held_back = any(self.clock.now >= end for end in ends)
            return super().read_frames(timeout)

    clock = SteppedClock()
    test = self_test_of(monkeypatch, True, rate, clock=clock, bus=Bus)
    checks = dict(test.checks())
    checks["adapter opens"]()
    checks["board sends scans"]()
    ends.append(clock.now + round((DURATION - silence) * 1e9))
    if passes:
        assert checks["scans are complete and in time"]().startswith(f"{rate:.1f} scans/s, 0 frames lost")
    else:
        with pytest.raises(
            CheckFailed, match=rf"^{rate:.1f} scans/s, 0 frames lost.*; no scan in the last 0\.[678] s$"
        ):
            checks["scans are complete and in time"]()
