# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Estimation of force: length of the block, groups of states left out, and filters of fixed noise."""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.fronts.estimators import STACK, Variant, shipped_variant, variants
from benchmarks.fronts.front import Effort, Front
from benchmarks.fronts.pipeline import (
    A_PEER,
    BOARDS,
    SENSOR,
    Method,
    Other,
    Stack,
    calibrated,
    measured,
    theory,
)
from benchmarks.fronts.recordings import HEADINGS, Recording, record
from benchmarks.outcome import shown
from benchmarks.peers.taxel_kalman import TaxelKalman
from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_sim.scene import load_scene

SCENES = {"hold_10s": 8.0, "press_slide_lift": 4.0}


def _stack(variant: Variant) -> Method:
    def make(calibration: Calibration) -> Stack:
        return Stack(Reconstructor(SENSOR, calibration, variant.settings), variant)

    return make


def methods() -> dict[tuple[str, str], Method]:
    """Return how to make each variant and the peer, by series and parameter."""
    found: dict[tuple[str, str], Method] = {key: _stack(variant) for key, variant in variants().items()}
    found["fixed noise", "Kalman filter per taxel"] = lambda known: Other(TaxelKalman(SENSOR, known))
    return found


def measure(effort: Effort) -> list[Front]:
    """Return a front for each film."""
    found = []
    for film, board in list(BOARDS.items())[: 1 if effort.short else 2]:
        seed, calibration = (1, Calibration.nominal(SENSOR)) if effort.short else calibrated(board)
        scenes = {"press_slide_lift": 1.4} if effort.short else SCENES
        recordings = [record(SENSOR, load_scene(name, SENSOR), span, seed, board) for name, span in scenes.items()]
        found.append(_front(film, tuple(scenes), recordings, calibration, effort))
    return found


def _front(
    film: str, scenes: Sequence[str], recordings: Sequence[Recording], calibration: Calibration, effort: Effort
) -> Front:
    choices = measured(methods(), recordings, calibration, min(effort.repeats, 2))
    shipped = ", ".join(shipped_variant())
    own = next(each for each in choices if each.name == shipped)
    plain = next(each for each in choices if each.series == "fixed noise")
    best = min(choices, key=lambda each: each.error)
    return Front(
        f"estimation_{film}",
        f"Estimation of force, {film} film",
        "one scan of 25 taxels, contacts included",
        "error of the total force while touched [%]",
        f"forces of the simulated scenes {', '.join(scenes)}",
        0.0,
        tuple(choices),
        shipped,
        theory(),
        f"A Kalman filter per taxel with fixed noise has {shown(plain.error / own.error)} times the error of the "
        f"shipped choice, in {shown(plain.median / own.median)} of its run time. The least error, "
        f"{shown(best.error / own.error)} of the shipped one's, is that of: {best.name}. Blocks below 20 ms, one "
        "period of the mains, are no choice: they count its hum as forces, so that in a short scene no force is valid.",
        why_not={
            "": "A longer block averages more, but thresholds, faults and offsets follow a touch that much later; it "
            "is 20 ms, one period of the mains.",
            f"{STACK} with less": "It leaves out a cause of error that these scenes do not have: the objects in them "
            "are as warm as the chip, and one board has one film.",
            "fixed noise": A_PEER,
        },
        question="an estimator of forces alone" if film == "realistic" else "",
        rival=plain.name if film == "realistic" else "",
        swept=False,
        columns=HEADINGS,
    )
