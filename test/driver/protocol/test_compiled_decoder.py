# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The compiled decoder agrees with the one in Python in every field of every scan and in every counter, exactly."""

from __future__ import annotations

from collections import Counter

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from posfet_core.protocol import ScanStatistics
from posfet_driver.bus.frame import CLASSIC, ERROR, EXTENDED, FD, RATE_SWITCH, Frame
from posfet_driver.protocol.decoded import ScanReady
from posfet_driver.protocol.decoder import Decoder
from posfet_driver.protocol.scan_codec import make_codec
from posfet_model.sensor.scan import Scan
from support.decoder_pair import BASE, COUNTERS, SENSOR, WALL, Pair, run
from support.fake_board import with_fd
from support.fault_injector import sealed


@pytest.mark.parametrize("fd", [True, False], ids=["fd", "classic"])
def test_both_decoders_agree_in_every_field_and_counter(fd: bool) -> None:
    published, resets, counted = 0, 0, Counter[str]()
    for seed in range(18):
        ours = run(seed, fd, 400, Pair).ours
        published += ours.scans
        resets += ours.resets
        counted += Counter({name: getattr(ours.statistics, name) for name in ours.statistics.__slots__})
        counted += Counter({f"other {name}": getattr(ours.traffic, name) for name in COUNTERS})
    assert published > 1800
    assert resets > 6
    never = {"checksum"} if not fd else set()
    assert {*ScanStatistics.__slots__, *(f"other {name}" for name in COUNTERS)} - set(counted) == never


@settings(max_examples=60)
@given(
    frames=st.lists(
        st.tuples(
            st.one_of(st.integers(BASE - 2, BASE + 14), st.integers(0, 0x1FFF_FFFF)),
            st.sampled_from([CLASSIC, EXTENDED, ERROR, FD, FD | RATE_SWITCH]),
            st.sampled_from([0, 7, 8, 8, 63, 64, 64]).flatmap(lambda size: st.binary(min_size=size, max_size=size)),
        ),
        max_size=40,
    ),
    fd=st.booleans(),
    arrivals=st.lists(st.integers(-(1 << 62), 1 << 62), min_size=1, max_size=4),
)
def test_both_decoders_agree_on_arbitrary_frames(frames: list[Frame], fd: bool, arrivals: list[int]) -> None:
    pair = Pair(with_fd(SENSOR, fd))
    pair.do("start")
    sealed_frames = [
        (identifier, kind, sealed(kind, data) if len(data) == 64 else data) for identifier, kind, data in frames
    ]
    for arrival in sorted(arrivals):
        pair.decode(sealed_frames, arrival, WALL)


@pytest.mark.parametrize("frame", [(BASE, CLASSIC), (BASE, CLASSIC, bytearray(8)), (1.0, CLASSIC, bytes(8)), "frame"])
def test_what_is_no_frame_is_named(frame: object) -> None:
    with pytest.raises(TypeError, match="a frame must be a tuple of identifier, kind and bytes"):
        list(Decoder(SENSOR).decode([frame], 0, 0))  # type: ignore[list-item]


@pytest.mark.parametrize(("arrival", "stamp"), [(1 << 80, (1 << 63) - 1), (-(1 << 80), -(1 << 63))])
def test_times_beyond_64_bits_are_the_last_of_them(arrival: int, stamp: int) -> None:
    decoder = Decoder(SENSOR)
    decoder.start()
    frames = make_codec(SENSOR).encode(Scan.empty(SENSOR.layout.id, SENSOR.layout.taxels), BASE)
    assert [found.scan.stamp for found in decoder.decode(frames, arrival, 0) if isinstance(found, ScanReady)] == [stamp]
