# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Run the benchmarks: `python -m benchmarks [--full] [--only NAME ...]`, or `make bench`.

Each subject runs in its own process group with a time-out. A complete run writes RESULTS.md, plots and
results/latest.json, and adds a line to results/history.jsonl; with --only nothing is written.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from importlib import import_module
from pathlib import Path

from rich.console import Console

from benchmarks import machine, plot, report
from benchmarks.outcome import Outcome
from posfet_model.ros.start import BLAS_THREADS

FOLDER = Path(__file__).parent
RESULTS = FOLDER / "results"
SUBJECTS = {
    "latency": ("latency.end_to_end", 360.0),
    "ordinary": ("latency.baseline", 120.0),
    "sustained": ("latency.sustained_rate", 360.0),
    "startup": ("latency.startup", 120.0),
    "setup": ("latency.fresh_clone", 600.0),
    "web": ("latency.web_view", 120.0),
    "slcan": ("micro.slcan_readers", 40.0),
    "decode": ("micro.frame_decoding", 20.0),
    "decode_mapped": ("micro.mapped_decoding", 30.0),
    "sim_vs_ngspice": ("simulation.follower_against_ngspice", 120.0),
    "board": ("simulation.board", 60.0),
    "mcap": ("simulation.recording_speed", 60.0),
    "labelling": ("micro.labelling", 20.0),
    "contacts": ("micro.compiled_contacts", 20.0),
    "reconstruction": ("micro.reconstruction", 60.0),
    "scaling": ("micro.scaling", 60.0),
    "skipped": ("micro.skipped_computation", 40.0),
}
"""Subjects in the order in which they run: module and time limit of a short run [s], three times the expected time."""
MIN_WIDTH = 130
FULL_FACTOR = 8.0
"""Factor on the time limit of a full run."""


def run_isolated(name: str, full: bool) -> Outcome:
    """Run one subject in its own process group, which is ended afterwards.

    Raises RuntimeError with the reason when it fails or takes too long.
    """
    limit = SUBJECTS[name][1] * (FULL_FACTOR if full else 1.0)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "outcome.json"
        command = [sys.executable, "-m", "benchmarks", "--worker", name, "--out", str(path)]
        # Domains 1 to 100 do not collide with the ephemeral ports of the system.
        environment = os.environ | {"ROS_DOMAIN_ID": str(1 + os.getpid() % 100)}
        environment.pop("PYTHONDONTWRITEBYTECODE", None)  # otherwise every start compiles all modules
        environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        if not any(environment.get(name) for name in BLAS_THREADS):
            environment[BLAS_THREADS[0]] = "1"  # as in the commands and nodes
        environment["PYTHONPATH"] = os.pathsep.join(filter(None, sys.path))  # the same import path as this process
        worker = subprocess.Popen(
            command + ["--full"] * full, cwd=FOLDER.parent, env=environment, start_new_session=True
        )
        try:
            code = worker.wait(limit)
        except subprocess.TimeoutExpired:
            raise RuntimeError(f"not done within {limit:.0f} s") from None
        finally:
            _end_group(worker)
        if code:
            raise RuntimeError(f"exit code {code}, see above")
        return Outcome.read(path)


def _end_group(worker: subprocess.Popen[bytes]) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.killpg(worker.pid, signal.SIGKILL)
    worker.wait()


def publish(outcomes: dict[str, Outcome], failed: dict[str, str], facts: dict[str, str | float], full: bool) -> None:
    """Write all results of a complete run."""
    RESULTS.mkdir(exist_ok=True)
    values = {key: value for outcome in outcomes.values() for key, value in outcome.values.items()}
    flat = facts | values
    (RESULTS / "latest.json").write_text(json.dumps(flat, indent=1) + "\n", encoding="utf-8")
    with (RESULTS / "history.jsonl").open("a", encoding="utf-8") as history:
        short = {key: float(f"{value:.4g}") if isinstance(value, float) else value for key, value in flat.items()}
        history.write(json.dumps(short, separators=(",", ":")) + "\n")
    for outcome in outcomes.values():
        for chart in outcome.charts:
            plot.draw(chart, RESULTS)
    (FOLDER / "RESULTS.md").write_text(report.results(facts, outcomes, failed, full), encoding="utf-8")


def main() -> int:
    """Run what was asked for; return 1 when a benchmark failed; one whose tool is missing is skipped."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description="Measure the speed of the stack.")
    parser.add_argument("--only", nargs="+", choices=SUBJECTS, metavar="NAME", help=f"of {', '.join(SUBJECTS)}")
    parser.add_argument("--full", action="store_true", help="every rate, size and step")
    parser.add_argument("--worker", choices=SUBJECTS, help=argparse.SUPPRESS)
    parser.add_argument("--out", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        import_module(f"benchmarks.{SUBJECTS[options.worker][0]}").measure(options.full).write(options.out)
        return 0
    console = Console(width=max(Console().width, MIN_WIDTH))
    facts = machine.facts()
    outcomes: dict[str, Outcome] = {}
    failed: dict[str, str] = {}
    begin = time.monotonic()
    for name in options.only or SUBJECTS:
        console.rule(name)
        try:
            outcomes[name] = run_isolated(name, options.full)
        except RuntimeError as error:
            failed[name] = str(error)
            console.print(f"{name}: {error}", style="red")
            continue
        report.show(outcomes[name], console)
    if not options.only:
        publish(outcomes, failed, facts, options.full)
        console.print(report.printed(report.targets_table(outcomes)))
    skipped = [name for name, outcome in outcomes.items() if outcome.skipped]
    console.print(
        f"{time.monotonic() - begin:.0f} s; skipped: {', '.join(skipped) or 'none'}; "
        f"failed: {', '.join(failed) or 'none'}"
    )
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
