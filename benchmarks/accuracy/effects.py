# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Accuracy under the effects of a real film and board, for contacts of every kind, and for long holds.

Part of `make accuracy`; alone: `make accuracy ONLY=effects`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Final

import numpy as np

from posfet_model.calibration.taxel_calibration import Calibration
from posfet_model.reconstruction.reconstructor import Reconstructor
from posfet_model.reconstruction.settings import ReconstructionSettings
from posfet_model.sensor.description import load_sensor
from posfet_sim.calibration.simulated_bench import calibrate
from posfet_sim.contact.indenters import Sphere
from posfet_sim.device.board_effects import BoardEffects
from posfet_sim.device.error_model import HARD, MODERATE, ErrorModel
from posfet_sim.device.film_effects import FilmEffects
from posfet_sim.emulation.offline import received_scans
from posfet_sim.evaluation.reliability_scorer import SETTLED
from posfet_sim.evaluation.scorer import Score, Scorer
from posfet_sim.scene import Keyframes, Scene, SceneObject, load_scene

BOARD: Final = replace(ErrorModel.default(), resets_per_hour=0.0)

REST: Final = SETTLED + 0.2
"""Rest after the last touch [s]."""

WARMING: Final = 2.0 / 60.0
"""Rate of the chip temperature where an effect needs a change of temperature [K/s]."""

EVERY: Final = 7
"""One of this many scans is scored, which meets every phase of the mains hum."""

ALONE, ALONE_FULL = 1, 3
"""Number of boards for an effect alone, in the short and in the full run."""

TOGETHER, TOGETHER_FULL = 2, 5
"""The same for all effects at once."""

SHAPES, SHAPES_FULL = 1, 3
"""The same for each contact and hold."""

FILM: Final = {
    "dielectric relaxation": "relaxation",
    "creep": "creep",
    "minor loops": "minor_loops",
    "preload": "preload_nonlinearity",
    "d33 with temperature": "d33_temperature",
    "leakage with temperature": "leak_halving",
    "leakage drift": "leak_drift",
    "warmth of touched taxels": "contact_warmth",
    "warming of the chip": "chip_warming",
    "gain drift": "gain_drift",
}
"""Field of `FilmEffects` by the title of an effect; bending has two."""

CIRCUIT: Final = {
    "lag of the temperature sensors": ("sensor_lag",),
    "offset of the temperature sensors": ("sensor_offset",),
    "mains hum with harmonics": ("third_harmonic", "fifth_harmonic", "frequency_wander"),
    "bursts": ("burst_rate", "burst_amplitude"),
    "telegraph noise": ("telegraph_amplitude", "telegraph_dwell"),
    "stuck bit": ("stuck_bit",),
    "missing codes": ("missing_codes",),
    "skew of the taxels": ("taxel_skew",),
}
"""Fields of `BoardEffects` by the title of an effect."""

WHILE_WARMING: Final = (
    "d33 with temperature",
    "leakage with temperature",
    "lag of the temperature sensors",
    "offset of the temperature sensors",
)
"""Effects that show only while the temperature changes."""

AT_START: Final = "contact_at_power_on"

CONTACTS: Final = (
    "flat_pad_fast",
    "flat_pad_slow",
    "ring",
    "ridged_fingertip",
    "screw_head",
    "rolling",
    "stick_slip",
    "tap_1ms",
    "slow_press",
    AT_START,
    "overload",
)
"""Scenes of one kind of contact each."""

HOLD: Final = 2.0
"""Duration of the hold of `BRIEF` [s]."""

BRIEF: Final = Scene(
    name="brief",
    description="a press, a slide and a hold of 2 N by one fingertip",
    period=math.inf,
    objects=(
        SceneObject(
            "fingertip",
            Sphere(5e-3, 2e6),
            Keyframes(
                (1.0, 1.2, 2.0, 2.2, 3.0, 3.2, 4.4, 5.6, 5.8, 6.6, 6.8, 6.8 + HOLD, 7.1 + HOLD),
                tuple(
                    (x * 1e-3, y * 1e-3, 0.0, force)
                    for x, y, force in (
                        *((-1.5, -1.2, force) for force in (0.0, 1.0, 1.0, 0.0)),
                        *((-1.4, -0.7, 0.0), (-1.4, -0.7, 1.2), (1.4, 0.7, 1.2), (-1.4, -0.7, 1.2), (-1.4, -0.7, 0.0)),
                        *((0.2, -0.1, force) for force in (0.0, 2.0, 2.0, 0.0)),
                    )
                ),
            ),
        ),
    ),
    temperature=Keyframes((0.0,), ((25.0,),)),
)
"""The scene for an effect alone: `mixed` with less of everything."""

