# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""`posfet sim`: simulate a scene faster than real time and write it to a file."""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from posfet_model.command_line import BAD_INPUT, checked_namespace
from posfet_model.config import ConfigError
from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.scan import Scan
from posfet_sim.commands.options import add_duration, add_error_model, add_scene, add_seed, add_sensor
from posfet_sim.commands.progress import progress
from posfet_sim.device.error_model import load_error_model
from posfet_sim.device.simulated_board import SimulatedBoard
from posfet_sim.emulation.faulty_scans import FaultyScans
from posfet_sim.recording.recorders import FORMATS, make_recorder
from posfet_sim.scene import DEFAULT_SCENE, SceneLoads, load_scene

STATIC_DURATION: Final = 10.0
"""Default duration of a scene that never changes [s]."""
INTERRUPTED: Final = 130
"""Exit code when interrupted."""


def main(words: Sequence[str] | None = None) -> int:
    """Run `posfet sim`.

    Parameters
    ----------
    words : sequence of str, optional
        Command line; default: that of the process.

    Returns
    -------
    int
        0 after a complete run; 1, with one line on stderr, for bad input; 130 when interrupted: the file then has the
        scans up to there.
    """
    options = make_parser().parse_args(words)
    try:
        outcome = _run(options)
    except (ConfigError, OSError, ValueError) as error:
        print(_line(error, options.out), file=sys.stderr)
        return BAD_INPUT
    board = outcome.scans.board
    simulated = outcome.done / board.sensor.can.scan_rate
    work = board.taxel_updates / max(outcome.done * board.sensor.layout.taxels, 1)
    counted = "".join(f", {count} {name}" for name, count in outcome.scans.counters.items() if count)
    factor = simulated / max(outcome.seconds, 1e-9)
    print(
        f"{options.out}: {outcome.done} scans{counted}; "
        f"{simulated:g} s in {outcome.seconds:.2f} s, {factor:.1f} times real time; "
        f"{board.taxel_updates} taxel updates, {work:.3f} of all"
    )
    return 0 if outcome.done == outcome.requested else INTERRUPTED


@dataclass(frozen=True)
class _Outcome:
    """Result of a run."""

    scans: FaultyScans
    """The board with its link."""
    done: int
    """Number of scans computed."""
    requested: int
    """Number of scans requested."""
    seconds: float
    """Computation time [s]."""


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of `posfet sim`."""
    parser = argparse.ArgumentParser(
        prog="posfet sim", description="Simulate a scene faster than real time and write it to a file."
    )
    add_scene(parser, default=DEFAULT_SCENE)
    parser.add_argument("--out", type=Path, required=True, help=f"file to write: {' or '.join(FORMATS)}")
    add_sensor(parser)
    add_error_model(parser)
    add_seed(parser, default=0)
    add_duration(parser)
    parser.add_argument("--namespace", default="tactile", help="namespace of the topics (default: tactile)")
    parser.add_argument("--full", action="store_true", help="compute every taxel in every scan, for comparison")
    return parser


def _run(options: argparse.Namespace) -> _Outcome:
    """Simulate and write the file."""
    sensor = load_sensor(options.sensor)
    scene = load_scene(options.scene, sensor)
    seconds = options.seconds or scene.duration or STATIC_DURATION
    namespace = checked_namespace(options.namespace)
    board = SimulatedBoard(
        sensor,
        SceneLoads(scene, sensor),
        options.seed,
        load_error_model(options.imperfections),
        compute_all=options.full,
    )
    scans = FaultyScans(board, options.seed)
    requested = math.ceil(seconds * sensor.can.scan_rate - 1e-6)
    recorder = make_recorder(options.out, sensor, [item.name for item in scene.objects], namespace)
    scan = Scan.empty(sensor.layout.id, sensor.layout.taxels)
    done = 0
    begin = time.perf_counter()
    try:
        with progress(scene.name, requested) as at:
            for done in range(requested):
                for _ in range(scans.scan(done, scan)):
                    recorder.write(scan, board.truth())
                at(done)
            done = requested
    except KeyboardInterrupt:
        pass
    finally:
        recorder.close()
    return _Outcome(scans, done, requested, time.perf_counter() - begin)


def _line(error: Exception, out: Path) -> str:
    if isinstance(error, OSError):  # without a file name when the disk is full
        return f"{error.filename or out}: cannot be written: {error.strerror}"
    return " ".join(str(error).split())


if __name__ == "__main__":
    sys.exit(main())
