# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Run time and accuracy of the simulated board: `python -m benchmarks.simulation [PART ...]`.

scenes    updates and time saved by skipped computation, and the resulting difference
reference error against full computation at 100 kHz over whole scenes, noise off in both (a quarter of an hour)
speed     share of a core of 5 x 5 at 1 kHz, touched and at rest; 64 x 64 against real time
schemes   run time against error over step, scheme and float width; writes docs/figures/simulation_schemes.csv

Each part prints one table for docs/simulation.md. Times are processor times of this process.
`python -m benchmarks.simulation.figure` draws the schemes.
"""

from __future__ import annotations

import argparse
import csv
import math
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from posfet_model.sensor.description import load_sensor
from posfet_model.sensor.scan import Scan
from posfet_sim.device.error_model import ErrorModel
from posfet_sim.device.simulated_board import SimulatedBoard
from posfet_sim.scene import SCENE_FOLDER, Scene, SceneLoads, load_scene

SENSOR = load_sensor()
SHIPPED = sorted(path.stem for path in SCENE_FOLDER.glob("*.yaml"))
FULL_SCALE = SENSOR.device.force_max * SENSOR.volts_per_newton
NONE, DEFAULT = ErrorModel.none(), ErrorModel.default()
REFERENCE_RATE = 100_000.0
CHUNK = 64
"""Scans timed together; the minimum of many chunks is the time of an undisturbed processor."""
SCHEME_SCENE = "tap"
SCHEME_SPAN = (0.25, 1.25)
STRIDES = (10, 30, 100, 300, 1000)
"""Step sizes in steps of the reference."""
SCHEME_FILE = Path(__file__).resolve().parents[2] / "docs" / "figures" / "simulation_schemes.csv"

Scheme = Callable[[np.ndarray, np.ndarray, float], Iterator[np.ndarray]]


def scans(scene: str, longest: float) -> int:
    """Return the number of scans to run of a scene."""
    return round(min(load_scene(scene, SENSOR).duration or 10.0, longest) * SENSOR.can.scan_rate)


def run(board: SimulatedBoard, indices: range) -> float:
    """Return the processor time [s] of some scans."""
    scan = Scan.empty(1, board.sensor.layout.taxels)
    begin = time.process_time()
    for index in indices:
        board.scan(index, scan)
    return time.process_time() - begin


def scenes(options: argparse.Namespace) -> None:
    """Print the table of skipped computation."""
    columns = (
        "taxel updates / (taxels * scans) | us per scan | full computation | speed-up | max difference / full scale"
    )
    print(f"| scene | {columns} |")
    print("|---|---|---|---|---|---|")
    wide = replace(SENSOR, layout=replace(SENSOR.layout, rows=32, cols=32))
    for sensor, suffix in ((SENSOR, ""), (wide, " (32 x 32)")):
        for name in options.scene:
            count = scans(name, options.longest or 2.0)
            scene = load_scene(name, sensor)
            lazy, full = (
                SimulatedBoard(sensor, SceneLoads(scene, sensor), 0, NONE.without_noise(), compute_all=full)
                for full in (False, True)
            )
            times = run(lazy, range(count)), run(full, range(count))
            lazy, full = (
                SimulatedBoard(sensor, SceneLoads(scene, sensor), 0, NONE.without_noise(), compute_all=full)
                for full in (False, True)
            )
            scan, worst = Scan.empty(1, sensor.layout.taxels), 0.0
            for index in range(count):
                lazy.scan(index, scan)
                full.scan(index, scan)
                worst = max(worst, float(np.abs(lazy.volts() - full.volts()).max()))
            share = lazy.taxel_updates / full.taxel_updates
            micro = [seconds / count * 1e6 for seconds in times]
            print(
                f"| `{name}`{suffix} | {share:.3f} | {micro[0]:.1f} | {micro[1]:.1f} | {micro[1] / micro[0]:.1f} "
                f"| {worst / FULL_SCALE:.0e} |"
            )


def reference(options: argparse.Namespace) -> None:
    """Print the table of errors against the full computation at 100 kHz."""
    print("| scene | duration s | max error, % of full scale | default error model, noise off |")
    print("|---|---|---|---|")
    fast = replace(SENSOR, can=replace(SENSOR.can, scan_rate=REFERENCE_RATE))
    ratio = round(REFERENCE_RATE / SENSOR.can.scan_rate)
    for name in options.scene:
        count = scans(name, options.longest or math.inf)
        errors = []
        for error_model in (
            NONE.without_noise(),
            replace(DEFAULT.without_noise(), dead_probability=0.0, stuck_probability=0.0),
        ):
            board = SimulatedBoard(SENSOR, SceneLoads(load_scene(name, SENSOR), SENSOR), 0, error_model)
            truth = SimulatedBoard(fast, SceneLoads(load_scene(name, fast), fast), 0, error_model, compute_all=True)
            scan, worst = Scan.empty(1, SENSOR.layout.taxels), 0.0
            for index in range(count):
                board.scan(index, scan)
                truth.scan(index * ratio, scan)  # computes every taxel in every scan between
                worst = max(worst, float(np.abs(board.volts() - truth.volts()).max()))
            assert truth.taxel_updates == ((count - 1) * ratio + 1) * SENSOR.layout.taxels
            errors.append(100 * worst / FULL_SCALE)
        print(f"| `{name}` | {count / SENSOR.can.scan_rate:g} | {errors[0]:.5f} | {errors[1]:.5f} |", flush=True)


def speed(options: argparse.Namespace) -> None:
    """Print the table of speed."""
    del options
    print("| array | error model | state | us per scan, min | median | load of a core at 1 kHz | times real time |")
    print("|---|---|---|---|---|---|---|")
    large = replace(SENSOR, layout=replace(SENSOR.layout, rows=64, cols=64))
    parts = (("press_slide_lift", "sliding", range(1000, 2000)),
             ("texture", "ridges sliding, rotated", range(500, 1500)),
             ("press_slide_lift", "held", range(520, 900)), ("idle", "unloaded", range(3000)))  # fmt: skip
    for sensor, title in ((SENSOR, "5 x 5"), (large, "64 x 64")):
        for error_model, what in ((NONE, "none"), (DEFAULT, "default")):
            for name, state, part in parts:
                scene, micro = load_scene(name, sensor), []
                if "rotated" in state:
                    scene = rotated(scene, 0.5)
                for _ in range(3):
                    board = SimulatedBoard(sensor, SceneLoads(scene, sensor), 0, error_model)
                    run(board, range(part.start))
                    chunks = [range(k, k + CHUNK) for k in range(part.start, part.stop - CHUNK + 1, CHUNK)]
                    micro += [run(board, chunk) / CHUNK * 1e6 for chunk in chunks]
                least, middle = min(micro), float(np.median(micro))
                print(
                    f"| {title} | {what} | {state} | {least:.1f} | {middle:.1f} | {least / 10:.1f} % "
                    f"| {1000 / least:.1f} |"
                )


def rotated(scene: Scene, angle: float) -> Scene:
    """Return the scene with its objects and their trajectories rotated by an angle [rad]."""
    return replace(
        scene,
        objects=tuple(
            replace(item, path=replace(item.path, angle=angle, to_angle=angle))  # type: ignore[type-var, call-arg]
            for item in scene.objects
        ),
    )


def exact_hold(source: np.ndarray, change: np.ndarray, ratio: float) -> Iterator[np.ndarray]:
    """First-order hold, exact, as in the board."""
    decay, mean = source.dtype.type(math.exp(-ratio)), source.dtype.type(-math.expm1(-ratio) / ratio)
    charge = np.zeros_like(source[0])
    for row in change:
        charge *= decay
        charge += mean * row
        yield charge


def zero_order(source: np.ndarray, change: np.ndarray, ratio: float) -> Iterator[np.ndarray]:
    """Zero-order hold, exact: the force jumps at each step."""
    decay, charge = source.dtype.type(math.exp(-ratio)), np.zeros_like(source[0])
    for row in change:
        charge *= decay
        charge += row
        yield charge


def forward_euler(source: np.ndarray, change: np.ndarray, ratio: float) -> Iterator[np.ndarray]:
    """Forward Euler."""
    decay, charge = source.dtype.type(1 - ratio), np.zeros_like(source[0])
    for row in change:
        charge *= decay
        charge += row
        yield charge


def backward_euler(source: np.ndarray, change: np.ndarray, ratio: float) -> Iterator[np.ndarray]:
    """Backward Euler."""
    decay, charge = source.dtype.type(1 / (1 + ratio)), np.zeros_like(source[0])
    for row in change:
        charge += row
        charge *= decay
        yield charge


def trapezoid(source: np.ndarray, change: np.ndarray, ratio: float) -> Iterator[np.ndarray]:
    """Trapezoidal rule."""
    dtype = source.dtype.type
    decay, weight, charge = dtype((2 - ratio) / (2 + ratio)), dtype(2 / (2 + ratio)), np.zeros_like(source[0])
    for row in change:
        charge *= decay
        charge += weight * row
        yield charge


SCHEMES: dict[str, Scheme] = {
    "first-order hold": exact_hold,
    "zero-order hold": zero_order,
    "forward Euler": forward_euler,
    "backward Euler": backward_euler,
    "trapezoidal rule": trapezoid,
}


def schemes(options: argparse.Namespace) -> None:
    """Print and write run time against error of one taxel's charge, 4096 of them, for step, scheme and float width."""
    del options
    forces = scheme_forces()
    full_scale = SENSOR.device.force_max
    ratio_of = 1 / SENSOR.device.leak_time_constant
    finest = 1 / REFERENCE_RATE
    exact = march(exact_hold, forces, finest * ratio_of)[0]
    rows: list[tuple[str, str, float, float, float]] = []
    for stride in STRIDES:
        step = stride * finest
        for title, scheme in SCHEMES.items():
            for dtype in (np.float64, np.float32):
                values, seconds = march(scheme, forces[::stride].astype(dtype), step * ratio_of)
                error = 100 * float(np.abs(values - exact[::stride][: len(values)]).max()) / full_scale
                rows.append((title, np.dtype(dtype).name, step, seconds / (len(values) * step), error))
    rows += whole_boards()
    with SCHEME_FILE.open("w", newline="", encoding="ascii") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["scheme", "width", "step_s", "run_time_per_second_s", "error_percent"])
        for title, width, step, cost, error in rows:
            writer.writerow([title, width, f"{step:g}", f"{cost:.4g}", f"{error:.4g}"])
    print("| scheme | precision | step ms | ms per second, 4096 taxels | max error, % of full scale |")
    print("|---|---|---|---|---|")
    for title, width, step, cost, error in rows:
        print(f"| {title} | {width} | {step * 1e3:g} | {cost * 1e3:.1f} | {error:.2g} |")


