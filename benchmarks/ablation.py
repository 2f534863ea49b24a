"""What each piece of the reconstruction is worth: scenes with one of them taken out. A part of `make accuracy`.

Nothing in the product knows of this: a piece is taken out by a calibration that does not have it, by settings, or by
putting something in its place from here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Final
from unittest.mock import patch

import numpy as np

from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.estimation.common_mode import CommonModeTemperature
from posfet_model.estimation.drift_filter import DriftFilter
from posfet_model.estimation.force_observer import ForceObserver
from posfet_model.estimation.settings import ObserverSettings
from posfet_model.reconstruction import reconstructor
from posfet_model.reconstruction.mains_hum import MainsHum
from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.reconstruction.taxel_faults import TaxelFaultDetector
from posfet_model.sensor.description import Sensor
from posfet_sim.evaluation.scorer import Score

SCENES: Final[dict[str, tuple[str, float, tuple[tuple[str, float], ...]]]] = {
    "`press_slide_lift`": ("press_slide_lift", 4.0, ()),
    "`hold`": ("hold", 6.5, ()),
    "`hold`, leak +20 %": ("hold", 5.0, (("leak", 20.0),)),
    "`warm_finger`": ("warm_finger", 9.0, ()),
}
"""By their titles: scene, how much of it is run [s], and in what the device differs from its description [%]."""

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
"""Title of a scene, and a figure of its score, with so many digits."""


def _same(_: Sensor, calibration: Calibration) -> Calibration:
    return calibration


def _none(*_: object) -> float:
    return 0.0


def _no_change(_: DriftFilter, where: Any) -> tuple[Any, Any]:
    taxels = np.count_nonzero(where)
    return np.zeros(taxels), np.zeros(taxels, np.intp)


@dataclass(frozen=True)
class Without:
    """How to take out one piece."""

    calibration: Callable[[Sensor, Calibration], Calibration] = _same
    """What is known of the sensor, of its calibration."""
    settings: ObserverSettings | None = None
    instead: Mapping[tuple[type, str], object] = field(default_factory=dict)
    """What stands for members of classes."""

    @contextmanager
    def reconstructor(self, sensor: Sensor, calibration: Calibration) -> Iterator[Reconstructor]:
        """Return a reconstructor that does without the piece, within the context."""
        with ExitStack() as stack:
            for (owner, name), stand_in in self.instead.items():
                stack.enter_context(patch.object(owner, name, stand_in))
            observer = partial(ForceObserver, settings=self.settings)
            stack.enter_context(patch.object(reconstructor, "ForceObserver", observer))
            yield Reconstructor(sensor, self.calibration(sensor, calibration))


PIECES: Final = {
    "nothing": Without(),
    "calibration": Without(lambda sensor, _: Calibration.nominal(sensor)),
    "film's temperature": Without(
        lambda _, calibration: replace(calibration, pyroelectric_gain=np.zeros_like(calibration.gain))
    ),
    "film's lag": Without(lambda _, calibration: replace(calibration, thermal_time_constant=0.0)),
    "what all taxels show together": Without(
        instead={(CommonModeTemperature, name): _none for name in ("update_untouched", "update_touched", "update")}
    ),
    "learning the leak": Without(
        settings=ObserverSettings(
            leakage_common_deviation_calibrated=1e-6, leakage_individual_deviation_calibrated=1e-6
        )
    ),
    "1/f noise in the zeros": Without(settings=ObserverSettings(flicker=1e-9)),
    "putting back what was taken for drift": Without(instead={(DriftFilter, "roll_back"): _no_change}),
    "crosstalk": Without(lambda _, calibration: replace(calibration, crosstalk=0.0)),
    "mains hum": Without(instead={(MainsHum, "sampling"): False}),
    "bad taxels": Without(instead={(TaxelFaultDetector, "close_block"): lambda *_: False}),
}
"""What is taken out, by name."""

TEXT: Final = """\
The same boards with right gains, so that nothing hides behind wrong ones, and each time one piece of the reconstruction
taken out (benchmarks/ablation.py). Figures are means over the boards; of forces there is none where none was ever said
to be fit for control. Without calibration the description alone is believed; without the film's temperature no warmth
is taken off; without what all taxels show together the chip's sensors alone tell it; without bad taxels those that the
calibration did not find count like the others. To learn the leak costs a little where the calibration is right."""


def rows(scores: Mapping[tuple[str, str], Sequence[Score]]) -> list[str]:
    """Return a table, a row for each piece, of the scores of boards by piece and title of a scene."""
    heads = " | ".join(f"{title}: {head}" for title, head, _, _ in COLUMNS)
    table = [f"| without | {heads} |", f"|---|{'---|' * len(COLUMNS)}"]
    for piece in PIECES:
        cells = []
        for title, _, of, digits in COLUMNS:
            known = [value for score in scores[piece, title] if (value := of(score)) is not None]
            cells.append(f"{np.mean(known):.{digits}f}" if known else "-")
        table.append(f"| {piece} | {' | '.join(cells)} |")
    return table
