# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Tables of many runs: the same in one process, in several and on a dask cluster; a missing package is one line."""

from __future__ import annotations

import csv
import json
import sys
from pathlib import Path

import pytest

from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.config import ConfigError
from posfet_model.sensor.description import Sensor
from posfet_sim.commands import score
from posfet_sim.commands.batch import LOCAL, flat, results
from posfet_sim.commands.score import main
from posfet_sim.device.error_model import ErrorModel

QUICK = ["--for", "0.8", "--calibration", "none"]
TIMED = "us_per_scan"


def rows(text: str) -> list[dict[str, str]]:
    """Return the rows of a table without what depends on the machine."""
    found = [dict(row) for row in csv.DictReader(text.splitlines())]
    for row in found:
        assert float(row.pop(TIMED)) > 0
    return found


def double(number: int) -> int:
    return 2 * number


def test_scenes_boards_and_sensors_are_the_rows_of_a_table(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["press", "tap", "--seeds", "1,4-5", "--sensor", "posfet_5x5", "--sensor", "posfet_16x16"]
    assert main([*words, "--for", "0.02", "--calibration", "none"]) == 0
    found = [(row["sensor"], row["seed"], row["scene"]) for row in rows(capsys.readouterr().out)]
    expected = [(s, b, c) for s in ("posfet_5x5", "posfet_16x16") for b in "145" for c in ("press", "tap")]
    assert found == expected


def test_several_processes_give_the_table_of_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("joblib")
    words = ["press", "tap", "--seeds", "1-2", *QUICK]
    assert main(words) == 0
    alone = rows(capsys.readouterr().out)
    assert main([*words, "--jobs", "2", "--out", str(tmp_path / "a.csv")]) == 0
    assert capsys.readouterr().out.startswith(f"{tmp_path / 'a.csv'}: 4 runs in ")
    assert rows((tmp_path / "a.csv").read_text(encoding="utf-8")) == alone
    assert len({row["force_rmse_pct"] for row in alone}) == 4, "boards and scenes differ"


def test_a_row_is_the_score_of_its_single_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["press", "--seed", "3", *QUICK]) == 0
    single = json.loads(capsys.readouterr().out)
    assert main(["press", "--seeds", "3", *QUICK, "--out", str(tmp_path / "a.json")]) == 0
    [row] = json.loads((tmp_path / "a.json").read_text(encoding="utf-8"))
    assert [row.pop(name) for name in ("scene", "sensor", "seed", "problem")] == ["press", "posfet_5x5", 3, ""]
    single.pop(TIMED), row.pop(TIMED)
    assert row == single


def test_a_board_is_calibrated_once_for_all_its_scenes(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    calibrated: list[int] = []

    def nominal(sensor: Sensor, seed: int, model: ErrorModel) -> Calibration:
        calibrated.append(seed)
        return Calibration.nominal(sensor)

    monkeypatch.setattr(score, "calibrate", nominal)
    score._calibration.cache_clear()
    assert main(["press", "tap", "slide", "--seeds", "1-2", "--for", "0.05"]) == 0
    score._calibration.cache_clear()
    assert calibrated == [1, 2]
    assert len(rows(capsys.readouterr().out)) == 6


def test_a_board_that_cannot_be_calibrated_is_a_row_that_says_so(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def bad(sensor: Sensor, seed: int, model: ErrorModel) -> Calibration:
        if seed != 1:
            raise ValueError(f"board {seed} is noisy")
        return Calibration.nominal(sensor)

    monkeypatch.setattr(score, "calibrate", bad)
    score._calibration.cache_clear()
    assert main(["press", "--seeds", "1-2", "--for", "0.05"]) == 1
    captured = capsys.readouterr()
    first, second = csv.DictReader(captured.out.splitlines())
    assert (first["problem"], second["problem"]) == ("", "calibration of the simulated board: board 2 is noisy")
    assert first[TIMED] != second[TIMED] == ""
    assert captured.err.splitlines() == ["1 of 2 runs have no score, see column problem"]
    assert main(["press", "--seeds", "2-3", "--for", "0.05"]) == 1
    assert capsys.readouterr().err.splitlines() == ["calibration of the simulated board: board 2 is noisy"]
    score._calibration.cache_clear()


def test_results_keep_the_order_of_the_items_and_report_progress() -> None:
    pytest.importorskip("joblib")
    seen: list[int] = []
    assert results(double, range(20), jobs=2, done=seen.append) == [2 * number for number in range(20)]
    assert seen == list(range(1, 21))


def test_a_dask_cluster_gives_the_same_results() -> None:
    pytest.importorskip("distributed")
    assert results(double, range(5), jobs=2, dask=LOCAL) == [0, 2, 4, 6, 8]
    with pytest.raises(ConfigError, match="no dask scheduler at tcp"):
        results(double, range(2), dask="tcp://127.0.0.1:9")


@pytest.mark.parametrize(
    ("module", "option", "remedy"),
    [("joblib", ["--jobs", "2"], "pip install joblib"), ("distributed", ["--dask", LOCAL], "pip install distributed")],
)
def test_a_missing_package_is_one_line(
    module: str, option: list[str], remedy: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    assert main(["press", "tap", *QUICK, *option]) == 1
    assert [remedy in line for line in capsys.readouterr().err.splitlines()] == [True]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["press", "nowhere"], "nowhere"),
        (["press", "tap", "--out", "a.txt"], "a.txt: must end in .csv, .json"),
        (["press", "tap", "--sensor", "nowhere"], "nowhere"),
        (["press", "tap", "--out", "nowhere/a.csv"], "nowhere/a.csv: cannot be written: nowhere is not a folder"),
        (["press", "tap", "--calibration", "nowhere.yaml"], "nowhere.yaml: cannot be read"),
    ],
)
def test_bad_input_is_one_line_before_any_run(
    words: list[str], said: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(score, "attempt", lambda case: pytest.fail("ran"))
    assert main(words) == 1
    [line] = capsys.readouterr().err.splitlines()
    assert said in line


@pytest.mark.parametrize("option", [["--seeds", "5-1"], ["--seeds", "a"], ["--seeds", ""], ["--jobs", "-1"]])
def test_arguments_out_of_range_are_refused(option: list[str]) -> None:
    with pytest.raises(SystemExit):
        main(["press", *option])


def test_values_with_parts_are_columns_of_their_own() -> None:
    assert flat({"a": 1, "b": {"mean": 2.0, "max": None}}) == {"a": 1, "b_mean": 2.0, "b_max": None}
