# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""A mapping that does not fit its DBC file or array is refused in one line; whatever fits is decoded."""

from __future__ import annotations

import builtins
import importlib
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from posfet_driver.protocol.bit_field import BitField
from posfet_driver.protocol.frame_tables import load_tables
from posfet_model.config import ConfigError
from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.scan import ScanStatus
from support.each_row import each_row
from support.own_boards import FOLDER, sensor_a, sensor_b

DBC = """VERSION ""

BU_: X

BO_ 256 Counts: 8 X
 SG_ C0 : 0|12@1+ (1,0) [0|0] "" X
 SG_ C1 : 12|12@1+ (1,0) [0|0] "" X
 SG_ Count : 24|4@1+ (1,0) [0|15] "" X
 SG_ Toggle : 28|1@1+ (1,0) [0|1] "" X
 SG_ Long : 32|32@1+ (1,0) [0|0] "" X

BO_ 257 Other: 8 X
 SG_ Count : 0|8@1+ (1,0) [0|255] "" X
 SG_ Signed : 8|16@1- (1,0) [0|0] "ms" X
 SG_ Time : 24|16@1+ (1,0) [0|0] "ms" X
 SG_ Bare : 40|8@1+ (1,0) [0|0] "" X
 SG_ Short : 48|2@1+ (1,0) [0|0] "ms" X
 SG_ Kelvin : 56|8@1+ (1,0) [0|0] "K" X

BO_ 258 Real: 8 X
 SG_ Real : 0|32@1- (1,0) [0|0] "" X
 SG_ Reversed : 32|12@1+ (1,0) [5|1] "" X

BO_ 259 Switched: 8 X
 SG_ Switch M : 0|4@1+ (1,0) [0|15] "" X
 SG_ S0 m0 : 8|12@1+ (1,0) [0|0] "" X
 SG_ S1 m1 : 8|12@1+ (1,0) [0|0] "" X
 SG_ Both : 24|12@1+ (1,0) [0|0] "" X
 SG_ Hidden m7 : 8|8@1+ (1,0) [0|0] "ms" X

BO_ 260 Big: 12 X
 SG_ B0 : 0|12@1+ (1,0) [0|0] "" X
 SG_ B1 : 80|12@1+ (1,0) [0|0] "" X

BO_ 290 Vast: 16 X
 SG_ Huge : 0|72@1+ (1,0) [0|0] "" X

BO_ 291 Slow: 2 X
 SG_ Slow : 0|16@1+ (2000,0) [0|0] "s" X

SIG_VALTYPE_ 258 Real : 1;
"""
"""A DBC file with a signal for every misfit."""

