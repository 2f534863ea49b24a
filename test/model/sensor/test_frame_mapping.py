# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The section `protocol` of a sensor file."""

from __future__ import annotations

from pathlib import Path

import pytest

from posfet_model.config import ConfigError
from posfet_model.sensor import description
from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.frame_mapping import FrameMapping
from posfet_model.sensor.scan import ScanStatus
from support.each_row import each_row

SHIPPED = (description.SENSOR_FOLDER / "posfet_5x5.yaml").read_text(encoding="utf-8")


def load(folder: Path, protocol: str, base_id: bool = False) -> FrameMapping | None:
    path = folder / "hand.yaml"
    text = SHIPPED if base_id else SHIPPED.replace("  base_id: 0x100\n", "")
    path.write_text(f"{text}\n{protocol}\n", encoding="utf-8")
    return load_sensor(path).mapping


def mapped(counts: str, more: str = "") -> str:
    return f"protocol: {{dbc: my.dbc, counts: {counts}{', ' if more else ''}{more}}}"


def test_the_protocol_of_this_project_is_the_default(tmp_path: Path) -> None:
    assert load(tmp_path, "", base_id=True) is None
    assert load(tmp_path, "protocol: posfet", base_id=True) is None


def test_the_dbc_file_is_beside_the_sensor_file(tmp_path: Path) -> None:
    mapping = load(tmp_path, mapped('"T{row}_{col:02}"'))
    assert mapping is not None
    assert mapping.dbc == tmp_path / "my.dbc"
    assert mapping.counts[:6] == ("T0_00", "T0_01", "T0_02", "T0_03", "T0_04", "T1_00")
    assert len(mapping.counts) == 25


def test_patterns_and_lists_of_counts(tmp_path: Path) -> None:
    with each_row() as row:
        for counts, more, first, last in (
            ('"S{taxel:02}"', "", "S00", "S24"),
            ('"S{taxel}"', "numbered_from: 1", "S1", "S25"),
            ('"Row{row}.Col{col}"', "numbered_from: 1", "Row1.Col1", "Row5.Col5"),
            (f"[{', '.join(f'X{24 - number}' for number in range(25))}]", "", "X24", "X0"),
            ('"C{place}"', "block: Index, counts_per_frame: 26", "C0", "C25"),
            ("[A, B, C]", "block: Index", "A", "C"),
        ):
            with row(counts + more):
                mapping = load(tmp_path, mapped(counts, more))
                assert mapping is not None
                assert (mapping.counts[0], mapping.counts[-1]) == (first, last)


def test_all_other_keys(tmp_path: Path) -> None:
    more = "sequence: [A.N, B.N], time: T, time_unit: ms, temperatures: [T1, T2], order: [A, B]"
    mapping = load(tmp_path, mapped('"S{taxel}"', f"{more}, status: {{Low: supply_low, Hot: overtemperature}}"))
    assert mapping is not None
    assert (mapping.sequence, mapping.time, mapping.time_unit) == (("A.N", "B.N"), ("T",), "ms")
    assert (mapping.temperatures, mapping.order) == (("T1", "T2"), ("A", "B"))
    assert mapping.status == (("Low", ScanStatus.SUPPLY_LOW), ("Hot", ScanStatus.OVERTEMPERATURE))


def test_misfits_are_one_line(tmp_path: Path) -> None:
    good = '"S{taxel}"'
    with each_row() as row:
        for protocol, expected in (
            ("protocol: canopen", "protocol: must be one of posfet, got 'canopen'"),
            ("protocol: [my.dbc]", "protocol: must be one of posfet, got ['my.dbc']"),
            ("protocol: {dbc: my.dbc}", "protocol.counts: missing, must be a text or a list of texts"),
            (f"protocol: {{counts: {good}}}", "protocol.dbc: missing, must be text"),
            (mapped("[A, B]"), "protocol.counts: must name 5 x 5 = 25 signals, got 2"),
            (mapped("[]"), "protocol.counts: must be a text or a list of texts, each of one line and not empty"),
            (mapped("5"), "protocol.counts: must be a text or a list of texts, each of one line and not empty"),
            (mapped('"S{cell}"'), "protocol.counts: must be a pattern with {row}, {col}, {taxel}, such as"),
            (mapped('"S{taxel.real}"'), "protocol.counts: must be a pattern with {row}, {col}, {taxel}, such as"),
            (mapped('"S{taxel!r}"'), "protocol.counts: must be a pattern with {row}, {col}, {taxel}, such as"),
            (mapped('"S{taxel:999}"'), "protocol.counts: must be a pattern with {row}, {col}, {taxel}, such as"),
            (mapped('"S{taxel"'), "protocol.counts: must be a pattern with {row}, {col}, {taxel}, such as"),
            (mapped('"S {taxel}"'), "protocol.counts: must name a signal as Signal or Message.Signal, got 'S 0'"),
            (mapped('"S{taxel}"', "block: I"), "protocol.counts_per_frame: missing, must be a whole number in"),
            (mapped(good, "sequence: a b"), "protocol.sequence: must name a signal as Signal or Message.Signal"),
            (mapped(good, "time_unit: h"), "protocol.time_unit: must be one of s, ms, us, ns, got 'h'"),
            (mapped(good, "temperatures: [A, B, C]"), "protocol.temperatures: must name at most 2 signals"),
            (mapped(good, "status: {A: hot}"), "protocol.status.A: must be one of supply_low, adc_fault, overtemp"),
            (mapped(good, "rate: 5"), "protocol.rate: unknown key, known here are dbc, block, numbered_from, counts"),
        ):
            with row(protocol):
                with pytest.raises(ConfigError) as caught:
                    load(tmp_path, protocol)
                assert str(caught.value).startswith(f"{tmp_path / 'hand.yaml'}: {expected}"), caught.value
                assert "\n" not in str(caught.value)


def test_the_identifiers_are_those_of_the_dbc_file(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"can\.base_id: unknown key"):
        load(tmp_path, mapped('"S{taxel}"'), base_id=True)
