# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A socketcand daemon with one classic bus and one board on it, for python-can's client (protocol.md of socketcand)."""

from __future__ import annotations

import select
import socket
import threading

from posfet_driver.bus.frame import CLASSIC, Frame
from posfet_driver.clock import Clock
from posfet_sim.emulation.firmware import BoardFirmware
from support.clocks import POLL


class FakeSocketcand:
    """Server for one client in raw mode on 127.0.0.1, from `open` to `close`."""

    def __init__(self, firmware: BoardFirmware, clock: Clock) -> None:
        self._firmware = firmware
        self._clock = clock
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.settimeout(POLL)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._raw = False  # whether the client receives frames

    @property
    def port(self) -> int:
        return int(self._listener.getsockname()[1])

    def open(self) -> None:
        self._thread.start()

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        self._listener.close()

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                client, _ = self._listener.accept()
            except TimeoutError:
                self._clock.monotonic()  # the clock waits for this thread although it is idle
                continue
            with client:
                client.sendall(b"< hi >")
                self._serve(client)

    def _serve(self, client: socket.socket) -> None:
        waiting, self._raw = b"", False
        while not self._stop.is_set():
            wait = (self._firmware.next_due() - self._clock.monotonic()) / 1e9
            try:
                readable = select.select([client], [], [], min(max(wait, 0.0), POLL))[0]
                self._send(client, self._firmware.due(self._clock.monotonic()))
                if readable:
                    received = client.recv(4096)
                    if not received:
                        return
                    *orders, waiting = (waiting + received).split(b">")
                    for order in orders:
                        self._obey(client, order.decode("ascii").strip("< ").split())
            except ConnectionError:
                return

    def _obey(self, client: socket.socket, words: list[str]) -> None:
        if words[0] == "send":
            frame = int(words[1], 16), CLASSIC, bytes(int(word, 16) for word in words[3:])
            self._send(client, self._firmware.receive(frame, self._clock.monotonic()))
        else:
            client.sendall(b"< ok >")
            self._raw = words == ["rawmode"]

    def _send(self, client: socket.socket, frames: list[Frame]) -> None:
        if not self._raw:
            return
        seconds = self._clock.wall() / 1e9
        client.sendall(b"".join(b"< frame %03X %.6f %s >" % (i, seconds, d.hex().encode()) for i, _, d in frames))
