# Copyright 2026 posfet maintainers
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with
# the License. You may obtain a copy of the License at http://www.apache.org/licenses/LICENSE-2.0 Unless required by
# applicable law or agreed to in writing, software distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific language
# governing permissions and limitations under the License.

"""Reaction times to slip over many grasps, beside published ones."""

from __future__ import annotations

import math
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np

from examples.grasp_mujoco.controller import GripSettings
from examples.grasp_mujoco.gripper import GROSS_SPEED, OBJECTS, SLIP_SPEED
from examples.grasp_mujoco.trial import grasp, seeded_task

PUBLISHED = "piezoelectric, arXiv 2602.16127: onset detected after 20.4 +- 6 ms, response about 30 ms; on a real hand"
NEAR = 0.05
"""Time around a true slip within which a raise of the grip counts as caused by it [s]."""


@dataclass(frozen=True)
class Outcome:
    """What became of one task, with slip feedback and without."""

    object: str
    reactions: tuple[float, ...]
    """Reaction time to each true slip [s]; NaN without one."""
    gross: tuple[float, ...]
    """The same from `GROSS_SPEED` on [s]; NaN for a slip that was not that fast, too."""
    slid: float
    """Distance that the object slid in the hand while it was pulled, with feedback [m]."""
    excess: float
    """Final grip force over the least that Coulomb's law allows [1], with feedback."""
    unprovoked: int
    """Raises of the grip without a true slip near."""
    held: bool
    dropped_without: bool
    """Whether the object fell without feedback."""


def outcome(seed: int, kind: str | None = None, creep: bool = True) -> Outcome:
    """Run the task of a seed with and without feedback."""
    task = seeded_task(seed, kind)
    trial = grasp(task, seed, settings=GripSettings() if creep else GripSettings(creep=math.inf))
    without = grasp(task, seed, feedback=False)
    rows = trial.columns()
    pulled = rows[0] >= task.pull_start
    near = [any(abs(time - slip) < NEAR for slip in trial.slips) for time in trial.raised]
    return Outcome(
        object=task.object,
        reactions=tuple(reaction for _, reaction in trial.reactions()),
        gross=tuple(
            slip + reaction - fast for (slip, reaction), fast in zip(trial.reactions(), trial.gross, strict=False)
        ),
        slid=float(np.ptp(rows[5][pulled])),
        excess=float(rows[1, -1] / rows[4, -1]),
        unprovoked=near.count(False),
        held=not trial.dropped,
        dropped_without=without.dropped,
    )


def outcomes(seeds: Iterable[int], kind: str | None = None, creep: bool = True, processes: int = 2) -> list[Outcome]:
    """Run the tasks of several seeds, in several processes."""
    with ProcessPoolExecutor(processes) as pool:
        return list(pool.map(partial(outcome, kind=kind, creep=creep), seeds))


def table(found: list[Outcome]) -> str:
    """Return the outcomes as a table in Markdown, one line an object and one of all."""
    lines = [
        "| object | grasps | held | dropped without feedback | slips | reaction ms: mean | s.d. | max | no reaction | "
        "from 2 mm/s: slips | mean | max | raises without slip | slid mm, max | grip over least |",
        "|" + 15 * "---|",
    ]
    for name in (*OBJECTS, "all"):
        these = [each for each in found if name in {each.object, "all"}]
        if not these:
            continue
        every = np.array([value for each in these for value in each.reactions]) * 1e3
        times = every[~np.isnan(every)]
        mean, deviation, most = (times.mean(), times.std(), times.max()) if times.size else (np.nan,) * 3
        fast = np.array([value for each in these for value in each.gross]) * 1e3
        fast = fast[~np.isnan(fast)]
        later, latest = (fast.mean(), fast.max()) if fast.size else (np.nan,) * 2
        held, dropped = sum(each.held for each in these), sum(each.dropped_without for each in these)
        lines.append(
            f"| {name} | {len(these)} | {held} | {dropped} | {every.size} | {mean:.1f} | {deviation:.1f} | "
            f"{most:.1f} | {int(np.isnan(every).sum())} | {fast.size} | {later:.1f} | {latest:.1f} | "
            f"{sum(each.unprovoked for each in these)} | "
            f"{max(each.slid for each in these) * 1e3:.2f} | {np.mean([each.excess for each in these]):.2f} |"
        )
    lines += [
        "",
        f"True slip by the engine: from {SLIP_SPEED * 1e3:g} mm/s on; from {GROSS_SPEED * 1e3:g} mm/s.",
        f"Published: {PUBLISHED}.",
    ]
    return "\n".join(lines)
