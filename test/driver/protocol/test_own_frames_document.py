# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The example of docs/own-frames.md: its files are valid, and its frames give the counts that it states."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from posfet_driver.protocol.mapped_decoder import MappedDecoder
from posfet_driver.tools.can_cli import main, make_parser
from posfet_model.sensor import description
from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.frame_mapping import FLAGS, TIME_UNITS
from posfet_model.sensor.scan import ScanStatus
from support.paths import DOCS

TEXT = (DOCS / "own-frames.md").read_text(encoding="utf-8")


def block(kind: str) -> str:
    found = re.search(rf"^```{kind}\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)
    assert found, kind
    return found[1]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with the files of the example."""
    shipped = (description.SENSOR_FOLDER / "posfet_5x5.yaml").read_text(encoding="utf-8")
    shipped = re.sub(r"^can:\n(  .*\n)*", "", shipped, flags=re.MULTILINE)
    for old, new in (("rows: 5 ", "rows: 2 "), ("cols: 5", "cols: 2"), ("bits: 16 ", "bits: 12 ")):
        assert old in shipped
        shipped = shipped.replace(old, new)
    (tmp_path / "hand.yaml").write_text(f"{shipped}\n{block('yaml')}", encoding="utf-8")
    (tmp_path / "hand_board.dbc").write_text(block("dbc"), encoding="ascii")
    (tmp_path / "bus.log").write_text(block("text"), encoding="ascii")
    return tmp_path


def test_the_frames_give_the_counts(folder: Path) -> None:
    decoder = MappedDecoder(load_sensor(folder / "hand.yaml"))
    decoder.start()
    frames = [
        (int(identifier, 16), 0, bytes.fromhex(data))
        for identifier, data in re.findall(r"can0 (\w+)#(\w+)", block("text"))
    ]
    assert len(list(decoder.decode(frames, 0, 0))) == 1
    scan = decoder.scan
    stated = re.search(r"give the counts (.*)\. Check", TEXT)
    assert stated
    assert scan.counts.tolist() == [int(number) for number in re.findall(r"\d+", stated[1])]
    assert (scan.sequence, scan.status, scan.temperatures[0]) == (7, ScanStatus.TIME_ESTIMATED, 31.5)


def test_the_commands_are_valid(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = [shlex.split(line, comments=True) for line in block("bash").splitlines()]
    actions = [words[2:] for words in lines if words[:2] == ["posfet", "can"]]
    assert len(actions) == 4
    for words in actions:
        make_parser().parse_args(words)
    decode = [str(folder / word) if "." in word else word for word in actions[-1]]
    assert main(decode) == 0
    assert re.search(r"complete scans\s*│\s*1\b", capsys.readouterr().out)


def test_keys_flags_and_units_are_complete() -> None:
    for name in (*FLAGS, "dbc", "counts", "numbered_from", "block", "counts_per_frame", "sequence", "time", "order"):
        assert f"`{name}`" in TEXT, name
    assert f"| {', '.join(TIME_UNITS)} |" in TEXT
