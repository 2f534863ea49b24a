# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Judge the model of the stack on boards of the independent plant, each calibrated on its own stand.

``python -m independent.judge --cover gauss --boards 1 2 --rows none creep --scenes mixed pad`` in the folder `test`
prints a line for each row, board and scene. `rows` returns the rows, each with what it requires (`Limits`).
"""

from __future__ import annotations

import argparse
import math
import time as clock
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from independent.contacts import COVERS, CoverName, Scene, scenes
from independent.film import HARD, MODERATE, Array, Board, Effects, Load, Recording
from independent.other_laws import LAWS
from independent.stand import calibration_of
from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.contacts.tracker import ContactState
from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.reconstruction.settings import ReconstructionSettings
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_model.sensor.scan import Scan

START_UP: Final = 0.05
"""Scans before this time are not judged [s]."""
STRIDE: Final = 10
"""One scan in so many is judged, where nothing is sharp; all are processed."""
TOUCHED: Final = 5e-3
"""True total force above which something touches [N]."""
ALLOWED: Final = (0.1, 0.05)
"""A total force is wrong by more than this: relative [1], and [N]."""
LASTING: Final = 5.0
"""Contacts that are listed so long after the last release do not end [s]."""
TRUE_TOUCH: Final = 2e-3
"""A contact is false if no taxel near it had as much true force while it was listed [N]."""
NEAR: Final = 1.6
"""Taxels within this distance are near a contact [pitch]."""
FORGOTTEN: Final = 0.3
"""A taxel that was touched within this time may still be listed [s]."""


@dataclass(frozen=True)
class Limits:
    """What a row requires, in percent; None: nothing."""

    error: float | None
    """Mean error of the total force over the mean total force."""
    coverage: float | None = 90.0
    """Taxels and totals within two reported standard deviations."""
    misleading: float | None = 1.0
    """Scans in contact that are valid although the total is wrong."""
    clean: bool = False
    """No contact that does not end, no false contact."""
    doubtful: float | None = None
    """Reported deviation over force above which no scan may be valid."""
    left: float | None = None
    """Force that is left 5 s after the last release [N]."""


@dataclass(frozen=True)
class Row:
    """One case of the requirements."""

    effects: Effects
    scenes: dict[str, Limits]


def rows() -> dict[str, Row]:
    """Return the cases by their names, with the scenes in which each is judged."""

    def row(effects: Effects, limits: Limits, *names: str) -> Row:
        return Row(effects, dict.fromkeys(names or ("mixed",), limits))

    grips = ("grasp", "regrasp", "handle", "two_fingers")
    noisy = Limits(1.0, clean=True)
    many = {
        "mixed": Limits(3.0, 90.0, 2.0),
        **dict.fromkeys(("sliding", "ridged", "rolling"), Limits(6.0, 90.0, 2.0)),
        "hold300": Limits(None, 90.0, 2.0, clean=True, doubtful=20.0, left=0.02),
        **dict.fromkeys(
            ("ring", "overload", "tap", "slow", "pad", "pad_slow", "power_on", "held_at_start", *grips),
            Limits(None, 90.0, 2.0),
        ),
    }
    hidden = dict.fromkeys(("pad", "pad_slow", "slow", "two_fingers", "held_at_start"), Limits(None, None, 1.0))
    drift = Effects(drift=2.0 / 60.0, sensor_lag=1.0, sensor_offset=0.3, chip_warming=0.05)
    nothing = Limits(0.5, 95.0, 0.0)
    return {
        "none": Row(
            Effects(),
            {
                "mixed": nothing,
                "pad": Limits(1.0, 90.0, 0.0),
                "pad_slow": Limits(2.0, 90.0, 1.0),
                "slow": Limits(None, 90.0, 1.0),
                **dict.fromkeys(
                    ("sliding", "ridged", "rolling", "ring", "tap", "overload", "power_on", *grips), nothing
                ),
                "hold300": Limits(None, 90.0, 0.0, clean=True, doubtful=20.0, left=0.02),
            },
        ),
        "relaxation": row(Effects(relaxation=0.03), Limits(1.5)),
        "creep": row(Effects(creep=0.05), Limits(1.0)),
        "hysteresis": row(Effects(hysteresis=0.03), Limits(2.5)),
        "warmth_30mK": row(Effects(warmth=0.03), Limits(2.0)),
        "warmth_100mK": Row(Effects(warmth=0.1), {"mixed": Limits(10.0), **hidden}),
        "warmth_100mK_soft": row(Effects(warmth=0.1, warmth_force=5e-3), Limits(10.0)),
        "warmth_100mK_stiff": row(Effects(warmth=0.1, warmth_force=0.15), Limits(10.0)),
        "warmth_30mK_step": row(Effects(warmth=0.03, warmth_step=5e-3), Limits(2.0), "mixed", "sliding"),
        "warmth_100mK_step": Row(Effects(warmth=0.1, warmth_step=10e-3), {"mixed": Limits(10.0), **hidden}),
        "warmth_30mK_objects": row(
            Effects(warmth=0.03, warmth_spread=0.25), Limits(None, 90.0, None), "mixed", "regrasp", "pad"
        ),
        "warmth_300mK": row(Effects(warmth=0.3), Limits(None)),
        "warm_object_30mK": row(Effects(warmth=0.03, warmth_on_stand=False), Limits(2.0)),
        "warm_object_100mK": row(Effects(warmth=0.1, warmth_on_stand=False), Limits(10.0)),
        "warm_object_300mK": row(Effects(warmth=0.3, warmth_on_stand=False), Limits(None)),
        "drift": row(drift, Limits(2.0)),
        "drift_under_way": row(replace(drift, drift_under_way=True), Limits(2.0)),
        "drift_dead_time": row(replace(drift, sensor_lag=0.0, sensor_dead_time=1.0), Limits(2.0)),
        "bending_2": row(Effects(bending=2e-3), Limits(1.0)),
        "bending_8": row(Effects(bending=8e-3), Limits(3.0)),
        "bending_8_dome": row(Effects(bending=8e-3, bending_dome=0.4), Limits(3.0)),
        "hum": row(Effects(hum=5e-3, hum_wander=0.2), noisy),
        "bursts": row(Effects(bursts=50e-3), noisy),
        "stuck_bit_1": row(Effects(stuck_bit=1), noisy),
        "stuck_bit_7": row(Effects(stuck_bit=7), noisy),
        "telegraph": row(Effects(telegraph=3e-3), noisy),
        "flicker_50uV": row(Effects(flicker=50e-6), Limits(None)),
        "nonlinearity": row(Effects(nonlinearity=0.01), Limits(None)),
        "gain_drift": row(Effects(gain_drift=0.01), Limits(None)),
        "leak_halving": row(replace(drift, leak_halving=15.0), Limits(None)),
        "timing": row(Effects(jitter=5e-6, skew=0.5e-3, lost=1e-3), noisy),
        "moderate": Row(MODERATE, many),
        "moderate_soft": Row(replace(MODERATE, warmth_force=5e-3), many),
        "moderate_stiff": Row(replace(MODERATE, warmth_force=0.15), many),
        "moderate_step": Row(replace(MODERATE, warmth_step=5e-3), many),
        "moderate_under_way": Row(replace(MODERATE, drift_under_way=True), many),
        "hard": Row(HARD, {name: Limits(None) for name in many}),
    }


@dataclass(eq=False)
class Verdict:
    """Measures of one run, in percent where no unit is named; NaN: there is nothing to measure."""

    error: float = math.nan
    """Mean error of the total force over the mean total force, of all scans in which something touches."""
    error_valid: float = math.nan
    """The same of valid scans."""
    valid: float = math.nan
    """Scans in contact that are valid."""
    taxels: float = math.nan
    """Coverage of the forces of taxels with the contact threshold or more, over valid scans."""
    total: float = math.nan
    """Coverage of the total force while something touches, over valid scans."""
    misleading: float = math.nan
    """Scans in contact that are valid although the total is wrong by more than 10 % and 50 mN."""
    doubtful: float = math.nan
    """Largest reported deviation over force of a valid scan with 0.2 N or more."""
    lasting: int = 0
    """Contacts that are listed 5 s after the last release."""
    false: int = 0
    """Contacts where nothing touched."""
    left: float = math.nan
    """Total force 5 s after the last release [N]."""
    scale: float = math.nan
    """Mean of the estimated total over that of the true one, less 1."""
    start: float = math.nan
    """Time of the first valid scan [s]."""
    series: dict[str, NDArray[Any]] = field(default_factory=dict, repr=False)
    """Time, truth, total, std, valid of the judged scans."""

    def failures(self, limits: Limits) -> list[str]:
        """Return what does not meet the limits, in words.

        Parameters
        ----------
        limits : Limits
            What is required.
        """
        bad = []
        for name, value, limit in (
            ("error", self.error, limits.error),
            ("misleading", self.misleading, limits.misleading),
            ("doubtful", self.doubtful, limits.doubtful),
            ("left", abs(self.left), limits.left),
        ):
            if limit is not None and value > limit:
                bad.append(f"{name} {value:.3g} > {limit:g}")
        for name, value in (("taxels", self.taxels), ("total", self.total)):
            if limits.coverage is not None and value < limits.coverage:
                bad.append(f"{name} {value:.1f} < {limits.coverage:g}")
        if limits.clean:
            bad += [f"{name} {value}" for name, value in (("lasting", self.lasting), ("false", self.false)) if value]
        return bad


def scans(sensor: Sensor, recording: Recording) -> Iterator[Scan]:
    """Yield the scans of a recording; each overwrites the one before.

    Parameters
    ----------
    sensor : Sensor
        Sensor file.
    recording : Recording
        What the board sent.
    """
    scan, period = Scan.empty(sensor.layout.id, sensor.layout.taxels), round(1e6 / sensor.can.scan_rate)
    for row, number in enumerate(recording.index.tolist()):
        scan.sequence = number
        scan.device_time = 1_000_000 + number * period
        scan.stamp = 1_700_000_000_000_000_000 + number * period * 1000
        scan.counts[:] = recording.counts[row]
        scan.temperatures[:] = recording.temperatures[row]
        yield scan


def play(sensor: Sensor, calibration: Calibration | None, scene: Scene, load: Load, recording: Recording) -> Verdict:
    """Return how well the model does on a recording.

    Parameters
    ----------
    sensor : Sensor
        Sensor file.
    calibration : Calibration, optional
        Calibration of the board; None: none.
    scene : Scene
        What happened.
    load : Load
        The true forces.
    recording : Recording
        What the board sent.

    Returns
    -------
    Verdict
        Measures.
    """
    reconstructor = Reconstructor(sensor, calibration, ReconstructionSettings(touch_at_start=scene.starts > 0.0))
    first = round(scene.starts * sensor.can.scan_rate)
    stride = 1 if scene.sharp else STRIDE
    listed: dict[int, list[tuple[int, tuple[float, float]]]] = {}
    kept: list[int] = []
    forces, deviations, totals, total_deviations, valid = [], [], [], [], []
    for row, scan in enumerate(scans(sensor, recording)):
        if scan.sequence < first:
            continue
        result, number = reconstructor.process(scan), scan.sequence
        if row % stride or not result.accepted:
            continue
        image = reconstructor.image()
        kept.append(number)
        valid.append(result.valid)
        forces.append(image.force.copy())
        deviations.append(image.standard_deviation.copy())
        totals.append(image.total)
        total_deviations.append(image.total_standard_deviation)
        for contact in result.contacts:
            if contact.state is not ContactState.RELEASED:
                listed.setdefault(contact.id, []).append((number, contact.region.centre_of_pressure))
    truth = load.force[kept] + recording.late * (
        load.force[np.minimum(np.array(kept) + 1, len(load.force) - 1)] - load.force[kept]
    )
    time = np.array(kept) / sensor.can.scan_rate - scene.starts
    verdict = _measured(
        sensor,
        time,
        truth,
        np.array(forces),
        np.array(deviations),
        np.array(totals),
        np.array(total_deviations),
        np.array(valid),
    )
    released = np.flatnonzero(load.force.sum(axis=1) > TOUCHED)[-1]
    after = released + round(LASTING * sensor.can.scan_rate)
    verdict.lasting = sum(places[-1][0] >= after for places in listed.values())
    later = np.flatnonzero(np.array(kept) >= after)
    if len(later):
        verdict.left = float(totals[later[0]])
    verdict.false = sum(_is_false(sensor, load.force, places) for places in listed.values())
    return verdict


def _measured(
    sensor: Sensor,
    time: Array,
    truth: Array,
    force: NDArray[np.float32],
    deviation: NDArray[np.float32],
    total: Array,
    total_deviation: Array,
    valid: NDArray[np.bool_],
) -> Verdict:
    """Return the measures of forces."""
    started = time >= START_UP
    true_total = truth.sum(axis=1)
    touched = started & (true_total > TOUCHED)
    difference = np.abs(total - true_total)
    known = touched & np.isfinite(difference)
    used = touched & valid & np.isfinite(difference)
    verdict = Verdict(
        error=_percent(difference[known].sum(), true_total[known].sum()),
        error_valid=_percent(difference[used].sum(), true_total[used].sum()),
        valid=_percent(_count(touched & valid), _count(touched)),
        scale=_percent((total - true_total)[known].sum(), true_total[known].sum()),
    )
    strong = (truth >= sensor.contact.threshold) & used[:, None] & np.isfinite(deviation)
    within = np.abs(force - truth) <= 2.0 * deviation
    verdict.taxels = _percent(_count(within & strong), _count(strong))
    certain = used & np.isfinite(total_deviation)
    verdict.total = _percent(_count((difference <= 2.0 * total_deviation) & certain), _count(certain))
    wrong = difference > np.maximum(ALLOWED[0] * true_total, ALLOWED[1])
    verdict.misleading = _percent(_count(touched & valid & wrong), _count(touched))
    sure = certain & (total > 0.2)
    if sure.any():
        verdict.doubtful = 100.0 * float((total_deviation[sure] / total[sure]).max())
    if valid.any():
        verdict.start = float(time[np.argmax(valid)])
    verdict.series = {"time": time, "truth": true_total, "total": total, "deviation": total_deviation, "valid": valid}
    verdict.series |= {"forces": force, "true_forces": truth, "deviations": deviation}
    return verdict


def _is_false(sensor: Sensor, force: Array, places: list[tuple[int, tuple[float, float]]]) -> bool:
    """Return whether nothing ever touched near a contact."""
    before, reach = round(FORGOTTEN * sensor.can.scan_rate), NEAR * sensor.layout.pitch_x
    for number, centre in places:
        near = np.hypot(*(sensor.layout.positions - centre).T) <= reach
        if (force[max(number - before, 0) : number + 1, near] >= TRUE_TOUCH).any():
            return False
    return True


def _count(mask: NDArray[np.bool_]) -> int:
    """Return how many are true."""
    return int(np.count_nonzero(mask))


def _percent(part: float, whole: float) -> float:
    """Return a share in percent; NaN of nothing."""
    return 100.0 * float(part) / float(whole) if whole else math.nan


def judge(board: Board, calibration: Calibration | None, cover: CoverName, scene: Scene) -> Verdict:
    """Return how well the model does in one scene on one board.

    Parameters
    ----------
    board : Board
        The board.
    calibration : Calibration, optional
        Its calibration; None: none.
    cover : str
        Its cover: gauss, layer or half_space.
    scene : Scene
        The scene.

    Returns
    -------
    Verdict
        Measures.
    """
    load = scene.load(board.sensor, cover, board.seed)
    recording = board.record(load, sum(map(ord, scene.name)))
    return play(board.sensor, calibration, scene, load, recording)


def without_interference(effects: Effects) -> Effects:
    """Return effects without what disturbs a calibration, for boards whose calibration is refused with it.

    Parameters
    ----------
    effects : Effects
        Effects of a board.
    """
    return replace(effects, hum=0.0, bursts=0.0, telegraph=0.0, warmth=min(effects.warmth, 0.03))


COLUMNS: Final = (
    "row               scene        cover      board   error  valid-e  valid  scale  taxel  total  mislead  dev/F "
    " last false  left/mN"
)


def line(row: str, scene: str, cover: str, board: int, verdict: Verdict) -> str:
    """Return one line of the table.

    Parameters
    ----------
    row : str
        Name of the row.
    scene : str
        Name of the scene.
    cover : str
        Name of the cover.
    board : int
        Number of the board.
    verdict : Verdict
        Measures.
    """
    return (
        f"{row:17} {scene:12} {cover:10} {board:5d} {verdict.error:7.2f} {verdict.error_valid:8.2f} "
        f"{verdict.valid:6.1f} {verdict.scale:+6.2f} {verdict.taxels:6.1f} {verdict.total:6.1f} "
        f"{verdict.misleading:8.2f} {verdict.doubtful:6.1f} {verdict.lasting:5d} {verdict.false:5d} "
        f"{verdict.left * 1e3:8.1f}"
    )


def main(words: Sequence[str] | None = None) -> int:
    """Print the table; return 1 if a row does not meet its limits."""
    cases = rows()
    parser = argparse.ArgumentParser(prog="python -m independent.judge", description=__doc__)
    parser.add_argument("--cover", nargs="+", choices=COVERS, default=["gauss"], help="covers (default: gauss)")
    parser.add_argument("--boards", nargs="+", type=int, default=[1], help="numbers of the boards (default: 1)")
    parser.add_argument("--rows", nargs="+", choices=list(cases), default=list(cases), help="rows (default: all)")
    parser.add_argument("--law", choices=list(LAWS), default="film", help="other laws than those of the plant")
    parser.add_argument("--scenes", nargs="+", choices=list(scenes()), help="scenes (default: those of each row)")
    parser.add_argument("--calibrations", type=Path, help="folder in which calibrations are kept")
    parser.add_argument("--nominal", action="store_true", help="without calibration")
    options = parser.parse_args(words)
    sensor, bad = load_sensor(), 0
    print(COLUMNS)
    for cover in options.cover:
        for name in options.rows:
            case = cases[name]
            for number in options.boards:
                board = LAWS[options.law](sensor, case.effects, number)
                try:
                    calibration = None if options.nominal else calibration_of(board, cover, options.calibrations)
                except ValueError as error:
                    print(f"{name:17} board {number}: refused: {error}", flush=True)
                    bad += 1
                    quiet = replace(board, effects=without_interference(case.effects))
                    try:
                        calibration = calibration_of(quiet, cover, options.calibrations)
                    except ValueError:
                        continue
                    print(
                        f"{name:17} board {number}: calibrated without hum, bursts, telegraph noise and warmth",
                        flush=True,
                    )
                for scene in options.scenes or case.scenes:
                    began = clock.monotonic()
                    verdict = judge(board, calibration, cover, scenes()[scene])
                    failures = verdict.failures(case.scenes.get(scene, Limits(None)))
                    bad += bool(failures)
                    text = line(name, scene, cover, number, verdict)
                    print(f"{text}  {clock.monotonic() - began:4.1f} s  {'; '.join(failures)}", flush=True)
    return int(bad > 0)


if __name__ == "__main__":
    raise SystemExit(main())
