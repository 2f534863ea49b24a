# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""docs/protocol.md and the golden frames are what the DBC and posfet.yaml say, by cantools and by formulas."""

from __future__ import annotations

import importlib.resources
import json
import re
from pathlib import Path
from typing import Any

import cantools
import pytest

from posfet.protocol_document import SECTIONS, document, main
from posfet.protocol_vectors import as_json, golden_frames
from posfet_driver.bus.frame_timing import classic_time, fd_time
from posfet_driver.conformance.description import BASE, checksum, load_description
from support.paths import DATA, DOCS

TEXT = (DOCS / "protocol.md").read_text(encoding="utf-8")
VECTORS = DATA / "protocol" / "golden_frames.json"
FRAMES: list[dict[str, Any]] = json.loads(VECTORS.read_text(encoding="ascii"))["frames"]
DATABASE = cantools.database.load_string(
    (importlib.resources.files("posfet_driver") / "protocol" / "posfet.dbc").read_text(encoding="ascii"), "dbc"
)
DESCRIPTION = load_description()


def test_document_and_golden_frames_are_up_to_date() -> None:
    assert document(TEXT) == TEXT, "run: make protocol"
    assert VECTORS.read_text(encoding="ascii") == as_json(), "run: make protocol"


def test_the_command_writes_document_and_golden_frames(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, vectors = tmp_path / "protocol.md", tmp_path / "frames.json"
    file.write_text(re.sub(r"\n\|.*", "", TEXT), encoding="utf-8")
    assert main(["--document", str(file), "--vectors", str(vectors)]) == 0
    assert vectors.read_text(encoding="ascii") == as_json()
    assert file.read_text(encoding="utf-8").count("\n|") > 100
    assert capsys.readouterr().out == f"{file}, {vectors}: written\n"


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("<!-- begin rules -->", "<!-- begin tools -->"),
        ("<!-- end rules -->", ""),
        ("<!-- begin rules -->", "<!-- begin rules -->\n<!-- end rules -->\n<!-- begin rules -->"),
    ],
)
def test_markers_that_do_not_match_are_refused(old: str, new: str) -> None:
    with pytest.raises(ValueError, match="markers do not match"):
        document(TEXT.replace(old, new))


def section(name: str) -> str:
    return TEXT.split(f"<!-- begin {name} -->\n")[1].split("<!-- end ")[0]


@pytest.mark.parametrize("message", [message for message in DATABASE.messages if message.name in SECTIONS], ids=str)
def test_every_signal_is_documented_with_its_bits(message: Any) -> None:
    for signal in message.signals:
        if re.fullmatch(r"(Count|Code)\d+", signal.name):
            continue
        last = signal.start + signal.length - 1
        bits = f"{signal.start}-{last}" if signal.length > 1 else f"{signal.start}"
        name = signal.name.replace("ScanCounter0", "ScanCounter k")
        assert f"| {bits} | {name} |" in section(message.name), signal.name


def test_every_bit_of_a_frame_is_documented_once() -> None:
    for name in ("ScanHeader", "Status", "Identity", "Command", "Response"):
        spans = [[int(bit) for bit in bits.split("-")] for bits in re.findall(r"^\| ([\d-]+) \|", section(name), re.M)]
        covered = [bit for span in spans for bit in range(span[0], span[-1] + 1)]
        assert covered == list(range(64)), name


def test_taxel_positions_in_frames_follow_the_formulas() -> None:
    assert "| from 96 + 16 i | Count i |" in section("ScanBlockFd")
    assert "| from 4 + 12 i | Code 5 k + i |" in section("ScanBlock0")
    counts = [signal for signal in DATABASE.get_message_by_name("ScanBlockFd").signals if "Count" in signal.name]
    assert [(signal.name, signal.start) for signal in counts] == [(f"Count{i}", 96 + 16 * i) for i in range(26)]
    for k in range(5):
        block = DATABASE.get_message_by_name(f"ScanBlock{k}")
        assert [(s.name, s.start) for s in block.signals[1:]] == [(f"Code{5 * k + i}", 4 + 12 * i) for i in range(5)]


