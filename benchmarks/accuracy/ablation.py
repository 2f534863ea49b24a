# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Ablation study: scenes with one component of the reconstruction disabled. Part of `make accuracy`.

A component is disabled by a calibration without it, or by the settings of the reconstructor.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from benchmarks.fronts.estimators import WITHOUT_STATES
from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.estimation.error_states import ErrorPriors
from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.reconstruction.settings import ReconstructionSettings
from posfet_model.sensor.description import Sensor
from posfet_sim.evaluation.scorer import Score

SCENES: Final[dict[str, tuple[str, float, tuple[tuple[str, float], ...]]]] = {
    "`press_slide_lift`": ("press_slide_lift", 4.0, ()),
    "`hold`": ("hold", 6.5, ()),
    "`hold`, leak +20 %": ("hold", 5.0, (("leak", 20.0),)),
    "`warm_finger`": ("warm_finger", 9.0, ()),
}
"""By title: scene, simulated time [s], and by how much device parameters differ from the description [%]."""

COLUMNS: Final[tuple[tuple[str, str, Callable[[Score], float | None], int], ...]] = (
    ("`press_slide_lift`", "total force %", lambda score: score.total_force_error_pct, 2),
    ("`press_slide_lift`", "cop mm", lambda score: score.cop_error_mm["mean"], 3),
    ("`hold`", "total force %", lambda score: score.total_force_error_pct, 2),
    ("`hold`", "drift %", lambda score: score.held_force_drift_pct, 2),
    ("`hold`, leak +20 %", "total force %", lambda score: score.total_force_error_pct, 2),
    ("`warm_finger`", "total force %", lambda score: score.total_force_error_pct, 2),
    ("`warm_finger`", "recall", lambda score: score.contact_recall, 3),
    ("`warm_finger`", "false contacts per h", lambda score: score.false_contacts_per_hour, 0),
)
"""Title of a scene, heading, figure of its score, and number of digits."""


def _same(_: Sensor, calibration: Calibration) -> Calibration:
    return calibration


@dataclass(frozen=True)
class Without:
    """How to disable one component."""

    calibration: Callable[[Sensor, Calibration], Calibration] = _same
    """Changes the calibration."""
    settings: ReconstructionSettings | None = None
    """Settings of the reconstructor; None: the defaults."""

    def reconstructor(self, sensor: Sensor, calibration: Calibration) -> Reconstructor:
        """Return a reconstructor without the component."""
        return Reconstructor(sensor, self.calibration(sensor, calibration), settings=self.settings)


def _without_states(name: str) -> Without:
    return Without(settings=ReconstructionSettings(priors=replace(ErrorPriors(), **WITHOUT_STATES[name])))


PIECES: Final = {
    "nothing": Without(),
    "calibration": Without(lambda sensor, _: Calibration.nominal(sensor)),
    "film temperature": Without(
        lambda _, calibration: replace(calibration, pyroelectric_gain=np.zeros_like(calibration.gain))
    ),
    "thermal lag of the film": Without(lambda _, calibration: replace(calibration, thermal_time_constant=0.0)),
    "states of the leakage": _without_states("no leakage error"),
    "states of creep": _without_states("no creep"),
    "states of bending": _without_states("no bending"),
    "states of warmth": _without_states("no warmth"),
    "crosstalk compensation": Without(lambda _, calibration: replace(calibration, crosstalk=0.0)),
    "mains hum removal": Without(settings=ReconstructionSettings(hum_removal=False)),
    "fault detection": Without(settings=ReconstructionSettings(fault_detection=False)),
}
"""Disabled components, by name."""

TEXT: Final = """\
The same boards without gain error, each time with one component of the reconstruction disabled
(benchmarks/accuracy/ablation.py). Figures are means over the boards; a force error is missing where no force was valid.

| without | means |
|---|---|
| calibration | nominal parameters, those of the sensor file |
| film temperature | the pyroelectric signal is not compensated |
| states of a cause of errors | this cause is assumed to be known ([estimation.md](estimation.md)) |
| fault detection | faulty taxels that the calibration did not find count like the others |"""


def rows(scores: Mapping[tuple[str, str], Sequence[Score]]) -> list[str]:
    """Return a table of the scores of boards, a row for each component; `scores` by component and title of a scene."""
    heads = " | ".join(f"{title}: {head}" for title, head, _, _ in COLUMNS)
    table = [f"| without | {heads} |", f"|---|{'---|' * len(COLUMNS)}"]
    for piece in PIECES:
        cells = []
        for title, _, of, digits in COLUMNS:
            known = [value for score in scores[piece, title] if (value := of(score)) is not None]
            cells.append(f"{np.mean(known):.{digits}f}" if known else "-")
        table.append(f"| {piece} | {' | '.join(cells)} |")
    return table
