# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""`posfet export`: arrays equal the messages; damaged recordings and missing packages are said in one line."""

from __future__ import annotations

import errno
import importlib
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO
from unittest.mock import MagicMock

import numpy as np
import pytest

pytest.importorskip("mcap", reason="recordings need the package mcap")

from posfet_model.sensor.description import load_sensor
from posfet_sim.commands.export import BAD_INPUT, main
from posfet_sim.recording.columns import Columns
from posfet_sim.recording.export import Export
from posfet_sim.recording.mcap_file import MessageFile
from posfet_sim.recording.mcap_reader import Topic
from posfet_sim.recording.recorded_scans import RecordedScans
from posfet_sim.recording.ros2msg import parse_schema
from support.paths import DATA

STORED = DATA / "recording" / "posfet_0.2.0.mcap"
ROWS = Export.rows
INNER = "=====\nMSG: a/Inner\nuint8 key\n=====\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"


def test_arrays_equal_the_messages(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "x.npz"
    assert main([str(STORED), str(out)]) == 0
    assert capsys.readouterr().out == f"{out}: 0.0 MB\n"
    scans = [scan.snapshot() for scan in RecordedScans(STORED, load_sensor()).scans()]
    with np.load(out) as arrays:
        assert arrays["tactile/raw/counts"].dtype == np.uint16
        assert arrays["tactile/raw/counts"].tolist() == [scan.counts.tolist() for scan in scans]
        assert arrays["tactile/raw/header/stamp"].tolist() == [scan.stamp for scan in scans]
        assert arrays["tactile/raw/recorded_ns"].tolist() == [scan.stamp for scan in scans]
        assert set(arrays["tactile/raw/header/frame_id"]) == {"posfet_array"}
        np.testing.assert_array_equal(arrays["tactile/raw/temperatures"], [scan.temperatures for scan in scans])


def test_sequences_and_lists_of_messages_keep_their_owner() -> None:
    schema = "uint16[] ragged\nuint8[2] pair\nInner[] inner\nbuiltin_interfaces/Time at\nstring[] names\n" + INNER
    columns = Columns(parse_schema("a/B", schema), "a/B")
    time = {"sec": 2, "nanosec": 5}
    columns.add({"ragged": [1, 2], "pair": [3, 4], "inner": [{"key": 7}, {"key": 8}], "at": time, "names": ["p", "q"]})
    columns.add({"ragged": [], "pair": [5, 6], "inner": [], "at": time, "names": []})
    columns.add({"ragged": [9], "pair": [7, 8], "inner": [{"key": 9}], "at": time, "names": ["r"]})
    arrays = {name: array.tolist() for name, array in columns.arrays("t").items()}
    assert arrays == {
        "t/ragged": [1, 2, 9],
        "t/ragged.ends": [2, 2, 3],
        "t/pair": [[3, 4], [5, 6], [7, 8]],
        "t/inner/row": [0, 0, 2],
        "t/inner/key": [7, 8, 9],
        "t/at": [2_000_000_005] * 3,
        "t/names": ["p\nq", "", "r"],
    }


def test_what_can_be_read_of_a_damaged_recording_is_exported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = tmp_path / "x.mcap", tmp_path / "x.npz"
    file = MessageFile(path, "test")
    good, bad = (file.add_topic(name, "a/N", "uint32 value") for name in ("/good", "/bad"))
    file.add(good, 1, b"\0\1\0\0\5\0\0\0")
    file.add(bad, 2, b"\0\1\0\0\5")
    file.close()
    path.write_bytes(path.read_bytes()[:-30])
    assert main([str(path), str(out)]) == 0
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "/bad: a/N: the message is too short; its messages from there on are left out"
    assert len(lines) <= 2
    with np.load(out) as arrays:
        assert arrays["good/value"].tolist() == [5]


def test_a_recording_that_was_cut_before_its_first_message_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(STORED.read_bytes()[:500])
    assert main([str(cut), str(tmp_path / "x.npz")]) == BAD_INPUT
    said = capsys.readouterr().err
    assert said == f"{cut}: it ends within a record; 0 messages up to byte {said.split()[-5]} of 500 were read\n"
    assert list(tmp_path.iterdir()) == [cut]


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        ([str(STORED), "x.txt"], "x.txt: must end in .npz, .h5, .hdf5, .parquet"),
        (["none.mcap", "x.npz"], "none.mcap: no such file"),
        ([str(STORED), "x.npz", "--topics", "image"], "has no topic image, but /tactile/raw"),
        ([str(STORED), "none/x.npz"], "none/x.npz: cannot be written: none is not a folder"),
    ],
)
def test_bad_input_is_one_line(
    words: list[str], reason: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(words) == BAD_INPUT
    error = capsys.readouterr().err
    assert reason in error
    assert error.count("\n") == 1


@pytest.mark.parametrize(("suffix", "package"), [("h5", "h5py"), ("parquet", "pyarrow")])
def test_a_missing_package_is_named_in_one_line(
    suffix: str, package: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    out = tmp_path / f"x.{suffix}"
    assert main([str(STORED), str(out)]) == BAD_INPUT
    expected = f"{out}: needs the package {package}: pip install {package}; .npz needs no further package\n"
    assert capsys.readouterr().err == expected


def test_hdf5_has_the_same_arrays(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    assert main([str(STORED), str(tmp_path / "x.h5")]) == 0
    assert main([str(STORED), str(tmp_path / "x.npz")]) == 0
    with h5py.File(tmp_path / "x.h5") as file, np.load(tmp_path / "x.npz") as arrays:
        assert file["tactile/raw/counts"][:].tolist() == arrays["tactile/raw/counts"].tolist()
        assert file["tactile/raw/header/frame_id"][0] == b"posfet_array"


def test_parquet_has_one_file_for_each_topic(tmp_path: Path) -> None:
    pytest.importorskip("pyarrow")
    parquet = importlib.import_module("pyarrow.parquet")
    path = tmp_path / "x.mcap"
    file = MessageFile(path, "test")
    schema = "uint16[] many\nInner[] inner\n" + INNER
    topics = [file.add_topic(name, "a/B", schema) for name in ("/s/one", "/s/two")]
    monkey = {"many": [1, 2], "inner": [{"key": 3}]}
    data = b"\0\1\0\0" + serialise_by_hand(monkey)
    for topic in topics:
        file.add(topic, 5, data)
    file.close()
    assert main([str(path), str(tmp_path / "x.parquet")]) == 0
    rows = parquet.read_table(tmp_path / "x.s.one.parquet").to_pylist()
    assert rows == [{"recorded_ns": 5, **monkey}]
    assert (tmp_path / "x.s.two.parquet").is_file()


@pytest.mark.parametrize("step", ["open", "write", "close"])
@pytest.mark.parametrize("full", ["one", "two"])
def test_the_file_of_the_topic_that_cannot_be_written_is_named(
    full: str, step: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file = MessageFile(tmp_path / "x.mcap", "test")
    for name in ("one", "two"):
        file.add(file.add_topic(f"/s/{name}", "a/B", "string data"), 5, b"\0\1\0\0\1\0\0\0\0")
    file.close()
    order: list[Writer] = []

    class Writer:
        """A writer on a disk that is full at a step of one of the two files."""

        def __init__(self, part: Path, _: object) -> None:
            self.name = ("one", "two")[len(order)]
            order.append(self)
            part.write_bytes(b"PAR1")
            self.reach("open")

        def reach(self, at: str) -> None:
            if (self.name, at) == (full, step):
                raise OSError(errno.ENOSPC, "No space left on device")

        def write_table(self, _: object) -> None:
            self.reach("write")

        def close(self) -> None:
            self.reach("close")

    monkeypatch.setitem(sys.modules, "pyarrow", MagicMock())
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", MagicMock(ParquetWriter=Writer))
    assert main([str(file.path), str(tmp_path / "x.parquet")]) == BAD_INPUT
    said = f"{tmp_path}/x.s.{full}.parquet: cannot be written: No space left on device\n"
    assert capsys.readouterr().err == said
    assert [path.name for path in tmp_path.iterdir()] == ["x.mcap"]


def serialise_by_hand(values: dict[str, list[object]]) -> bytes:
    """The message of two numbers and one inner message."""
    assert values == {"many": [1, 2], "inner": [{"key": 3}]}
    return b"\2\0\0\0\1\0\2\0\1\0\0\0\3"


def interrupted(self: Export, at: Callable[[int], object]) -> Iterator[tuple[Topic, int, dict[str, Any]]]:
    """As `Export.rows`, with an interrupt after the first message."""
    yield next(ROWS(self, at))
    raise KeyboardInterrupt


def half_written(stream: BinaryIO, **_: np.ndarray) -> None:
    """As `numpy.savez_compressed`, with an interrupt after the first bytes."""
    stream.write(b"PK")
    raise KeyboardInterrupt


@pytest.mark.parametrize(("suffix", "package"), [("npz", "numpy"), ("h5", "h5py"), ("parquet", "pyarrow")])
def test_an_interrupted_export_leaves_the_file_that_was_there(
    suffix: str, package: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip(package)
    out = tmp_path / f"x.{suffix}"
    words = [str(STORED), str(out), "--topics", "raw"]
    assert main(words) == 0
    before = out.read_bytes()
    if suffix == "npz":
        monkeypatch.setattr(np, "savez_compressed", half_written)
    else:
        monkeypatch.setattr(Export, "rows", interrupted)
    with pytest.raises(KeyboardInterrupt):
        main(words)
    assert out.read_bytes() == before
    assert list(tmp_path.iterdir()) == [out]
