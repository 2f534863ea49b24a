# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Bytes of a bus that become scans in one call give what Python makes of them by way of frames, exactly."""

from __future__ import annotations

import math
import random
from abc import abstractmethod
from typing import TYPE_CHECKING

import pytest

from posfet_core.protocol import LineReader
from posfet_driver.bus.frame import CLASSIC, ERROR, Frame
from posfet_driver.bus.slcan_codec import encode_line
from posfet_driver.protocol.decoded import ScanReady
from posfet_driver.protocol.decoder import Decoder
from posfet_driver.protocol.messages import STATUS_OFFSET, Status
from posfet_model.sensor.description import Sensor
from reference.protocol import kernel_frames, slcan_lines
from support.decoder_pair import BASE, SENSOR, WALL, Pair, run, seen
from support.frame_examples import LineStream, to_kernel
from support.long_cases import crossed, long_cases

if TYPE_CHECKING:
    from posfet_core.protocol import Found


class BytePair(Pair):
    """Gives bytes to the compiled decoder, and the frames in them, as Python reads them, to the one in Python."""

    def __init__(self, sensor: Sensor) -> None:
        super().__init__(sensor)
        self.noise = random.Random(7)
        self.core = self.ours._core
        self.errors = 0

    @abstractmethod
    def found(self, frames: list[Frame], arrival: int, wall_offset: int) -> tuple[list[Found], list[Frame]]:
        """Return what the compiled decoder finds, and the frames that Python reads."""

    def decode(self, frames: list[Frame], arrival: int, wall_offset: int, most: int = 0) -> None:
        del most  # all is decoded
        found, read = self.found(frames, arrival, wall_offset)
        expected = [seen(result) for result in self.theirs.decode(read, arrival, wall_offset)]
        ours: list[object] = []
        for result in found:
            if len(result) == 3:
                if not result[1] & ERROR:
                    ours.append(repr(self.ours.message(result)))
                continue
            *stated, uncertainty, counts = result
            self.published += 1
            temperatures = self.ours.scan.temperatures.tobytes()
            ours.append((*stated, "unknown" if math.isnan(uncertainty) else uncertainty, counts, temperatures))
        assert ours == expected
        errors = [frame for frame in found if len(frame) == 3 and frame[1] & ERROR]
        assert errors == [frame for frame in read if frame[1] & ERROR]
        self.errors += len(errors)
        self.compare()


class Lines(BytePair):
    """The bytes are those of a slcan adapter, in any pieces, with lines that are no frames."""

    def __init__(self, sensor: Sensor) -> None:
        super().__init__(sensor)
        self.readers = LineReader(), slcan_lines.LineReader()
        self.stream = LineStream(self.noise)

    def found(self, frames: list[Frame], arrival: int, wall_offset: int) -> tuple[list[Found], list[Frame]]:
        data = self.stream.piece(frames)
        ours, theirs = self.readers
        found = self.core.decode_lines(ours, data, arrival, wall_offset)
        read = theirs.frames(data)
        assert (ours.malformed, ours.refusals, ours.flags) == (theirs.malformed, theirs.refusals, theirs.flags)
        return found, read


class Reads(BytePair):
    """The bytes are those that a SocketCAN socket returns."""

    def found(self, frames: list[Frame], arrival: int, wall_offset: int) -> tuple[list[Found], list[Frame]]:
        reads = [to_kernel(frame) for frame in frames]
        read = [kernel_frames.parse_kernel_frame(data) for data in reads]
        return self.core.decode_kernel_frames(reads, arrival, wall_offset), read


@pytest.mark.parametrize(
    ("pair", "fd"),
    long_cases(
        crossed({"Lines": Lines, "Reads": Reads}, {"fd": True, "classic": False}), ["Lines-classic", "Reads-fd"]
    ),
)
def test_bytes_give_the_scans_messages_and_counters_of_their_frames(pair: type[BytePair], fd: bool) -> None:
    published = errors = 0
    for seed in range(100, 112):
        played = run(seed, fd, 300, pair)
        assert played.published == played.ours.scans
        published, errors = published + played.published, errors + played.errors
    assert published > 800
    assert (errors > 0) == (pair is Reads)  # slcan has no line for an error frame


def test_what_is_in_two_batches_is_counted_in_both() -> None:
    decoder, lines = Decoder(SENSOR), LineReader()
    line = encode_line((BASE + STATUS_OFFSET, CLASSIC, Status((20.0, 21.0), 3.3, 0, True, 1, 2).pack()))
    assert decoder._core.decode_lines(lines, line[:9], 0, WALL) == []
    assert decoder.traffic.frames == 0
    ((identifier, _, _),) = decoder._core.decode_lines(lines, line[9:] + line, 1000, WALL)
    assert identifier == BASE + STATUS_OFFSET
    assert (decoder.traffic.frames, decoder.traffic.status_repeated) == (2, 1)


def test_too_few_bytes_of_a_kernel_are_named_when_the_others_are_decoded() -> None:
    decoder = Decoder(SENSOR)
    with pytest.raises(ValueError, match="at least 8 bytes, got 7"):
        decoder._core.decode_kernel_frames([bytes(7), to_kernel((5, CLASSIC, b""))], 0, WALL)
    assert (decoder.traffic.frames, decoder.traffic.unrelated) == (1, 1)
    assert not any(isinstance(found, ScanReady) for found in decoder.decode([], 0, WALL))
