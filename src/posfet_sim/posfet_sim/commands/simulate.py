"""`posfet sim`: runs a scene faster than real time into a file."""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Protocol

from posfet_model.command_line import checked_namespace
from posfet_model.config import ConfigError
from posfet_model.parameters import SENSOR_FILE
from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.scan import Scan
from posfet_sim.device.imperfections import load_imperfections
from posfet_sim.device.simulated_board import SEED_MAX, SimulatedBoard
from posfet_sim.emulation.line_faults import FaultyScans
from posfet_sim.parameters import IMPERFECTIONS, SCENE, SEED
from posfet_sim.recording.recorders import FORMATS, make_recorder
from posfet_sim.scene import SceneLoads, load_scene

UNENDING: Final = 10.0
"""Time that a scene in which nothing happens is run for unless told otherwise [s]."""
LONGEST: Final = 1e6
"""Longest run [s]."""
CHUNK: Final = 250
"""Scans between two steps of the progress bar."""
BAD_INPUT: Final = 1
INTERRUPTED: Final = 130


class Progress(Protocol):
    """What is told how far a run is."""

    def __call__(self, done: int) -> None:
        """Take the number of scans done."""
        ...


def main(words: Sequence[str] | None = None) -> int:
    """Run `posfet sim` and return the exit code.

    0 after a whole run; 1, with one line on stderr, for bad input; 130 when interrupted: what was done is in the file.
    """
    options = _parser().parse_args(words)
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
    return 0 if outcome.done == outcome.asked else INTERRUPTED


@dataclass(frozen=True)
class _Outcome:
    """What a run came to."""

    scans: FaultyScans
    done: int
    asked: int
    """Scans that were computed, and that were asked for."""
    seconds: float
    """How long it took."""


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="posfet sim", description="Run a scene on the simulated board, faster than real time, into a file."
    )
    parser.add_argument("scene", nargs="?", default=SCENE.default, help=SCENE.help)
    parser.add_argument("--out", type=Path, required=True, help=f"file to write: {' or '.join(FORMATS)}")
    parser.add_argument("--sensor", default=SENSOR_FILE.default, help=SENSOR_FILE.help)
    parser.add_argument("--seed", type=int, default=SEED.default, help=SEED.help)
    parser.add_argument("--imperfections", default=IMPERFECTIONS.default, help=IMPERFECTIONS.help)
    parser.add_argument("--for", dest="seconds", type=float, help="time to simulate in s (default: that of the scene)")
    parser.add_argument("--namespace", default="tactile", help="namespace of the topics (default: tactile)")
    parser.add_argument("--full", action="store_true", help="compute every taxel in every scan, for comparison")
    return parser


def _run(options: argparse.Namespace) -> _Outcome:
    """Simulate into the file."""
    sensor = load_sensor(options.sensor)
    scene = load_scene(options.scene, sensor)
    seconds = options.seconds
    if seconds is None:
        seconds = scene.duration or UNENDING
    if not 0 < seconds <= LONGEST:
        raise ConfigError(f"--for: must be in (0, {LONGEST:g}], got {seconds:g}")
    if not 0 <= options.seed <= SEED_MAX:
        raise ConfigError(f"--seed: must be in [0, {SEED_MAX}], got {options.seed}")
    namespace = checked_namespace(options.namespace)
    board = SimulatedBoard(
        sensor, SceneLoads(scene, sensor), options.seed, load_imperfections(options.imperfections), full=options.full
    )
    scans = FaultyScans(board, options.seed)
    asked = math.ceil(seconds * sensor.can.scan_rate - 1e-6)
    recorder = make_recorder(options.out, sensor, [item.name for item in scene.objects], namespace)
    scan = Scan.empty(sensor.layout.id, sensor.layout.taxels)
    done = 0
    begin = time.perf_counter()
    try:
        with _progress(scene.name, asked) as progress:
            for done in range(asked):
                for _ in range(scans.scan(done, scan)):
                    recorder.write(scan, board.truth())
                if done % CHUNK == 0:
                    progress(done)
            done = asked
    except KeyboardInterrupt:
        pass
    finally:
        recorder.close()
    return _Outcome(scans, done, asked, time.perf_counter() - begin)


@contextmanager
def _progress(title: str, total: int) -> Iterator[Progress]:
    """Show a bar on a terminal, and nothing elsewhere."""
    if not sys.stderr.isatty():
        yield lambda done: None
        return
    from rich.console import Console  # noqa: PLC0415  only who looks at a terminal needs it
    from rich.markup import escape  # noqa: PLC0415
    from rich.progress import Progress as Bar  # noqa: PLC0415

    with Bar(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(escape(title), total=total)
        yield lambda done: bar.update(task, completed=done)


def _line(error: Exception, out: Path) -> str:
    if isinstance(error, OSError):  # a full disk's names no file
        return f"{error.filename or out}: cannot be written: {error.strerror}"
    return " ".join(str(error).split())


if __name__ == "__main__":
    sys.exit(main())
