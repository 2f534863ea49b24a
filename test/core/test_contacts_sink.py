# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Contacts that are published without Python: the same bytes, also across ends of blocks and interruptions."""

from __future__ import annotations

import ctypes
import socket
from collections import Counter
from typing import Any

import numpy as np
import pytest

from posfet_core.protocol import ArrivalTime, LoopControl, LoopEnd, SocketPort
from posfet_core.scan_path import Mutex
from posfet_driver.protocol.decoded import ScanReady
from posfet_driver.protocol.decoder import Decoder
from posfet_driver.protocol.scan_codec import make_codec
from posfet_model.reconstruction.contacts_writer import ContactsWriter
from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_model.sensor.scan import Scan
from posfet_model.sensor.signal_chain import ForwardSignalChain
from support.fake_board import with_fd
from support.frame_examples import to_kernel

REST, SCANS = 800, 700


class SerializedMessage(ctypes.Structure):
    """A message as rcl takes it."""

    _fields_ = (("buffer", ctypes.c_void_p), ("length", ctypes.c_size_t), ("capacity", ctypes.c_size_t))


class Publisher:
    """Functions in the place of those of rcl: collects the messages, or refuses them."""

    def __init__(self) -> None:
        self.messages: list[bytes] = []
        self.resets = 0
        self.refuses = False
        kind = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.POINTER(SerializedMessage), ctypes.c_void_p)
        self._functions = kind(self._publish), ctypes.CFUNCTYPE(None)(self._reset)
        self.addresses = [ctypes.cast(function, ctypes.c_void_p).value or 0 for function in self._functions]

    def _publish(self, _: int, message: ctypes._Pointer[SerializedMessage], allocation: int | None) -> int:
        assert allocation is None
        content = message.contents
        assert content.length == content.capacity
        if self.refuses:
            return 1
        self.messages.append(ctypes.string_at(content.buffer, content.length))
        return 0

    def _reset(self) -> None:
        self.resets += 1


class Streamed:
    """A loop on a socket, whose scans a sink takes, and the same in Python."""

    def __init__(self, sensor: Sensor) -> None:
        self.ends = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.decoder, self.model, self.publisher = Decoder(sensor), Reconstructor(sensor), Publisher()
        self.decoder.start()
        self.port = SocketPort(self.ends[1].fileno())
        self.loop = self.decoder.make_loop(self.port, LoopControl(), ArrivalTime())
        self.writer = ContactsWriter(sensor, "finger")
        self.sink = self.model.make_sink(self.writer, Mutex())
        self.sink.publish_with(*self.publisher.addresses, 1)
        self.returns: Counter[str] = Counter()
        self.python = Decoder(sensor), Reconstructor(sensor), ContactsWriter(sensor, "finger")
        self.python[0].start()
        self.expected: list[bytes] = []

    def play(self, frames: list[tuple[int, int, bytes]]) -> None:
        """Send the frames of a scan, and process all that is waiting in both ways."""
        for frame in frames:
            self.ends[0].send(to_kernel(frame))
        while (end := self.loop.run(self.sink.capsule, 0.0)) != LoopEnd.TIMEOUT:
            self.returns[end.name] += 1
            if end == LoopEnd.SCAN:
                result = self.model.process(self.decoder.scan)
                self.publisher.messages.append(result.serialise(self.writer))
            self.model.run_maintenance()
        decoder, model, writer = self.python
        for found in decoder.decode(frames, self.loop.arrival, self.loop.wall_offset):
            assert isinstance(found, ScanReady)
            self.expected.append(model.process(found.scan).serialise(writer))
            model.run_maintenance()

    def close(self) -> None:
        for end in self.ends:
            end.close()


