# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The command `posfet sim`: its files are readable by other tools, agree with the board, and are reproducible."""

import csv
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.scan import Scan
from posfet_sim.commands.simulate import BAD_INPUT, INTERRUPTED, main
from posfet_sim.device.error_model import ErrorModel
from posfet_sim.device.simulated_board import SimulatedBoard
from posfet_sim.emulation.faulty_scans import FaultyScans
from posfet_sim.recording.message_definitions import message_fields, schema_text
from posfet_sim.scene import SceneLoads, load_scene
from posfet_sim.scene.scene_file import SCENE_FOLDER

SENSOR = load_sensor()
SCENE = "two_fingers"
TAXELS = SENSOR.layout.taxels


def board_counts(scans: int, seed: int, imperfections: ErrorModel) -> np.ndarray:
    board = SimulatedBoard(SENSOR, SceneLoads(load_scene(SCENE, SENSOR), SENSOR), seed, imperfections)
    source, scan = FaultyScans(board, seed), Scan.empty(1, TAXELS)
    return np.array([scan.counts.copy() for index in range(scans) for _ in range(source.scan(index, scan))])


def read_csv(path: Path) -> tuple[list[str], np.ndarray]:
    with path.open(encoding="ascii", newline="") as stream:
        rows = list(csv.reader(stream))
    return rows[0], np.array(rows[1:], np.float64)


