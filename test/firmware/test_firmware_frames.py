# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""What the reference firmware sends and does, against posfet.dbc and posfet.yaml."""

from __future__ import annotations

import json
import random
import subprocess
from collections.abc import Iterator
from importlib import resources
from pathlib import Path
from typing import Any

import pytest
import yaml

from posfet_driver.bus.frame import CLASSIC, EXTENDED, FD, RATE_SWITCH, REMOTE, Frame
from support.paths import DATA
from support.reference_board import VirtualBoard, make, virtual_board

cantools = pytest.importorskip("cantools")

PROTOCOL = resources.files("posfet_driver.protocol")
DATABASE = cantools.database.load_string((PROTOCOL / "posfet.dbc").read_text(), "dbc")
RULES = yaml.safe_load((PROTOCOL / "posfet.yaml").read_text())
COMMANDS = RULES["commands"]
GOLDEN = DATA / "protocol" / "golden_frames.json"
BASE = 0x100
FORMATS = ["fd", "classic"]
SECOND = 1_000_000


def command(name: str, argument: int = 0, tag: int = 7) -> Frame:
    """Return the frame of a command, as the DBC describes it."""
    signals = {"CommandCode": COMMANDS[name]["code"], "CommandTag": tag, "CommandArgument": argument}
    return BASE, CLASSIC, DATABASE.encode_message("Command", signals)


def decoded(frames: list[Frame], message: str) -> list[dict[str, Any]]:
    """Return the signals of all frames of a message."""
    description = DATABASE.get_message_by_name(message)
    return [
        description.decode(data, decode_choices=False)
        for identifier, _, data in frames
        if identifier == description.frame_id
    ]


def responses(frames: list[Frame]) -> list[tuple[str, int]]:
    """Return result and value of all responses."""
    names = {code: name for name, code in RULES["results"].items()}
    return [(names[each["ResponseResult"]], each["ResponseValue"]) for each in decoded(frames, "Response")]


def checksum(data: bytes) -> int:
    """Return the checksum of posfet.yaml, bit by bit."""
    settings = RULES["checksum"]
    crc = settings["initial"]
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ (settings["polynomial"] if crc & 0x8000 else 0)) & 0xFFFF
    return crc ^ settings["final_xor"]


@pytest.fixture(params=FORMATS)
def board(request: pytest.FixtureRequest, program: Path) -> Iterator[VirtualBoard]:
    with virtual_board(program, "--format", request.param, "--boot", "11") as board:
        yield board


def test_every_frame_is_in_the_dbc_with_its_format_and_length(board: VirtualBoard) -> None:
    frames = board.run_until(0) + board.send(command("START")) + board.send(command("IDENTIFY"))
    frames += board.send(command("SET_RATE", 2000)) + board.run_until(2 * SECOND)
    messages = set()
    for identifier, kind, data in frames:
        message = DATABASE.get_message_by_frame_id(identifier)
        messages.add(message.name)
        assert message.senders == ["Board"]
        assert kind == (FD | RATE_SWITCH if message.is_fd else CLASSIC)
        assert len(data) == message.length
        signals = message.decode(data, decode_choices=False)
        assert message.encode(signals) == data, "a reserved bit is set"
        assert signals.get("Boot", signals.get("BlockBoot", 11)) == 11
    assert {"Response", "Status", "Identity"} < messages


def test_fd_blocks_carry_their_scan_and_its_checksum(program: Path, tmp_path: Path) -> None:
    log = tmp_path / "scans.txt"
    with virtual_board(program, "--boot", "9", "--log", str(log)) as board:
        frames = board.send(command("START")) + board.run_until(50_000)
    sent = [data for identifier, _, data in frames if identifier == BASE + RULES["offsets"]["ScanBlockFd"]]
    blocks = decoded(frames, "ScanBlockFd")
    sampled = [[int(word) for word in line.split()] for line in log.read_text().splitlines()]
    assert len(sent) == len(sampled) == 50
    for data, block, (boot, sequence, time, *counts) in zip(sent, blocks, sampled, strict=True):
        assert (block["BlockBoot"], block["Sequence"], block["DeviceTime"]) == (boot, sequence, time)
        assert [block[f"Count{i}"] for i in range(25)] == counts
        assert (block["BlockIndex"], block["BlockStatus"], block["Count25"]) == (0, 0, 0)
        assert block["Checksum"] == checksum(data[:10] + data[12:])


