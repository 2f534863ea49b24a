# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Golden frames of the protocol: what a board or host of any make has to encode and decode to these bytes."""

from __future__ import annotations

import json
import random
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

from posfet_driver.bus.frame import FD
from posfet_driver.conformance.description import BASE, Description, checksum, load_description

UNKNOWN_TEMPERATURE: Final = -0x8000
UNKNOWN_SUPPLY: Final = 0xFFFF
FD_TAXELS: Final = 26
CLASSIC_TAXELS: Final = 5
_SEED: Final = 2
_TAXELS: Final = 25
_TAXELS_16: Final = 256
"""Taxels of the larger layout, whose last FD block has 22."""
_CODES: Final = (0x000, 0xFFF, 0x123, 0x800, 0x7FF)


@dataclass(frozen=True)
class GoldenFrame:
    """A frame, its meaning and its bytes."""

    name: str
    message: str
    """Name of the frame in the DBC."""
    signals: dict[str, int]
    """Every signal, without its scale."""
    fd: bool
    identifier: int
    """Identifier at base identifier 0x100."""
    data: bytes

    @property
    def physical(self) -> dict[str, float | int]:
        """Signals other than 0 with their scales."""
        scales = {signal.name: signal.scale for signal in load_description().messages[self.message].signals}
        return {name: value * scales[name] for name, value in self.signals.items() if value}


def golden_frames() -> list[GoldenFrame]:
    """Return all golden frames: each message with typical values and its limits."""
    description = load_description()
    return [
        _frame(description, name, message, values)
        for name, message, values in (
            *_commands(description),
            *_responses(description),
            *_statuses(),
            *_identities(),
            *_fd_blocks(),
            *_classic(),
        )
    ]


def as_json() -> str:
    """Return the golden frames as JSON."""
    rows = [
        {
            "name": frame.name,
            "message": frame.message,
            "identifier": frame.identifier,
            "fd": frame.fd,
            "signals": frame.signals,
            "data": frame.data.hex(),
        }
        for frame in golden_frames()
    ]
    lines = ",\n".join(json.dumps(row) for row in rows)
    return f'{{"base": {BASE}, "version": {load_description().states["version"]}, "frames": [\n{lines}\n]}}\n'


_Rows = Iterator[tuple[str, str, dict[str, int]]]


def _frame(description: Description, name: str, message: str, values: dict[str, int]) -> GoldenFrame:
    described = description.messages[message]
    data = described.encode(**values)
    if message == "ScanBlockFd":
        data = described.encode(**values | {"Checksum": checksum(data)})
    identifier, kind, _ = described.frame(BASE)
    return GoldenFrame(name, message, described.decode(data), bool(kind & FD), identifier, data)


def _commands(description: Description) -> _Rows:
    for tag, (name, code) in enumerate(description.codes.items(), 1):
        yield name, "Command", {"CommandCode": code, "CommandTag": tag, "CommandArgument": 1000 * (name == "SET_RATE")}
    longest = description.states["timing"]["longest_period_us"]
    yield "longest period", "Command", {"CommandCode": 3, "CommandTag": 255, "CommandArgument": longest}
    yield "all bits of a command", "Command", {"CommandCode": 255, "CommandTag": 255, "CommandArgument": 0xFFFF_FFFF}


def _responses(description: Description) -> _Rows:
    codes, results = description.codes, description.results

    def response(command: str | int, tag: int, result: str, boot: int, value: int = 0) -> dict[str, int]:
        code = command if isinstance(command, int) else codes[command]
        return {
            "ResponseCommand": code,
            "ResponseTag": tag,
            "ResponseResult": results[result],
            "ResponseBoot": boot,
            "ResponseValue": value,
        }

    identity = 1 | 2 << 16 | 1 << 20 | 3 << 24
    for name, row in (
        ("START accepted", response("START", 1, "OK", 5, 4711)),
        ("START, sequence before its wrap", response("START", 255, "OK", 15, 0xFFFF_FFFF)),
        ("STOP accepted", response("STOP", 2, "OK", 5, 5000)),
        ("SET_RATE accepted", response("SET_RATE", 3, "OK", 0, 1000)),
        ("IDENTIFY accepted", response("IDENTIFY", 4, "OK", 5, identity)),
        ("SELF_TEST passed", response("SELF_TEST", 5, "OK", 5)),
        ("SELF_TEST failed", response("SELF_TEST", 6, "FAILED", 5, 2)),
        ("SELF_TEST while scanning, refused", response("SELF_TEST", 7, "BUSY", 5)),
        ("period refused", response("SET_RATE", 8, "BAD_ARGUMENT", 5)),
        ("unknown command", response(0xC8, 9, "UNKNOWN_COMMAND", 5)),
    ):
        yield name, "Response", row


