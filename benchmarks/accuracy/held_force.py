# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Error of a held force against the optimal estimator.

Part of `make accuracy`; alone: `python -m benchmarks.accuracy.held_force`.
"""

from __future__ import annotations

from concurrent.futures import Executor, ProcessPoolExecutor
from dataclasses import dataclass
from typing import Final

import numpy as np

from reference.held_force import COMMON_LEAKAGE, OWN_LEAKAGE, Held, hold
from reference.temperature_drift import Drift

TIMES: Final = (1.0, 5.0, 20.0, 60.0)
"""Times since the onset of the force [s]."""

FLICKER: Final = 10e-6
"""1/f noise of the simulated board at 1 Hz [V/sqrt(Hz)]."""

FEW: Final = 3
FEW_FULL: Final = 10
"""Number of runs of 256 taxels with independent errors."""

MANY: Final = 20
"""Number of runs in which all taxels have an error in common."""

SMALL: Final = 5
"""Rows and columns of an array that is pressed in part."""


@dataclass(frozen=True)
class Case:
    """Conditions of a run, which gives a row for each time."""

    flicker: float
    """1/f noise at 1 Hz [V/sqrt(Hz)]."""
    temperature: str = "constant"
    """Course of the temperature, as in the table."""
    drift: Drift | None = None
    """Drift of the temperature; None: constant."""
    leakage_estimated: bool = False
    """Whether the leakage is estimated online, not known."""
    untouched: int = 0
    """Number of taxels of a small array that are left untouched."""


CASES: Final = (
    Case(0.0),
    Case(FLICKER),
    Case(FLICKER, leakage_estimated=True),
    Case(FLICKER, "ramp", Drift(random_walk=0.0)),
    Case(FLICKER, "ramp, random walk 1", Drift(random_walk=1e-3)),
    Case(FLICKER, "ramp, random walk 2", Drift(random_walk=2e-3)),
    Case(FLICKER, "ramp, random walk 4", Drift(random_walk=4e-3)),
    Case(FLICKER, "ramp", Drift(random_walk=0.0), untouched=15),
    Case(FLICKER, "ramp, random walk 2", Drift(random_walk=2e-3), untouched=15),
)

TEXT: Final = f"""\
2 N are held by 256 taxels at once, after 2 s at rest. The film neither relaxes, bends nor is warmed by a touch, and the
estimator knows that it does not. The optimal estimator is a Kalman filter that knows the noise, the leakage, and when
something touches (test/reference/held_force.py). Errors are root mean squares over the taxels.

Target: at most 1.2 times the error of the optimal estimator, and 95 % coverage of the two-sigma interval
(test/model/estimation/test_held_force.py). Not reached are

- the ratio with white noise alone, where errors are smallest;
- the ratio with a strong random walk, which looks like a ramp; the strongest is not covered either.

| column | meaning |
|---|---|
| 1/f noise | in addition to white noise. With white noise alone the reported standard uncertainty exceeds the error: \
the estimator allows for a random walk of the offsets, whose absence cannot be known |
| temperature: ramp | the chip warms or cools by {Drift.ramp * 60:g} K a minute from the touch on |
| temperature: random walk | additional random walk of the chip temperature at all times, in mK/sqrt(s) |
| untouched | taxels of an array of 25 that are left untouched. They show the temperature of all taxels. The optimal \
estimator does not use them, so its columns are empty |
| leakage: estimated | the time constants differ from the calibration by {COMMON_LEAKAGE * 100:g} % on all taxels in \
common and by {OWN_LEAKAGE * 100:g} % on each taxel (standard deviations). The estimator knows only these deviations, \
and estimates the time constants from the held force; the optimal estimator knows the time constants |

Temperature (test/reference/temperature_drift.py): the film lags behind the chip. Two sensors measure the chip
temperature at 10 Hz with a resolution of 1/256 K. The taxels differ by {Drift.spread * 100:g} % in their pyroelectric
response. The optimal estimator knows lag, rounding, random walk, and the greatest slope of a ramp; the estimator
observes the random walk in the 2 s of rest. Both know that nothing but that walk warmed the film before the start."""


def held(seed: int, case: Case) -> list[Held]:
    """Return the errors of a held force at `TIMES`."""
    side = SMALL if case.untouched else 16
    found = hold(
        seed,
        TIMES,
        flicker=case.flicker,
        side=side,
        drift=case.drift,
        leakage_estimated=case.leakage_estimated,
        untouched=case.untouched,
    )
    return list(found)


def rows(pool: Executor, full: bool) -> list[str]:
    """Return a table of the error of a held force against that of the optimal estimator."""
    table = [
        "| 1/f noise, uV/sqrt(Hz) at 1 Hz | temperature | untouched | leakage | held for s | error mN |"
        " % of the force | optimal mN | ratio | reported uncertainty mN | two-sigma coverage % |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    few = FEW_FULL if full else FEW
    runs = [
        [pool.submit(held, seed, case) for seed in range(MANY if case.drift or case.leakage_estimated else few)]
        for case in CASES
    ]
    for case, futures in zip(CASES, runs, strict=True):
        found = [future.result() for future in futures]
        for at, time_held in enumerate(TIMES):
            table.append(_row(case, time_held, [one[at] for one in found]))
            print(table[-1], flush=True)
    return table


def _row(case: Case, time_held: float, these: list[Held]) -> str:
    error, optimal = (
        float(np.sqrt(np.mean([getattr(one, name) ** 2 for one in these]))) for name in ("error", "optimal")
    )
    reported, inside = (np.mean([getattr(one, name) for one in these]) for name in ("deviation", "inside"))
    cells = [f"{case.flicker * 1e6:g}", case.temperature, f"{case.untouched or 'none'}"]
    cells += ["estimated" if case.leakage_estimated else "known", f"{time_held:g}"]
    cells += [f"{error * 1e3:.2f}", f"{100 * error / these[0].force:.2f}"]
    cells += ["-" if case.untouched else f"{optimal * 1e3:.2f}"]
    cells += [
        "-" if case.leakage_estimated or case.untouched else f"{error / optimal:.2f}",
        f"{reported * 1e3:.2f}",
        f"{inside * 100:.1f}",
    ]
    return f"| {' | '.join(cells)} |"


if __name__ == "__main__":
    with ProcessPoolExecutor(2) as workers:
        rows(workers, full=False)