def test_classic_blocks_carry_their_scan(program: Path, tmp_path: Path) -> None:
    log = tmp_path / "scans.txt"
    with virtual_board(program, "--format", "classic", "--log", str(log)) as board:
        frames = board.send(command("START")) + board.run_until(40_000)
    sampled = [[int(word) for word in line.split()] for line in log.read_text().splitlines()]
    headers = [(header["HeaderSequence"], header["HeaderTime"]) for header in decoded(frames, "ScanHeader")]
    assert headers == [(1, 1000), (16, 16_000), (32, 32_000)]
    for k in range(5):
        blocks = decoded(frames, f"ScanBlock{k}")
        assert [block[f"ScanCounter{k}"] for block in blocks] == [scan[1] % 16 for scan in sampled]
        for i in range(5 * k, 5 * k + 5):
            assert [block[f"Code{i}"] for block in blocks] == [scan[3 + i] >> 4 for scan in sampled]


@pytest.mark.parametrize("rows, cols", [(1, 1), (1, 26), (3, 9), (16, 16), (32, 32)])
@pytest.mark.parametrize("form", FORMATS)
def test_any_layout_has_all_its_blocks(program: Path, rows: int, cols: int, form: str) -> None:
    with virtual_board(program, "--layout", f"{rows}x{cols}", "--format", form) as board:
        frames = board.send(command("START")) + board.run_until(3000)
    offsets = [identifier - BASE for identifier, _, _ in frames]
    per_block, first = (26, 3) if form == "fd" else (5, 8)
    blocks = -(-rows * cols // per_block)
    if form == "fd":
        indices = [data[8] for identifier, _, data in frames if identifier == BASE + first]
        assert indices == [*range(blocks)] * 3
    else:
        assert [offset for offset in offsets if offset >= first] == [*range(first, first + blocks)] * 3


def test_status_reports_what_the_hardware_measures(board: VirtualBoard) -> None:
    board.line("V 2750")
    board.line("K -640 22016")  # -2.5 and 86 degC
    first = decoded(board.run_until(0), "Status")[0]
    assert (first["Supply"], first["Temperature1"], first["Temperature2"]) == (2.75, -2.5, 86.0)
    assert (first["SupplyLow"], first["Overtemperature"], first["AdcFault"], first["Scanning"]) == (1, 1, 0, 0)
    board.line("V 65535")
    board.line("K -32768 -32768")
    board.send(command("START"))
    board.line("A 1")
    second = decoded(board.run_until(SECOND // 10), "Status")[0]
    assert (second["Temperature1"], second["Supply"]) == (-128.0, 65.535)
    assert (second["SupplyLow"], second["Overtemperature"], second["AdcFault"], second["Scanning"]) == (0, 0, 1, 1)
    assert (second["Heartbeat"], first["Heartbeat"]) == (1, 0)


@pytest.mark.parametrize("state", RULES["states"])
@pytest.mark.parametrize("name", COMMANDS)
def test_commands_lead_to_the_states_that_they_are_described_with(board: VirtualBoard, name: str, state: str) -> None:
    board.run_until(10_500)
    if state == "scanning":
        board.send(command("START"))
    argument = 4000 if name == "SET_RATE" else 0
    frames = board.send(command(name, argument))
    ((result, value),) = responses(frames)
    assert result in COMMANDS[name]["results"]
    assert decoded(frames, "Response")[0]["ResponseTag"] == 7
    if result == "OK":
        form = decoded(board.send(command("IDENTIFY")), "Identity")[0]["Format"]
        expected = {"START": 11, "STOP": 11, "SET_RATE": 4000, "IDENTIFY": 0x0102_0001 | form << 20, "SELF_TEST": 0}
        assert value == expected[name]
    after = decoded(board.run_until(SECOND // 10), "Status")[-1]
    assert after["Scanning"] == (COMMANDS[name]["next"][state] == "scanning")


def test_refusals_are_those_that_are_described(board: VirtualBoard) -> None:
    for name in COMMANDS:
        wrong = 1 if name != "SET_RATE" else RULES["timing"]["longest_period_us"] + 1
        assert responses(board.send(command(name, wrong))) == [("BAD_ARGUMENT", 0)]
    codes = {each["code"] for each in COMMANDS.values()}
    for code in set(range(256)) - codes:
        frame = BASE, CLASSIC, bytes([code, 1, 0, 0, 0, 0, 0, 0])
        assert responses(board.send(frame)) == [("UNKNOWN_COMMAND", 0)]
    for kind in (REMOTE, EXTENDED, FD, FD | RATE_SWITCH):
        assert responses(board.send((BASE, kind, bytes(8)))) == []


def test_reports_keep_the_periods_that_are_described(board: VirtualBoard) -> None:
    timing = RULES["timing"]
    frames = board.run_until(10 * SECOND - 1)
    assert len(decoded(frames, "Status")) == 10_000 // timing["status_period_ms"]
    assert len(decoded(frames, "Identity")) == 10_000 // timing["identity_period_ms"]
    beats = [status["Heartbeat"] for status in decoded(frames, "Status")]
    assert beats == [n % 16 for n in range(len(beats))]


def test_a_power_cycle_begins_again_with_another_boot(board: VirtualBoard) -> None:
    board.send(command("START"))
    board.run_until(5 * SECOND)
    frames = board.line("R 12") + board.run_until(5 * SECOND + 99_999)
    (status,) = decoded(frames, "Status")
    assert (status["Boot"], status["Heartbeat"], status["Scanning"]) == (12, 0, 0)
    assert responses(board.send(command("START"))) == [("OK", 100)]


def test_a_stalled_board_and_a_blocked_bus_miss_whole_scans(program: Path) -> None:
    with virtual_board(program) as board:
        board.send(command("START"))
        board.run_until(10_000)
        stalled = decoded(board.line("J 15500") + board.run_until(17_000), "ScanBlockFd")
        assert [(block["Sequence"], block["BlockStatus"]) for block in stalled] == [(15, 8), (16, 0), (17, 0)]
        board.line("B 1")
        assert board.run_until(SECOND) == []
        blocked = decoded(board.line("B 0") + board.run_until(SECOND + 5000), "ScanBlockFd")
    sequences = [block["Sequence"] for block in blocked]
    assert sequences == sorted(set(sequences))
    assert sequences[-6:] == [sequences[-6], *range(1001, 1006)] and sequences[-6] < 999
    assert [block["BlockStatus"] for block in blocked[-6:]] == [0, 8, 0, 0, 0, 0]


def test_a_classic_header_follows_missing_scans(program: Path) -> None:
    with virtual_board(program, "--format", "classic") as board:
        board.send(command("START"))
        board.run_until(10_000)
        stalled = decoded(board.line("J 20500") + board.run_until(31_500), "ScanHeader")
        assert [header["HeaderSequence"] for header in stalled] == [20]
        board.line("B 1")
        board.run_until(SECOND)
        board.line("B 0")
        released = decoded(board.run_until(SECOND + 5000), "ScanHeader")
    assert [header["HeaderSequence"] for header in released] == [1001]


def test_any_input_is_survived(program: Path) -> None:
    """Malformed lines are answered with a question mark; sanitizers watch."""
    generator = random.Random(3)
    with virtual_board(program) as board:
        assert board._process.stdin is not None
        assert board._process.stdout is not None
        for _ in range(300):
            text = "".join(generator.choices("TFJBVKARtdbr 0123456789-\t", k=generator.randrange(1, 40)))
            board._process.stdin.write(b"!" + text.encode() + b"\n" + text[:1].encode() + b"x\n")
        board._process.stdin.flush()
        assert {board._process.stdout.readline() for _ in range(600)} == {b"?\n"}
        assert responses(board.send(command("START"))) == [("OK", 1)]


@pytest.mark.skipif(not GOLDEN.exists(), reason="there are no golden frames")
def test_golden_frames_are_encoded_alike(built: Path) -> None:
    make(built, f"{built}/encode_lines")
    frames = [each for each in json.loads(GOLDEN.read_text())["frames"] if each["message"] != "Command"]
    lines = [" ".join([each["message"], *map(str, each["signals"].values())]) for each in frames]
    output = subprocess.run(
        [built / "encode_lines"], input="\n".join(lines) + "\n", capture_output=True, text=True, check=True
    ).stdout.splitlines()
    assert dict(zip(lines, output, strict=True)) == {
        line: each["data"] for line, each in zip(lines, frames, strict=True)
    }


@pytest.mark.skipif(not GOLDEN.exists(), reason="there are no golden frames")
def test_golden_commands_are_understood(board: VirtualBoard) -> None:
    for each in json.loads(GOLDEN.read_text())["frames"]:
        if each["message"] == "Command":
            (response,) = decoded(board.send((each["identifier"], CLASSIC, bytes.fromhex(each["data"]))), "Response")
            assert response["ResponseCommand"] == each["signals"]["CommandCode"]
            assert response["ResponseTag"] == each["signals"]["CommandTag"]
