# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Options of the reference firmware's process, and the signals that it samples."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from posfet_driver.bus.frame import CLASSIC
from support.reference_board import virtual_board

START = 0x100, CLASSIC, bytes([1, 0, 0, 0, 0, 0, 0, 0])
REFUSED = {
    "layout": (["--layout", "0x5"], "--layout must be ROWSxCOLS with 1 to 1024 taxels, got '0x5'"),
    "number": (["--boot", "16"], "--boot must be in [0, 15], got '16'"),
    "format": (["--format", "CAN"], "--format must be fd or classic, got 'CAN'"),
    "argument": (["board"], "there is no such argument, got 'board'"),
    "combination": (["--format", "classic", "--base-id", "0x7F4"], "no board has this combination"),
    "no interface": (["--can", "can_nowhere"], "can_nowhere: "),
    "no table": (["--table", "nowhere"], "nowhere: No such file"),
}


@pytest.mark.parametrize("options, message", REFUSED.values(), ids=REFUSED)
def test_what_cannot_be_is_refused_in_one_line(program: Path, options: list[str], message: str) -> None:
    done = subprocess.run([program, *options], capture_output=True, text=True, check=False)
    assert done.returncode in (1, 2)
    assert message in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize(
    "text", ["0 1 2\n", "1 1 2\n2 1 2\n", "0 1 2\n0 1 2\n", "0 1\n5 1\n", "0 1 70000\n", "0 1 2 3\n"]
)
def test_a_malformed_table_is_refused_in_one_line(program: Path, tmp_path: Path, text: str) -> None:
    table = tmp_path / "table.txt"
    table.write_text(text)
    command = [program, "--virtual", "--layout", "1x2", "--table", table]
    done = subprocess.run(command, capture_output=True, text=True, check=False, input="")
    assert done.returncode == 1
    assert str(table) in done.stderr
    assert done.stderr.count("\n") == 1


def test_counts_of_a_table_are_interpolated_and_repeated(program: Path, tmp_path: Path) -> None:
    table, log = tmp_path / "table.txt", tmp_path / "log.txt"
    table.write_text("# us, two taxels\n0 100 60000\n4000 500, 20000\n5000 100 60000\n")
    with virtual_board(program, "--layout", "1x2", "--table", str(table), "--log", str(log)) as board:
        board.send(START)
        board.run_until(6000)
    rows = [[int(word) for word in line.split()] for line in log.read_text().splitlines()]
    assert rows == [
        [0, 1, 1000, 200, 50000],
        [0, 2, 2000, 300, 40000],
        [0, 3, 3000, 400, 30000],
        [0, 4, 4000, 500, 20000],
        [0, 5, 5000, 100, 60000],
        [0, 6, 6000, 200, 50000],
    ]


def test_a_press_is_largest_in_the_middle_and_leaks(program: Path, tmp_path: Path) -> None:
    log = tmp_path / "log.txt"
    with virtual_board(program, "--period", "10000", "--noise", "0", "--log", str(log)) as board:
        board.send(START)
        board.run_until(2_560_000)
    rows = [[int(word) for word in line.split()] for line in log.read_text().splitlines()]
    change = {row[2]: [count - rest for count, rest in zip(row[3:], rows[89][3:], strict=True)] for row in rows}
    risen, held, released = change[1_100_000], change[1_600_000], change[1_700_000]
    assert max(risen) == risen[12] > 1.3 * risen[7] > 1.3 * risen[6] > 0 == risen[0]
    assert 0.1 < held[12] / risen[12] < 0.2  # exp(-0.5 s/0.27 s) = 0.157
    assert released[12] < -0.6 * risen[12]
