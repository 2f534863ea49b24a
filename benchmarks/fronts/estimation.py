# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Estimation of force: length of the block, groups of states left out, and filters of fixed noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from benchmarks.fronts.front import Effort, Front
from benchmarks.fronts.pipeline import (
    BOARDS,
    SENSOR,
    SHIPPED_ESTIMATOR,
    Method,
    Other,
    Stack,
    calibrated,
    measured,
    theory,
    title,
)
from benchmarks.fronts.recordings import HEADINGS, Recording, record
from benchmarks.outcome import shown
from benchmarks.peers.taxel_kalman import TaxelKalman
from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.estimation.choice import Estimator
from posfet_model.estimation.error_states import ErrorPriors
from posfet_model.estimation.settings import ObserverSettings
from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.reconstruction.settings import ReconstructionSettings
from posfet_sim.scene import load_scene

BLOCKS = (0.005, 0.01, 0.02, 0.05, 0.1)
TINY = 1e-9
"""Standard deviation of a state that is left out: nothing is learnt of it."""

WITHOUT_STATES: Mapping[str, Mapping[str, float]] = {
    "no bending": {"bend": TINY, "bend_gradient": TINY},
    "no warmth": {"warmth": TINY, "warmth_beside": TINY},
    "no leakage error": {"leak": TINY, "leak_calibrated": TINY},
    "film noise fixed": {"rate_change": TINY},
}
"""Groups of states of the estimator of all errors, left out by their priors."""

SCENES = {"hold_10s": 8.0, "press_slide_lift": 4.0}


def _stack(estimator: Estimator, **settings: Any) -> Method:
    def make(calibration: Calibration) -> Stack:
        return Stack(Reconstructor(SENSOR, calibration, estimator, ReconstructionSettings(**settings)))

    return make


def methods() -> dict[tuple[str, str], Method]:
    """Return how to make each estimator, by series and parameter."""
    observer, states = Estimator.OBSERVER, Estimator.ERROR_STATE
    default = ObserverSettings()
    found: dict[tuple[str, str], Method] = {
        (title(observer), f"block {block * 1e3:g} ms"): _stack(observer, observer=replace(default, block=block))
        for block in BLOCKS
    }
    found[title(states), "all"] = _stack(states)
    for name, priors in WITHOUT_STATES.items():
        found[f"{title(states)} with less", name] = _stack(states, priors=replace(ErrorPriors(), **priors))
    less = f"{title(observer)} with less"
    found[less, "no common mode"] = _stack(observer, observer=replace(default, common_mode=False))
    found[less, "no roll-back"] = _stack(observer, observer=replace(default, roll_back=False))
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
    block = f"block {ObserverSettings().block * 1e3:g} ms"
    shipped = (
        f"{title(SHIPPED_ESTIMATOR)}, {block}"
        if SHIPPED_ESTIMATOR is Estimator.OBSERVER
        else f"{title(SHIPPED_ESTIMATOR)}, all"
    )
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
        f"A Kalman filter per taxel with fixed noise errs {shown(plain.error / own.error)} times as much as what is "
        f"shipped, in {shown(plain.median / own.median)} of the run time. The smallest error has {best.name}, "
        f"{shown(best.error / own.error)} of the shipped one's: the table shows what each block length and each "
        "group of "
        "states is worth.",
        why_not="Two scenes on one board do not decide this: docs/accuracy.md compares both estimators over many.",
        swept=False,
        columns=HEADINGS,
    )