HOLDS: Final = ("hold_10s", "hold")
LONGEST_HOLD: Final = "hold_300s"


@dataclass(frozen=True)
class Case:
    """One row."""

    title: str
    board: ErrorModel
    scene: Scene
    boards: int
    """Number of boards."""
    warming: float = 0.0
    """Rate of the chip temperature from 1 s on [K/s]."""
    stand: ErrorModel | None = None
    """The board on its calibration stand; None: the same."""
    settings: ReconstructionSettings | None = None
    """Settings of the reconstruction; None: the defaults."""

    def play(self) -> tuple[Scene, float]:
        """Return the scene, which plays once, and its duration with a rest at the end [s]."""
        scene = replace(self.scene, period=math.inf)
        duration = scene.duration + REST
        if self.warming:
            warm = 25.0 + self.warming * (duration - 1.0)
            scene = replace(scene, temperature=Keyframes((1.0, duration), ((25.0,), (warm,))))
        return scene, duration


@dataclass(frozen=True)
class Run:
    """Score on one board."""

    score: Score
    calibration: str
    """What is wrong with the calibration; empty: nothing."""
    seconds: float
    """Simulated time [s]."""
    processor: float
    """Processor time [s]."""


def alone(boards: int, moderate_too: bool) -> list[Case]:
    """Return the cases of each effect alone, hard or, where that differs, at both sizes."""

    def case(title: str, board: ErrorModel, warming: float = 0.0) -> Case:
        return Case(title, board, BRIEF, boards, warming)

    cases = [case("none", BOARD), case("none, while warming", BOARD, WARMING)]
    for title, changed in _single_effects().items():
        warming = WARMING if title in WHILE_WARMING else 0.0
        moderate, hard = (changed(BOARD.with_realism(size)) for size in (MODERATE, HARD))
        if moderate == hard:
            cases.append(case(f"{title}, either size", hard, warming))
            continue
        if moderate_too:
            cases.append(case(f"{title}, moderate", moderate, warming))
        cases.append(case(f"{title}, hard", hard, warming))
    return cases


def _single_effects() -> dict[str, Callable[[ErrorModel], ErrorModel]]:
    """Return, by title, what leaves of a board with all effects only one."""

    def of_film(*names: str) -> Callable[[ErrorModel], ErrorModel]:
        def only(real: ErrorModel) -> ErrorModel:
            return replace(
                BOARD, film=replace(FilmEffects.ideal(), **{name: getattr(real.film, name) for name in names})
            )

        return only

    def of_circuit(*names: str, also: Sequence[str] = ()) -> Callable[[ErrorModel], ErrorModel]:
        def only(real: ErrorModel) -> ErrorModel:
            effects = BoardEffects(**{name: getattr(real.board, name) for name in names})
            more: dict[str, Any] = {name: getattr(real, name) for name in also}
            return replace(BOARD, board=effects, **more)

        return only

    effects = {title: of_film(name) for title, name in FILM.items()}
    effects["bending"] = of_film("bending", "bending_gradient")
    for title, names in CIRCUIT.items():
        effects[title] = of_circuit(*names, also=("hum_amplitude",) if "harmonics" in title else ())
    effects["jitter"] = of_circuit(also=("clock_jitter",))
    effects["lost scans"] = of_circuit(also=("drop_probability",))
    return effects


def together(boards: int) -> list[Case]:
    """Return the cases of all effects at once."""
    mixed = load_scene("mixed", load_sensor())
    return [
        Case(f"all, {size}{title}", BOARD.with_realism(size), mixed, boards, stand=stand)
        for size in (MODERATE, HARD)
        for title, stand in (("", None), (", calibrated without them", BOARD))
    ]


