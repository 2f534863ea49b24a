# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""The whole pipeline on recorded scans with ground truth: this stack in its configurations, and peers."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from benchmarks.fronts.estimators import STACK, Variant
from benchmarks.fronts.front import Check, Choice, Effort, Front, FrontError
from benchmarks.fronts.recordings import HEADINGS, Recording, Tally, random_scene, record
from benchmarks.outcome import shown
from benchmarks.peers.calibration_curve import CalibrationCurve
from benchmarks.peers.exponential_baseline import ExponentialBaseline
from benchmarks.peers.peer import TARE_TIME, Peer
from benchmarks.peers.skin_baseline import SkinBaseline
from benchmarks.peers.taxel_kalman import TaxelKalman
from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.contacts.tracker import ContactState
from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.reconstruction.settings import ReconstructionSettings
from posfet_model.reconstruction.taxel_faults import TaxelStatus
from posfet_model.sensor.description import Sensor, load_sensor
from posfet_sim.calibration.simulated_bench import calibrate
from posfet_sim.device.error_model import MODERATE, ErrorModel
from posfet_sim.evaluation.scorer import Scorer
from posfet_sim.scene import Keyframes, Scene, SceneObject, load_scene

SENSOR = load_sensor()
SHIPPED = (STACK, "as shipped")
"""Series and parameter of the shipped configuration."""

SEEDS = range(1, 9)
"""Boards; the first one whose calibration is not refused is used."""

JUDGED = 3
"""One of this many scans is judged, which takes longer than most methods."""

FAULTY = (TaxelStatus.DEAD, TaxelStatus.STUCK, TaxelStatus.NOISY)

CHUNK = 250
"""Scans that one method processes before the next one has its turn."""

ORDINARY = replace(ErrorModel.default(), resets_per_hour=0.0)
BOARDS = {"ordinary": ORDINARY, "realistic": ORDINARY.with_realism(MODERATE)}
SCENES = {"press_slide_lift": 4.0, "two_fingers": 3.0, "hold_10s": 8.0}
"""Scenes of the first two fronts, with their duration [s]."""

A_PEER = (
    "It states no uncertainty, and knows nothing of temperature, faults, hum and offsets that change after the start."
)
WHY_NOT = {
    f"{STACK}, uncalibrated": "Here what the nominal parameters miss and what the film does cancel in part; on "
    "the ordinary film they do not, and a calibration pays.",
    STACK: "It leaves out what protects against an error that this board or these scenes do not have.",
    "": A_PEER,
}
"""Why the shipped configuration may be beaten in some front."""

HELD_OUT = 3
"""Number of random scenes, of five presses each."""


class Stack:
    """The stack of this repository, scan by scan."""

    def __init__(self, reconstructor: Reconstructor, variant: Variant | None = None) -> None:
        self._reconstructor, self._variant = reconstructor, variant or Variant()

    def advance(self, recording: Recording, part: range, tally: Tally | None) -> float:
        """Process some scans; return the processor time [s] of results and force image."""
        with self._variant.in_use():
            return self._advance(recording, part, tally)

    def _advance(self, recording: Recording, part: range, tally: Tally | None) -> float:
        spent = 0.0
        for index in part:
            begin = time.process_time()
            result = self._reconstructor.process(recording.scans[index])
            image = self._reconstructor.image()
            spent += time.process_time() - begin
            if tally is None or index % JUDGED:
                continue
            live = [each for each in result.contacts if each.state is not ContactState.RELEASED]
            tally.add(
                recording.truths[index],
                image.total,
                [each.region.centre_of_pressure for each in live],
                image.total_standard_deviation,
                result.valid,
                float(recording.truths[index].force @ np.isin(image.status, FAULTY)),
            )
        return spent


class Other:
    """A peer, scan by scan."""

    def __init__(self, peer: Peer) -> None:
        self._peer = peer

    def advance(self, recording: Recording, part: range, tally: Tally | None) -> float:
        """Process some scans; return the processor time [s]."""
        spent, peer = 0.0, self._peer
        for index in part:
            counts = recording.scans[index].counts
            begin = time.process_time()
            peer.process(counts)
            spent += time.process_time() - begin
            if tally is not None and index % JUDGED == 0:
                tally.add(recording.truths[index], float(peer.force.sum()), [each[:2] for each in peer.contacts])
        return spent


Method = Callable[[Calibration], "Stack | Other"]