def test_csv_contains_the_counts_and_the_ground_truth(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "run.csv"
    assert main([SCENE, "--out", str(path), "--for", "0.6", "--seed", "3", "--imperfections", "default"]) == 0
    names, values = read_csv(path)
    assert len(set(names)) == len(names) == values.shape[1]
    first = names.index("count_r0_c0")
    expected = board_counts(600, 3, ErrorModel.default())
    np.testing.assert_array_equal(values[:, first : first + TAXELS], expected)
    pressed = [names.index(f"{item}.force_N") for item in ("lower", "upper")]
    forces = [index for index, name in enumerate(names) if name.startswith("force_")]
    np.testing.assert_allclose(values[:, forces].sum(axis=1), values[:, pressed].sum(axis=1), atol=0.02)
    assert values[:, pressed].max() > 0.5
    output = capsys.readouterr().out
    assert "times real time" in output
    share = float(re.search(r"(\d+) taxel updates, ([0-9.]+) of all", output)[2])
    assert 0 < share < 1


@pytest.mark.parametrize("suffix", [".csv", ".mcap"])
def test_output_is_reproducible_by_seed(tmp_path: Path, suffix: str) -> None:
    if suffix == ".mcap":
        pytest.importorskip("mcap")
    contents = []
    for name, seed in (("a", "1"), ("b", "1"), ("c", "2")):
        path = tmp_path / (name + suffix)
        assert main([SCENE, "--out", str(path), "--for", "0.3", "--seed", seed, "--imperfections", "default"]) == 0
        contents.append(path.read_bytes())
    assert contents[0] == contents[1] != contents[2]


def test_an_mcap_file_describes_its_contents(tmp_path: Path) -> None:
    reader = pytest.importorskip("mcap.reader")
    path = tmp_path / "run.mcap"
    assert main([SCENE, "--out", str(path), "--for", "0.5", "--namespace", "thumb", "--imperfections", "none"]) == 0
    with path.open("rb") as stream:
        file = reader.make_reader(stream, validate_crcs=True)
        assert file.get_header().profile == "ros2"
        summary = file.get_summary()
        assert summary.statistics.message_count == 1000
        schemas = {schema.name: schema for schema in summary.schemas.values()}
        assert set(schemas) == {"posfet_msgs/msg/TactileRaw", "posfet_msgs/msg/TactileTruth"}
        assert {schema.encoding for schema in schemas.values()} == {"ros2msg"}
        assert {channel.topic for channel in summary.channels.values()} == {"/thumb/raw", "/thumb/truth"}
        times = [message.log_time for _, _, message in file.iter_messages(topics=["/thumb/raw"])]
    assert times == [index * 1_000_000 for index in range(500)]


def by_mcap_ros2(path: Path) -> list[tuple[str, int, Any]]:
    """Topic, time [ns] and message of each record, decoded by the ROS 2 reader of the MCAP project with the schemas."""
    decoder = pytest.importorskip("mcap_ros2.decoder")
    reader = pytest.importorskip("mcap.reader")
    with path.open("rb") as file:
        decoded = reader.make_reader(file, decoder_factories=[decoder.DecoderFactory()]).iter_decoded_messages()
        return [(channel.topic, record.log_time, message) for _, channel, record, message in decoded]


def by_rosbags(path: Path) -> list[tuple[str, int, Any]]:
    """The same by rosbags, an independent implementation of MCAP, message definitions and CDR."""
    highlevel = pytest.importorskip("rosbags.highlevel")
    with highlevel.AnyReader([path]) as reader:
        return [(at.topic, time, reader.deserialize(raw, at.msgtype)) for at, time, raw in reader.messages()]


@pytest.mark.parametrize("read", [by_mcap_ros2, by_rosbags])
def test_independent_readers_decode_an_mcap_file_by_its_embedded_schemas(
    tmp_path: Path, read: Callable[[Path], list[tuple[str, int, Any]]]
) -> None:
    pytest.importorskip("mcap")
    path, csv_path = tmp_path / "run.mcap", tmp_path / "run.csv"
    for each in (path, csv_path):
        assert main([SCENE, "--out", str(each), "--for", "1.6", "--imperfections", "default", "--seed", "5"]) == 0
    messages = read(path)
    names, *rows = [line.split(",") for line in csv_path.read_text(encoding="ascii").splitlines()]
    raw, truth = ([each for each in messages if each[0] == topic] for topic in ("/tactile/raw", "/tactile/truth"))
    assert len(raw) == len(truth) == len(rows) > 1500
    for (_, time, scan), (_, _, true), row in zip(raw, truth, rows, strict=True):
        written = dict(zip(names, row, strict=True))
        stamp = scan.header.stamp.sec * 1_000_000_000 + scan.header.stamp.nanosec
        assert time == stamp == round(float(written["stamp_s"]) * 1e9)
        assert list(scan.counts) == [int(written[f"count_r{r}_c{c}"]) for r in range(5) for c in range(5)]
        forces = [float(written[f"force_{r}_{c}_N"]) for r in range(5) for c in range(5)]
        np.testing.assert_allclose(true.force, forces, rtol=1e-6, atol=1e-9)
        assert list(true.objects) == ["lower", "upper"]
        assert true.poses[1].position.z == float(written["upper.z_m"])
        assert all(normal.z == 1.0 for normal in true.contact_normals)


@pytest.mark.ros
def test_ros_deserializes_the_messages_of_an_mcap_file(tmp_path: Path) -> None:
    reader = pytest.importorskip("mcap.reader")
    serialization = pytest.importorskip("rclpy.serialization")
    messages = pytest.importorskip("posfet_msgs.msg")
    path = tmp_path / "run.mcap"
    assert main([SCENE, "--out", str(path), "--for", "0.7", "--seed", "5", "--imperfections", "none"]) == 0
    read: dict[str, list] = {"/tactile/raw": [], "/tactile/truth": []}
    with path.open("rb") as stream:
        for schema, channel, message in reader.make_reader(stream).iter_messages():
            kind = getattr(messages, schema.name.rpartition("/")[2])
            read[channel.topic].append(serialization.deserialize_message(message.data, kind))
            again = serialization.serialize_message(read[channel.topic][-1])
            assert len(again) == len(message.data)  # padding bytes differ: ROS leaves them uninitialised
    counts = np.array([message.counts for message in read["/tactile/raw"]])
    np.testing.assert_array_equal(counts, board_counts(700, 5, ErrorModel.none()))
    last = read["/tactile/truth"][-1]
    assert last.objects == ["lower", "upper"]
    assert [list(last.contact_objects), list(last.contact_forces)] == [[0], [np.float32(0.8)]]
    assert (last.header.stamp.sec, last.header.stamp.nanosec) == (0, 699_000_000)


@pytest.mark.ros
@pytest.mark.parametrize("name", ["TactileRaw", "TactileTruth"])
def test_embedded_definitions_equal_those_of_the_ros_installation(name: str) -> None:
    messages = pytest.importorskip("posfet_msgs.msg")
    fields = getattr(messages, name).get_fields_and_field_types()
    assert [field.name for field in message_fields(f"posfet_msgs/{name}")] == list(fields)
    for field in message_fields(f"posfet_msgs/{name}"):
        kind = {"float32": "float", "float64": "double"}.get(field.type, field.type)
        assert fields[field.name] == (f"sequence<{kind}>" if field.many else kind)


def test_a_schema_includes_all_nested_message_types() -> None:
    parts = schema_text("posfet_msgs/TactileTruth").split(f"\n{'=' * 80}\n")
    assert "float32[] force" in parts[0]
    named = {part.splitlines()[0] for part in parts[1:]}
    assert {"MSG: std_msgs/Header", "MSG: builtin_interfaces/Time", "MSG: geometry_msgs/Quaternion"} <= named
    assert len(named) == len(parts) - 1


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["--out", "x.bag"], "x.bag: must end in .mcap or .csv"),
        (["nothing", "--out", "x.csv"], "nothing: no such scene"),
        (["--out", "x.csv", "--imperfections", "some.yaml"], "some.yaml: cannot be read"),
        (["--out", "x.mcap", "--namespace", ""], "namespace: must be names"),
        (["--out", "x.csv", "--namespace", "a b"], "namespace: must be names"),
        (["--out", "no/such/x.csv"], "no/such/x.csv: cannot be written: no/such is not a folder"),
        (["--out", "no/such/x.mcap"], "no/such/x.mcap: cannot be written: no/such is not a folder"),
    ],
)
def test_invalid_input_gives_a_one_line_error(
    tmp_path: Path, words: list[str], reason: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(words) == BAD_INPUT
    output = capsys.readouterr().err
    assert output.count("\n") == 1
    assert reason in output
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["--for", "-1"], "--for: must be a number in (0, 1e+06], got '-1'"),
        (["--for", "nan"], "--for: must be a number in (0, 1e+06], got 'nan'"),
        (["--seed", "-3"], "--seed: must be a whole number in [0, 1000000000], got '-3'"),
        (["--seed", "1.5"], "--seed: must be a whole number in [0, 1000000000], got '1.5'"),
    ],
)
def test_invalid_option_values_are_usage_errors(
    tmp_path: Path, words: list[str], reason: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as ended:
        main(["--out", "x.csv", *words])
    assert ended.value.code == 2
    assert reason in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_missing_mcap_package_gives_a_one_line_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "mcap.writer", None)
    path = tmp_path / "x.mcap"
    assert main([SCENE, "--out", str(path)]) == BAD_INPUT
    assert capsys.readouterr().err == f"{path}: needs the package mcap: pip install mcap\n"
    assert not path.exists()