def test_identifiers_of_dbc_yaml_and_document_agree() -> None:
    offsets = DESCRIPTION.states["offsets"]
    for message in DATABASE.messages:
        k = int(message.name[-1]) if message.name[:-1] == "ScanBlock" else 0
        assert message.frame_id == BASE + offsets[message.name.rstrip("01234")] + k
        if not k:
            pattern = rf"\| 0x{message.frame_id:X}[^|]*\| {message.name.rstrip('0')}"
            kind = "FD" if message.is_fd else "classic"
            assert re.search(rf"{pattern}[^|]*\| {kind} \| {message.length} \|", section("identifiers")), message.name


def test_the_description_reads_the_dbc_as_cantools_does() -> None:
    assert list(DESCRIPTION.messages) == [message.name for message in DATABASE.messages]
    for message in DATABASE.messages:
        described = DESCRIPTION.messages[message.name]
        assert (described.length, described.fd, described.when) == (
            message.length,
            message.is_fd,
            message.comment or "",
        )
        assert [
            (s.name, s.start, s.length, s.signed, s.scale, s.unit, s.meaning, dict(s.choices))
            for s in described.signals
        ] == [
            (s.name, s.start, s.length, s.is_signed, s.scale, s.unit or "", s.comment or "", dict(s.choices or {}))
            for s in sorted(message.signals, key=lambda signal: signal.start)
        ]


def test_names_of_values_in_the_dbc_are_those_of_the_yaml() -> None:
    for message, signal, named in (
        ("Command", "CommandCode", DESCRIPTION.codes),
        ("Response", "ResponseCommand", DESCRIPTION.codes),
        ("Response", "ResponseResult", DESCRIPTION.results),
    ):
        choices = DATABASE.get_message_by_name(message).get_signal_by_name(signal).choices
        assert {str(name): value for value, name in choices.items()} == named


def test_the_state_machine_is_complete() -> None:
    states = DESCRIPTION.states
    assert states["initial"] in states["states"]
    for command in states["commands"].values():
        assert set(command["next"]) == set(states["states"])
        assert set(command["next"].values()) <= set(states["states"])
        assert set(command["results"]) <= set(states["results"])
        assert {"OK", "BAD_ARGUMENT"} <= set(command["results"])


def test_every_rule_and_command_is_in_the_document() -> None:
    ids = re.findall(r'^\| <a id="(\w+)"></a>(\w+) \| (.*) \|$', section("rules"), re.M)
    assert [(anchor, text) for anchor, _, text in ids] == [(id.lower(), t) for id, t in DESCRIPTION.rules.items()]
    for name, code in DESCRIPTION.codes.items():
        assert f"\n| {code} | {name} |" in section("commands")


def test_cycle_times_of_dbc_and_yaml_agree() -> None:
    timing = DESCRIPTION.states["timing"]
    assert DATABASE.get_message_by_name("Status").cycle_time == timing["status_period_ms"]
    assert DATABASE.get_message_by_name("Identity").cycle_time == timing["identity_period_ms"]


def bitwise_crc(data: bytes) -> int:
    """CRC from the parameters in posfet.yaml, one bit at a time."""
    crc = DESCRIPTION.states["checksum"]
    register = crc["initial"]
    for byte in data:
        register ^= byte << 8
        for _ in range(8):
            register = (register << 1) ^ (crc["polynomial"] * (register >> 15))
            register &= 0xFFFF
    return register ^ crc["final_xor"]


def test_checksum_parameters_give_the_stated_check_value() -> None:
    assert bitwise_crc(b"123456789") == DESCRIPTION.states["checksum"]["check"]


def test_golden_frames_cover_every_message() -> None:
    assert len(FRAMES) >= 40
    assert {frame["message"] for frame in FRAMES} == {message.name for message in DATABASE.messages}
    assert len({frame["name"] for frame in FRAMES}) == len(FRAMES)


