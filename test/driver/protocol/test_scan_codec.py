# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The codec verified against cantools with the DBC: every message, in both directions."""

from __future__ import annotations

import importlib.resources
import math
from dataclasses import replace

import cantools
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from posfet_core.protocol import unpack_counts
from posfet_driver.bus.frame import CLASSIC, FD, RATE_SWITCH
from posfet_driver.protocol.messages import Command, Identification, Identity, Request, Response, Result, Status
from posfet_driver.protocol.scan_codec import ClassicCodec, FdCodec, ScanCodec, ScanHeader, checksum, make_codec
from posfet_model.config import ConfigError
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_model.sensor.scan import Scan
from support.fake_board import make_scan, with_fd, with_layout

BASE = 0x100
DBC = importlib.resources.files("posfet_driver") / "protocol" / "posfet.dbc"
BYTES = st.integers(0, 0xFF)
SHORTS = st.integers(0, 0xFFFF)
WORDS = st.integers(0, 0xFFFF_FFFF)
COUNTS = st.lists(SHORTS, min_size=25, max_size=25)
FLAGS = ("SupplyLow", "AdcFault", "Overtemperature", "ScanOverrun")
BOOTS = st.integers(0, 15)

DATABASE = cantools.database.load_string(DBC.read_text(encoding="ascii"), "dbc")


def encode(name: str, **signals: float) -> bytes:
    return DATABASE.get_message_by_name(name).encode(signals, scaling=True, strict=True)


def decode(name: str, data: bytes) -> dict[str, float]:
    return DATABASE.get_message_by_name(name).decode(data, decode_choices=False)


def scan_of(counts: list[int], sequence: int = 0, time: int = 0, status: int = 0) -> Scan:
    scan = Scan.empty(1, len(counts))
    scan.counts[:] = counts
    scan.sequence, scan.device_time, scan.status = sequence, time, status
    return scan


def decoded(codec: ScanCodec, frames: list[bytes]) -> list[int]:
    out = np.zeros(codec.taxels, np.uint16)
    unpack_counts(codec.fd, b"".join(frames), out)
    return out.tolist()


@given(
    counts=COUNTS,
    sequence=st.integers(0, 1 << 40),
    time=st.integers(0, 1 << 40),
    status=st.integers(0, 31),
    boot=BOOTS,
)
def test_fd_blocks_agree_with_cantools(counts: list[int], sequence: int, time: int, status: int, boot: int) -> None:
    codec = FdCodec(25)
    ((identifier, kind, data),) = codec.encode(scan_of(counts, sequence, time, status), BASE, boot)
    assert (identifier, kind) == (BASE + 3, FD | RATE_SWITCH)
    signals = {f"Count{i}": count for i, count in enumerate([*counts, 0])}
    signals |= {"Sequence": sequence & 0xFFFF_FFFF, "DeviceTime": time & 0xFFFF_FFFF, "BlockIndex": 0}
    signals |= {"BlockStatus": status & 15, "BlockBoot": boot, "Checksum": crc_16(data[:10] + data[12:])}
    assert decode("ScanBlockFd", data) == signals
    assert encode("ScanBlockFd", **signals) == data
    assert codec.header(data)[:3] == (signals["Sequence"], signals["DeviceTime"], 0)
    assert checksum(data) == signals["Checksum"]
    assert decoded(codec, [data]) == counts