def test_an_interrupted_run_leaves_a_complete_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    reader = pytest.importorskip("mcap.reader")
    scan_of = FaultyScans.scan

    def interrupted(self: FaultyScans, index: int, out: Scan) -> int:
        if index == 300:
            raise KeyboardInterrupt
        return scan_of(self, index, out)

    monkeypatch.setattr(FaultyScans, "scan", interrupted)
    path = tmp_path / "run.mcap"
    assert main([SCENE, "--out", str(path), "--for", "1"]) == INTERRUPTED
    with path.open("rb") as stream:
        assert reader.make_reader(stream, validate_crcs=True).get_summary().statistics.message_count == 600


@pytest.mark.skipif(not Path("/dev/full").is_char_device(), reason="needs /dev/full")
@pytest.mark.parametrize("suffix", [".csv", ".mcap"])
def test_a_full_disk_error_names_the_file(tmp_path: Path, suffix: str, capsys: pytest.CaptureFixture[str]) -> None:
    if suffix == ".mcap":
        pytest.importorskip("mcap")
    path = tmp_path / f"run{suffix}"
    path.symlink_to("/dev/full")
    assert main([SCENE, "--out", str(path), "--for", "0.5"]) == BAD_INPUT
    error = capsys.readouterr().err
    assert error.startswith(f"{path}: cannot be written: No space left on device")
    assert error.count("\n") == 1


def test_names_with_non_ascii_characters_are_written(tmp_path: Path) -> None:
    scene = tmp_path / "scene.yaml"
    shipped = (SCENE_FOLDER / f"{SCENE}.yaml").read_text(encoding="utf-8")
    scene.write_text(shipped.replace("name: lower", "name: Fu\u00df"), encoding="utf-8")
    path = tmp_path / "run.csv"
    assert main([str(scene), "--out", str(path), "--for", "0.01"]) == 0
    assert "Fu\u00df".encode() in path.read_bytes()


def test_a_terminal_shows_a_progress_bar(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = tmp_path / "scene.yaml"
    shipped = (SCENE_FOLDER / f"{SCENE}.yaml").read_text(encoding="utf-8")
    scene.write_text(shipped.replace(f"name: {SCENE}\n", 'name: "[/red]"\n'), encoding="utf-8")
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    assert main([str(scene), "--out", str(tmp_path / "run.csv"), "--for", "0.5"]) == 0
    output = capsys.readouterr()
    assert "[/red]" in output.err
    assert "500 scans" in output.out


@pytest.mark.parametrize("suffix", [".csv", ".mcap"])
def test_a_file_is_never_overwritten(tmp_path: Path, suffix: str, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / f"run{suffix}"
    path.write_text("a recording", encoding="utf-8")
    assert main([SCENE, "--out", str(path), "--for", "0.5"]) == BAD_INPUT
    expected = f"{path}: cannot be written: File exists; choose another name, or remove it\n"
    assert capsys.readouterr().err == expected
    assert path.read_text(encoding="utf-8") == "a recording"