def methods() -> dict[tuple[str, str], Method]:
    """Return how to make each method from a calibration, by series and parameter."""

    def stack(calibrated: bool = True, **settings: bool) -> Method:
        def make(calibration: Calibration) -> Stack:
            used = calibration if calibrated else None
            return Stack(Reconstructor(SENSOR, used, ReconstructionSettings(**settings)))

        return make

    def other(peer: type[Peer]) -> Method:
        return lambda calibration: Other(peer(SENSOR, calibration))

    found: dict[tuple[str, str], Method] = {SHIPPED: stack()}
    found[STACK, "no hum removal"] = stack(hum_removal=False)
    found[STACK, "no fault detection"] = stack(fault_detection=False)
    found[STACK, "uncalibrated"] = stack(calibrated=False)
    for peer in peers():
        found[peer.name, ""] = other(peer)
    return found


def peers() -> Sequence[type[Peer]]:
    """Return the peers; the one that needs scipy only where it is."""
    found: list[type[Peer]] = [SkinBaseline, CalibrationCurve, ExponentialBaseline, TaxelKalman]
    try:
        from benchmarks.peers.labelled_centroids import LabelledCentroids  # noqa: PLC0415
    except ImportError:
        return found
    return [*found, LabelledCentroids]


def measure(effort: Effort) -> list[Front]:
    """Return a front for the ordinary and the realistic film, and one for random scenes on the realistic film."""
    if effort.short:
        brief = {"press_slide_lift": load_scene("press_slide_lift", SENSOR)}
        recordings = [record(SENSOR, scene, 1.6, SEEDS[0], BOARDS["realistic"]) for scene in brief.values()]
        return [_front("realistic", "press_slide_lift", recordings, Calibration.nominal(SENSOR), effort)]
    found = []
    for film, board in BOARDS.items():
        seed, calibration = calibrated(board)
        recordings = [record(SENSOR, load_scene(name, SENSOR), span, seed, board) for name, span in SCENES.items()]
        found.append(_front(film, ", ".join(SCENES), recordings, calibration, effort))
    scenes = [random_scene(seed, 5) for seed in range(HELD_OUT)]
    recordings = [record(SENSOR, each, each.duration + 1.0, seed, board) for each in scenes]
    what = f"{HELD_OUT} random scenes of presses and slides that nothing was tuned to"
    found.append(_front("held_out", what, recordings, calibration, effort))
    return found


def calibrated(board: ErrorModel) -> tuple[int, Calibration]:
    """Return the first board whose calibration is not refused, and its calibration."""
    for seed in SEEDS:
        try:
            return seed, calibrate(SENSOR, seed, board)
        except ValueError:  # a taxel that does not fit
            continue
    raise FrontError(f"no board of {len(SEEDS)} can be calibrated")


def run(
    makers: Mapping[tuple[str, str], Method],
    recordings: Sequence[Recording],
    calibration: Calibration,
    sensor: Sensor = SENSOR,
    judged: bool = True,
) -> dict[tuple[str, str], tuple[Tally, float]]:
    """Return the tally of each method and its processor time of a scan [s], all in turn on the same scans.

    The time does not contain the judging, which another run for its time alone can leave out.
    """
    tallies = {key: Tally(sensor) for key in makers}
    spent = dict.fromkeys(makers, 0.0)
    for recording in recordings:
        objects = {key: make(calibration) for key, make in makers.items()}
        for first in range(0, len(recording.scans), CHUNK):
            part = range(first, min(first + CHUNK, len(recording.scans)))
            for key, each in objects.items():
                spent[key] += each.advance(recording, part, tallies[key] if judged else None)
    scans = sum(len(recording.scans) for recording in recordings)
    return {key: (tallies[key], spent[key] / scans) for key in makers}


def measured(
    makers: Mapping[tuple[str, str], Method], recordings: Sequence[Recording], calibration: Calibration, repeats: int
) -> list[Choice]:
    """Return each method with its errors of the first run and its processor time of every run."""
    runs = [run(makers, recordings, calibration, judged=k == 0) for k in range(repeats)]
    choices = []
    for series, parameter in makers:
        tally = runs[0][series, parameter][0]
        seconds = tuple(each[series, parameter][1] for each in runs)
        choices.append(Choice(series, parameter, tally.force_percent, seconds, tally.figures))
    return choices