@pytest.mark.parametrize("frame", FRAMES, ids=[frame["name"] for frame in FRAMES])
def test_golden_frames_agree_with_cantools_in_both_directions(frame: dict[str, Any]) -> None:
    message = DATABASE.get_message_by_name(frame["message"])
    data = bytes.fromhex(frame["data"])
    assert (message.frame_id, message.is_fd) == (frame["identifier"], frame["fd"])
    assert message.decode(data, decode_choices=False, scaling=False) == frame["signals"]
    assert message.encode(frame["signals"], scaling=False, strict=False) == data
    if frame["message"] == "ScanBlockFd":
        assert bitwise_crc(data[:10] + data[12:]) == frame["signals"]["Checksum"] == checksum(data)


def test_examples_of_the_document_agree_with_cantools() -> None:
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in section("examples").splitlines()[2:]]
    assert len(rows) >= 10
    for _, name, identifier, data, signals in rows:
        message = DATABASE.get_message_by_name(name)
        assert message.frame_id == int(identifier, 16)
        decoded = message.decode(bytes.fromhex(data.strip("`")).ljust(message.length, b"\0"), decode_choices=False)
        assert {key: value for key, value in decoded.items() if value} == {
            key: pytest.approx(float(value), abs=1e-6) for key, value in (pair.split() for pair in signals.split(", "))
        }


def test_messages_refuse_values_that_do_not_fit() -> None:
    status = DESCRIPTION.messages["Status"]
    with pytest.raises(ValueError, match=r"Heartbeat must be in \[0, 15\], got 16"):
        status.encode(Heartbeat=16)
    with pytest.raises(ValueError, match=r"Temperature1 must be in \[-32768, 32767\]"):
        status.encode(Temperature1=32768)
    with pytest.raises(ValueError, match="Status has no signal Humidity"):
        status.encode(Humidity=1)


def test_bus_load_is_that_of_the_frames_of_one_second() -> None:
    """Each row again, as the sum of all frames that a board sends in one second."""
    short, long = classic_time(8, 1e6), fd_time(64, 1e6, 5e6)
    others = 10 + 1  # status and identity
    for row, blocks, headers, frame in (("5 x 5, FD", 1, 0, long), ("5 x 5, classic", 5, 62.5, short)):
        cells = [cell.strip() for cell in section("bus load").split(f"| {row} |")[1].split("|")]
        low, high = (
            100 * (1000 * blocks * b + (headers + others) * s)
            for b, s in ((frame.least, short.least), (frame.most, short.most))
        )
        assert cells[0] == str(blocks)
        assert cells[2] == f"{low:.1f}-{high:.1f} %"
        rate = int(cells[3])
        seconds = [
            r * (blocks * frame.most + headers / 1000 * short.most) + others * short.most for r in (rate, rate + 1)
        ]
        assert seconds[0] <= 1 < seconds[1]
    assert "| classic, 8 bytes | 111.0 | 135.0 |" in section("frame times")
    assert "| FD, 64 bytes | 139.8 | 169.6 |" in section("frame times")


def test_frame_times_agree_with_the_published_formula() -> None:
    """Davis et al., Real-Time Systems 35 (2007): at most 55 + 10 s bits for s bytes, including intermission."""
    for length in range(9):
        assert classic_time(length, 1.0).most == 55 + 10 * length


@pytest.mark.parametrize("arguments", [(9, 1e6), (-1, 1e6), (8, 0.0), (8, float("nan"))])
def test_frame_times_of_invalid_frames_are_rejected(arguments: tuple[int, float]) -> None:
    with pytest.raises(ValueError, match=r"must be in|must be a whole"):
        classic_time(*arguments)


def test_physical_values_of_examples_have_their_scale() -> None:
    typical = next(frame for frame in golden_frames() if frame.name == "scanning")
    assert typical.physical["Temperature1"] == 25.5
    assert typical.physical["Supply"] == 5.0
