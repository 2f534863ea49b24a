# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A bus that reconnects: any exception of a backend is a failure, losses are events, and nothing leaks."""

from __future__ import annotations

import gc
import os
import threading
from pathlib import Path

import can
import pytest

from posfet_driver.bus import open_bus
from posfet_driver.bus.error_frame import BUS_OFF, error_frame
from posfet_driver.bus.frame import CLASSIC, Frame
from posfet_driver.bus.open_bus import BusSettings
from posfet_driver.bus.python_can_bus import PythonCanFrameBus
from posfet_driver.bus.reconnecting_bus import BUS_OFF_MEMORY, SETTLE_TIME, ReconnectingBus
from posfet_model.config import ConfigError
from support.clocks import SteppedClock

DATA: Frame = (0x123, CLASSIC, b"\x01")
ERRORS = [ValueError("not\na number"), KeyError("x"), RuntimeError(), AttributeError("no handle"), OSError(19, "gone")]
"""What backends raise instead of can.CanError."""
TEXTS = ["ValueError: not a number", "KeyError: 'x'", "RuntimeError: RuntimeError", "AttributeError: no handle", "gone"]


class FakeBus:
    """A bus that raises `error` from every method, or returns `frames` once; holds a descriptor while it is open."""

    def __init__(self, clock: SteppedClock, error: Exception | None = None, frames: list[Frame] | None = None) -> None:
        self.unreadable = 3
        self.error = error
        self.frames = frames or []
        self._clock = clock
        self._descriptor = os.open(os.devnull, os.O_RDONLY)

    def _fail(self) -> None:
        if self.error:
            raise self.error

    def read_frames(self, timeout: float) -> list[Frame]:
        self._fail()
        frames, self.frames = self.frames, []
        if not frames:
            self._clock.now += round(timeout * 1e9)
        return frames

    def write_frame(self, frame: Frame) -> None:
        self._fail()

    def ask_state(self) -> None:
        self._fail()

    def shutdown(self) -> None:
        os.close(self._descriptor)
        self._fail()


@pytest.mark.parametrize(("error", "text"), list(zip(ERRORS, TEXTS, strict=True)), ids=TEXTS)
def test_any_exception_of_a_backend_is_a_failure_of_the_bus(error: Exception, text: str) -> None:
    clock = SteppedClock()
    bus = ReconnectingBus(lambda: FakeBus(clock, error), None, clock)
    bus.connect()
    for use in (lambda: bus.read(0.1), lambda: bus.write(DATA), bus.ask_state):
        with pytest.raises(can.CanError) as caught:
            use()
        assert str(caught.value).endswith(text)
        assert "\n" not in str(caught.value)
    bus.fail()
    assert (bus.is_open, bus.failed, bus.unreadable) == (False, 1, 3)


@pytest.mark.parametrize("error", ERRORS, ids=TEXTS)
def test_any_exception_while_opening_is_a_failure_of_the_bus(error: Exception) -> None:
    def fail() -> FakeBus:
        raise error

    bus = ReconnectingBus(fail, None, SteppedClock())
    with pytest.raises(can.CanError):
        bus.connect()
    bus = ReconnectingBus(lambda: FakeBus(SteppedClock()), fail, SteppedClock())
    with pytest.raises(can.CanError):
        bus.connect()
    assert (bus.is_open, bus.failed, bus.open_failures) == (False, 0, 1)


@pytest.mark.parametrize("error", ERRORS, ids=TEXTS)
def test_any_exception_of_python_can_is_a_failure_of_the_bus(error: Exception, monkeypatch: pytest.MonkeyPatch) -> None:
    class Backend:
        def __init__(self, **arguments: object) -> None:
            raise error

        def recv(self, timeout: float) -> None:
            raise error

        def send(self, message: can.Message, timeout: float) -> None:
            raise error

        @property
        def state(self) -> can.BusState:
            raise error

    monkeypatch.setattr(open_bus, "_bus_class", lambda _: Backend)
    with pytest.raises(can.CanInitializationError, match=r"^virtual:x: ") as caught:
        open_bus.open_bus(BusSettings("virtual", "x", 1, 1, True))
    assert "\n" not in str(caught.value)
    bus = PythonCanFrameBus(object.__new__(Backend))
    for use in (lambda: bus.read_frames(0.0), lambda: bus.write_frame(DATA), bus.ask_state):
        with pytest.raises(can.CanError):
            use()


def test_arguments_that_can_never_work_are_an_error_of_the_configuration() -> None:
    with pytest.raises(ConfigError, match="bitrate must be one of"):
        open_bus.open_bus(BusSettings("slcan", "x", 123, 1, False))


def test_a_device_that_opens_while_it_is_down_is_lost_once() -> None:
    clock = SteppedClock()
    made = [FakeBus(clock, frames=[DATA]), *(FakeBus(clock, can.CanError("network is down")) for _ in range(6))]
    made.append(FakeBus(clock, frames=[DATA]))
    opened = iter(made)
    bus = ReconnectingBus(lambda: next(opened), None, clock)
    bus.connect()
    assert bus.read(0.1) == [DATA]
    made[0].error = can.CanError("network is down")
    for _ in range(7):
        with pytest.raises(can.CanError):
            bus.read(0.1)
        clock.sleep(bus.fail())
        bus.connect()
    assert bus.read(0.1) == [DATA]
    assert (bus.failed, bus.opened) == (1, 8)
    made[-1].error = can.CanError("network is down")
    with pytest.raises(can.CanError):
        bus.read(0.1)
    bus.fail()
    assert bus.failed == 2  # the loss before was over
    bus.close()


def test_a_bus_without_traffic_counts_as_open_again_once_it_has_worked_for_a_while() -> None:
    clock = SteppedClock()
    bus = ReconnectingBus(lambda: FakeBus(clock), None, clock)
    for losses in (1, 2):
        bus.connect()
        assert bus.read(SETTLE_TIME) == []
        bus.fail()
        assert bus.failed == losses


def test_bus_off_is_one_event_however_often_it_is_reported() -> None:
    clock = SteppedClock()
    device = FakeBus(clock)
    bus = ReconnectingBus(lambda: device, None, clock)
    bus.connect()
    for _ in range(5):
        device.frames = [DATA, error_frame(BUS_OFF)]
        bus.read(0.0)
        assert (bus.bus_offs, bus.is_bus_off) == (1, True)
        bus.read(0.2)
    device.frames = [DATA]
    bus.read(0.0)
    assert not bus.is_bus_off
    device.frames = [error_frame(BUS_OFF)]
    bus.read(0.0)
    assert (bus.bus_offs, bus.errors.bus_off, bus.is_bus_off) == (2, 6, True)
    bus.read(BUS_OFF_MEMORY)
    assert not bus.is_bus_off
    bus.close()


def test_a_thousand_reopenings_leave_no_descriptor_and_no_thread() -> None:
    clock = SteppedClock()
    bus = ReconnectingBus(lambda: FakeBus(clock, OSError(19, "gone")), None, clock)
    gc.collect()  # of what other tests left
    descriptors, threads = len(list(Path("/proc/self/fd").iterdir())), threading.active_count()
    for _ in range(1000):
        bus.connect()
        with pytest.raises(can.CanError, match="gone"):
            bus.read(0.1)
        bus.fail()
    # What other tests left may go meanwhile.
    assert len(list(Path("/proc/self/fd").iterdir())) <= descriptors
    assert threading.active_count() <= threads
    assert bus.opened == 1000
