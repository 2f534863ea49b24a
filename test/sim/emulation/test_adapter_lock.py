# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The lock of an emulated adapter: nothing that another user prepares at its path is followed or touched."""

from __future__ import annotations

import gc
import os
from pathlib import Path

import pytest

from posfet_driver.board.scan_source import SourceError
from posfet_model.sensor.description import load_sensor
from posfet_sim.emulation import slcan_adapter
from posfet_sim.emulation.adapter_lock import is_served, lock
from posfet_sim.emulation.firmware import BoardFirmware
from posfet_sim.emulation.slcan_adapter import EmulatedAdapter
from support.clocks import SteppedClock
from support.fake_board import FakeBoard


def adapter(link: Path) -> EmulatedAdapter:
    sensor, clock = load_sensor(), SteppedClock()
    return EmulatedAdapter(link, BoardFirmware(sensor, FakeBoard(sensor), clock.monotonic()), clock)


def test_one_lock_at_a_time(tmp_path: Path) -> None:
    held = lock(tmp_path / "can0")
    assert is_served(tmp_path / "can0")
    os.close(held)
    assert not is_served(tmp_path / "can0")


@pytest.mark.parametrize("kind", ["symbolic link", "dangling link", "hard link", "fifo"])
def test_a_prepared_lock_file_is_neither_followed_nor_made_nor_waited_for(tmp_path: Path, kind: str) -> None:
    victim, file = tmp_path / "victim", tmp_path / ".can0.lock"
    if kind != "dangling link":
        victim.write_text("precious")
    if kind == "hard link":
        file.hardlink_to(victim)
    elif kind == "fifo":
        os.mkfifo(file)
    else:
        file.symlink_to(victim)
    before = sorted(tmp_path.iterdir())
    with pytest.raises(OSError, match="its lock file is") as caught:
        lock(tmp_path / "can0")
    assert not isinstance(caught.value, BlockingIOError)
    with pytest.raises(SourceError, match="the adapter cannot be linked here: its lock file is"):
        adapter(tmp_path / "can0").open()
    assert sorted(tmp_path.iterdir()) == before


def test_nothing_is_left_of_an_adapter_that_cannot_be_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    gc.collect()  # of what other tests left
    descriptors = len(os.listdir("/proc/self/fd"))

    def fail(*_: object) -> None:
        raise OSError(24, "Too many open files")

    for name in ("openpty", "set_blocking"):
        with monkeypatch.context() as patch, pytest.raises(SourceError, match="Too many open files"):
            patch.setattr(slcan_adapter.os, name, fail)
            adapter(tmp_path / "can0").open()
    with monkeypatch.context() as patch, pytest.raises(SourceError, match="Too many open files"):
        patch.setattr(Path, "replace", fail)
        adapter(tmp_path / "can0").open()
    assert [path.name for path in tmp_path.iterdir()] == [".can0.lock"]
    assert len(os.listdir("/proc/self/fd")) <= descriptors  # what other tests left may go meanwhile
    assert not is_served(tmp_path / "can0")