MISFITS: dict[str, tuple[dict[str, Any], str]] = {
    "unknown signal": ({"counts": ("C0", "C01")}, "counts: misfits.dbc has no signal 'C01'; did you mean 'C1'?"),
    "unknown message": (
        {"counts": ("C0", "Cuonts.C1")},
        "counts: misfits.dbc has no message 'Cuonts'; did you mean 'Counts'?",
    ),
    "used twice": ({"counts": ("C0", "C0")}, "counts: signal Counts.C0 is used twice"),
    "used for two": ({"sequence": ("C1",)}, "sequence: signal Counts.C1 is used twice, also for counts"),
    "32 bits": ({"counts": ("C0", "Long")}, "counts: signal Long has 32 bits, a count has at most 16"),
    "float": ({"counts": ("C0", "Real")}, "counts: signal Real is a floating-point number"),
    "fewer bits than the ADC": ({"counts": ("C0", "Bare")}, "counts: signal Bare has 8 bits, adc.bits = 12"),
    "reversed range": ({"counts": ("C0", "Reversed")}, "counts: signal Reversed: the scale must not be 0"),
    "all or none multiplexed": ({"counts": ("S0", "Both")}, "counts: message Switched: all counts or none"),
    "ambiguous time": ({"time": ("Time", "Signed")}, "time: signal Other.Signed must be a whole number without sign"),
    "toggle bit": ({"sequence": ("Toggle",)}, "sequence: signal Counts.Toggle has 1 bits, a counter needs 2 or more"),
    "different counters": (
        {"sequence": ("Count", "Other.Count")},
        "sequence: signals Counts.Count and Other.Count differ in length or scale",
    ),
    "ambiguous status": (
        {"status": (("Count", ScanStatus.ADC_FAULT),)},
        "status: signal 'Count' is in several messages, write one of Counts.Count, Other.Count",
    ),
    "time without a unit": ({"time": ("Bare",)}, "time_unit: missing, must be one of s, ms, us, ns"),
    "time that wraps too soon": ({"time": ("Short",)}, "time: signal Other.Short wraps after 4 ms, less than 4 scan"),
    "time in no frame with counts": (
        {"counts": ("S0", "S1"), "time": ("Hidden",)},
        "time: signal Switched.Hidden is in no frame with counts",
    ),
    "kelvin": ({"temperatures": ("Kelvin",)}, "temperatures: signal Other.Kelvin must be a whole number, scaled to"),
    "order lacks a message": (
        {"counts": ("C0", "Both"), "order": ("Counts",)},
        "order: must name each message of a scan once: Counts, Switched",
    ),
    "12 bytes": ({"counts": ("B0", "B1")}, "dbc: message Big has 12 bytes, which needs can.fd: true"),
    "72 bits": (
        {"status": (("Huge", ScanStatus.ADC_FAULT),)},
        "status: signal Vast.Huge has 72 bits, at most 64 are read",
    ),
    "steps of 2000 s": ({"time": ("Slow",)}, "time: signal Slow.Slow has steps of 2000 s, at most 1000"),
    "block elsewhere": ({"block": "Bare"}, "block: misfits.dbc has no signal 'Counts.Bare'"),
    "too many blocks": ({"block": "Toggle", "counts": ("C0",)}, "block: 3 frames need more than the 1 bits of"),
}


def test_every_misfit_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "misfits.dbc"
    path.write_text(DBC, encoding="ascii")
    sensor = sensor_a(tmp_path)
    mapping = sensor.mapping
    assert mapping is not None
    base = replace(
        mapping, source="hand.yaml", dbc=path, counts=("C0", "C1"), sequence=(), temperatures=(), status=(), order=()
    )
    small = replace(
        sensor,
        layout=replace(sensor.layout, rows=1, cols=2),
        adc=replace(sensor.adc, bits=12),
        can=replace(sensor.can, scan_rate=999.0),
    )
    assert load_tables(replace(small, mapping=base)).blocks == 1
    with each_row() as row:
        for name, (changes, expected) in MISFITS.items():
            with row(name):
                layout = replace(small.layout, cols=3) if name == "too many blocks" else small.layout
                with pytest.raises(ConfigError) as caught:
                    load_tables(replace(small, layout=layout, mapping=replace(base, **changes)))
                assert str(caught.value).startswith(f"hand.yaml: protocol.{expected}"), caught.value
                assert "\n" not in str(caught.value)


def test_a_dbc_file_that_cannot_be_used(tmp_path: Path) -> None:
    sensor = sensor_a(tmp_path)
    mapping = sensor.mapping
    assert mapping is not None
    (tmp_path / "text.dbc").write_text("counts: 5\n", encoding="ascii")
    (tmp_path / "binary.dbc").write_bytes(bytes(range(256)))
    (tmp_path / "large.dbc").write_bytes(b" " * 8_000_001)
    with each_row() as row:
        for name, expected in (
            ("missing.dbc", "No such file"),
            ("text.dbc", "text.dbc is not a valid DBC file: "),
            ("binary.dbc", "binary.dbc is not a valid DBC file: "),
            ("large.dbc", "larger than"),
            (".", "Is a directory"),
        ):
            with row(name):
                with pytest.raises(ConfigError, match=re.escape(expected)) as caught:
                    load_tables(replace(sensor, mapping=replace(mapping, dbc=tmp_path / name)))
                assert str(caught.value).isprintable()


