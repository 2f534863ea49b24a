"""The benchmarks stay alive: what they hand back is kept, judged and written as it was."""

from __future__ import annotations

import math
import sys
from importlib import import_module
from pathlib import Path

import pytest

pytest.importorskip("rich", reason="the tables of the benchmarks need rich")
ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from benchmarks import inverse, report
from benchmarks.outcome import Chart, Outcome, Table
from benchmarks.targets import TARGETS, Target

NEED = {"latency": "rclpy", "ordinary": "rclpy", "sustained": "rclpy", "startup": "rclpy", "skipped": "posfet_msgs",
        "labelling": "scipy",
        "decode": "cantools"}  # fmt: skip


def test_an_outcome_is_read_as_it_was_written(tmp_path: Path) -> None:
    chart = Chart("front", "Front", "time", "error", {"way": [(1.0, 2.0, "a point")]})
    outcome = Outcome({"name_us": 1.25}, [Table("Title", ("a", "b"), [("x", 1)], "note")], [chart])
    outcome.write(tmp_path / "outcome.json")
    read = Outcome.read(tmp_path / "outcome.json")
    assert read.values == outcome.values
    assert report.results({}, {"one": read}, {}, False) == report.results({}, {"one": outcome}, {}, False)


def test_results_hold_every_target_and_every_failure() -> None:
    text = report.results({"commit": "abc"}, {"start": Outcome({"startup_s": 0.75})}, {"slcan": "too slow"}, False)
    for target in TARGETS:
        assert f"| {target.name} |" in text
    assert "| 0.75 | pass |" in text
    assert "Failed: too slow" in text


@pytest.mark.parametrize(
    ("value", "verdict"), [(90.0, "stretch"), (100.0, "stretch"), (101.0, "pass"), (251.0, "short")]
)
def test_verdicts(value: float, verdict: str) -> None:
    assert Target("name", "what", (250.0, 100.0)).verdict(value) == verdict
    assert Target("name", "what", (-250.0, -100.0), at_least=True).verdict(-value) == verdict


def test_every_subject_can_be_loaded() -> None:
    from benchmarks.__main__ import SUBJECTS  # noqa: PLC0415

    for name in SUBJECTS:
        if name in NEED:
            try:
                import_module(NEED[name])
            except ImportError:
                continue
        assert callable(import_module(f"benchmarks.{name}").measure), name


def test_one_of_them_runs() -> None:
    outcome = inverse.measure(False)
    assert all(math.isfinite(value) and value > 0 for value in outcome.values.values())
    assert max(error for *_, error in outcome.tables[0].rows) < 1e-6
