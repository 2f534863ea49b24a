# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The driver's messages and codec encode and decode the golden frames, byte by byte."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest

from posfet_core.protocol import unpack_counts
from posfet_driver.bus.frame import CLASSIC
from posfet_driver.protocol.messages import Identification, Identity, Request, Response, Status
from posfet_driver.protocol.scan_codec import ClassicCodec, FdCodec, ScanCodec, ScanHeader, checksum
from posfet_model.sensor.scan import Scan
from support.paths import DATA

FRAMES: list[dict[str, Any]] = json.loads((DATA / "protocol" / "golden_frames.json").read_text())["frames"]


def frames(*messages: str) -> Any:
    chosen = [frame for frame in FRAMES if frame["message"].rstrip("01234") in messages]
    return pytest.mark.parametrize("frame", chosen, ids=[frame["name"] for frame in chosen])


def physical(code: int, unknown: int, steps: int) -> float:
    return math.nan if code == unknown else code / steps


def message_of(name: str, values: dict[str, int]) -> Any:
    """Return the driver's object with the content of a frame."""
    match name:
        case "Command":
            return Request(values["CommandCode"], values["CommandTag"], values["CommandArgument"])
        case "Response":
            names = ("ResponseCommand", "ResponseTag", "ResponseResult", "ResponseValue", "ResponseBoot")
            return Response(*(values[name] for name in names))
        case "Status":
            names = ("SupplyLow", "AdcFault", "Overtemperature", "ScanOverrun")
            return Status(
                temperatures=tuple(physical(values[f"Temperature{i}"], -0x8000, 256) for i in (1, 2)),
                supply=physical(values["Supply"], 0xFFFF, 1000),
                flags=sum(values[name] << bit for bit, name in enumerate(names)),
                scanning=bool(values["Scanning"]),
                charge_reset=bool(values["ChargeReset"]),
                boot=values["Boot"],
                heartbeat=values["Heartbeat"],
            )
        case _:
            version, fd = values["ProtocolVersion"], bool(values["Format"])
            board = Identification(values["LayoutId"], version, fd, values["FirmwareMajor"])
            return Identity(board, values["FirmwareMinor"], values["ScanPeriod"])


@frames("Command", "Response", "Status", "Identity")
def test_messages(frame: dict[str, Any]) -> None:
    message, data = message_of(frame["message"], frame["signals"]), bytes.fromhex(frame["data"])
    assert message.pack() == data
    assert repr(type(message).unpack(data)) == repr(message)  # NaN equals itself


@frames("ScanHeader")
def test_scan_headers(frame: dict[str, Any]) -> None:
    values, data = frame["signals"], bytes.fromhex(frame["data"])
    header = ScanHeader(values["HeaderBoot"], values["HeaderSequence"], values["HeaderTime"])
    assert header.pack() == data
    assert ScanHeader.unpack(CLASSIC, data) == header


def block_of(codec: ScanCodec, index: int, counts: list[int], values: dict[str, int]) -> tuple[bytes, list[int]]:
    """Return a block with these counts as encoded, and the counts as decoded from it."""
    scan = Scan.empty(1, codec.taxels)
    first = index * codec.taxels_per_block
    scan.counts[first:] = counts
    scan.sequence, scan.device_time = values.get("Sequence", 0), values.get("DeviceTime", 0)
    scan.status = values.get("BlockStatus", 0)
    encoded = codec.encode(scan, 0x100, values.get("BlockBoot", 0), header=False)
    decoded = np.zeros(codec.taxels, np.uint16)
    unpack_counts(codec.fd, b"".join(data for _, _, data in encoded), decoded)
    return encoded[index][2], decoded[first:].tolist()


@frames("ScanBlockFd")
def test_fd_blocks(frame: dict[str, Any]) -> None:
    values, data = frame["signals"], bytes.fromhex(frame["data"])
    counts = [values[f"Count{i}"] for i in range(26)]
    index = values["BlockIndex"]
    assert block_of(FdCodec(26 * (index + 1)), index, counts, values) == (data, counts)
    state = values["BlockBoot"] << 4 | values["BlockStatus"]
    assert FdCodec.header(data) == (values["Sequence"], values["DeviceTime"], index, state, values["Checksum"])
    assert checksum(data) == values["Checksum"]


@frames("ScanBlock")
def test_classic_blocks(frame: dict[str, Any]) -> None:
    values, data = frame["signals"], bytes.fromhex(frame["data"])
    index = int(frame["message"][-1])
    counts = [values[f"Code{5 * index + i}"] * 0x1001 >> 8 for i in range(5)]
    sequence = {"Sequence": values[f"ScanCounter{index}"]}
    assert block_of(ClassicCodec(5 * (index + 1)), index, counts, sequence) == (data, counts)
