# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Tables of ``docs/protocol.md`` and golden frames: ``python -m posfet.protocol_document``."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable, Iterable, Sequence
from itertools import groupby
from pathlib import Path
from typing import Final

from posfet.protocol_vectors import CLASSIC_TAXELS, FD_TAXELS, GoldenFrame, as_json, golden_frames
from posfet_driver.bus.frame_timing import BusTime, classic_time, fd_time
from posfet_driver.conformance.description import BASE, Message, Signal, load_description

DOCUMENT: Final = Path("docs/protocol.md")
VECTORS: Final = Path("test/data/protocol/golden_frames.json")

NOMINAL_RATE: Final = 1e6
DATA_RATE: Final = 5e6
"""Bit rates of the tables of bus load [bit/s]."""
SCAN_RATE: Final = 1000
"""Scan rate of the table of bus load [Hz]."""
LAYOUTS: Final = (("5 x 5", 25, True), ("5 x 5", 25, False), ("16 x 16", 256, True), ("32 x 32", 1024, True))
EXAMPLES: Final = (
    "START",
    "START accepted",
    "period refused",
    "unknown command",
    "SELF_TEST failed",
    "IDENTIFY accepted",
    "scanning",
    "temperatures unknown",
    "supply unknown",
    "FD board at 1 kHz",
    "FD, first three counts",
    "header",
    "classic, block 0",
    "classic, block 4",
)
"""Golden frames that the document shows."""