def by_contact(boards: int, scenes: Sequence[str]) -> list[Case]:
    """Return the cases of scenes without the effects and with all of them at moderate size.

    Where something touches at the start, also with the parameter that says so.
    """
    sensor, informed = load_sensor(), ReconstructionSettings(touch_at_start=True)
    return [
        Case(f"`{scene}`{title}, {name}", board, load_scene(scene, sensor), boards, settings=settings)
        for scene in scenes
        for title, settings in (("", None), *([(", `touch_at_start`", informed)] if scene == AT_START else []))
        for name, board in (("none", BOARD), ("all, moderate", BOARD.with_realism(MODERATE)))
    ]


@lru_cache
def _calibration(seed: int, stand: ErrorModel) -> Calibration | str:
    """Return the calibration of a board, or why it was refused."""
    try:
        return calibrate(load_sensor(), seed, stand)
    except ValueError as error:
        return str(error)


def run(case: Case, seed: int) -> Run:
    """Run a case on one board, calibrated on its own stand."""
    begin, sensor, wrong = time.process_time(), load_sensor(), ""
    calibration = _calibration(seed, case.stand or case.board)
    if isinstance(calibration, str):
        wrong, calibration = f"refused ({calibration}), nominal parameters used", None
    if calibration is not None and calibration.residuals is not None:
        after, before = calibration.residuals.force_rms, calibration.residuals.force_rms_before
        if after > before:
            wrong = f"residual {1e3 * after:.0f} mN, with nominal parameters {1e3 * before:.0f} mN"
    scene, duration = case.play()
    model, scorer = Reconstructor(sensor, calibration, case.settings), Scorer(sensor)
    for number, (scan, truth) in enumerate(received_scans(sensor, scene, duration, seed, case.board)):
        result = model.process(scan)
        if number % EVERY == 0 and result.accepted:
            scorer.add(result, model.image(), truth)
    return Run(scorer.score(0.0), wrong, duration, time.process_time() - begin)


@dataclass(frozen=True)
class Column:
    """A figure over the boards of a case."""

    head: str
    of: Callable[[Score], float | None]
    digits: int = 0
    worst: bool = False
    """Whether the greatest value of the boards counts, not their mean."""

    def value(self, scores: Sequence[Score]) -> float | None:
        """Return the figure; None: no board has one."""
        known = [value for score in scores if (value := self.of(score)) is not None]
        if not known:
            return None
        return max(known) if self.worst else float(np.mean(known))


COLUMNS: Final = (
    Column("mean error %", lambda score: score.total_force_error_pct, 2),
    Column("worst %", lambda score: score.total_force_worst_pct, 1, worst=True),
    Column("covered %: taxels", lambda score: score.coverage_pct["taxel"], 1),
    Column("contacts", lambda score: score.coverage_pct["contact"], 1),
    Column("total", lambda score: score.coverage_pct["total"], 1),
    Column("valid %", lambda score: score.valid_pct, 1),
    Column("misleading %", lambda score: score.misleading_pct, 1),
    Column("contacts left", lambda score: score.contacts_left, 0, worst=True),
)

HEAD: Final = (
    f"| effects | s | boards | {' | '.join(column.head for column in COLUMNS)} |",
    "|---|---|---|" + "---|" * len(COLUMNS),
)

TEXT: Final = f"""\
The effects are those of a [real film](simulation.md#real-film) and a [real board](simulation.md#real-board), which
ideal ones do not have. Each acts alone here, at the hard size (with FULL=1 also at the moderate one); the next section
has all at once. Otherwise the board is the default one, without resets and without an additional gain error. It is
calibrated with its effects on the simulated rig of `posfet calibrate`. Every {EVERY}th scan is scored.

The scene is a press of 1 N, a slide and a hold of 2 N for {HOLD:g} s. Sensor lag and offset, d33 and leakage with
temperature act while the chip warms by {60 * WARMING:g} K a minute from 1 s on: compare them with
"none, while warming".

| column | meaning |
|---|---|
| mean error | mean absolute error of the total force over the mean true one, during contact |
| worst | greatest error over the true total force of at least 50 mN; the greatest of the boards |
| covered | share of errors within two reported standard deviations: of taxels whose true force reaches the contact \
threshold, of contacts, and of the total force. 95 % is right for normally distributed errors, more is cautious |
| valid | share of scans that are valid; the start counts as not valid |
| misleading | share of scans that are valid although the total force is wrong by more than 10 % and more than 50 mN |
| contacts left | those still reported {SETTLED:g} s after the last touch; the greatest of the boards |
| wrongly calibrated | the calibration was refused, or it fits its own recording worse than nominal parameters do: \
nothing can be expected of such a board |

Errors and coverage are those of valid scans: read them together with the share that is valid. Figures without another
note are means over the boards."""

