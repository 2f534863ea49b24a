# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The protocol as its files describe it: signals from posfet.dbc, commands, timing and rules from posfet.yaml."""

from __future__ import annotations

import binascii
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from importlib.resources import files
from typing import Any, Final

from posfet_driver.bus.frame import CLASSIC, FD, RATE_SWITCH, Frame
from posfet_model.plain_yaml import parse

BASE: Final = 0x100
"""Base identifier in the DBC."""

_MESSAGE: Final = re.compile(r"BO_ (\d+) (\w+): (\d+) (\w+)$")
_SIGNAL: Final = re.compile(r' SG_ (\w+) : (\d+)\|(\d+)@1([+-]) \(([^,]+),0\) \[([^|]+)\|([^\]]+)\] "([^"]*)" \w+$')
_COMMENT: Final = re.compile(r'CM_ (?:BO_|SG_) (\d+) (?:(\w+) )?"([^"]*)";$')
_VALUES: Final = re.compile(r"VAL_ (\d+) (\w+) (.*) ;$")
_FD_FRAME: Final = re.compile(r'BA_ "VFrameFormat" BO_ (\d+) 14;$')


@dataclass(frozen=True)
class Signal:
    """A number within a frame, little-endian."""

    name: str
    start: int
    """Lowest bit; bit 8 is the lowest of byte 1."""
    length: int
    """Number of bits."""
    signed: bool
    scale: float
    """Physical value of one step."""
    unit: str
    meaning: str = ""
    choices: Mapping[int, str] = field(default_factory=dict)
    """Names of values."""

    @cached_property
    def mask(self) -> int:
        """Bits of the signal in the frame's data, taken as one little-endian number."""
        return ((1 << self.length) - 1) << self.start


@dataclass(frozen=True)
class Message:
    """A frame of the protocol."""

    name: str
    offset: int
    """Identifier less the board's base identifier."""
    length: int
    """Length of the data [byte]."""
    fd: bool
    sender: str
    signals: tuple[Signal, ...]
    when: str = ""

    @property
    def kind(self) -> int:
        """Kind of the frame; an FD frame may also be sent without rate switch."""
        return FD | RATE_SWITCH if self.fd else CLASSIC

    @cached_property
    def reserved(self) -> int:
        """Bits of the data that belong to no signal."""
        return ((1 << 8 * self.length) - 1) & ~sum(signal.mask for signal in self.signals)

    def decode(self, data: bytes) -> dict[str, int]:
        """Return the value of each signal, without its scale.

        Parameters
        ----------
        data : bytes
            Data of the frame.
        """
        bits = int.from_bytes(data, "little")
        values = {signal.name: (bits & signal.mask) >> signal.start for signal in self.signals}
        for signal in self.signals:
            if signal.signed and values[signal.name] >> (signal.length - 1):
                values[signal.name] -= 1 << signal.length
        return values

    def encode(self, **values: int) -> bytes:
        """Return the data of a frame.

        Parameters
        ----------
        **values : int
            Signals without their scales; those left out are 0.

        Raises
        ------
        ValueError
            For an unknown signal, or a value that does not fit.
        """
        signals = {signal.name: signal for signal in self.signals}
        bits = 0
        for name, value in values.items():
            if name not in signals:
                raise ValueError(f"{self.name} has no signal {name}")
            signal = signals[name]
            low = -(1 << (signal.length - 1)) if signal.signed else 0
            if not low <= value < low + (1 << signal.length):
                raise ValueError(f"{name} must be in [{low}, {low + (1 << signal.length) - 1}], got {value}")
            bits |= (value << signal.start) & signal.mask
        return bits.to_bytes(self.length, "little")

    def frame(self, base: int, **values: int) -> Frame:
        """Return a frame of the board at a base identifier; see `encode`.

        Parameters
        ----------
        base : int
            Base identifier of the board.
        **values : int
            Signals without their scales; those left out are 0.
        """
        return base + self.offset, self.kind, self.encode(**values)


@dataclass(frozen=True)
class Description:
    """All that the files say about the protocol."""

    messages: Mapping[str, Message]
    """Frames by name."""
    states: Mapping[str, Any]
    """Content of posfet.yaml."""

    @property
    def rules(self) -> dict[str, str]:
        """Text of each rule by its id."""
        return {rule["id"]: rule["text"] for rule in self.states["rules"]}

    @property
    def codes(self) -> dict[str, int]:
        """Code of each command by its name."""
        return {name: command["code"] for name, command in self.states["commands"].items()}

    @property
    def results(self) -> dict[str, int]:
        """Number of each result by its name."""
        return dict(self.states["results"])


@lru_cache(maxsize=1)
def load_description() -> Description:
    """Return the description that is shipped with this package."""
    folder = files("posfet_driver") / "protocol"
    states: Any = parse((folder / "posfet.yaml").read_text(encoding="utf-8"))
    return Description(_messages((folder / "posfet.dbc").read_text(encoding="ascii")), states)


def _messages(text: str) -> dict[str, Message]:
    """Return the frames of a DBC file: of the format, only what the file of the protocol uses."""
    heads: list[tuple[int, str, int, str]] = []
    signals: dict[int, list[re.Match[str]]] = {}
    comments: dict[tuple[int, str], str] = {}
    choices: dict[tuple[int, str], dict[int, str]] = {}
    fd = set()
    for line in text.splitlines():
        if match := _MESSAGE.match(line):
            heads.append((int(match[1]), match[2], int(match[3]), match[4]))
        elif match := _SIGNAL.match(line):
            signals.setdefault(heads[-1][0], []).append(match)
        elif match := _COMMENT.match(line):
            comments[int(match[1]), match[2] or ""] = match[3]
        elif match := _VALUES.match(line):
            pairs = re.findall(r'(\d+) "([^"]*)"', match[3])
            choices[int(match[1]), match[2]] = {int(value): name for value, name in pairs}
        elif match := _FD_FRAME.match(line):
            fd.add(int(match[1]))
        elif line.startswith(("BO_ ", " SG_ ")):
            raise ValueError(f"posfet.dbc: unexpected line: {line}")
    return {
        name: Message(
            name,
            identifier - BASE,
            length,
            identifier in fd,
            sender,
            tuple(
                Signal(
                    match[1],
                    int(match[2]),
                    int(match[3]),
                    match[4] == "-",
                    float(match[5]),
                    match[8],
                    comments.get((identifier, match[1]), ""),
                    choices.get((identifier, match[1]), {}),
                )
                for match in signals[identifier]
            ),
            comments.get((identifier, ""), ""),
        )
        for identifier, name, length, sender in heads
    }


def checksum(data: bytes) -> int:
    """Return the CRC-16/CCITT-FALSE that an FD block has to carry.

    Parameters
    ----------
    data : bytes
        Data of the block; the checksum in it is left out.
    """
    return binascii.crc_hqx(data[:10] + data[12:], 0xFFFF)