def table(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table in Markdown.

    Parameters
    ----------
    header : sequence of str
        Titles of the columns.
    rows : iterable of sequence
        Cells of each row.
    """
    cells = [[f" {cell} " if cell != "" else " " for cell in row] for row in (header, *rows)]
    cells.insert(1, ["---"] * len(header))
    return "\n".join(f"|{'|'.join(row)}|" for row in cells)


def _identifiers() -> str:
    rows = []
    for message in load_description().messages.values():
        if message.name.startswith("ScanBlock") and message.name[-1] in "1234":
            continue
        several = message.name == "ScanBlock0"
        rows.append(
            [
                f"{message.offset} + k" if several else message.offset,
                f"0x{BASE + message.offset:X}" + " + k" * several,
                "ScanBlock k" if several else message.name,
                "FD" if message.fd else "classic",
                message.length,
                message.sender.lower(),
                message.when,
            ]
        )
    return table(["offset", "0x100 + offset", "message", "format", "length [byte]", "sender", "when"], rows)


def _signals(message: Message) -> str:
    """Return the table of a frame's bits: taxels in one row, and the unused bits."""
    rows: list[tuple[int, list[str]]] = []
    for stem, group in groupby(message.signals, key=lambda signal: re.sub(r"\d+$", "", signal.name)):
        signals = list(group)
        if stem in {"Count", "Code"}:
            step = signals[1].start - signals[0].start
            name = "Count i" if stem == "Count" else "Code 5 k + i"
            bits = f"from {signals[0].start} + {step} i"
            cells = [bits, name, f"{signals[0].meaning}, i from 0 to {len(signals) - 1}"]
            rows.append((signals[0].start, [cells[0], cells[1], f"{signals[0].length} bits", cells[2]]))
            continue
        for signal in signals:
            name = signal.name.replace("ScanCounter0", "ScanCounter k")
            rows.append((signal.start, [_bits(signal.start, signal.length), name, _unit(signal), _meaning(signal)]))
    rows += [(first, [_bits(first, length), "", "", "reserved"]) for first, length in _runs(message.reserved)]
    return table(["bits", "signal", "unit", "meaning"], [row for _, row in sorted(rows)])


def _bits(start: int, length: int) -> str:
    return f"{start}-{start + length - 1}" if length > 1 else f"{start}"


def _runs(mask: int) -> list[tuple[int, int]]:
    """Return first bit and length of each run of ones."""
    bits = f"{mask:b}"[::-1]
    return [(match.start(), len(match[0])) for match in re.finditer("1+", bits)]


def _unit(signal: Signal) -> str:
    unit = signal.unit if signal.scale == 1 else f"1/{round(1 / signal.scale)} {signal.unit}"
    return f"{unit}, signed" if signal.signed else unit


def _meaning(signal: Signal) -> str:
    choices = ", ".join(f"{value} {name}" for value, name in signal.choices.items())
    if signal.name == "BlockStatus":
        choices = ", ".join(f"{value} {name}" for name, value in load_description().states["flags"].items())
    if signal.name in {"CommandCode", "ResponseCommand"}:
        choices = ""
    return f"{signal.meaning}: {choices}" if choices else signal.meaning


def _checksum() -> str:
    crc = load_description().states["checksum"]
    rows = [
        ["covers", crc["covers"]],
        ["polynomial", f"0x{crc['polynomial']:04X}, {crc['width']} bits"],
        ["initial value", f"0x{crc['initial']:04X}"],
        ["reflected", "yes" if crc["reflected"] else "no"],
        ["final XOR", f"0x{crc['final_xor']:04X}"],
        ["checksum of the ASCII digits 123456789", f"0x{crc['check']:04X}"],
    ]
    return table(["CRC-16/CCITT-FALSE", ""], rows)


def _commands() -> str:
    rows = [
        [
            command["code"],
            name,
            command["argument"],
            command["value"],
            ", ".join([*command["results"]]),
            *(command["next"][state] for state in load_description().states["states"]),
        ]
        for name, command in load_description().states["commands"].items()
    ]
    states = [f"then, when {state}" for state in load_description().states["states"]]
    return table(["code", "command", "argument", "value of an OK response", "results", *states], rows)


def _rules() -> str:
    rules = load_description().rules.items()
    return table(["rule", "text"], ([f'<a id="{name.lower()}"></a>{name}', text] for name, text in rules))


def _timing() -> str:
    timing = load_description().states["timing"]
    rows = [
        ["from a command to its response, at most", f"{timing['response_ms']} ms"],
        ["from one status to the next", f"{timing['status_period_ms']} ms"],
        ["from one identity to the next", f"{timing['identity_period_ms']} ms"],
        ["longest scan period", f"{timing['longest_period_us'] / 1e6:g} s"],
        ["classic scans from one header to the next, at most", timing["header_scans"]],
        ["largest error of the board's clock (assumed)", f"{timing['tolerance_ppm']} ppm"],
    ]
    return table(["time", "value"], rows)


def _examples() -> str:
    frames = {frame.name: frame for frame in golden_frames()}
    rows = [_example(frames[name]) for name in EXAMPLES]
    return table(["example", "message", "identifier", "data", "signals"], rows)


def _example(frame: GoldenFrame) -> list[str]:
    data = frame.data.rstrip(b"\0") if frame.fd else frame.data
    signals = ", ".join(
        f"{name} {value:g}" if value % 1 else f"{name} {value:.0f}" for name, value in frame.physical.items()
    )
    return [frame.name, frame.message, f"0x{frame.identifier:X}", f"`{data.hex(' ').upper()}`", signals]


def _frame_times() -> str:
    rows = [
        [name, f"{1e6 * time.least:.1f}", f"{1e6 * time.most:.1f}"]
        for name, time in (("classic, 8 bytes", _time(False)), ("FD, 64 bytes", _time(True)))
    ]
    return table(["frame", "minimum [us]", "maximum [us]"], rows)


def _bus_load() -> str:
    timing = load_description().states["timing"]
    others = 1e3 / timing["status_period_ms"] + 1e3 / timing["identity_period_ms"]  # frames per second besides scans
    rows = []
    for name, taxels, fd in LAYOUTS:
        blocks = -(-taxels // (FD_TAXELS if fd else CLASSIC_TAXELS))
        short, frame = _time(False), _time(fd)
        scans = [blocks * time for time in (frame.least, frame.most)]
        headers = 0 if fd else 1 / timing["header_scans"]
        load = [
            100 * (SCAN_RATE * (scan + headers * time) + others * time)
            for scan, time in zip(scans, (short.least, short.most), strict=True)
        ]
        highest = int((1 - others * short.most) / (scans[1] + headers * short.most))
        span = f"{load[0]:.1f}-{load[1]:.1f} %" if load[1] <= 100 else "-"
        kind = "FD" if fd else "classic"
        rows.append([f"{name}, {kind}", blocks, f"{1e6 * scans[0]:.1f}-{1e6 * scans[1]:.1f}", span, highest])
    load_title = "bus load at 1 kHz, all frames"
    return table(["layout, format", "blocks", "duration of the blocks [us]", load_title, "maximum rate [Hz]"], rows)


def _time(fd: bool) -> BusTime:
    return fd_time(64, NOMINAL_RATE, DATA_RATE) if fd else classic_time(8, NOMINAL_RATE)


SECTIONS: Final[dict[str, Callable[[], str]]] = {
    "identifiers": _identifiers,
    "checksum": _checksum,
    "commands": _commands,
    "rules": _rules,
    "examples": _examples,
    "timing": _timing,
    "frame times": _frame_times,
    "bus load": _bus_load,
} | {
    name: lambda message=name: _signals(load_description().messages[message])
    for name in ("ScanBlockFd", "ScanHeader", "ScanBlock0", "Status", "Identity", "Command", "Response")
}
"""Generated parts of the document by the names of their markers."""


def document(text: str) -> str:
    """Return the document with its generated parts written anew.

    Parameters
    ----------
    text : str
        The document.

    Raises
    ------
    ValueError
        For a marker that is unknown, missing or repeated.
    """
    parts = re.split(r"(<!-- begin [^>]* -->\n)(.*?)(<!-- end [^>]* -->\n)", text, flags=re.DOTALL)
    names = [match[1] for match in re.finditer(r"<!-- begin ([^>]*) -->", text)]
    if sorted(names) != sorted(SECTIONS) or len(parts) != 4 * len(names) + 1:
        wrong = ", ".join(sorted(set(names) ^ set(SECTIONS))) or "one of them is repeated or has no end"
        raise ValueError(f"markers do not match the generated parts: {wrong}")
    for index, name in enumerate(names):
        parts[4 * index + 2] = SECTIONS[name]() + "\n"
    return "".join(parts)


def main(words: Sequence[str] | None = None) -> int:
    """Write document and golden frames, and return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m posfet.protocol_document", description=__doc__)
    parser.add_argument("--document", type=Path, default=DOCUMENT, metavar="FILE", help=f"default: {DOCUMENT}")
    parser.add_argument("--vectors", type=Path, default=VECTORS, metavar="FILE", help=f"default: {VECTORS}")
    options = parser.parse_args(words)
    options.document.write_text(document(options.document.read_text(encoding="utf-8")), encoding="utf-8")
    options.vectors.write_text(as_json(), encoding="ascii")
    print(f"{options.document}, {options.vectors}: written")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
