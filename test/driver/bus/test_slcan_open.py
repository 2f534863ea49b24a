# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Opening an slcan adapter: one that replies, one that refuses, and one that never replies."""

from __future__ import annotations

import os
import threading
import tty

import can
import pytest

from posfet_driver.bus.slcan_bus import REPLY_TIMEOUT, SILENT, SlcanBus
from support.fake_board import PATIENCE


class Terminal:
    """An adapter that replies to each command as `replies` says, and to others not at all."""

    def __init__(self, replies: dict[bytes, bytes]) -> None:
        self.commands: list[bytes] = []
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.port = os.ttyname(self._slave)
        self._replies = replies
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        waiting = b""
        while b"q" not in waiting:
            *lines, waiting = (waiting + os.read(self._master, 64)).split(b"\r")
            for line in lines:
                self.commands.append(line)
                os.write(self._master, self._replies.get(line, b""))

    def close(self) -> None:
        os.write(self._slave, b"q")
        self._thread.join()
        os.close(self._master)
        os.close(self._slave)


class Waits(list[float]):
    """Timeouts with which replies are waited for [s]; those from the second on may be longer."""

    patience = 0.0


@pytest.fixture
def waits(monkeypatch: pytest.MonkeyPatch) -> Waits:
    asked = Waits()
    configure = SlcanBus._configure

    def record(bus: SlcanBus, command: bytes, timeout: float) -> bool:
        asked.append(timeout)
        return configure(bus, command, max(timeout, asked.patience) if len(asked) > 1 else timeout)

    monkeypatch.setattr(SlcanBus, "_configure", record)
    return asked


def test_an_adapter_that_never_replies_is_open_after_two_timeouts(waits: Waits) -> None:
    terminal = Terminal({})
    try:
        bus = SlcanBus(terminal.port, bitrate=1_000_000, data_bitrate=5_000_000, fd=True)
        bus.shutdown()
    finally:
        terminal.close()
    assert waits == [REPLY_TIMEOUT] * SILENT + [0.0] * 2
    assert terminal.commands == [b"C", b"S8", b"Y5", b"O", b"C"]


def test_an_adapter_that_only_does_not_reply_to_closing_can_refuse(waits: Waits) -> None:
    waits.patience = PATIENCE
    terminal = Terminal({b"S8": b"\r", b"Y5": b"\a", b"O": b"\r"})
    try:
        with pytest.raises(can.CanInitializationError, match="the adapter refuses the command Y5"):
            SlcanBus(terminal.port, bitrate=1_000_000, data_bitrate=5_000_000, fd=True)
    finally:
        terminal.close()
    assert waits == [REPLY_TIMEOUT] * 3