def played(sensor: Sensor, breaks: bool) -> list[list[tuple[int, int, bytes]]]:
    """Return the frames of each scan: rest, then two fingertips; with `breaks`, scans are lost and repeated."""
    chain = ForwardSignalChain(sensor, np.random.default_rng(3))
    force, codec, scan = np.zeros((5, 5)), make_codec(sensor), Scan.empty(sensor.layout.id, 25)
    force[1:3, 0:2], force[3:5, 3:5] = 0.3, 0.2
    sent = []
    for index in range(REST + SCANS):
        chain.advance(force.ravel() * min(max(index - REST, 0) / 20, 1.0), 25.0, 1e-3)
        scan.counts[:] = chain.counts()
        scan.temperatures[:] = 25.0
        later = 40_000 * (index >= REST + 400) if breaks else 0  # longer than the force can be tracked
        scan.sequence = index + later
        scan.device_time = 1000 * scan.sequence
        sent.append(codec.encode(scan, sensor.can.base_id))
    if breaks:
        del sent[900:903]
        sent[1000] += sent[1000]
    return sent


@pytest.mark.parametrize("fd", [True, False], ids=["fd", "classic"])
@pytest.mark.parametrize("breaks", [False, True], ids=["steady", "breaks"])
def test_messages_are_those_of_the_python_path(fd: bool, breaks: bool) -> None:
    sensor = with_fd(load_sensor(), fd)
    streamed = Streamed(sensor)
    for frames in played(sensor, breaks):
        streamed.play(frames)
    assert len(streamed.publisher.messages) > REST + SCANS - 40
    assert streamed.publisher.messages == streamed.expected
    own, theirs = streamed.model.refresh(), streamed.python[1].refresh()
    assert repr(own.snapshot()) == repr(theirs.snapshot()) and len(own.contacts) == 2
    assert streamed.model.counts == streamed.python[1].counts
    streamed.close()


@pytest.mark.parametrize("breaks", [False, True], ids=["steady", "breaks"])
def test_python_runs_neither_at_the_first_scan_nor_at_the_end_of_a_block_nor_after_a_break(breaks: bool) -> None:
    sensor = load_sensor()
    streamed = Streamed(sensor)
    for frames in played(sensor, breaks):
        streamed.play(frames)
    assert streamed.model.counts.accepted > REST + SCANS - 40
    assert not streamed.returns and not streamed.model.maintenance_due
    streamed.close()


def test_a_sink_that_is_closed_leaves_the_scans_to_python() -> None:
    sensor = load_sensor()
    streamed = Streamed(sensor)
    sent = played(sensor, breaks=False)
    for frames in sent[:100]:
        streamed.play(frames)
    streamed.returns.clear()
    streamed.sink.close()
    for frames in sent[100:200]:
        streamed.play(frames)
    assert streamed.returns == {"SCAN": 100}
    assert streamed.publisher.messages == streamed.expected
    streamed.close()


def test_a_message_that_is_not_published_ends_the_call() -> None:
    sensor = load_sensor()
    streamed = Streamed(sensor)
    sent = played(sensor, breaks=False)
    for frames in sent[:105]:
        streamed.play(frames)
    streamed.publisher.refuses = True
    streamed.returns.clear()
    streamed.play(sent[105])
    assert streamed.returns == {"LAST": 1} and streamed.publisher.resets == 1
    assert streamed.sink.take_failure() and not streamed.sink.take_failure()
    assert streamed.model.refresh().serialise(streamed.writer) == streamed.expected[-1]
    streamed.close()


def test_nothing_is_published_without_a_publisher() -> None:
    sensor = load_sensor()
    streamed = Streamed(sensor)
    sent = played(sensor, breaks=False)
    for frames in sent[:100]:
        streamed.play(frames)
    before = len(streamed.publisher.messages)
    streamed.sink.publish_with(*streamed.publisher.addresses, 0)
    for frames in sent[100:110]:
        streamed.play(frames)
    assert len(streamed.publisher.messages) == before
    assert streamed.model.counts.accepted == 110
    streamed.close()


def test_a_filter_that_diverges_ends_neither_call_nor_loop() -> None:
    sensor = load_sensor()
    streamed = Streamed(sensor)
    sent = played(sensor, breaks=False)
    for frames in sent[:100]:
        streamed.play(frames)
    estimator: Any = streamed.model
    estimator._estimator.belief.slope[...] = np.nan
    for frames in sent[100:200]:
        streamed.play(frames)
    assert estimator._estimator.restarts == sensor.layout.taxels
    assert np.isfinite(estimator._estimator.belief.slope).all()
    assert streamed.model.counts.accepted == 200
    streamed.close()