def _statuses() -> _Rows:
    typical = {
        "Temperature1": 25 * 256 + 128,
        "Temperature2": 24 * 256,
        "Supply": 5000,
        "Scanning": 1,
        "Boot": 5,
        "Heartbeat": 9,
    }
    yield "scanning", "Status", typical
    yield "stopped", "Status", typical | {"Scanning": 0, "Heartbeat": 10}
    yield "below freezing", "Status", typical | {"Temperature1": -1, "Temperature2": -10 * 256 - 64}
    yield "temperatures unknown", "Status", typical | dict.fromkeys(("Temperature1", "Temperature2"), -0x8000)
    yield "one temperature unknown", "Status", typical | {"Temperature2": UNKNOWN_TEMPERATURE}
    yield "supply unknown", "Status", typical | {"Supply": UNKNOWN_SUPPLY}
    yield "supply low", "Status", typical | {"Supply": 4200, "SupplyLow": 1}
    yield "ADC fault", "Status", typical | {"AdcFault": 1}
    yield "overtemperature", "Status", typical | {"Temperature1": 0x7FFF, "Overtemperature": 1}
    yield "scan overrun", "Status", typical | {"ScanOverrun": 1}
    yield "charge reset", "Status", typical | {"ChargeReset": 1}
    yield "lowest values", "Status", {"Temperature1": -0x7FFF, "Temperature2": -0x7FFF}
    flags = dict.fromkeys(("SupplyLow", "AdcFault", "Overtemperature", "ScanOverrun", "Scanning", "ChargeReset"), 1)
    limits = {"Temperature1": 0x7FFF, "Temperature2": 0x7FFF, "Supply": 65534, "Boot": 15, "Heartbeat": 15}
    yield "highest values", "Status", flags | limits


def _identities() -> _Rows:
    typical = {"LayoutId": 1, "ProtocolVersion": 2, "Format": 1, "FirmwareMajor": 3, "FirmwareMinor": 7}
    yield "FD board at 1 kHz", "Identity", typical | {"ScanPeriod": 1000}
    yield "classic board, longest period", "Identity", typical | {"Format": 0, "ScanPeriod": 10_000_000}
    yield "layout of one's own", "Identity", typical | {"LayoutId": 0xFFFF, "FirmwareMinor": 255, "ScanPeriod": 250}


def _fd_blocks() -> _Rows:
    random_numbers = random.Random(_SEED)

    def block(counts: list[int], sequence: int, time: int, index: int = 0, status: int = 0, boot: int = 5) -> Any:
        head = {"Sequence": sequence, "DeviceTime": time, "BlockIndex": index, "BlockStatus": status, "BlockBoot": boot}
        return head | {f"Count{i}": count for i, count in enumerate(counts)}

    yield "FD, first three counts", "ScanBlockFd", block([0x8000, 0xFFFF, 0x1234], 1234, 1_234_567)
    yield "FD, all zero", "ScanBlockFd", block([], 0, 0, boot=0)
    counts = [random_numbers.randrange(0x1_0000) for _ in range(_TAXELS_16)]
    yield "FD, 5 x 5 with one count unused", "ScanBlockFd", block(counts[:_TAXELS], 2**31, 2**31)
    last = -(-_TAXELS_16 // FD_TAXELS) - 1
    first = block(counts[:FD_TAXELS], 0xFFFF_FFFF, 0xFFFF_FFFF, 0, 8, 15)
    yield "FD, 16 x 16, first block", "ScanBlockFd", first
    unused = block(counts[last * FD_TAXELS :], 0xFFFF_FFFF, 0xFFFF_FFFF, last, 8, 15)
    yield "FD, 16 x 16, last block with four counts unused", "ScanBlockFd", unused
    yield "FD, highest values", "ScanBlockFd", block([0xFFFF] * FD_TAXELS, 2**32 - 1, 2**32 - 1, 255, 15, 15)
    for flag in (1, 2, 4, 8):
        yield f"FD, status {flag}", "ScanBlockFd", block(counts[:_TAXELS], 1000 + flag, 1_000_000 + flag, 0, flag)


def _classic() -> _Rows:
    for name, sequence, time, boot in (
        ("header", 4119, 4_119_345, 5),
        ("header, zero", 0, 0, 0),
        ("header, highest values", 0xFFFF_FFFF, 2**28 - 1, 15),
    ):
        yield name, "ScanHeader", {"HeaderSequence": sequence, "HeaderTime": time, "HeaderBoot": boot}
    for k in range(_TAXELS // CLASSIC_TAXELS):
        codes = {f"Code{CLASSIC_TAXELS * k + i}": (_CODES[i] + 0x111 * k) & 0xFFF for i in range(CLASSIC_TAXELS)}
        yield f"classic, block {k}", f"ScanBlock{k}", {f"ScanCounter{k}": 4119 & 15} | codes
    full = {f"Code{i}": 0xFFF for i in range(CLASSIC_TAXELS)}
    yield "classic, highest values", "ScanBlock0", {"ScanCounter0": 15} | full
    yield "classic, zero", "ScanBlock0", {}