def whole_boards() -> list[tuple[str, str, float, float, float]]:
    """Scheme, width, step [s], run time of a second [s], and error [%] of the board's own outputs, noise off.

    The time is that of 64 x 64 taxels with contact, read-out and conversion; the error is against 100 kHz.
    """
    silent = NONE.without_noise()
    large = replace(SENSOR, layout=replace(SENSOR.layout, rows=64, cols=64))
    rows = []
    for stride in STRIDES:
        step = stride / REFERENCE_RATE
        for float32 in (False, True):
            small, wide, truth = (
                SimulatedBoard(
                    each,
                    SceneLoads(load_scene(SCHEME_SCENE, each), each),
                    0,
                    silent,
                    single_precision=float32 and not full,
                    compute_all=full,
                )
                for each, full in (
                    *((replace(each, can=replace(each.can, scan_rate=1 / step)), False) for each in (SENSOR, large)),
                    (replace(SENSOR, can=replace(SENSOR.can, scan_rate=REFERENCE_RATE)), True),
                )
            )
            first, count = round(SCHEME_SPAN[0] / step), round(SCHEME_SPAN[1] / step)
            scan, worst = Scan.empty(1, SENSOR.layout.taxels), 0.0
            for index in range(count):
                small.scan(index, scan)
                truth.scan(index * stride, scan)
                worst = max(worst, float(np.abs(small.volts() - truth.volts()).max()))
            run(wide, range(first))
            cost = run(wide, range(first, count)) / (SCHEME_SPAN[1] - SCHEME_SPAN[0])
            rows.append(("whole board", "float32" if float32 else "float64", step, cost, 100 * worst / FULL_SCALE))
    return rows