def crc_16(data: bytes) -> int:
    """Return the CRC-16/CCITT-FALSE bit by bit, from its definition."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ (0x1021 if crc & 0x8000 else 0)) & 0xFFFF
    return crc


def test_the_checksum_is_the_published_one() -> None:
    assert crc_16(b"123456789") == 0x29B1


@given(counts=COUNTS, sequence=st.integers(0, 1 << 40), time=st.integers(0, 1 << 40), boot=BOOTS)
def test_classic_scans_agree_with_cantools(counts: list[int], sequence: int, time: int, boot: int) -> None:
    codec = ClassicCodec(25)
    header, *frames = codec.encode(scan_of(counts, sequence, time), BASE, boot)
    assert header[:2] == (BASE + 4, CLASSIC)
    signals = {"HeaderSequence": sequence & 0xFFFF_FFFF, "HeaderTime": time & 0xFFF_FFFF, "HeaderBoot": boot}
    assert decode("ScanHeader", header[2]) == signals
    assert encode("ScanHeader", **signals) == header[2]
    assert ScanHeader.unpack(*header[1:]) == ScanHeader(boot, sequence & 0xFFFF_FFFF, time & 0xFFF_FFFF)
    assert codec.encode(scan_of(counts, sequence, time), BASE, boot, header=False) == frames
    for block, (identifier, kind, data) in enumerate(frames):
        assert (identifier, kind) == (BASE + 8 + block, CLASSIC)
        signals = {f"Code{i}": counts[i] >> 4 for i in range(5 * block, 5 * block + 5)}
        signals[f"ScanCounter{block}"] = sequence % 16
        assert decode(f"ScanBlock{block}", data) == signals
        assert encode(f"ScanBlock{block}", **signals) == data
    received = decoded(codec, [data for _, _, data in frames])
    assert received == [count >> 4 << 4 | count >> 12 for count in counts]
    assert max(abs(a - b) for a, b in zip(received, counts, strict=True)) <= 15


def test_classic_blocks_preserve_both_ends_of_the_scale() -> None:
    frames = ClassicCodec(2).encode(scan_of([0, 0xFFFF]), BASE, header=False)
    assert decoded(ClassicCodec(2), [data for _, _, data in frames]) == [0, 0xFFFF]


@given(code=BYTES, tag=BYTES, argument=WORDS)
def test_command_messages_agree_with_cantools(code: int, tag: int, argument: int) -> None:
    request = Request(code, tag, argument)
    signals = {"CommandCode": code, "CommandTag": tag, "CommandArgument": argument}
    assert encode("Command", **signals) == request.pack()
    assert decode("Command", request.pack()) == signals
    assert Request.unpack(request.pack()) == request


@given(code=BYTES, tag=BYTES, result=BYTES, value=WORDS, boot=BOOTS)
def test_response_messages_agree_with_cantools(code: int, tag: int, result: int, value: int, boot: int) -> None:
    response = Response(code, tag, result, value, boot)
    signals = {"ResponseCommand": code, "ResponseTag": tag, "ResponseResult": result, "ResponseValue": value}
    signals["ResponseBoot"] = boot
    assert encode("Response", **signals) == response.pack()
    assert decode("Response", response.pack()) == signals
    assert Response.unpack(response.pack()) == response


@given(
    raw=st.tuples(*[st.integers(-0x7FFF, 0x7FFF)] * 2),
    supply=st.integers(0, 0xFFFE),
    flags=st.integers(0, 15),
    scanning=st.booleans(),
    boot=BOOTS,
    heartbeat=BOOTS,
    charge_reset=st.booleans(),
)
def test_status_messages_agree_with_cantools(
    raw: tuple[int, int], supply: int, flags: int, scanning: bool, boot: int, heartbeat: int, charge_reset: bool
) -> None:
    temperatures = raw[0] / 256, raw[1] / 256
    status = Status(temperatures, supply / 1000, flags, scanning, boot, heartbeat, charge_reset)
    signals = {"Temperature1": raw[0] / 256, "Temperature2": raw[1] / 256, "Supply": supply / 1000}
    signals |= {name: flags >> bit & 1 for bit, name in enumerate(FLAGS)}
    signals |= {"Scanning": int(scanning), "ChargeReset": int(charge_reset), "Boot": boot, "Heartbeat": heartbeat}
    assert decode("Status", status.pack()) == pytest.approx(signals, abs=1e-9)
    assert encode("Status", **signals) == status.pack()
    assert Status.unpack(status.pack()) == status


@given(layout=SHORTS, fd=st.booleans(), major=BYTES, minor=BYTES, period=st.integers(1, 10_000_000))
def test_identity_messages_agree_with_cantools(layout: int, fd: bool, major: int, minor: int, period: int) -> None:
    board = Identification(layout, 2, fd, major)
    identity = Identity(board, minor, period)
    signals = {"LayoutId": layout, "ProtocolVersion": 2, "Format": int(fd), "FirmwareMajor": major}
    signals |= {"FirmwareMinor": minor, "ScanPeriod": period}
    assert decode("Identity", identity.pack()) == signals
    assert encode("Identity", **signals) == identity.pack()
    assert Identity.unpack(identity.pack()) == identity
    assert Identification.unpack(board.pack()) == board


def test_status_marks_unknown_values() -> None:
    unpacked = Status.unpack(Status((math.nan, 20.0), math.nan, 0, False, 0, 0).pack())
    assert unpacked is not None
    assert math.isnan(unpacked.temperatures[0])
    assert unpacked.temperatures[1] == 20.0
    assert math.isnan(unpacked.supply)


def test_status_values_out_of_range_are_clipped() -> None:
    unpacked = Status.unpack(Status((1e9, -1e9), 1e9, 0, False, 0, 0).pack())
    assert unpacked is not None
    assert unpacked.temperatures == (0x7FFF / 256, -0x7FFF / 256)
    assert unpacked.supply == 65.534


@pytest.mark.parametrize(("signal", "names"), [("CommandCode", Command), ("ResponseResult", Result)])
def test_value_names_of_the_dbc_equal_those_of_the_code(signal: str, names: type[Command]) -> None:
    (choices,) = (s.choices for m in DATABASE.messages for s in m.signals if s.name == signal)
    assert {value: str(name) for value, name in choices.items()} == {item.value: item.name for item in names}


@pytest.mark.parametrize("length", [0, 7, 9, 64])
def test_messages_of_wrong_length_are_rejected(length: int) -> None:
    assert [kind.unpack(bytes(length)) for kind in (Request, Response, Status, Identity)] == [None] * 4
    assert ScanHeader.unpack(CLASSIC, bytes(length)) is None


@pytest.mark.parametrize(("rows", "cols"), [(1, 1), (5, 5), (2, 13), (1, 27), (16, 16), (32, 32)])
@pytest.mark.parametrize("fd", [True, False], ids=["fd", "classic"])
def test_every_layout_survives_a_round_trip(sensor: Sensor, rows: int, cols: int, fd: bool) -> None:
    sensor = with_layout(sensor, rows, cols)
    codec = make_codec(with_fd(sensor, fd))
    scan = make_scan(sensor, 12_345)
    frames = codec.encode(scan, BASE)
    frames = frames if fd else frames[1:]
    assert len(frames) == codec.blocks == math.ceil(rows * cols / (26 if fd else 5))
    indices = [FdCodec.header(data)[2] if fd else identifier - BASE - 8 for identifier, _, data in frames]
    assert indices == list(range(codec.blocks))
    assert decoded(codec, [data for _, _, data in frames]) == scan.counts.tolist()


def test_a_layout_that_does_not_fit_is_rejected_with_a_one_line_error() -> None:
    sensor = load_sensor()
    with pytest.raises(ConfigError, match=r"rows \* cols must be in \[1, 6656\] on CAN, got 16384"):
        make_codec(with_layout(sensor, 128, 128))
    high = replace(sensor, can=replace(sensor.can, base_id=0x7F8))
    with pytest.raises(ConfigError, match=r"base_id: must be in \[0, 0x7F3\] for 5 classic scan blocks, got 0x7F8"):
        make_codec(with_fd(high, False))