@pytest.mark.parametrize("encoding", ["cp1252", "utf-8", "utf-8-sig"])
def test_encodings_of_dbc_files(tmp_path: Path, encoding: str) -> None:
    """A DBC file names no encoding; the unit of a voltage may be µV, that of a temperature °F."""
    sensor = sensor_a(tmp_path)
    mapping = sensor.mapping
    assert mapping is not None
    text = (FOLDER / "classic_board.dbc").read_text(encoding="ascii").replace('"degC"', '"°F"')
    (tmp_path / "units.dbc").write_bytes(text.encode(encoding))
    with pytest.raises(ConfigError, match=r"temperatures: signal Climate\.ChipTemperature must be .* scaled to degC"):
        load_tables(replace(sensor, mapping=replace(mapping, dbc=tmp_path / "units.dbc")))


def test_without_cantools_the_message_names_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sensor = sensor_a(tmp_path)

    def refuse(name: str, *arguments: Any) -> Any:
        raise ImportError(name)

    monkeypatch.setattr(importlib, "import_module", refuse)
    with pytest.raises(ConfigError, match=r"protocol\.dbc: needs the package cantools: pip install cantools"):
        load_tables(sensor)


def test_cantools_is_imported_for_such_sensors_only(monkeypatch: pytest.MonkeyPatch) -> None:
    from posfet_driver.protocol.mapped_decoder import make_decoder  # noqa: PLC0415

    original = builtins.__import__

    def refuse(name: str, *arguments: Any, **named: Any) -> Any:
        assert not name.startswith("cantools")
        return original(name, *arguments, **named)

    monkeypatch.setattr(builtins, "__import__", refuse)
    assert make_decoder(load_sensor()).blocks == 1


def test_tables_of_both_boards(tmp_path: Path) -> None:
    a, b = load_tables(sensor_a(tmp_path)), load_tables(sensor_b(tmp_path))
    assert (a.blocks, a.sequence_bits, a.sequenced, a.time_bits) == (5, 8, True, 0)
    assert (b.blocks, b.sequence_bits, b.sequenced, b.time_bits, b.tick) == (2, 0, False, 16, 1e6)
    assert a.names == {(0x18FF0100, True): "TactileRow", (0x18FF0200, True): "Climate"}
    assert b.sent == ((32, False), (24, False))


def test_a_header_of_its_own_is_part_of_the_scan(tmp_path: Path) -> None:
    path = tmp_path / "misfits.dbc"
    path.write_text(DBC, encoding="ascii")
    sensor = sensor_a(tmp_path)
    mapping = sensor.mapping
    assert mapping is not None
    header = replace(
        mapping, dbc=path, counts=("C0", "C1"), sequence=(), time=("Time",), temperatures=(), status=(), order=()
    )
    small = replace(sensor, layout=replace(sensor.layout, rows=1, cols=2), mapping=header)
    assert [part.block for part in load_tables(small).messages[257, 0].parts.values()] == [0]
    last = load_tables(replace(small, mapping=replace(header, order=("Counts", "Other"))))
    assert last.messages[257, 0].parts[0].block == 1


def test_dbc_files_of_the_tests_are_those_of_their_generator() -> None:
    namespace: dict[str, Any] = {"__name__": "make_boards"}
    exec((FOLDER / "make_boards.py").read_text(encoding="utf-8"), namespace)
    for name in ("classic", "fd"):
        assert (FOLDER / f"{name}_board.dbc").read_text(encoding="ascii") == namespace[name]()


@pytest.mark.parametrize(
    ("start", "length", "order", "expected"),
    [
        (0, 8, "little_endian", BitField(0, 1, "little", 0, 8)),
        (12, 12, "little_endian", BitField(1, 3, "little", 4, 12)),
        (7, 16, "big_endian", BitField(0, 2, "big", 0, 16)),
        (3, 10, "big_endian", BitField(0, 2, "big", 2, 10)),
        (8, 16, "big_endian", BitField(1, 4, "big", 1, 16)),
    ],
)
def test_places_of_signals(start: int, length: int, order: str, expected: BitField) -> None:
    from cantools.database.can import Signal  # noqa: PLC0415

    assert BitField.of_signal(Signal("S", start, length, order)) == expected