def scheme_forces() -> np.ndarray:
    """Force on the taxels [N] at 100 kHz, shape [steps, 25]."""
    loads = SceneLoads(load_scene(SCHEME_SCENE, SENSOR), SENSOR)
    count = round((SCHEME_SPAN[1] - SCHEME_SPAN[0]) * REFERENCE_RATE) + 1
    forces = np.zeros((count, SENSOR.layout.rows, SENSOR.layout.cols))
    for index in range(0, count, CHUNK):
        part = slice(index, min(index + CHUNK, count))
        for patch in loads.forces([SCHEME_SPAN[0] + k / REFERENCE_RATE for k in range(part.start, part.stop)]):
            forces[part, patch.rows, patch.cols] += patch.force
    return forces.reshape(count, -1)


def march(scheme: Scheme, forces: np.ndarray, ratio: float) -> tuple[np.ndarray, float]:
    """Return the charge in units of force after each step, shape [steps + 1, 25], and the time for 4096 taxels [s]."""
    change = np.diff(forces, axis=0)
    values = np.zeros_like(forces)
    for index, charge in enumerate(scheme(forces, change, ratio)):
        values[index + 1] = charge
    wide = np.zeros((1, 4096), forces.dtype)
    rows = np.zeros((min(len(change), 300), 4096), forces.dtype)
    seconds = math.inf
    for _ in range(3):
        begin = time.process_time()
        for _ in scheme(wide, rows, ratio):
            pass
        seconds = min(seconds, time.process_time() - begin)
    return values, seconds * len(change) / len(rows)


PARTS = {"scenes": scenes, "reference": reference, "speed": speed, "schemes": schemes}


def main() -> int:
    """Run the parts asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"which (default: all): {', '.join(PARTS)}")
    parser.add_argument("--longest", type=float, help="time of each scene at most in s (scenes: 2, reference: all)")
    parser.add_argument("--scene", nargs="+", default=SHIPPED, help="scenes of the first two parts (default: all)")
    options = parser.parse_args()
    for name in options.parts or PARTS:
        if name not in PARTS:
            parser.error(f"no part {name}; there are {', '.join(PARTS)}")
        print(f"\n### {name}\n")
        PARTS[name](options)
    return 0


if __name__ == "__main__":
    sys.exit(main())