TOGETHER_TEXT: Final = """\
All effects at once, on `mixed`: four presses, a slide and a hold of 2 N for 20 s. "Calibrated without them": the same
board, calibrated on a rig where it has none of the effects. The difference shows what the calibration does."""

CONTACTS_TEXT: Final = """\
Each scene without the effects ("none": the default board) and with all of them at moderate size. In
`contact_at_power_on` a force is there at power-on. By default the array is assumed to be untouched then, so this force
is not seen until it is released. With the parameter `touch_at_start` data is not valid until the release."""

HOLDS_TEXT: Final = """\
The same for a force of 2 N that is held for 10 s, a minute, and, with FULL=1 only, five minutes."""

NOT_COVERED: Final = """\
Limits of these four tables:

- No real film was measured. The effects are models of assumed magnitude, and the priors of the estimator were chosen
  for such magnitudes.
- One board, or few, give no confidence interval: two rows may differ by some tenths of a per cent by chance.
- Not covered: some of the effects at once; faults of the link and resets; tangential forces, which are not simulated;
  arrays other than the 5 x 5 one; temperature changes in the tables of contacts and holds."""


def alone_rows(pool: Executor, full: bool) -> list[str]:
    """Return text and table of each effect alone."""
    return [TEXT, "", *_rows(pool, alone(ALONE_FULL if full else ALONE, moderate_too=full))]


def together_rows(pool: Executor, full: bool) -> list[str]:
    """Return text and table of all effects at once."""
    return [TOGETHER_TEXT, "", *_rows(pool, together(TOGETHER_FULL if full else TOGETHER))]


def contact_rows(pool: Executor, full: bool) -> list[str]:
    """Return text and table of contacts of every kind."""
    return [CONTACTS_TEXT, "", *_rows(pool, by_contact(SHAPES_FULL if full else SHAPES, CONTACTS))]


def hold_rows(pool: Executor, full: bool) -> list[str]:
    """Return text and table of held forces, and what none of the tables covers."""
    scenes = (*HOLDS, LONGEST_HOLD) if full else HOLDS
    return [HOLDS_TEXT, "", *_rows(pool, by_contact(SHAPES_FULL if full else SHAPES, scenes)), "", NOT_COVERED]


def _rows(pool: Executor, cases: Sequence[Case]) -> list[str]:
    """Return a table, and which calibrations failed."""
    futures = [(case, [pool.submit(run, case, seed + 1) for seed in range(case.boards)]) for case in cases]
    table, found, processor = list(HEAD), [], 0.0
    for case, waiting in futures:
        runs = [future.result() for future in waiting]
        processor += sum(one.processor for one in runs)
        found.append((case, runs))
        table.append(_row(case, runs))
        print(table[-1], flush=True)
    return [*table, "", *_failed(found), f"Processor time of this table: {processor:.0f} s."]


def _row(case: Case, runs: Sequence[Run]) -> str:
    wrong = ", wrongly calibrated" if any(one.calibration for one in runs) else ""
    values = [column.value([one.score for one in runs]) for column in COLUMNS]
    cells = ["-" if value is None else f"{value:.{of.digits}f}" for of, value in zip(COLUMNS, values, strict=True)]
    return f"| {case.title}{wrong} | {runs[0].seconds:g} | {len(runs)} | {' | '.join(cells)} |"


def _failed(found: Sequence[tuple[Case, Sequence[Run]]]) -> list[str]:
    """Return a paragraph on the calibrations that failed; none if none did."""
    wrong = [f"{case.title}: {one.calibration}" for case, runs in found for one in runs if one.calibration]
    return [f"Calibrations that failed, one for each board: {'; '.join(wrong)}.", ""] if wrong else []