def _front(film: str, what: str, recordings: Sequence[Recording], calibration: Calibration, effort: Effort) -> Front:
    choices = measured(methods(), recordings, calibration, min(effort.repeats, 3))
    shipped = ", ".join(SHIPPED)
    own = next(each for each in choices if each.name == shipped)
    rival = min((each for each in choices if each.series != STACK), key=lambda each: each.error)
    nearest = min((each for each in choices if each.series != STACK and each.more[0] == each.more[0]),
                  key=lambda each: each.more[0])  # fmt: skip
    reading = (
        f"Over {what} the error of the total force is {shown(own.error)} % with the shipped configuration. With the "
        f"best peer ({rival.name}) it is {shown(rival.error)} %, {shown(rival.error / own.error)} times as much, in "
        f"{shown(rival.median / own.median)} of the run time. The centre of pressure is off by {shown(own.more[0])} "
        f"mm; with the nearest peer ({nearest.name}) by {shown(nearest.more[0])} mm. Choose a peer without "
        "leakage in its model only where nothing is held: it follows the charge, which decays under a constant "
        f"force. The stack also estimates the {shown(own.more[-1])} % of the force that is on taxels which it "
        "declares faulty."
    )
    return Front(
        f"pipeline_{film}",
        {"held_out": "Whole pipeline, held-out scenes, realistic film"}.get(film, f"Whole pipeline, {film} film"),
        "one scan of 25 taxels, from counts to forces and contacts",
        "error of the total force while touched [%]",
        "forces of the simulated scene on the taxels",
        0.0,
        tuple(choices),
        shipped,
        (*theory(), _same_as_scorer(recordings[0], calibration), _untouched_start(recordings)),
        reading,
        why_not=WHY_NOT,
        question={
            "ordinary": "forces and contacts of an ordinary film",
            "realistic": "the same on a film that creeps, warms and bends",
            "held_out": "the same on touches that nothing was tuned to",
        }[film],
        rival=rival.name,
        swept=False,
        columns=HEADINGS,
    )


def theory() -> tuple[Check, ...]:
    """Check methods on an ideal board, whose answer is known: a force held for a time, from rest."""
    held, force = 1.0, 1.0
    press = SceneObject(
        "ball",
        load_scene("press", SENSOR).objects[0].shape,
        Keyframes((0.0, 0.5, 0.51, 0.51 + held), tuple((0.0, 0.0, 0.0, load) for load in (0.0, 0.0, force, force))),
    )
    scene = Scene(name="theory", description="", period=math.inf, objects=(press,),
                  temperature=Keyframes((0.0,), ((25.0,),)))  # fmt: skip
    recording = record(SENSOR, scene, 0.51 + held, SEEDS[0], ErrorModel.none())
    calibration = Calibration.nominal(SENSOR)
    chosen: dict[tuple[str, str], Method] = {
        ("curve", ""): lambda known: Other(CalibrationCurve(SENSOR, known)),
        ("Kalman", ""): lambda known: Other(TaxelKalman(SENSOR, known)),
        ("stack", ""): methods()[SHIPPED],
    }
    found = {key[0]: tally.force_percent for key, (tally, _) in run(chosen, [recording], calibration).items()}
    tau = SENSOR.device.leak_time_constant
    leaked = 100 * (1 - tau / held * -math.expm1(-held / tau))
    return (
        Check("calibration curve on a held force of an ideal board, error over what leaked", found["curve"] / leaked,
              0.97, 1.03),
        Check("Kalman filter per taxel on the same, error [%]", found["Kalman"], 0.0, 2.0),
        Check("this stack on the same, error [%]", found["stack"], 0.0, 2.0),
    )  # fmt: skip


def _untouched_start(recordings: Sequence[Recording]) -> Check:
    starts = [next(truth.time for truth in each.truths if truth.force.any()) for each in recordings]
    return Check("shortest untouched start over what the peers need [1]", min(starts) / TARE_TIME, 1.0, math.inf)


def _same_as_scorer(recording: Recording, calibration: Calibration) -> Check:
    """Compare the error of the total force with that of `posfet score`, which counts valid scans alone."""
    scorer, tally = Scorer(SENSOR), Tally(SENSOR)
    reconstructor = Reconstructor(SENSOR, calibration)
    for scan, truth in zip(recording.scans, recording.truths, strict=True):
        result = reconstructor.process(scan)
        image = reconstructor.image()
        if result.accepted:
            scorer.add(result, image, truth)
        if result.accepted and result.valid:
            tally.add(truth, image.total, [])
    expected = scorer.score(0.0).total_force_error_pct or math.nan
    return Check("error of the total force over that of `posfet score` on its scans [1]",
                 tally.force_percent / expected, 0.98, 1.02)  # fmt: skip
